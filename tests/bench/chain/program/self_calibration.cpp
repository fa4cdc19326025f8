// Self-calibration over random benches whose truth is a tracer of its own (true_bench.h): what
// frames of flight leave of the height's calibration part and whether the truth is in the stated
// interval, how often a bench that stays is called changed, and after how many frames a changed
// one is found, beside the noncentrality that linear theory gives.
//   chain_self_calibration [benches] [frames] [first seed] [parts: "grcbl"] [frames before a
//   change] [frames after it] [the change's name, its beginning]
// Parts: g goals and false alarms, r the recursive form against whole sessions, c changes, b
//   what changes could at most be found by, l what the information of landings and frames leaves.
// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_planner.h"
#include "optics/chain/chain_refiner.h"

#include <Eigen/Dense>

#include "../sessions.h"
#include "../true_bench.h"
#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

constexpr double kApart = 5;  // s, between frames
constexpr int kJudged = 12;   // places a bench

double at_part(std::vector<double> values, double part) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1) + 0.5)];
}

/// A run: its bench, its refiner and its clock.
struct Run {
  std::mt19937_64 random;
  ChainRefiner refiner;
  double time = 0;
  int offered = 0;

  Run(const NominalChain& nominal, const TrueBench& truth, std::uint64_t seed)
      : random(seed), refiner(landed(nominal, landing_session(truth, random))) {}
  static ChainRefiner landed(const NominalChain& nominal, const ChainSession& session) {
    const ChainEstimate made = estimate_chain(nominal, {}, session);
    return {made.belief, {}, {session.looks, made.places}};
  }

  RefinerOutcome fly(const TrueBench& truth) {
    const ChainLook look = flight_look(truth, random);
    time += kApart;
    ++offered;
    const auto near = locate_in_chain(refiner.belief().chain, look.seen, look.axis);
    // A frame that the chain shows nowhere is offered where the middle of the workspace is.
    const RefinerOutcome outcome =
        refiner.add(look.seen, look.axis, near.value_or(Eigen::Vector3d(0, 0, 5e-3)), time);
    refiner.work(15);
    return outcome;
  }
  /// Until it has so many frames, is stopped, or twice as many were offered.
  bool fly_until(const TrueBench& truth, std::size_t frames) {
    const int most = offered + 2 * static_cast<int>(frames);
    while (refiner.frames() < frames && offered < most && !refiner.changed()) fly(truth);
    return !refiner.changed();
  }
};

struct Heights {
  int places = 0;
  int within = 0;
  std::vector<double> left;    // m, calibration's part of the height
  std::vector<double> errors;  // m
};

void judge(const TrueBench& truth, Run& run, Heights& to) {
  const ChainBelief& belief = run.refiner.belief();
  to.left.push_back(left_of(belief, PlanGoal::height));
  for (int i = 0; i < kJudged; ++i) {
    const Eigen::Vector3d place = random_place(run.random);
    const Eigen::Vector3d axis = random_axis(run.random, 0);
    const auto seen =
        truth.seen(place, tilted(axis, kAxisSigma, run.random), kNoise_px, kAxisSigma, run.random);
    if (!seen) continue;
    const auto found = locate_in_chain(belief.chain, *seen, axis);
    if (!found) continue;
    const auto doubt = position_doubt(belief, {*found, axis, seen->ellipse.head<2>()}, *seen,
                                      PositionFit::weighted);
    if (!doubt) continue;
    const double error =
        found->z() - retina_offset(belief.chain, {0, 0}) - (place.z() - truth.retina(0, 0));
    ++to.places;
    to.within += std::abs(error) < 1.96 * std::sqrt(doubt->height_variance);
    to.errors.push_back(std::abs(error));
  }
}

void goals(const NominalChain& nominal, int benches, int frames, std::uint64_t first) {
  const std::vector<std::size_t> counts{0, 100, 300, 1000};
  const char* const floors[] = {"180 / 296", "114 / 192", "85 / 141", "61 / 99"};
  std::vector<Heights> all(counts.size());
  std::vector<double> evidence;
  int alarms = 0;
  int twins = 0;
  const auto begin = std::chrono::steady_clock::now();
  for (int k = 0; k < benches; ++k) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, {}, seed);
    Run run(nominal, truth, 3000 + seed);
    double most = 0;
    for (std::size_t i = 0; i < counts.size() && counts[i] <= static_cast<std::size_t>(frames);
         ++i) {
      if (!run.fly_until(truth, counts[i])) break;
      run.refiner.work(2 * static_cast<int>(counts[i]));
      most = std::max(most, run.refiner.change_evidence());
      judge(truth, run, all[i]);
    }
    alarms += run.refiner.changed().has_value();
    twins += run.refiner.explanations() > 1;
    if (run.refiner.changed())
      std::printf("  seed %d: FALSE ALARM after %d frames: %s, evidence %.1f\n",
                  static_cast<int>(seed), run.offered, run.refiner.changed()->part.c_str(),
                  run.refiner.change_evidence());
    evidence.push_back(most);
  }
  for (std::size_t i = 0; i < counts.size() && !all[i].left.empty(); ++i)
    std::printf(
        "five landings, %4zu frames | %3zu benches | calibration's part of the height %4.0f / "
        "%4.0f "
        "(floor %s) um | height in 95 %%: %5.1f of %d, errs %4.0f / %4.0f um\n",
        counts[i], all[i].left.size(), 1e6 * at_part(all[i].left, 0.5),
        1e6 * at_part(all[i].left, 0.9), floors[i], 100.0 * all[i].within / all[i].places,
        all[i].places, 1e6 * at_part(all[i].errors, 0.5), 1e6 * at_part(all[i].errors, 0.9));
  std::printf(
      "false alarms %d of %d benches (goal 1 %%), log evidence at most %.1f (alarm 5.3), twins at "
      "the end in %d, %.0f s\n",
      alarms, benches, at_part(evidence, 1), twins,
      std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count());
  std::fflush(stdout);
}

/// By linear theory at drawn benches, no estimate in it: (1 + information of five landings and so
/// many frames)^-1. 120 frames stand for any number.
void limits(const NominalChain& nominal, int benches, std::uint64_t first) {
  constexpr std::size_t kFlown = 120;
  const std::vector<int> counts{0, 100, 300, 1000};
  std::vector<std::vector<double>> left(counts.size());
  for (int k = 0; k < benches; ++k) {
    std::mt19937_64 random(first + static_cast<std::uint64_t>(k));
    std::normal_distribution<double> normal;
    const auto parameters = chain_parameters(nominal, {});
    Eigen::VectorXd theta(static_cast<Eigen::Index>(parameters.size()));
    for (double& one : theta) one = normal(random);
    const ViewingChain chain(nominal, parameters, theta);
    const auto add = [&](ChainSession& session, std::vector<Eigen::Vector3d>& places,
                         const Eigen::Vector3d& axis, const Eigen::Vector3d& place, bool lying) {
      const auto seen = planned_outline(chain, {place, axis, chain.nominal().image.center_px},
                                        lying ? 0.05 : kNoise_px, kAxisSigma);
      if (!seen) return;
      ChainLook look{*seen, axis};
      if (lying) look.contact_sigma = 30e-6, look.lying_height = nominal.robot.semi_radius;
      session.looks.push_back(look);
      places.push_back(place);
    };
    ChainSession landings, flight;
    std::vector<Eigen::Vector3d> touched, flown;
    for (const Eigen::Vector2d& at :
         {Eigen::Vector2d(0, 0), Eigen::Vector2d(3e-3, 0), Eigen::Vector2d(-3e-3, 0),
          Eigen::Vector2d(0, 3e-3), Eigen::Vector2d(0, -3e-3)}) {
      const double retina = nominal_retina(chain, at) + retina_offset(chain, at);
      add(landings, touched, {1, 0, 0}, {at.x(), at.y(), retina + nominal.robot.semi_radius}, true);
    }
    for (std::size_t i = 0; flown.size() < kFlown && i < 10 * kFlown; ++i) {
      const Eigen::Vector3d axis = random_axis(random, 0.35);
      add(flight, flown, axis, random_place(random), false);
    }
    const Eigen::MatrixXd landed = Eigen::MatrixXd::Identity(theta.size(), theta.size()) +
                                   session_information(chain, landings, touched);
    const Eigen::MatrixXd each =
        session_information(chain, flight, flown) / static_cast<double>(flown.size());
    for (std::size_t i = 0; i < counts.size(); ++i)
      left[i].push_back(left_of({chain, (landed + counts[i] * each).inverse()}, PlanGoal::height));
  }
  for (std::size_t i = 0; i < counts.size(); ++i)
    std::printf("five landings, %4d frames, by their information: %.0f / %.0f um of the height\n",
                counts[i], 1e6 * at_part(left[i], 0.5), 1e6 * at_part(left[i], 0.9));
}

/// From the same landings and frames: what the recursive form leaves of the height's calibration
/// part, the estimator of whole sessions, and that with the landings linearized at their own
/// solution; all from one start.
void recursive_form(const NominalChain& nominal, int benches, int frames, std::uint64_t first) {
  const auto height = [](const ViewingChain& chain, const Eigen::MatrixXd& covariance) {
    return 1e6 * left_of({chain, covariance}, PlanGoal::height);
  };
  for (int k = 0; k < benches; ++k) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, {}, seed);
    std::mt19937_64 random(seed);
    ChainSession session = landing_session(truth, random);
    const std::size_t landings = session.looks.size();
    const ChainEstimate landed = estimate_chain(nominal, {}, session, {.starts = 1});
    ChainRefiner refiner(landed.belief, {}, {session.looks, landed.places});
    for (double time = 0; refiner.frames() < static_cast<std::size_t>(frames) && time < 1e4;
         time += kApart) {
      const ChainLook look = flight_look(truth, random);
      const auto near = locate_in_chain(refiner.belief().chain, look.seen, look.axis);
      if (near && refiner.add(look.seen, look.axis, *near, time) == RefinerOutcome::taken)
        session.looks.push_back(look);
      refiner.work(15);
    }
    refiner.work(20 * frames);
    const ChainEstimate whole = estimate_chain(nominal, {}, session, {.starts = 1});
    ChainSession flights = session;
    flights.looks.erase(flights.looks.begin(),
                        flights.looks.begin() + static_cast<std::ptrdiff_t>(landings));
    const std::vector<Eigen::Vector3d> places(
        whole.places.begin() + static_cast<std::ptrdiff_t>(landings), whole.places.end());
    const Eigen::MatrixXd of_flights = session_information(whole.belief.chain, flights, places);
    const Eigen::MatrixXd at_landing = (landed.belief.covariance.inverse() + of_flights).inverse();
    const Eigen::VectorXd apart = refiner.belief().chain.theta() - whole.belief.chain.theta();
    std::printf(
        "seed %d, %zu frames: landings %.0f, recursive %.0f (%zu explanations, landings counted "
        "at whole's place: %.0f), whole %.0f, whole with the landings at their own solution %.0f "
        "um; apart %.2f\n",
        static_cast<int>(seed), refiner.frames(),
        height(landed.belief.chain, landed.belief.covariance),
        height(refiner.belief().chain, refiner.belief().covariance), refiner.explanations(),
        height(whole.belief.chain, refiner.belief().covariance),
        height(whole.belief.chain, whole.belief.covariance), height(whole.belief.chain, at_landing),
        apart.dot(whole.belief.covariance.ldlt().solve(apart)));
    std::fflush(stdout);
  }
}

/// A change by hand. Of another bench there is no single step.
struct Change {
  const char* name;
  const char* part;
  std::map<std::string, double> by;  // empty: another bench
  int over = 0;                      // frames in which it comes about
};

const std::vector<Change>& changes() {
  static const std::vector<Change> all{
      {"another bench", "bench", {}},
      {"lens aside 1 mm", "condensing_lens", {{"lens_aside_x", 1e-3}}},
      {"lens aside 0.5 mm", "condensing_lens", {{"lens_aside_x", 0.5e-3}}},
      {"lens tilted 4 degrees", "condensing_lens", {{"lens_tilt_y", 0.07}}},
      {"lens 1 mm farther", "condensing_lens", {{"lens_axial", 1e-3}}},
      {"eye turned 5 degrees", "eye_rotation", {{"eye_rotation_x", 0.087}}},
      {"eye turned 3 degrees", "eye_rotation", {{"eye_rotation_x", 0.052}}},
      {"pupil power by 2 / m", "microscope", {{"pupil_power", 2.0}}},
      {"center by 0.4 mm", "microscope", {{"center_x", 0.4e-3}}},
      {"eye drifts 5 degrees in 100 frames", "eye_rotation", {{"eye_rotation_x", 0.087}}, 100},
  };
  return all;
}

TrueBench part_of(const TrueBench& truth, const Change& change, double part) {
  std::map<std::string, double> by = change.by;
  for (auto& [name, much] : by) much *= part;
  return truth.moved(by);
}

struct Found {
  int benches = 0;
  int named = 0;
  std::vector<double> frames;       // until it stopped; 1e9: not
  std::vector<double> kept_after;   // of the new bench, in the belief that stays
  std::vector<double> predicted30;  // noncentrality of thirty frames
  std::vector<double> predicted100;
  std::vector<double> height_error;  // of what stays, in its own sigmas
};

/// delta' M delta of frames of the bench as it was, theta moved by delta: no frame of the changed
/// bench is in it.
void predict(const NominalChain& nominal, const Run& before, const TrueBench& truth,
             const TrueBench& after, Found& found) {
  const auto parameters = chain_parameters(nominal, {});
  Eigen::VectorXd delta(static_cast<Eigen::Index>(parameters.size()));
  for (std::size_t i = 0; i < parameters.size(); ++i)
    delta[static_cast<Eigen::Index>(i)] =
        (after.off(parameters[i].name) - truth.off(parameters[i].name)) / parameters[i].sigma;
  Run run = before;
  const std::size_t had = run.refiner.frames();
  for (const std::size_t more : {30U, 100U}) {
    if (!run.fly_until(truth, had + more)) return;
    (more == 30 ? found.predicted30 : found.predicted100)
        .push_back(delta.dot(run.refiner.information_since(had).information * delta));
  }
}

/// delta' M delta of changes by the number of frames before and after them, of the run's own
/// linearization: a move is found from a noncentrality of some 40. With ever more frames after it
/// tends to delta' C^-1 delta, C of what the frames before left: no test of frames passes that.
void bound(const NominalChain& nominal, int benches, std::uint64_t first) {
  const auto parameters = chain_parameters(nominal, {});
  for (int k = 0; k < benches; ++k) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, {}, seed);
    Run run(nominal, truth, 3000 + seed);
    for (const std::size_t frames : {100U, 300U, 600U, 1000U}) {
      if (!run.fly_until(truth, frames)) break;
      run.refiner.work(3 * static_cast<int>(frames));
      const Eigen::MatrixXd most = run.refiner.belief().covariance.inverse();
      for (const Change& change : changes()) {
        if (change.by.empty() || change.over > 0) continue;
        Eigen::VectorXd delta = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
        for (std::size_t i = 0; i < parameters.size(); ++i)
          if (const auto by = change.by.find(parameters[i].name); by != change.by.end())
            delta[static_cast<Eigen::Index>(i)] = by->second / parameters[i].sigma;
        std::printf("bound\t%d\t%s\t%zu\t%.1f", static_cast<int>(seed), change.name, frames,
                    delta.dot(most * delta));
        for (const std::size_t after : {30U, 100U, 300U, 700U})
          if (after < frames)
            std::printf(
                "\t%zu+%zu: %.1f", frames - after, after,
                delta.dot(run.refiner.information_since(frames - after).information * delta));
        std::printf("\n");
      }
    }
    std::fflush(stdout);
  }
}

/// At most `most` frames are offered after the change.
void change_one(const Change& change, Run run, const TrueBench& truth, const TrueBench& after,
                int most, Found& found) {
  const int had = run.offered;
  const std::size_t frames = run.refiner.frames();
  ++found.benches;
  while (!run.refiner.changed() && run.offered - had < most) {
    const double part =
        change.over > 0 ? std::min(1.0, static_cast<double>(run.offered - had + 1) / change.over)
                        : 1;
    run.fly(change.over > 0 && part < 1 ? part_of(truth, change, part) : after);
  }
  const auto& changed = run.refiner.changed();
  found.frames.push_back(changed ? run.offered - had : 1e9);
  if (!changed) return;
  found.named += changed->part == change.part;
  found.kept_after.push_back(static_cast<double>(changed->after) - static_cast<double>(frames));
}

void find_changes(const NominalChain& nominal, int benches, std::uint64_t first, std::size_t before,
                  int most, const std::string& only) {
  std::vector<Found> found(changes().size());
  for (int k = 0; k < benches; ++k) {
    const std::uint64_t seed = first + static_cast<std::uint64_t>(k);
    const TrueBench truth(nominal, {}, seed);
    Run run(nominal, truth, 3000 + seed);
    if (!run.fly_until(truth, before)) continue;
    for (std::size_t i = 0; i < changes().size(); ++i) {
      const Change& change = changes()[i];
      if (!std::string(change.name).starts_with(only)) continue;
      const TrueBench after =
          change.by.empty() ? TrueBench(nominal, {}, 50000 + seed) : part_of(truth, change, 1);
      if (i < 7) predict(nominal, run, truth, after, found[i]);
      change_one(change, run, truth, after, most, found[i]);
    }
  }
  for (std::size_t i = 0; i < changes().size(); ++i) {
    const Found& one = found[i];
    if (one.benches == 0) continue;
    const auto within = [&](double frames) {
      return std::count_if(one.frames.begin(), one.frames.end(),
                           [&](double at) { return at <= frames; });
    };
    std::printf(
        "%-36s after %zu frames | %d benches | found within 30: %ld, 100: %ld, 300: %ld; median "
        "%.0f, 90 %% %.0f frames; named %d; dated %+.0f frames (median) | noncentrality of 30 "
        "frames %.0f (10 %% %.0f), of 100 %.0f (10 %% %.0f)\n",
        changes()[i].name, before, one.benches, static_cast<long>(within(30)),
        static_cast<long>(within(100)), static_cast<long>(within(300)), at_part(one.frames, 0.5),
        at_part(one.frames, 0.9), one.named, at_part(one.kept_after, 0.5),
        at_part(one.predicted30, 0.5), at_part(one.predicted30, 0.1),
        at_part(one.predicted100, 0.5), at_part(one.predicted100, 0.1));
  }
  std::fflush(stdout);
}

}  // namespace
}  // namespace vitreo::optics

int main(int count, char** arguments) {
  using namespace vitreo::optics;
  const auto number = [&](int i, int otherwise) {
    return count > i ? std::atoi(arguments[i]) : otherwise;
  };
  const std::string parts = count > 4 ? arguments[4] : "gc";
  const int benches = number(1, 10);
  const auto first = static_cast<std::uint64_t>(number(3, 1));
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  if (parts.find('g') != std::string::npos) goals(nominal, benches, number(2, 300), first);
  if (parts.find('r') != std::string::npos) recursive_form(nominal, benches, number(2, 40), first);
  if (parts.find('b') != std::string::npos) bound(nominal, benches, first);
  if (parts.find('l') != std::string::npos) limits(nominal, benches, first);
  if (parts.find('c') != std::string::npos)
    find_changes(nominal, benches, first, static_cast<std::size_t>(number(5, 100)), number(6, 300),
                 count > 7 ? arguments[7] : "");
  return 0;
}
