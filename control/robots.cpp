// Robots from the table of facts/magnetics 3.1; Faxen; the saturating ellipsoid.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kMu0 = 4e-7 * kPi;  // T m/A
constexpr double kRemanence = 1.2;   // T, of NdFeB
constexpr double kNearest = 1.155;   // of R: there the series towards the wall turns round
constexpr std::pair<std::string_view, Robot (*)()> kRobots[] = {
    {"coni_2mm", coni_2mm},
    {"ni_500um", ni_500um},
    {"ndfeb_sphere_500um", ndfeb_sphere_500um},
    {"ndfeb_cylinder_1mm", ndfeb_cylinder_1mm}};

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

// Carlson's R_D by duplication; the fifth-order series ends it at rounding.
double carlson_rd(double x, double y, double z) {
  double sum = 0, factor = 1, ex = 1, ey = 1, ez = 1, mean = 0;
  for (int k = 0; k < 60; ++k) {
    mean = (x + y + 3 * z) / 5;
    ex = (mean - x) / mean, ey = (mean - y) / mean, ez = (mean - z) / mean;
    if (std::max({std::abs(ex), std::abs(ey), std::abs(ez)}) < 1e-3) break;
    const double sx = std::sqrt(x), sy = std::sqrt(y), sz = std::sqrt(z),
                 lambda = sx * (sy + sz) + sy * sz;
    sum += factor / (sz * (z + lambda));
    factor /= 4;
    x = (x + lambda) / 4, y = (y + lambda) / 4, z = (z + lambda) / 4;
  }
  const double ea = ex * ey, eb = ez * ez, ec = ea - eb, ed = ea - 6 * eb, ef = ed + ec + ec;
  const double series = 1 + ed * (-3. / 14 + 9. / 88 * ed - 4.5 / 26 * ez * ef) +
                        ez * (1. / 6 * ef + ez * (-9. / 22 * ec + 3. / 26 * ez * ea));
  return 3 * sum + factor * series / (mean * std::sqrt(mean));
}

Robot magnet(std::string name, double semi_axis, double semi_radius, double volume) {
  Robot robot;
  robot.name = std::move(name);
  robot.semi_axis = semi_axis;
  robot.semi_radius = semi_radius;
  robot.solid_volume = volume;
  robot.solid_density = 7500;
  robot.saturation = kRemanence / kMu0;
  robot.hard = true;
  return robot;
}

}  // namespace

Robot ni_500um() {
  constexpr double kThickness = 20e-6, kAxis = 0.25e-3, kRadius = 0.125e-3;
  Robot robot;
  robot.name = "Ni 0.5 mm";
  robot.semi_axis = kAxis;
  robot.semi_radius = kRadius;
  robot.solid_volume = 2 * kPi * kAxis * kRadius * kThickness - 2 * kAxis * kThickness * kThickness;
  robot.solid_density = 8908;
  robot.saturation = 4.9e5;
  // From the table's m(20 mT) = 1.1e-6 A m^2, as for CoNi.
  robot.demagnetization =
      0.02 / (kMu0 * robot.saturation * std::atanh(1.1e-6 / (robot.solid_volume * 4.9e5)));
  const Eigen::Vector3d plate = demagnetizing_factors({kAxis, kRadius, kThickness / 2});
  robot.anisotropy = plate[1] - plate[0];
  return robot;
}

Robot ndfeb_sphere_500um() {
  constexpr double kRadius = 0.25e-3;
  return magnet("NdFeB sphere 0.5 mm", kRadius, kRadius,
                4. / 3 * kPi * kRadius * kRadius * kRadius);
}

Robot ndfeb_cylinder_1mm() {
  constexpr double kHalf = 0.5e-3, kRadius = 0.25e-3;
  // Fluid and optics see the ellipsoid within it, as the table of facts 3.1.
  return magnet("NdFeB cylinder 1 mm", kHalf, kRadius, 2 * kHalf * kPi * kRadius * kRadius);
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

WallFactors faxen(double radius, double distance) {
  const double x = std::min(radius / distance, 1 / kNearest), cube = x * x * x;
  return {1 / (1 - 9. / 16 * x + cube / 8), 1 / (1 - 9. / 8 * x + cube / 2)};
}

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

double rotational_resistance(const Robot& robot, const Medium& medium) {
  const Eigen::Vector3d axis = Eigen::Vector3d::UnitX();
  const double along = resistance(robot, medium, axis)(0, 0), a = robot.semi_axis,
               b = robot.semi_radius;
  // Perrin's (32/3) pi eta (a^4 - b^4) / ((2a^2 - b^2) S - 2a) by the drag along the axis, which
  // has the same denominator: nothing vanishes at the sphere, where this is 8 pi eta R^3.
  return 2. / 3 * (a * a + b * b) * along;
}

Eigen::Vector3d robot_moment(const Robot& robot, const Eigen::Vector3d& axis,
                             const Eigen::Vector3d& field) {
  if (robot.hard) return robot.solid_volume * robot.saturation * axis;
  const double strength = field.norm();
  if (!(strength > 0)) return Eigen::Vector3d::Zero();
  // In the plane of axis and field; only the part across the axis has another factor.
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

Eigen::Vector3d demagnetizing_factors(const Eigen::Vector3d& semi_axes) {
  require(semi_axes.allFinite() && semi_axes.minCoeff() > 0, "semi_axes: must be above 0 m");
  const Eigen::Vector3d s = semi_axes / semi_axes.maxCoeff(), q = s.cwiseProduct(s);
  const double product = s.prod() / 3;
  return {product * carlson_rd(q[1], q[2], q[0]), product * carlson_rd(q[2], q[0], q[1]),
          product * carlson_rd(q[0], q[1], q[2])};
}

void SoftBody::check() const {
  require(std::isfinite(volume) && volume > 0, "soft body volume: must be above 0 m^3");
  require(std::isfinite(saturation) && saturation > 0, "soft body saturation: must be above 0 A/m");
  require(factors.allFinite() && factors.minCoeff() > 0 && factors.maxCoeff() < 1,
          "soft body factors: must be within 0 and 1");
}

Eigen::Vector3d soft_moment(const SoftBody& body, const Eigen::Vector3d& field_in_body) {
  body.check();
  require(field_in_body.allFinite(), "field_in_body: not finite");
  const Eigen::Vector3d h = field_in_body / kMu0, linear = h.cwiseQuotient(body.factors);
  if (linear.norm() <= body.saturation) return body.volume * linear;
  // On the sphere |M| = saturation the minimum has M = H / (N + x) with one x > 0; Newton on 1/|M|,
  // which is nearly straight in x and bends down, so that it comes from below and never beyond.
  double x = 0;
  for (int k = 0; k < 50; ++k) {
    const Eigen::Vector3d denominator = body.factors.array() + x, m = h.cwiseQuotient(denominator);
    const double size = m.norm(),
                 slope = m.cwiseProduct(m).cwiseQuotient(denominator).sum() / (size * size * size);
    const double step = (1 / body.saturation - 1 / size) / slope;
    x += step;
    if (std::abs(step) <= 1e-14 * (1 + x)) break;
  }
  return body.volume * h.cwiseQuotient(Eigen::Vector3d(body.factors.array() + x));
}

}  // namespace vitreo::control
