// SPDX-License-Identifier: Apache-2.0
#include "control/coil_field.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kMu0Over4Pi = 1e-7;  // T m/A
constexpr double kDegree = std::numbers::pi / 180;

// Azimuth and elevation to a unit vector, z up (facts/magnetics 1.2).
Eigen::Vector3d unit(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

// Rows of FieldMatrix for a dipole's moment at the offset r from it (facts/magnetics 1.3).
FieldGradient dipole_field(const Eigen::Vector3d& m, const Eigen::Vector3d& r) {
  const double inverse2 = 1 / r.squaredNorm();
  const double inverse3 = kMu0Over4Pi * inverse2 * std::sqrt(inverse2);
  const double mr = m.dot(r);
  const double along = 3 * inverse3 * inverse2;
  const double twice = 5 * mr * inverse2;
  FieldGradient f;
  f << along * mr * r.x() - inverse3 * m.x(), along * mr * r.y() - inverse3 * m.y(),
      along * mr * r.z() - inverse3 * m.z(),
      along * (2 * m.x() * r.x() + mr - twice * r.x() * r.x()),
      along * (m.x() * r.y() + m.y() * r.x() - twice * r.x() * r.y()),
      along * (m.x() * r.z() + m.z() * r.x() - twice * r.x() * r.z()),
      along * (2 * m.y() * r.y() + mr - twice * r.y() * r.y()),
      along * (m.y() * r.z() + m.z() * r.y() - twice * r.y() * r.z());
  return f;
}

// Turns v by `angle` about an axis across it, itself turned by `around`.
Eigen::Vector3d tilted(const Eigen::Vector3d& v, double angle, double around) {
  const double length = v.norm();
  if (!(length > 0)) return v;
  const Eigen::Vector3d across = v.unitOrthogonal();
  const Eigen::Vector3d axis = Eigen::AngleAxisd(around, v / length) * across;
  return Eigen::AngleAxisd(angle, axis) * v;
}

}  // namespace

CoilField::CoilField(std::vector<Dipole> dipoles) : dipoles_(std::move(dipoles)) {
  if (dipoles_.empty() || dipoles_.size() > kMaxCoils) {
    throw std::invalid_argument("dipoles: " + std::to_string(dipoles_.size()) + " given, 1 to " +
                                std::to_string(kMaxCoils) + " allowed");
  }
  for (const Dipole& dipole : dipoles_) {
    if (!dipole.position.allFinite() || !dipole.moment_per_ampere.allFinite()) {
      throw std::invalid_argument("dipoles: a number is not finite");
    }
  }
}

CoilField CoilField::octomag() {
  std::vector<Dipole> dipoles;
  for (int k = 0; k < 8; ++k) {
    const double azimuth = 45 * k * kDegree;
    // Lower and upper coils take turns; the moments are not along the coils for cores magnetize
    // each other.
    if (k % 2 == 0) {
      dipoles.push_back(
          {0.0942 * unit(azimuth, -56.3 * kDegree), -9.35 * unit(azimuth, -83.1 * kDegree)});
    } else {
      dipoles.push_back(
          {0.1089 * unit(azimuth, -7.8 * kDegree), -19.64 * unit(azimuth, -37.9 * kDegree)});
    }
  }
  return CoilField(std::move(dipoles));
}

CoilField CoilField::perturbed(const FieldPerturbation& sigma, std::mt19937_64& random) const {
  if (!(sigma.gain >= 0) || !(sigma.position >= 0) || !(sigma.axis >= 0)) {
    throw std::invalid_argument("sigma: gain, position and axis must be at least 0");
  }
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi);
  std::vector<Dipole> dipoles;
  for (const Dipole& dipole : dipoles_) {
    // One statement a draw: the order within an expression is the compiler's, and the draws must be
    // repeatable.
    const double gain = 1 + sigma.gain * normal(random);
    const double x = normal(random);
    const double y = normal(random);
    const double z = normal(random);
    const double angle = sigma.axis * normal(random);
    const double around = turn(random);
    dipoles.push_back({dipole.position + sigma.position * Eigen::Vector3d(x, y, z),
                       gain * tilted(dipole.moment_per_ampere, angle, around)});
  }
  return CoilField(std::move(dipoles));
}

FieldMatrix CoilField::matrix(const Eigen::Vector3d& position_in_world) const {
  if (!position_in_world.allFinite()) throw std::invalid_argument("position_in_world: not finite");
  FieldMatrix result(8, coils());
  for (int k = 0; k < coils(); ++k) {
    const Dipole& dipole = dipoles_[static_cast<std::size_t>(k)];
    const Eigen::Vector3d offset = position_in_world - dipole.position;
    if (!(offset.squaredNorm() > 0))
      throw std::invalid_argument("position_in_world: at a coil's dipole");
    result.col(k) = dipole_field(dipole.moment_per_ampere, offset);
  }
  return result;
}

Eigen::Matrix3d gradient_matrix(const FieldGradient& field) {
  Eigen::Matrix3d g;
  g << field[3], field[4], field[5],  //
      field[4], field[6], field[7],   //
      field[5], field[7], -field[3] - field[6];
  return g;
}

Eigen::Matrix<double, 3, 8> force_from_field(const Eigen::Vector3d& moment) {
  const double x = moment.x(), y = moment.y(), z = moment.z();
  Eigen::Matrix<double, 3, 8> s;
  s << 0, 0, 0, x, y, z, 0, 0,  //
      0, 0, 0, 0, x, 0, y, z,   //
      0, 0, 0, -z, 0, x, -z, y;
  return s;
}

}  // namespace vitreo::control
