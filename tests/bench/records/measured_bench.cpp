// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/records/measured_bench.h"

#include "control/crossed_plates.h"
#include "host/rig/measured_chain.h"
#include "host/servo/robot_eye.h"
#include "host/servo/view_doubt.h"
#include "optics/chain/chain_estimator.h"

#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <vector>

namespace vitreo::records {
namespace {

const Eigen::Vector3d kAlongX(1, 0, 0);
constexpr double kSide = 15e-6;    // m, of the side camera's places
constexpr double kContour = 0.15;  // px, as scripts/calibration/chain.lua has it

/// The mean outline of some frames at a place where a field holds the robot to two degrees.
std::optional<optics::ChainLook> look_at(DrawnBench& bench, RobotEye& eye, std::mt19937_64& random,
                                         const Eigen::Vector3d& place) {
  constexpr int kFrames = 5;
  std::normal_distribution<double> normal;
  const Eigen::Vector3d axis =
      Eigen::Vector3d(1, kTakenAxis * normal(random), kTakenAxis * normal(random)).normalized();
  optics::EllipseVector sum = optics::EllipseVector::Zero();
  for (int k = 0; k < kFrames; ++k) {
    eye.forget();
    const auto seen = eye.look(bench.picture(place, axis));
    if (!seen) return std::nullopt;
    sum += seen->ellipse.vector();
  }
  optics::ChainLook look;
  look.seen.ellipse = sum / kFrames;
  look.seen.covariance = 0.09 * 0.09 * optics::EllipseCovariance::Identity();
  look.seen.covariance(4, 4) = std::pow(0.09 / (look.seen.ellipse[2] - look.seen.ellipse[3]), 2);
  look.seen.contour_sigma_px = kContour;
  look.seen.axis_sigma = kTakenAxis;
  look.axis = kAlongX;
  look.known = bench.by_side_camera(place) - bench.model().eye_in_world +
               kSide * Eigen::Vector3d(normal(random), 0, normal(random));
  look.known_sigma = {kSide, std::numeric_limits<double>::infinity(), kSide};
  return look;
}

optics::ChainSession session_of(DrawnBench& bench, int places, std::uint64_t seed) {
  std::mt19937_64 random(seed * 2862933555777941757ULL + 3037);
  std::uniform_real_distribution<double> even(0, 1);
  const auto eye = background_eye(bench.model(), bench.background());
  optics::ChainSession session;
  for (int k = 0; k < places; ++k) {
    const double far = 3e-3 * std::sqrt(even(random)), turn = 2 * M_PI * even(random);
    const Eigen::Vector3d at(far * std::cos(turn), far * std::sin(turn),
                             -2.5e-3 + 5e-3 * even(random));
    if (auto look = look_at(bench, *eye, random, at)) session.looks.push_back(*look);
  }
  return session;
}

bool is_explained(const optics::ChainEstimate& made) {
  return made.status == optics::SessionStatus::found ||
         made.status == optics::SessionStatus::ambiguous;
}

/// As scripts/calibration/chain.lua: by how much outlines are nearer than believed.
double nearer(optics::ChainEstimate& made,
              const std::function<optics::ChainEstimate(double)>& estimated) {
  const double degrees = std::max(made.degrees_of_freedom, 1);
  for (double factor = 1. / 3; factor < 0.9; factor *= 1.5) {
    optics::ChainEstimate other = estimated(factor);
    if (!is_explained(other) || other.chi2 > degrees) continue;
    made = std::move(other);
    return factor;
  }
  return 1;
}

}  // namespace

std::optional<std::string> measured_file(DrawnBench& bench, int places, std::uint64_t seed) {
  const RigModel& model = bench.model();
  optics::ChainSession session = session_of(bench, places, seed);
  if (session.looks.size() < 10) return std::nullopt;
  // As scripts/calibration/chain.lua believes it.
  optics::NominalChain nominal = nominal_chain(model);
  nominal.plate_ratio = control::plate_ratio(model.robot);
  optics::ChainSigmas sigmas;
  sigmas.axis_turn = 0.044;  // rad
  const auto estimated = [&](double factor) {
    for (auto& look : session.looks) look.seen.contour_sigma_px = factor * kContour;
    return optics::estimate_chain(nominal, sigmas, session);
  };
  optics::ChainEstimate made = estimated(1);
  double outline = 1;
  while (!is_explained(made) && outline < 3) made = estimated(++outline);
  if (!is_explained(made)) return std::nullopt;
  if (outline == 1) outline = nearer(made, estimated);
  const auto& parameters = made.belief.chain.parameters();
  const Eigen::Index size = made.belief.chain.size();
  nlohmann::json file{
      {"eye", model.eye_id}, {"touched", false}, {"outline_px", outline * kContour}};
  file["about"] = {{"eye", model.eye_name},
                   {"robot", model.robot.name},
                   {"plates", nominal.plate_ratio < 1},
                   {"pixel", model.top_image.pixel},
                   {"center", {model.top_image.center_px.x(), model.top_image.center_px.y()}},
                   {"pupil_power", 0},
                   {"tilt", {0, 0}}};
  std::vector<double> covariance;
  for (Eigen::Index i = 0; i < size; ++i) {
    const optics::ChainParameter& one = parameters[static_cast<std::size_t>(i)];
    file["parameters"].push_back({{"name", one.name},
                                  {"off", one.sigma * made.belief.chain.theta()[i]},
                                  {"sigma", one.sigma}});
    for (Eigen::Index j = 0; j < size; ++j)
      covariance.push_back(made.belief.covariance(i, j) * one.sigma *
                           parameters[static_cast<std::size_t>(j)].sigma);
  }
  file["covariance"] = covariance;
  return file.dump();
}

std::optional<RigModel> measured_model(DrawnBench& bench, int places, std::uint64_t seed) {
  const auto text = measured_file(bench, places, seed);
  if (!text) return std::nullopt;
  RigModel model = bench.model();
  std::vector<std::string> warnings;
  auto chain = read_measured_chain(*text, model, warnings);
  if (!chain) return std::nullopt;
  use_measured_chain(model, std::move(chain));
  return model;
}

}  // namespace vitreo::records
