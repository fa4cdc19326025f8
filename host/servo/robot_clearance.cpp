// SPDX-License-Identifier: Apache-2.0
#include "host/servo/robot_clearance.h"

#include "host/rig/measured_chain.h"
#include "host/servo/view_doubt.h"
#include "optics/system/prescriptions.h"
#include "optics/system/tolerance.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

// Relative, of the size of the image after a calibration on the retina: one observation at rest.
constexpr double kCalibrated = 2e-3;
// The same of a measured chain, in which the robot's size and the pixel are: what is left of a
// frame's outline, 0.1 px of 27.
constexpr double kMeasured = 4e-3;

constexpr const char* kAdvice =
    "; the bench counts as set up by hand (model.uncertainty.bench), and a look at the robot that "
    "lies on the retina tells more of it: calibrate=yes of the protocols, retina.view of scripts";

optics::DepthDoubt doubt_of(const RigModel& model, const ClearanceBelief& belief) {
  optics::DepthDoubt doubt;
  doubt.viewpoint = model.projection.viewpoint;
  doubt.scale = model.chain ? kMeasured : model.keep_out.scale_uncertainty;
  doubt.residual = kCalibrated;
  if (belief.calibrated) doubt.calibrated_at = 0;  // the retina's vertex
  if (model.keep_out.eye_uncertain && !model.chain)
    doubt.eye = optics::viewpoint_shifts(optics::prescription(model.eye_name), optics::table_5_1());
  const BenchShifts bench = bench_shifts(model);
  doubt.eye.insert(doubt.eye.end(), bench.along.begin(), bench.along.end());
  doubt.aside = bench.aside;
  doubt.check();
  return doubt;
}

}  // namespace

RobotClearance::RobotClearance(const RigModel& rig, const ClearanceBelief& belief)
    : belief_(belief) {
  std::optional<RigModel> centered;  // what a look on the retina has put right
  if (rig.chain && belief.calibrated) centered = without_measured_chain(rig);
  const RigModel& model = centered ? *centered : rig;
  model_.margin = model.keep_out.margin;
  model_.there = model.eye.size() > 2;
  model_.eye_in_world = model.eye_in_world;
  model_.body = control::surface_of(model.robot);
  if (!model_.there) return;
  model_.eye.vertex = model.eye_in_world;
  // Surfaces count from 1 at the retina, as in the thesis' tables: the second is the lens' rear.
  model_.eye.radius = model.eye.surfaces.front().radius;
  model_.eye.lens_depth = model.eye.vertex(2);
  // A look at the robot on the retina shows it where the retina is believed: its depth is none of
  // the height's doubts any more. The lens is looked at by nothing.
  const BenchUncertainty& bench = model.uncertainty.bench;
  if (!belief.calibrated) model_.eye.retina_sigma = retina_sigma(model);
  model_.eye.sag_sigma = bench.retina_curvature;
  model_.eye.lens_sigma = bench.axial_length;
  // What is seen through the eye moves with it, so that its place matters little. Positions of a
  // pose sensor, or of a view without an eye, have no doubt of the optics' kind, and are of a world
  // in which the walls are where the eye stands.
  if (belief.through_eye && !model.plain_view)
    doubt_ = doubt_of(model, belief);
  else
    eye_sigma_ = model.uncertainty.eye;
  look_helps_ = bench.by_hand && belief.through_eye && !model.plain_view && !belief.calibrated;
}

/// m^2, of a height, after a look at another place than the vertex. A picture that is aside by d
/// has the retina at p lower by d p / R than it is seen, and so it has the place q of the look, of
/// which the view makes what is believed there: what is left is d (p - q) / R, where the wall's
/// normal at p knows of d p / R.
double RobotClearance::by_other_place(const Eigen::Vector3d& in_eye) const {
  if (!belief_.calibrated) return 0;
  const Eigen::Vector2d here = in_eye.head<2>();
  const Eigen::Vector2d away = here - belief_.looked_at.head<2>();
  return std::pow(doubt_.aside / model_.eye.radius, 2) *
         std::max(0.0, away.squaredNorm() - here.squaredNorm());
}

std::optional<control::Clearance> RobotClearance::at(const Eigen::Vector3d& position,
                                                     const Eigen::Matrix3d& covariance) const {
  if (!model_.there || !position.allFinite() || !covariance.allFinite()) return std::nullopt;
  control::UncertainPose pose{position, covariance, belief_.axis, belief_.axis_sigma};
  // Systematic and random errors are independent: their covariances add up. The doubt is of the
  // eye's frame, which is parallel to the world's.
  pose.covariance += by_attitude_;
  pose.covariance += doubt_.covariance(position - model_.eye_in_world);
  pose.covariance(2, 2) += by_other_place(position - model_.eye_in_world);
  pose.covariance += eye_sigma_ * eye_sigma_ * Eigen::Matrix3d::Identity();
  control::Clearance found = control::clearance(model_.body, model_.eye, pose);
  found.retina.distance -= felt_retina_;
  found.lens.distance -= felt_lens_;
  return found;
}

void RobotClearance::felt(bool lens, double distance) {
  // Never taken back: a wall that was felt too early costs reach, one that was felt too late is
  // touched again.
  double& felt = lens ? felt_lens_ : felt_retina_;
  felt += std::max(0.0, distance);
}

// By samples in time, as check_reach has them. A robot that lies on the retina must be let off it:
// until the path has once kept the margin it may not come nearer, and after that never leave it.
void RobotClearance::check(const control::Trajectory& path) const {
  constexpr int kAsked = 200;      // positions along the way
  constexpr double kSlack = 5e-6;  // m: noise of a start that was measured, rounding
  bool kept = false;
  double before = -std::numeric_limits<double>::infinity();
  for (int i = 0; i <= kAsked; ++i) {
    const Eigen::Vector3d position = path.at(path.duration() * i / kAsked).position;
    const auto there = at(position);
    if (!there) return;
    const double bound = there->nearest().bound();
    kept = kept || bound >= margin() - kSlack;
    const bool refused = kept ? bound < margin() - kSlack : bound < before - kSlack;
    before = std::max(before, bound);
    if (!refused && !(i == kAsked && !kept)) continue;
    throw std::invalid_argument(fmt::format(
        "({:.2f}, {:.2f}, {:.2f}) mm is out of reach: the robot would be {}, and {:.2f} mm must be "
        "left (keep_out.margin){}",
        position.x() * 1e3, position.y() * 1e3, position.z() * 1e3, clearance_text(*there),
        margin() * 1e3, look_helps_ ? kAdvice : ""));
  }
}

PlacedClearance placed_at(const Eigen::Vector3d& position, const control::Clearance& walls) {
  return {walls, position, position};
}

PlacedClearance nearer_of(const PlacedClearance& one, const PlacedClearance& other) {
  PlacedClearance found = one;
  if (other.walls.retina.bound() < one.walls.retina.bound()) {
    found.walls.retina = other.walls.retina;
    found.near_retina = other.near_retina;
  }
  if (other.walls.lens.bound() < one.walls.lens.bound()) {
    found.walls.lens = other.walls.lens;
    found.near_lens = other.near_lens;
  }
  return found;
}

std::string clearance_text(const control::Clearance& clearance) {
  const control::WallClearance& wall = clearance.nearest();
  const char* const name = clearance.at_lens() ? "lens" : "retina";
  if (wall.distance < 0) return fmt::format("{:.2f} mm inside the {}", -wall.distance * 1e3, name);
  return fmt::format("{:.2f} mm from the {} (\u00b1{:.2f} mm)", wall.distance * 1e3, name,
                     wall.uncertainty * 1e3);
}

}  // namespace vitreo
