// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_planner.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kFramePixels = 0.2;    // px, of one frame
constexpr double kLookPixels = 0.05;    // px, of an average: not less, what stays is systematic
constexpr double kPlannedAxis = 0.035;  // rad

std::optional<OutlineSeen> outline_at(const ViewingChain& chain, const Eigen::Vector3d& place,
                                      const Eigen::Vector3d& axis, double sigma_px) {
  return planned_outline(chain, {place, axis, chain.nominal().image.center_px}, sigma_px,
                         kPlannedAxis);
}

/// Rows of d goal / d theta over the workspace, m per sigma; of the place aside one for each
/// direction.
// Each row says by how much the goal errs for one sigma of each parameter, at one place. The rows
// hold for every candidate, so they are made once for a plan.
Eigen::MatrixXd goal_rows(const ChainBelief& belief, PlanGoal goal) {
  Eigen::MatrixXd rows(0, belief.chain.size());
  const auto add = [&](const Eigen::RowVectorXd& row) {
    rows.conservativeResize(rows.rows() + 1, Eigen::NoChange);
    rows.row(rows.rows() - 1) = row;
  };
  for (const Eigen::Vector3d& place : workspace_places()) {
    const Eigen::Vector3d axis(1, 0, 0);
    const auto outline = outline_at(belief.chain, place, axis, kFramePixels);
    if (!outline) continue;
    const OutlineSeen& seen = *outline;
    const auto doubt =
        position_doubt(belief, {place, axis, seen.ellipse.head<2>()}, seen, PositionFit::weighted);
    if (!doubt) continue;
    if (goal == PlanGoal::aside) {
      add(doubt->by_theta.row(0));
      add(doubt->by_theta.row(1));
    } else if (goal == PlanGoal::height) {
      // Height over the retina at its middle: the retina's depth enters with both.
      add(doubt->by_theta.row(2) + retina_derivative(belief.chain, {0, 0}));
    } else {
      add(doubt->by_theta.row(2));
    }
  }
  return rows;
}

// sqrt(row C row') for each row, by the diagonal of R C R' alone; the median, so that a place at
// the rim that hardly shows does not decide a plan.
double median_sigma(const Eigen::MatrixXd& rows, const Eigen::MatrixXd& covariance) {
  if (rows.rows() == 0) return std::numeric_limits<double>::infinity();
  const Eigen::VectorXd variances = (rows * covariance).cwiseProduct(rows).rowwise().sum();
  std::vector<double> sorted(variances.begin(), variances.end());
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2),
                   sorted.end());
  return std::sqrt(std::max(0.0, sorted[sorted.size() / 2]));
}

/// Looks at places of the workspace, as often as wanted, their axes turning round and pitching.
// Twenty-five looks stand for any number of frames: information is multiplied by frames over looks.
// Frames that follow each other at once share their outline's error and count as one.
PlanCandidate flight(const ChainBelief& belief, const char* name, int frames, double sigma_px,
                     double known_sigma) {
  const auto places = workspace_places();
  ChainSession session;
  std::vector<Eigen::Vector3d> at;
  for (std::size_t i = 0; i < places.size(); ++i) {
    // Turning axes tell length from width, and pitch tells both from depth: without it a flight is
    // worth a fifth to a quarter less.
    const double azimuth = 2.4 * static_cast<double>(i);  // rad: the golden angle
    const double pitch = 0.35 * std::sin(1.7 * static_cast<double>(i));
    ChainLook look;
    look.axis = {std::cos(azimuth) * std::cos(pitch), std::sin(azimuth) * std::cos(pitch),
                 std::sin(pitch)};
    const auto outline = outline_at(belief.chain, places[i], look.axis, sigma_px);
    if (!outline) continue;
    look.seen = *outline;
    if (known_sigma > 0) {
      look.known = places[i];
      look.known_sigma.setConstant(known_sigma);
    }
    session.looks.push_back(look);
    at.push_back(places[i]);
  }
  const double each = frames / std::max<double>(1, static_cast<double>(at.size()));
  return {name, each * session_information(belief.chain, session, at)};
}

// The middle and four places 3 mm from it: more of them gain 7 to 9 % in height.
PlanCandidate landings(const ChainBelief& belief) {
  ChainSession session;
  std::vector<Eigen::Vector3d> at;
  const double lying = belief.chain.nominal().robot.semi_radius;
  for (const Eigen::Vector2d& aside :
       {Eigen::Vector2d(0, 0), Eigen::Vector2d(3e-3, 0), Eigen::Vector2d(-3e-3, 0),
        Eigen::Vector2d(0, 3e-3), Eigen::Vector2d(0, -3e-3)}) {
    Eigen::Vector3d place;
    place << aside,
        nominal_retina(belief.chain, aside) + retina_offset(belief.chain, aside) + lying;
    ChainLook look;
    look.axis = {1, 0, 0};
    const auto outline = outline_at(belief.chain, place, look.axis, kLookPixels);
    if (!outline) continue;
    look.seen = *outline;
    look.contact_sigma = 30e-6;
    look.lying_height = lying;
    session.looks.push_back(look);
    at.push_back(place);
  }
  return {"five landings", session_information(belief.chain, session, at)};
}

// Vessels seen now and in a picture of the fundus: they tie the eye's rotation, which pictures of
// the robot know only together with the condensing lens.
PlanCandidate landmarks(const ChainBelief& belief) {
  ChainSession session;
  for (int i = 0; i < 8; ++i) {
    const double angle = M_PI / 4 * i;
    const double radius = i % 2 == 0 ? 4e-3 : 2.5e-3;
    ChainLandmark one;
    one.place = {radius * std::cos(angle), radius * std::sin(angle)};
    Eigen::Vector3d point;
    point << one.place, nominal_retina(belief.chain, one.place);
    const auto seen = belief.chain.seen(point, belief.chain.nominal().image.center_px);
    if (!seen) continue;
    one.pixel_px = seen->pixel_px;
    one.sigma_px = 1;
    one.place_sigma = 80e-6;
    session.landmarks.push_back(one);
  }
  return {"eight landmarks", session_information(belief.chain, session, {})};
}

/// Only of parameters that the chain has.
// A candidate that measures nothing of this chain is none.
std::optional<PlanCandidate> numbers(const ChainBelief& belief, const char* name,
                                     const std::vector<std::pair<const char*, double>>& measured) {
  ChainSession session;
  for (const auto& [parameter, sigma] : measured)
    for (const ChainParameter& one : belief.chain.parameters())
      if (one.name == parameter) session.numbers.push_back({parameter, 0, sigma});
  if (session.numbers.empty()) return std::nullopt;
  return PlanCandidate{name, session_information(belief.chain, session, {})};
}

}  // namespace

std::optional<OutlineSeen> planned_outline(const ViewingChain& chain, const RobotPlace& place,
                                           double sigma_px, double axis_sigma) {
  const auto ellipse = shown_ellipse(chain, place);
  if (!ellipse) return std::nullopt;
  OutlineSeen seen;
  seen.ellipse = ellipse_from(*ellipse);
  seen.covariance = sigma_px * sigma_px * EllipseCovariance::Identity();
  const double difference = std::max(seen.ellipse[2] - seen.ellipse[3], 1.0);
  seen.covariance(4, 4) = sigma_px * sigma_px / (difference * difference);
  seen.axis_sigma = axis_sigma;
  return seen;
}

// Five layers of five; each layer is turned against the last, so that no meridian is preferred.
std::vector<Eigen::Vector3d> workspace_places() {
  std::vector<Eigen::Vector3d> places;
  for (int layer = 0; layer < 5; ++layer) {
    const double z = 2e-3 + 7e-3 * layer / 4;
    places.emplace_back(0, 0, z);
    for (int i = 0; i < 4; ++i) {
      const double angle = M_PI / 2 * i + 0.5 * layer;
      const double radius = (layer % 2 == 0 ? 3.5e-3 : 2e-3);
      places.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    }
  }
  return places;
}

double left_of(const ChainBelief& belief, PlanGoal goal) {
  return median_sigma(goal_rows(belief, goal), belief.covariance);
}

// Greedy: the best single measurement, then the best beside it. It is not the best pair, but in the
// study of such sessions the order hardly mattered and the first step brought most.
std::vector<PlanStep> plan(const ChainBelief& belief, std::vector<PlanCandidate> candidates,
                           PlanGoal goal, int steps) {
  const Eigen::MatrixXd rows = goal_rows(belief, goal);
  Eigen::MatrixXd information = belief.covariance.inverse();
  std::vector<PlanStep> taken;
  while (static_cast<int>(taken.size()) < steps && !candidates.empty()) {
    std::size_t best = 0;
    double least = std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < candidates.size(); ++i) {
      const double left = median_sigma(rows, (information + candidates[i].information).inverse());
      if (left < least) least = left, best = i;
    }
    information += candidates[best].information;
    taken.push_back({candidates[best].name, least});
    candidates.erase(candidates.begin() + static_cast<long>(best));
  }
  return taken;
}

// The sigmas are those that the named instruments reach with care: a microscope on a target 5 % of
// the pupil's power, reflexes of the condensing lens 0.1 mm and half a degree, a refractometer 0.1
// %.
std::vector<PlanCandidate> usual_candidates(const ChainBelief& belief) {
  std::vector<PlanCandidate> all{
      flight(belief, "300 frames of free flight", 300, kFramePixels, 0),
      flight(belief, "30 places by two side windows", 30, kLookPixels, 10e-6), landings(belief),
      landmarks(belief)};
  for (auto& one :
       {numbers(belief, "microscope on a target",
                {{"pupil_power", 0.1},
                 {"pixel", 5e-4},
                 {"center_x", 20e-6},
                 {"center_y", 20e-6},
                 {"object_plane", 50e-6},
                 {"microscope_tilt_x", 1.7e-3},
                 {"microscope_tilt_y", 1.7e-3}}),
        numbers(belief, "lens' place by its reflexes",
                {{"lens_axial", 0.1e-3},
                 {"lens_aside_x", 0.1e-3},
                 {"lens_aside_y", 0.1e-3},
                 {"lens_tilt_x", 8.7e-3},
                 {"lens_tilt_y", 8.7e-3}}),
        numbers(belief, "robot's size to 0.2 %", {{"robot_length", 2e-3}, {"robot_width", 2e-3}}),
        numbers(belief, "vitreous index to 0.1 %", {{"vitreous.index", 1e-3}}),
        numbers(belief, "keratometry and A-scan",
                {{"cornea.anterior.radius", 5e-3},
                 {"cornea.thickness", 0.02},
                 {"aqueous.thickness", 0.02},
                 {"lens.thickness", 0.02}}),
        numbers(belief, "retinal depth by OCT", {{"retina_depth", 50e-6}})})
    if (one) all.push_back(*one);
  return all;
}

// Posterior over prior variance. Single radii and thicknesses of the eye are always among them:
// they act as one power, which is harmless.
std::vector<std::string> unobserved(const ChainBelief& belief) {
  constexpr double kLittle = 0.9;  // of the variance
  std::vector<std::string> names;
  for (Eigen::Index i = 0; i < belief.chain.size(); ++i)
    if (belief.covariance(i, i) > kLittle)
      names.push_back(belief.chain.parameters()[static_cast<std::size_t>(i)].name);
  return names;
}

}  // namespace vitreo::optics
