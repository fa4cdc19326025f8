// Coverage of what a loop's localizer states of its positions, on drawn benches: pictures of a
// robot at known places, located as the servo does. Usage: record_coverage BENCHES [PLACES
// [FIRST_SEED [sampled|believed [known|table_5_1 [told|untold [measured]]]]]]. untold: a rig that
// says that its bench is known; measured: after a calibration by both cameras, too; alone: only
// that.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/measured_chain.h"
#include "host/servo/believed_view.h"
#include "host/servo/localizer.h"
#include "optics/calibration/camera_calibration.h"
#include "optics/chain/eye_look.h"
#include "tests/bench/records/measured_bench.h"

#include <Eigen/Dense>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <random>
#include <string>
#include <vector>

namespace vitreo::records {
namespace {

constexpr double kUm = 1e-6;
const Eigen::Vector3d kAxis(1, 0, 0);

/// Of one way to locate: normalized errors, errors and sigmas, per axis; of benches apart.
struct Tally {
  std::string name;
  double axis_sigma = 0;
  ViewCalibration calibrated = ViewCalibration::none;
  std::vector<Eigen::Vector3d> errors{};
  std::vector<Eigen::Vector3d> sigmas{};
  // Variances of the frame's noise, of attitude and outline, and of all that stays.
  std::vector<std::array<Eigen::Vector3d, 3>> parts{};
  std::vector<double> squares{};
  std::vector<std::size_t> begins{};  // of each bench in them
  int lost = 0;
  bool measured = false;  // the chain by both cameras beforehand, 30 places
};

double quantile(std::vector<double> values, double part) {
  if (values.empty()) return std::nan("");
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))];
}

bool within(const Tally& tally, std::size_t i, int axis) {
  return std::abs(tally.errors[i][axis]) < 1.96 * tally.sigmas[i][axis];
}

/// Part within, and the 95 % of a bootstrap over benches.
void print_axis(const Tally& tally, int axis) {
  const std::size_t benches = tally.begins.size();
  std::vector<double> in(benches, 0), count(benches, 0);
  for (std::size_t b = 0; b < benches; ++b) {
    const std::size_t end = b + 1 < benches ? tally.begins[b + 1] : tally.errors.size();
    for (std::size_t i = tally.begins[b]; i < end; ++i) in[b] += within(tally, i, axis);
    count[b] = static_cast<double>(end - tally.begins[b]);
  }
  std::mt19937_64 random(1);
  std::vector<double> parts;
  for (int k = 0; k < 1000; ++k) {
    double a = 0, n = 0;
    for (std::size_t b = 0; b < benches; ++b) {
      const std::size_t one = random() % benches;
      a += in[one], n += count[one];
    }
    parts.push_back(a / n);
  }
  double a = 0, n = 0;
  for (std::size_t b = 0; b < benches; ++b) a += in[b], n += count[b];
  std::vector<double> error, sigma;
  for (std::size_t i = 0; i < tally.errors.size(); ++i) {
    error.push_back(std::abs(tally.errors[i][axis]) / kUm);
    sigma.push_back(tally.sigmas[i][axis] / kUm);
  }
  std::printf("  %c %5.1f %% (%.0f to %.0f), sigma %4.0f / %4.0f, error %4.0f / %4.0f um",
              "xyz"[axis], 100 * a / n, 100 * quantile(parts, 0.025), 100 * quantile(parts, 0.975),
              quantile(sigma, 0.5), quantile(sigma, 0.9), quantile(error, 0.5),
              quantile(error, 0.9));
  double square = 0;
  for (std::size_t i = 0; i < tally.errors.size(); ++i)
    square += std::pow(tally.errors[i][axis] / tally.sigmas[i][axis], 2) / n;
  std::array<std::vector<double>, 3> split;
  for (const auto& one : tally.parts)
    for (std::size_t k = 0; k < 3; ++k)
      split[k].push_back(std::sqrt(std::max(0.0, one[k][axis])) / kUm);
  std::printf("; mean square %.2f; noise %.0f, attitude and outline %.0f, chain and place %.0f\n",
              square, quantile(split[0], 0.5), quantile(split[1], 0.5), quantile(split[2], 0.5));
}

void print(const Tally& tally) {
  double in = 0;
  double sum = 0;
  for (const double one : tally.squares) {
    in += one < 7.815;  // chi squared of 3, 95 %
    sum += one;
  }
  const double n = static_cast<double>(tally.squares.size());
  std::printf(
      "%s: %zu places in %zu benches, %d without an answer; 3-D %.1f %%, mean square %.2f\n",
      tally.name.c_str(), tally.squares.size(), tally.begins.size(), tally.lost, 100 * in / n,
      sum / n);
  for (int axis = 0; axis < 3; ++axis) print_axis(tally, axis);
}

/// The mean outline of a robot that lies on the retina, as scripts/calibration/retina.lua takes it.
std::optional<vision::EllipseMeasurement> look_on_retina(DrawnBench& bench) {
  const auto eye = background_eye(bench.model(), bench.background());
  std::optional<vision::EllipseMeasurement> mean;
  optics::EllipseVector sum = optics::EllipseVector::Zero();
  int count = 0;
  for (int k = 0; k < 10; ++k) {
    const auto seen = eye->look(bench.picture(bench.on_the_retina(), kAxis));
    if (!seen) continue;
    mean = seen;
    sum += seen->ellipse.vector();
    ++count;
  }
  if (!mean) return mean;
  sum /= count;
  mean->ellipse = {sum.head<2>(), sum[2], sum[3], sum[4]};
  mean->covariance = 0.05 * 0.05 * optics::EllipseCovariance::Identity();
  mean->covariance(4, 4) = std::pow(0.05 / (sum[2] - sum[3]), 2);
  return mean;
}

/// What the loop's model becomes by the look.
std::optional<RigModel> corrected(DrawnBench& bench, ViewCalibration how, bool told) {
  RigModel model = bench.model();
  if (!told) model.uncertainty.bench = BenchUncertainty::none();
  if (how == ViewCalibration::none) return model;
  const auto seen = look_on_retina(bench);
  if (!seen) return std::nullopt;
  const optics::PoseSettings pose = pose_settings_of(model);
  const double lying = model.robot.semi_radius;
  if (how == ViewCalibration::scale) {
    const auto made =
        optics::calibrate_pose(pose, seen->ellipse.vector(), kAxis, lying,
                               optics::PoseCorrection::image_scale, {seen->covariance, 0});
    model.top_image.pixel *= made.image_scale;
    return model;
  }
  const optics::NominalChain nominal{optics::prescription(model.eye_name), model.microscope,
                                     model.top_image, pose.robot};
  const auto made = optics::most_probable_view(
      nominal, {{seen->ellipse.vector(), seen->covariance, 0.1, 4 * M_PI / 180}, kAxis, lying},
      {model.uncertainty.pixel, model.uncertainty.size});
  model.eye = made.eye.system;
  model.exact.emplace(model.eye, model.microscope, 8e-3);
  model.projection = optics::fit_single_viewpoint(model.eye, model.microscope, 8e-3);
  model.top_image.pixel *= made.pixel;
  model.robot.semi_axis *= made.robot_length;
  model.robot.semi_radius *= made.robot_width;
  return model;
}

struct Place {
  Eigen::Vector3d at;
  cv::Mat picture;
};

/// A field holds the robot to two degrees. Places where a spiral goes.
std::vector<Place> places_of(DrawnBench& bench, int count, std::mt19937_64& random) {
  std::uniform_real_distribution<double> even(0, 1);
  std::normal_distribution<double> normal;
  std::vector<Place> places;
  for (int k = 0; k < count; ++k) {
    const double far = 3e-3 * std::sqrt(even(random));
    const double turn = 2 * M_PI * even(random);
    const Eigen::Vector3d at(far * std::cos(turn), far * std::sin(turn),
                             -2.5e-3 + 5e-3 * even(random));
    const Eigen::Vector3d axis =
        Eigen::Vector3d(1, kTakenAxis * normal(random), kTakenAxis * normal(random)).normalized();
    places.push_back({at, bench.picture(at, axis)});
  }
  return places;
}

void take(DrawnBench& bench, const std::vector<Place>& places, bool told, std::uint64_t seed,
          Tally& tally) {
  const auto model =
      tally.measured ? measured_model(bench, 30, seed) : corrected(bench, tally.calibrated, told);
  if (!model) {
    tally.lost += static_cast<int>(places.size());
    return;
  }
  Localizer localizer(*model, bench.background(), kAxis, tally.axis_sigma, tally.calibrated);
  tally.begins.push_back(tally.errors.size());
  for (const Place& place : places) {
    localizer.forget();
    const Observation seen = localizer.look(place.picture);
    if (!seen.position || seen.residual_px > 1.5) {
      ++tally.lost;
      continue;
    }
    const Eigen::Vector3d error = *seen.position - place.at;
    tally.errors.push_back(error);
    tally.sigmas.push_back(seen.covariance.diagonal().cwiseSqrt());
    tally.parts.push_back({(seen.covariance - seen.systematic).diagonal(),
                           seen.by_attitude.diagonal(),
                           (seen.systematic - seen.by_attitude).diagonal()});
    tally.squares.push_back(error.dot(seen.covariance.ldlt().solve(error)));
  }
  if (tally.begins.back() == tally.errors.size()) tally.begins.pop_back();
}

}  // namespace
}  // namespace vitreo::records

int main(int argc, char** argv) {
  using namespace vitreo;
  using namespace vitreo::records;
  const auto number = [&](int i, int fallback) { return argc > i ? std::atoi(argv[i]) : fallback; };
  const int benches = number(1, 20);
  const int places = number(2, 10);
  const int first = number(3, 1);
  const bool told = argc <= 6 || std::strcmp(argv[6], "told") == 0;
  BenchKind kind;
  kind.sampled = argc <= 4 || std::strcmp(argv[4], "sampled") == 0;
  kind.perturbed_eye = argc > 5 && std::strcmp(argv[5], "table_5_1") == 0;
  std::vector<Tally> all{{"axis taken, not calibrated", 0, ViewCalibration::none},
                         {"axis estimated, not calibrated", 0.07, ViewCalibration::none},
                         {"axis estimated, scale", 0.07, ViewCalibration::scale},
                         {"axis estimated, eye", 0.07, ViewCalibration::eye}};
  if (argc > 7) {
    all.push_back({"axis taken, chain measured", 0, ViewCalibration::none});
    all.push_back({"axis estimated, chain measured", 0.07, ViewCalibration::none});
    all[4].measured = all[5].measured = true;
    if (std::strcmp(argv[7], "alone") == 0) all.erase(all.begin(), all.begin() + 4);
  }
  for (int k = 0; k < benches; ++k) {
    const auto seed = static_cast<std::uint64_t>(first + k);
    DrawnBench bench(kind, seed);
    std::mt19937_64 random(seed * 6364136223846793005ULL + 1);
    const auto shown = places_of(bench, places, random);
    for (Tally& tally : all) try {
        take(bench, shown, told, seed, tally);
      } catch (const std::exception& problem) {
        std::printf("bench %d: %s: %s\n", first + k, tally.name.c_str(), problem.what());
        tally.lost += places;
      }
  }
  for (const Tally& tally : all) print(tally);
}
