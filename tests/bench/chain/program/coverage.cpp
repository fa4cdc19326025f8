// Coverage of the stated uncertainty of located positions, over random benches whose truth is a
// tracer of its own (true_bench.h): uncalibrated, calibrated by one look, and by whole sessions.
// Figures beside the floors of the study in docs/chain.md.
//   chain_coverage [benches] [places] [frames] [first seed] [1: a line for each bench, 2: and for
//   each place, which join_coverage.py joins over calls] [parts: "woei"] [seconds]
// Parts: w wrong ellipses, o one look, t one look in eyes of table 5.1 alone, e ex vivo, i in the
// eye.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/camera_calibration.h"
#include "optics/chain/chain_estimator.h"
#include "optics/chain/eye_look.h"

#include <Eigen/Dense>

#include "../sessions.h"
#include "../true_bench.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

double at_part(std::vector<double> values, double part) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1) + 0.5)];
}

double rms(const std::vector<double>& values) {
  double squares = 0;
  for (const double one : values) squares += one * one;
  return std::sqrt(squares / static_cast<double>(std::max<std::size_t>(values.size(), 1)));
}

/// Of one way to locate: what was claimed, what was wrong, and how often within 95 %.
struct Tally {
  std::vector<double> claimed_z, claimed_aside, claimed_height, calibration_of_height, errors_z,
      errors_aside, errors_height;
  int places = 0, within_z = 0, within_aside = 0, within_3d = 0, within_height = 0, misfits = 0,
      benches = 0, lost = 0;
  double seconds = 0;
  void add(const Eigen::Vector3d& error, double height_error, const PositionDoubt& doubt) {
    const Eigen::Vector3d sigma = doubt.covariance.diagonal().cwiseSqrt();
    const double height = std::sqrt(doubt.height_variance);
    ++places;
    within_z += std::abs(error.z()) < 1.96 * sigma.z();
    within_aside += std::abs(error.x()) < 1.96 * sigma.x();
    within_3d += error.dot(doubt.covariance.ldlt().solve(error)) < 7.815;
    within_height += std::abs(height_error) < 1.96 * height;
    misfits += doubt.chi2 > kMisfitChi2;
    claimed_z.push_back(sigma.z());
    claimed_aside.push_back(std::sqrt((sigma.x() * sigma.x() + sigma.y() * sigma.y()) / 2));
    claimed_height.push_back(height);
    calibration_of_height.push_back(
        std::sqrt(std::max(0.0, doubt.height_variance - doubt.height_noise)));
    errors_z.push_back(std::abs(error.z()));
    errors_aside.push_back(error.head<2>().norm() / std::sqrt(2.0));
    errors_height.push_back(std::abs(height_error));
  }
  void join(const Tally& other) {
    const auto add = [](std::vector<double>& to, const std::vector<double>& from) {
      to.insert(to.end(), from.begin(), from.end());
    };
    add(claimed_z, other.claimed_z), add(claimed_aside, other.claimed_aside);
    add(claimed_height, other.claimed_height);
    add(calibration_of_height, other.calibration_of_height), add(errors_z, other.errors_z);
    add(errors_aside, other.errors_aside), add(errors_height, other.errors_height);
    places += other.places, within_z += other.within_z, within_aside += other.within_aside;
    within_3d += other.within_3d, within_height += other.within_height;
    misfits += other.misfits, benches += other.benches, lost += other.lost;
  }
  void print(const char* name, const char* floor) const {
    const auto percent = [this](int count) { return 100.0 * count / std::max(places, 1); };
    std::printf(
        "%-34s %4d benches %5d places | in 95 %%: z %5.1f aside %5.1f 3-D %5.1f height %5.1f | "
        "misfit %4.1f %% | sigma z %4.0f / %4.0f aside %4.0f / %4.0f height %4.0f / %4.0f | "
        "|error| z %4.0f / %4.0f aside %4.0f / %4.0f height %4.0f / %4.0f um | calibration's part "
        "of the height %4.0f / %4.0f | floor %s | %.1f s, "
        "%d lost\n",
        name, benches, places, percent(within_z), percent(within_aside), percent(within_3d),
        percent(within_height), percent(misfits), 1e6 * at_part(claimed_z, 0.5),
        1e6 * at_part(claimed_z, 0.9), 1e6 * at_part(claimed_aside, 0.5),
        1e6 * at_part(claimed_aside, 0.9), 1e6 * at_part(claimed_height, 0.5),
        1e6 * at_part(claimed_height, 0.9), 1e6 * at_part(errors_z, 0.5),
        1e6 * at_part(errors_z, 0.9), 1e6 * at_part(errors_aside, 0.5),
        1e6 * at_part(errors_aside, 0.9), 1e6 * at_part(errors_height, 0.5),
        1e6 * at_part(errors_height, 0.9), 1e6 * at_part(calibration_of_height, 0.5),
        1e6 * at_part(calibration_of_height, 0.9), floor, seconds, lost);
    std::fflush(stdout);
  }
};

struct Scale {
  int benches;
  int places;
  int frames;
  std::uint64_t first;
  bool each;       // prints a line for each bench
  bool rows;       // prints a line for each place, for join_coverage.py
  double seconds;  // after so many no new bench is begun
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();
  bool over() const {
    return std::chrono::steady_clock::now() - begin > std::chrono::duration<double>(seconds);
  }
};

/// One place as a line, um: what join_coverage.py joins over several calls of this program.
/// `reference`: the error of a look in the middle of the retina, what "relative to a look" is to.
void print_row(const char* name, std::uint64_t seed, const Eigen::Vector3d& error,
               double height_error, const std::optional<Eigen::Vector3d>& reference,
               const PositionDoubt& doubt) {
  const Eigen::Vector3d sigma = 1e6 * doubt.covariance.diagonal().cwiseSqrt();
  const Eigen::Vector3d relative =
      reference ? Eigen::Vector3d(1e6 * (error - *reference))
                : Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
  std::printf(
      "row\t%s\t%llu\t%.2f\t%.2f\t%.2f\t%.2f\t%.2f\t%.2f\t%.2f\t%.2f\t%.3f\t%.3f\t%.2f\t%.2f\n",
      name, static_cast<unsigned long long>(seed), 1e6 * error.x(), 1e6 * error.y(),
      1e6 * error.z(), 1e6 * height_error, sigma.x(), sigma.y(), sigma.z(),
      1e6 * std::sqrt(doubt.height_variance), error.dot(doubt.covariance.ldlt().solve(error)),
      doubt.chi2, relative.x(), relative.y());
}

/// Largest difference of the two programs' ellipses at the same parameters, px.
void compare_programs(const NominalChain& nominal, const Scale& scale) {
  double worst = 0;
  std::mt19937_64 random(99);
  for (int k = 0; k < scale.benches; ++k) {
    const TrueBench truth(nominal, {}, scale.first + static_cast<std::uint64_t>(k));
    const auto parameters = chain_parameters(nominal, {});
    Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
    for (std::size_t i = 0; i < parameters.size(); ++i)
      theta[static_cast<Eigen::Index>(i)] = truth.off(parameters[i].name) / parameters[i].sigma;
    const ViewingChain chain(nominal, parameters, theta);
    for (int i = 0; i < scale.places; ++i) {
      const Eigen::Vector3d place = random_place(random);
      const Eigen::Vector3d axis = random_axis(random, 0.3);
      const auto theirs = truth.ellipse(place, axis);
      if (!theirs) continue;
      const auto ours = shown_ellipse(chain, {place, axis, theirs->head<2>()});
      if (ours) worst = std::max(worst, (*ours - smooth_from(*theirs)).cwiseAbs().maxCoeff());
    }
  }
  std::printf("chain against the true bench at its parameters: %.4f px at worst\n", worst);
}

/// The error of a steady look at the robot in the middle of the retina, 2 mm above it.
std::optional<Eigen::Vector3d> error_of_a_look(const TrueBench& truth, const ChainBelief& belief,
                                               std::mt19937_64 random) {
  const Eigen::Vector3d place(0, 0, 2e-3);
  const Eigen::Vector3d axis(1, 0, 0);
  const auto seen = truth.seen(place, tilted(axis, kAxisSigma, random), 0.05, kAxisSigma, random);
  const auto found = seen ? locate_in_chain(belief.chain, *seen, axis) : std::nullopt;
  if (!found) return {};
  return *found - place;
}

/// Whose frames are judged, in the lines of a place.
struct Judging {
  const char* name;
  std::uint64_t seed;
};

/// Judges new frames of a bench by a belief. The position is found by the belief's own chain.
void judge(const TrueBench& truth, const ChainBelief& belief, const Scale& scale, const Judging& of,
           std::mt19937_64& random, Tally& tally) {
  ++tally.benches;
  const auto reference = scale.rows ? error_of_a_look(truth, belief, random) : std::nullopt;
  for (int i = 0; i < scale.places; ++i) {
    const Eigen::Vector3d place = random_place(random);
    const Eigen::Vector3d axis = random_axis(random, 0);
    const auto seen =
        truth.seen(place, tilted(axis, kAxisSigma, random), kNoise_px, kAxisSigma, random);
    if (!seen) continue;
    const auto found = locate_in_chain(belief.chain, *seen, axis);
    if (!found) {
      ++tally.lost;
      continue;
    }
    const auto doubt = position_doubt(belief, {*found, axis, seen->ellipse.head<2>()}, *seen,
                                      PositionFit::weighted);
    if (!doubt) {
      ++tally.lost;
      continue;
    }
    const double retina = retina_offset(belief.chain, {0, 0});
    const double height_error = (found->z() - retina) - (place.z() - truth.retina(0, 0));
    tally.add(*found - place, height_error, *doubt);
    if (scale.rows) print_row(of.name, of.seed, *found - place, height_error, reference, *doubt);
  }
}

/// The belief by the most probable eye, as the loop has it (host/servo/view_doubt): the height of
/// the look is that above the believed retina.
std::optional<ChainBelief> by_eye(const NominalChain& nominal, const ChainSigmas& sigmas,
                                  const OutlineSeen& look, double lying, const BenchDoubt& bench) {
  const Eigen::Vector3d axis(1, 0, 0);
  const EyeLook one{look, axis, lying};
  const ProbableView made = most_probable_view(nominal, one, bench);
  NominalChain probable = nominal;
  probable.prescription = made.eye;
  probable.image.pixel *= made.pixel;
  probable.robot.semi_axis *= made.robot_length;
  probable.robot.semi_radius *= made.robot_width;
  const ChainBelief prior = prior_belief(probable, sigmas);
  return eye_calibrated(prior, one, Eigen::VectorXd::Ones(prior.chain.size()));
}

void one_look(const NominalChain& nominal, const ChainSigmas& sigmas, const Scale& scale,
              const char* name) {
  Tally before;
  Tally after;
  Tally eye;
  Tally with_bench;
  const ChainBelief prior = prior_belief(nominal, sigmas);
  PoseSettings believed;
  believed.image = nominal.image;
  believed.robot = nominal.robot;
  believed.exact.emplace(nominal.prescription.system, nominal.microscope, 8e-3);
  const std::string uncalibrated = std::string(name) + ", uncalibrated";
  const std::string one = std::string(name) + ", one look";
  const std::string eye_alone = std::string(name) + ", one look, eye";
  const std::string probable = std::string(name) + ", one look, eye and bench";
  const bool bench = sigmas.robot_size > 0;
  for (int k = 0; k < scale.benches && !scale.over(); ++k) {
    const std::uint64_t seed = scale.first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, sigmas, seed);
    std::mt19937_64 random(1000 + seed);
    judge(truth, prior, scale, {uncalibrated.c_str(), seed}, random, before);
    const Eigen::Vector3d axis(1, 0, 0);
    const double lying = nominal.robot.semi_radius;
    const auto look = truth.seen({0, 0, truth.retina(0, 0) + truth.robot().semi_radius},
                                 tilted(axis, kAxisSigma, random), 0.05, kAxisSigma, random);
    if (!look) continue;
    try {
      PoseSettings weighted = believed;
      const PoseCalibration made = calibrate_pose(weighted, look->ellipse, axis, lying);
      NominalChain scaled = nominal;
      scaled.image.pixel *= made.image_scale;
      ChainBelief belief = prior_belief(scaled, sigmas);
      const auto calibrated = scale_calibrated(
          belief, {{{0, 0, lying}, axis, look->ellipse.head<2>()}, *look, 10e-6, true},
          PositionFit::thesis);
      if (calibrated) judge(truth, *calibrated, scale, {one.c_str(), seed}, random, after);
    } catch (const std::invalid_argument&) {
      ++after.lost;
    }
    const auto take = [&](const BenchDoubt& doubt, const std::string& called, Tally& tally) {
      try {
        const auto belief = by_eye(nominal, sigmas, *look, lying, doubt);
        if (belief) judge(truth, *belief, scale, {called.c_str(), seed}, random, tally);
      } catch (const std::invalid_argument&) {
        ++tally.lost;
      }
    };
    take({}, eye_alone, eye);
    if (bench) take({sigmas.pixel, sigmas.robot_size}, probable, with_bench);
  }
  before.print(uncalibrated.c_str(), "557 / 644 (all priors)");
  after.print(one.c_str(), "311 / 369 depth, 226 / 335 height");
  eye.print(eye_alone.c_str(), "the same");
  if (bench) with_bench.print(probable.c_str(), "the same");
}

void session(const NominalChain& nominal, const Scale& scale, const char* name, const char* floor,
             const std::function<ChainSession(const TrueBench&, std::mt19937_64&)>& record) {
  Tally tally;
  const ChainSigmas sigmas;
  int twins = 0;
  for (int k = 0; k < scale.benches && !scale.over(); ++k) {
    const std::uint64_t seed = scale.first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, sigmas, seed);
    std::mt19937_64 random(2000 + seed);
    const auto begin = std::chrono::steady_clock::now();
    try {
      const ChainEstimate made = estimate_chain(nominal, sigmas, record(truth, random));
      twins += made.minima.size() > 1;
      Tally alone;
      judge(truth, made.belief, scale, {name, seed}, random, alone);
      tally.join(alone);
      if (scale.each)
        std::printf(
            "  bench %2d: %s, chi2 %.0f of %d, %zu minima of %d starts, rms z %.0f aside %.0f um, "
            "in 95 %% %d of %d\n",
            k, to_string(made.status), made.chi2, made.degrees_of_freedom, made.minima.size(),
            made.ended_starts, 1e6 * rms(alone.errors_z), 1e6 * rms(alone.errors_aside),
            alone.within_3d, alone.places);
    } catch (const std::invalid_argument&) {
      ++tally.lost;
    }
    tally.seconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  }
  tally.print(name, floor);
  std::printf("%-34s %d of %d with more than one minimum\n", "", twins, tally.benches);
}

/// Of one kind of ellipses: how many pass for right ones, and of those how many have the truth
/// beyond three sigmas. `errors`: of z over its sigma, of those that pass.
struct Judged {
  const char* name;
  int made = 0;
  int passed = 0;
  int beyond = 0;
  std::vector<double> errors{};
  void add(bool fits, double error) {
    ++made;
    if (!fits) return;
    ++passed;
    beyond += std::abs(error) > 3;
    errors.push_back(error);
  }
  void print() const {
    std::printf("  %-34s %4d, %4d found, %3d beyond 3 sigma (%.2f %%); z errs by %+.2f sigma\n",
                name, made, passed, beyond, 100.0 * beyond / std::max(passed, 1),
                at_part(errors, 0.5));
  }
};

/// Of ellipses that are not what is believed: how many pass for right ones, and of those how many
/// with the truth beyond three sigmas; and how many right ones do not pass. One right one in 370 is
/// beyond three sigmas by what a sigma is, so those stand beside them.
void wrong_ellipses(const NominalChain& nominal, int count, std::uint64_t first) {
  const ChainBelief prior = prior_belief(nominal, {});
  Judged right{"right ones"};
  Judged pitched{"pitched by 10 to 44 degrees"};
  Judged longer{"a body 1.4 times as long"};
  Judged larger{"a body 5 % larger"};
  int made = 0;
  std::mt19937_64 random(first);
  std::uniform_real_distribution<double> even(0, 1);
  for (int k = 0; made < count; ++k) {
    const TrueBench truth(nominal, {}, first + static_cast<std::uint64_t>(k));
    NominalChain other = nominal;  // a robot of another shape, then of another size
    other.robot.semi_axis *= k % 2 == 0 ? 1.4 : 1.05;
    other.robot.semi_radius *= k % 2 == 0 ? 1 : 1.05;
    const TrueBench wrong_body(other, {}, first + static_cast<std::uint64_t>(k));
    for (int i = 0; i < 12; ++i) {
      const Eigen::Vector3d place = random_place(random);
      const Eigen::Vector3d axis = random_axis(random, 0);
      const int kind = i % 3;  // right, pitched unseen, another body
      const double pitch = 0.175 + 0.6 * even(random);
      const Eigen::Vector3d real =
          kind == 1
              ? Eigen::Vector3d(std::cos(pitch) * axis + std::sin(pitch) * Eigen::Vector3d::UnitZ())
              : tilted(axis, kAxisSigma, random);
      const auto seen =
          (kind == 2 ? wrong_body : truth).seen(place, real, kNoise_px, kAxisSigma, random);
      if (!seen) continue;
      const auto found = locate_in_chain(prior.chain, *seen, axis);
      const auto doubt = found ? position_doubt(prior, {*found, axis, seen->ellipse.head<2>()},
                                                *seen, PositionFit::weighted)
                               : std::nullopt;
      const bool fits = doubt && doubt->chi2 <= kMisfitChi2;
      const double error =
          doubt ? (found->z() - place.z()) / std::sqrt(doubt->covariance(2, 2)) : 0;
      Judged& of_kind = kind == 0 ? right : kind == 1 ? pitched : (k % 2 == 0 ? longer : larger);
      of_kind.add(fits, error);
      made += kind != 0;
    }
  }
  std::printf(
      "wrong ellipses: %d, of them %d found, %d with the truth beyond 3 sigma (goal 0); false "
      "alarms %d of %d (goal 1 %%)\n",
      made, pitched.passed + longer.passed + larger.passed,
      pitched.beyond + longer.beyond + larger.beyond, right.made - right.passed, right.made);
  for (const Judged* one : {&right, &pitched, &longer, &larger}) one->print();
}

void time_one(const NominalChain& nominal) {
  const ChainBelief prior = prior_belief(nominal, {});
  OutlineSeen seen;
  const RobotPlace place{{1e-3, -1e-3, 5e-3}, {1, 0, 0}, {0, 0}};
  seen.ellipse = ellipse_from(*shown_ellipse(prior.chain, place));
  seen.covariance = 0.04 * EllipseCovariance::Identity();
  seen.covariance(4, 4) = 1e-5;
  seen.axis_sigma = kAxisSigma;
  std::vector<double> times;
  for (int i = 0; i < 400; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    const auto doubt = position_doubt(prior, {place.position, place.axis, seen.ellipse.head<2>()},
                                      seen, PositionFit::weighted);
    times.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
    if (!doubt) return;
  }
  std::printf("total covariance of one frame: median %.0f us, 10 %% %.0f us (goal 100)\n",
              1e6 * at_part(times, 0.5), 1e6 * at_part(times, 0.1));
}

}  // namespace
}  // namespace vitreo::optics

int main(int count, char** arguments) {
  using namespace vitreo::optics;
  const auto number = [&](int i, int otherwise) {
    return count > i ? std::atoi(arguments[i]) : otherwise;
  };
  const Scale scale{number(1, 10),
                    number(2, 25),
                    number(3, 150),
                    static_cast<std::uint64_t>(number(4, 1)),
                    number(5, 0) != 0,
                    number(5, 0) == 2,
                    static_cast<double>(number(7, 86400))};
  std::setvbuf(stdout, nullptr, _IOLBF, 0);  // what a call that is ended has printed counts
  const std::string parts = count > 6 ? arguments[6] : "woei";
  const auto wanted = [&](char part) { return parts.find(part) != std::string::npos; };
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  if (!scale.rows) {  // once is enough where many calls are joined
    time_one(nominal);
    compare_programs(nominal, scale);
  }
  if (wanted('w')) wrong_ellipses(nominal, 20 * scale.benches, scale.first);
  if (wanted('o')) one_look(nominal, {}, scale, "whole bench off");
  if (wanted('o') || wanted('t') || wanted('r')) {
    ChainSigmas table = ChainSigmas::none();
    table.eye = table_5_1();
    table.pixel = 1e-4;
    if (!wanted('r')) one_look(nominal, table, scale, "table 5.1");
    table.retina_depth = 0.3e-3;
    one_look(nominal, table, scale, "table 5.1 and retina 0.3 mm");
  }
  if (wanted('s')) {  // what observation_bound.lua calculates with
    ChainSigmas loop = ChainSigmas::none();
    loop.eye = table_5_1();
    loop.pixel = 0.005;
    loop.robot_size = 0.01;
    loop.microscope_tilt = 3.5e-3;
    one_look(nominal, loop, scale, "loop's bench");
  }
  if (wanted('e'))
    session(nominal, scale, "calibrate_bench", "47 / 68 depth, 7 / 13 aside",
            [](const TrueBench& truth, std::mt19937_64& random) {
              return bench_session(truth, 30, random);
            });
  if (wanted('i'))
    session(nominal, scale, "calibrate_in_eye",
            "71 / 87 height, 63 / 85 aside with 300 frames, index, lens place",
            [&](const TrueBench& truth, std::mt19937_64& random) {
              return in_eye_session(truth, scale.frames, random);
            });
  return 0;
}
