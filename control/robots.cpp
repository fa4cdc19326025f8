// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"

#include "control/constants.h"
#include "control/preconditions.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kRemanence = 1.2;  // T, of NdFeB
// In radii: 2 / sqrt(3), where 1 - 9/8 x + x^3/2, x = R/h, has its minimum. Nearer, the truncated
// series would let the drag towards the wall fall again.
constexpr double kNearestWall = 1.155;
constexpr std::pair<std::string_view, Robot (*)()> kRobots[] = {
    {"coni_2mm", coni_2mm},
    {"ni_500um", ni_500um},
    {"ndfeb_sphere_500um", ndfeb_sphere_500um},
    {"ndfeb_cylinder_1mm", ndfeb_cylinder_1mm},
    {"helix_2mm", helix_2mm},
    {"tail_3mm", tail_3mm}};

// A permanent magnet: m = Br V / mu0, and 7500 kg/m^3 of NdFeB (facts/magnetics 3.1).
// The moment of a permanent magnet is its remanence over mu0 times its volume, whatever the field.
Robot magnet(std::string name, BodyShape shape, double semi_axis, double semi_radius,
             double volume) {
  Robot robot;
  robot.name = std::move(name);
  robot.shape = shape;
  robot.semi_axis = semi_axis;
  robot.semi_radius = semi_radius;
  robot.solid_volume = volume;
  robot.solid_density = 7500;
  robot.saturation = kRemanence / kMu0;
  robot.hard = true;
  return robot;
}

}  // namespace

// Two crossed plates as of coni_2mm, of nickel.
Robot ni_500um() {
  constexpr double kThickness = 20e-6;
  constexpr double kAxis = 0.25e-3;
  constexpr double kRadius = 0.125e-3;
  Robot robot;
  robot.name = "Ni 0.5 mm";
  robot.shape = BodyShape::crossed_plates;
  robot.semi_axis = kAxis;
  robot.semi_radius = kRadius;
  robot.solid_volume = 2 * kPi * kAxis * kRadius * kThickness - 2 * kAxis * kThickness * kThickness;
  robot.solid_density = 8908;
  robot.saturation = 4.9e5;
  // From the table's m(20 mT) = 1.1e-6 A m^2 by the tanh law, as for CoNi.
  robot.demagnetization =
      0.02 / (kMu0 * robot.saturation * std::atanh(1.1e-6 / (robot.solid_volume * 4.9e5)));
  const Eigen::Vector3d plate = demagnetizing_factors({kAxis, kRadius, kThickness / 2});
  robot.anisotropy = plate[1] - plate[0];
  return robot;
}

Robot ndfeb_sphere_500um() {
  constexpr double kRadius = 0.25e-3;
  return magnet("NdFeB sphere 0.5 mm", BodyShape::sphere, kRadius, kRadius,
                4. / 3 * kPi * kRadius * kRadius * kRadius);
}

Robot ndfeb_cylinder_1mm() {
  constexpr double kHalf = 0.5e-3;
  constexpr double kRadius = 0.25e-3;
  // Drag and optics are those of the inscribed ellipsoid, as in the table of facts/magnetics 3.1.
  return magnet("NdFeB cylinder 1 mm", BodyShape::cylinder, kHalf, kRadius,
                2 * kHalf * kPi * kRadius * kRadius);
}

// Assumed, after helices as they are printed (a filament of resin, 1150 kg/m^3, and a cylinder of
// NdFeB of 0.25 mm x 0.25 mm, magnetized across its axis). Density and magnetization are means over
// both.
Robot helix_2mm() {
  constexpr double kMagnet = kPi * 0.125e-3 * 0.125e-3 * 0.25e-3;  // m^3
  constexpr double kResin = 1150;                                  // kg/m^3
  Helix helix;
  const double turn = std::hypot(2 * kPi * helix.radius, helix.pitch);
  const double filament = helix.turns * turn * kPi * helix.filament_radius * helix.filament_radius;
  // Its surface is the cylinder about it, in which it turns.
  Robot robot =
      magnet("helix 2 mm", BodyShape::cylinder, helix.length() / 2 + helix.filament_radius,
             helix.radius + helix.filament_radius, kMagnet + filament);
  robot.solid_density = (kMagnet * robot.solid_density + filament * kResin) / robot.solid_volume;
  robot.saturation *= kMagnet / robot.solid_volume;
  robot.helix = helix;
  return robot;
}

// Assumed: a filament of polyethylene of 50 um (0.3 GPa, 920 kg/m^3) in a bead of hollow glass
// spheres in resin (600 kg/m^3) about a cylinder of NdFeB of 0.25 mm x 0.25 mm, magnetized along
// the tail. Density and magnetization are means over all three.
Robot tail_3mm() {
  constexpr double kMagnet = kPi * 0.125e-3 * 0.125e-3 * 0.25e-3;  // m^3
  constexpr double kFoam = 600, kPolyethylene = 920;               // kg/m^3
  const FlexibleTail tail;
  const double head = 4. / 3 * kPi * std::pow(tail.head_radius, 3);
  const double filament = tail.length * kPi * tail.radius * tail.radius;
  // Its surface is a cylinder as long to the front as to the tail's end: more than there is.
  Robot robot =
      magnet("tail 3 mm", BodyShape::cylinder, tail.reach(), tail.head_radius, head + filament);
  robot.solid_density =
      (kMagnet * robot.solid_density + (head - kMagnet) * kFoam + filament * kPolyethylene) /
      robot.solid_volume;
  robot.saturation *= kMagnet / robot.solid_volume;
  robot.tail = tail;
  return robot;
}

const std::vector<std::string_view>& robot_names() {
  static const std::vector<std::string_view> names = [] {
    std::vector<std::string_view> list;
    for (const auto& [name, make] : kRobots) list.push_back(name);
    return list;
  }();
  return names;
}

Robot robot_named(std::string_view name) {
  std::string known;
  for (const auto& [own, make] : kRobots) {
    if (own == name) return make();
    known += (known.empty() ? "" : ", ") + std::string(own);
  }
  throw std::invalid_argument("robot: '" + std::string(name) + "' is not one of " + known);
}

// Faxen's corrections of Stokes' drag for a sphere beside a plane wall, to the third order in R/h
// (Happel & Brenner 1983, chapter 7; facts/magnetics 3.1).
// x is held at its largest sound value near the wall; `radius` and `distance` in m.
WallFactors faxen(double radius, double distance) {
  const double x = std::min(radius / distance, 1 / kNearestWall);
  const double cube = x * x * x;
  return {1 / (1 - 9. / 16 * x + cube / 8), 1 / (1 - 9. / 8 * x + cube / 2)};
}

// W R W with W = sqrt(k_par) (1 - n n') + sqrt(k_perp) n n'. For a sphere this is Faxen's result;
// for the elongated robot an approximation, that of the sphere with its mean radius (a b^2)^(1/3).
Eigen::Matrix3d resistance_near_wall(const Eigen::Matrix3d& free, const Robot& robot,
                                     const Eigen::Vector3d& normal, double distance) {
  robot.check();
  require(std::isfinite(distance) && distance > 0, "wall distance: must be above 0 m");
  require(normal.allFinite() && normal.norm() > 0, "wall normal: must be finite and not zero");
  const auto [along, towards] =
      faxen(std::cbrt(robot.semi_axis * robot.semi_radius * robot.semi_radius), distance);
  const Eigen::Vector3d n = normal.normalized();
  // The root on both sides keeps the tensor symmetric where the robot's axis is askew to the wall.
  const Eigen::Matrix3d root = std::sqrt(along) * Eigen::Matrix3d::Identity() +
                               (std::sqrt(towards) - std::sqrt(along)) * n * n.transpose();
  return root * free * root;
}

// About an axis across the robot's own; N m s.
double rotational_resistance(const Robot& robot, const Medium& medium) {
  if (robot.helix) return helix_resistance(*robot.helix, medium.dynamic_viscosity()).turning;
  if (robot.tail) return tail_drag(*robot.tail, medium.dynamic_viscosity()).turning;
  const Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  const double along = resistance(robot, medium, axis)(0, 0);
  const double a = robot.semi_axis;
  const double b = robot.semi_radius;
  // Perrin's z_rot = (32/3) pi eta (a^4 - b^4) / ((2a^2 - b^2) S - 2a) over the drag along the
  // axis, 16 pi eta (a^2 - b^2) / (the same), is 2/3 (a^2 + b^2): nothing vanishes at the sphere,
  // where this is 8 pi eta R^3.
  return 2. / 3 * (a * a + b * b) * along;
}

// The saturating ellipsoid of soft_moment with a rounded knee. With k = |N^-1 H| / Ms the sharp law
// has |M| = k Ms below k = 1; the factor tanh(k)/k there, and tanh(k) above, turn it into Ms tanh(B
// / (mu0 N Ms)) along the axis, the law of Robot::moment.
// A symmetric body's moment lies in the plane of axis and field.
Eigen::Vector3d robot_moment(const Robot& robot, const Eigen::Vector3d& axis,
                             const Eigen::Vector3d& field) {
  if (robot.hard) return robot.solid_volume * robot.saturation * axis;
  const double strength = field.norm();
  if (!(strength > 0)) return Eigen::Vector3d::Zero();
  // The problem is plane: axis and field span it, and the robot is symmetric about its axis.
  const Eigen::Vector3d across_field = field - axis.dot(field) * axis;
  const double across_strength = across_field.norm();
  const Eigen::Vector3d across =
      across_strength > 0 ? Eigen::Vector3d(across_field / across_strength) : axis;
  const SoftBody body{robot.solid_volume,
                      robot.saturation,
                      {robot.demagnetization, robot.demagnetization + robot.anisotropy,
                       robot.demagnetization + robot.anisotropy}};
  const Eigen::Vector3d in_body(axis.dot(field), across_strength, 0);
  const Eigen::Vector3d sharp = soft_moment(body, in_body);
  const Eigen::Vector3d linear = in_body.cwiseQuotient(kMu0 * body.factors);
  const double knee = linear.norm() / body.saturation;
  const double smooth = knee > 1e-9 ? std::tanh(knee) / std::min(knee, 1.0) : 1;
  return smooth * (sharp[0] * axis + sharp[1] * across);
}

}  // namespace vitreo::control
