// SPDX-License-Identifier: Apache-2.0
#include "control/coil_field.h"

#include "control/constants.h"

#include <Eigen/Geometry>

#include <cmath>
#include <numbers>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo::control {
namespace {

constexpr double kDegree = std::numbers::pi / 180;

// Azimuth and elevation to a unit vector, z up (facts/magnetics 1.2).
Eigen::Vector3d unit(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

// Rows of FieldMatrix for a point dipole's moment m at the offset r from it (Jackson 1998, 5.56;
// facts/magnetics 1.3), with k = mu0/4pi:
//   B    = k (3 (m.r) r / r^5 - m / r^3)
//   G_ij = dB_i/dx_j = 3k/r^5 (m_i r_j + m_j r_i + (m.r) d_ij - 5 (m.r) r_i r_j / r^2)
FieldGradient dipole_field(const Eigen::Vector3d& m, const Eigen::Vector3d& r) {
  // inverse3 = k/r^3, along = 3k/r^5, twice = 5 (m.r)/r^2
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

// v turned by `angle` about an axis across it, which stands at `around` about v: a tilt by `angle`
// in a random direction when `around` is uniform in [0, 2 pi).
// A vector of length 0 has no direction to tilt and stays.
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

// In the world frame; with positive current each coil's flux passes through the workspace.
CoilField CoilField::octomag() {
  std::vector<Dipole> dipoles;
  for (int k = 0; k < 8; ++k) {
    const double azimuth = 45 * k * kDegree;
    // The eight numbers of facts/magnetics 1.2, fitted to a calibration of 2025: lower and upper
    // coils alternate. The moments do not lie along the coils' axes, probably because each core
    // also magnetizes its neighbors and the fit absorbs that.
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

// Throws std::invalid_argument for a negative sigma. Coil after coil, six draws each, whatever
// their values.
CoilField CoilField::perturbed(const FieldPerturbation& sigma, std::mt19937_64& random) const {
  if (!(sigma.gain >= 0) || !(sigma.position >= 0) || !(sigma.axis >= 0)) {
    throw std::invalid_argument("sigma: gain, position and axis must be at least 0");
  }
  std::normal_distribution<double> normal;
  std::uniform_real_distribution<double> turn(0, 2 * std::numbers::pi);
  std::vector<Dipole> dipoles;
  for (const Dipole& dipole : dipoles_) {
    // One statement for each random number: the order of evaluation within an expression is
    // unspecified, and a seed must give the same machine with every compiler.
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

// Superposition: the cores are taken as linear, so every coil's field is proportional to its
// current.
// Currents are per unit: T/A and T/m/A.
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

// Symmetric because curl B = 0, of trace zero because div B = 0.
// From five numbers nine: no model can violate Maxwell's equations through this interface.
Eigen::Matrix3d gradient_matrix(const FieldGradient& field) {
  Eigen::Matrix3d g;
  g << field[3], field[4], field[5],  //
      field[4], field[6], field[7],   //
      field[5], field[7], -field[3] - field[6];
  return g;
}

// S(m) of facts/magnetics 2, F_i = sum_j m_j dB_i/dx_j, on the five independent gradients.
Eigen::Matrix<double, 3, 8> force_from_field(const Eigen::Vector3d& moment) {
  const double x = moment.x();
  const double y = moment.y();
  const double z = moment.z();
  Eigen::Matrix<double, 3, 8> s;
  s << 0, 0, 0, x, y, z, 0, 0,  //
      0, 0, 0, 0, x, 0, y, z,   //
      0, 0, 0, -z, 0, x, -z, y;
  return s;
}

}  // namespace vitreo::control
