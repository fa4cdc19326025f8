// SPDX-License-Identifier: Apache-2.0
#include "optics/system/first_order.h"

#include "optics/numerics/preconditions.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A power (1/m) or an angular magnification below this is rounding.
constexpr double kAfocal = 1e-9;

/// Of the vitreous, n_v, and of what is behind the last surface, n_i.
double front_index(const System& system) { return system.surfaces.front().index; }
double back_index(const System& system) { return system.surfaces.back().index; }

/// Radii of atoms and lengths of light years overflow; what follows must not be a NaN.
const Eigen::Matrix2d& checked(const Eigen::Matrix2d& matrix) {
  constexpr double kLargest = 1e100;
  if (!matrix.allFinite() || !(matrix.cwiseAbs().maxCoeff() < kLargest)) {
    throw std::invalid_argument("system: its powers and lengths are beyond any optics");
  }
  return matrix;
}

/// From an object in the vitreous to behind the last surface: B = A T with the transfer T (4.4)
/// over the distance left to surface 2. B acts on (n angle, height).
Eigen::Matrix2d from_object(const System& system, double depth) {
  const double distance = system.surfaces.front().thickness - depth;
  if (!(depth >= 0 && distance >= 0)) {
    throw std::invalid_argument("depth: must lie in the vitreous, between 0 and " +
                                std::to_string(system.surfaces.front().thickness * 1e3) + " mm");
  }
  return checked(system_matrix(system) * transfer_matrix(distance, front_index(system)));
}

}  // namespace

/// The power D = (n' - n) / r; a plane's is 0, its radius being infinite.
Eigen::Matrix2d refraction_matrix(double index_before, double index_behind, double radius) {
  Eigen::Matrix2d matrix;
  matrix << 1, -(index_behind - index_before) / radius, 0, 1;  // (4.2), (4.3)
  return matrix;
}

/// The reduced thickness t / n, as angles are carried multiplied by the index.
Eigen::Matrix2d transfer_matrix(double thickness, double index) {
  Eigen::Matrix2d matrix;
  matrix << 1, 0, thickness / index, 1;  // (4.4)
  return matrix;
}

/// In 64 steps; of an eye's lens the error is below 1e-13.
Eigen::Matrix2d medium_matrix(const Surface& surface) {
  if (surface.gradient.is_none()) return transfer_matrix(surface.thickness, surface.index);
  constexpr int kSteps = 64;
  const auto rate = [&](double z, const Eigen::Matrix2d& m) {
    Eigen::Matrix2d a;
    a << 0, 2 * surface.gradient.across[0], 1 / (surface.index + surface.gradient.value({0, 0, z})),
        0;
    return Eigen::Matrix2d(a * m);
  };
  Eigen::Matrix2d m = Eigen::Matrix2d::Identity();
  const double h = surface.thickness / kSteps;
  for (int i = 0; i < kSteps; ++i) {
    const double z = i * h;
    const Eigen::Matrix2d a = rate(z, m);
    const Eigen::Matrix2d b = rate(z + h / 2, m + h / 2 * a);
    const Eigen::Matrix2d c = rate(z + h / 2, m + h / 2 * b);
    const Eigen::Matrix2d d = rate(z + h, m + h * c);
    m += h / 6 * (a + 2 * b + 2 * c + d);
  }
  return m;
}

/// (4.9): the product of refractions (4.2), (4.3) and transfers (4.4), the first surface rightmost.
/// Conic constants and aspheric terms do not enter first-order optics.
/// From surface `from` to surface `to`, both refractions included; `to` 0 is the last. Throws
/// std::invalid_argument for an unsound system.
Eigen::Matrix2d system_matrix(const System& system, int from, int to) {
  system.check();
  if (to == 0) to = system.size();
  if (from < 2 || from > to)
    throw std::invalid_argument("from: must be a refracting surface before the last");
  if (to > system.size())
    throw std::invalid_argument("to: the system has no surface " + std::to_string(to));
  Eigen::Matrix2d matrix = Eigen::Matrix2d::Identity();
  for (int i = from - 1; i < to; ++i) {
    const Surface& before = system.surfaces[i - 1];
    const Surface& at = system.surfaces[i];
    if (i >= from) matrix = medium_matrix(before) * matrix;
    const double reached = before.index + before.gradient.value({0, 0, before.thickness});
    const double radius = at.is_toric() ? 2 / (1 / at.radius + 1 / at.radius_y) : at.radius;
    matrix = refraction_matrix(reached, at.index, radius) * matrix;
  }
  return checked(matrix);
}

/// Principal points by (4.7), (4.8); focal and nodal points follow from them: in media n_v and n_i
/// the focal lengths are n_v f and n_i f, and a nodal point lies the other side's focal length from
/// the focus.
std::optional<CardinalPoints> cardinal_points(const System& system) {
  const Eigen::Matrix2d a = system_matrix(system);
  const double power = -a(0, 1);
  const double front = front_index(system);
  const double back = back_index(system);
  if (std::abs(power) < kAfocal) return std::nullopt;
  CardinalPoints points;
  points.focal_length = 1 / power;  // (4.6)
  points.front_focal_length = front / power;
  points.back_focal_length = back / power;
  points.first_principal_point = front * (1 - a(0, 0)) / power;  // (4.7)
  points.second_principal_point = back * (a(1, 1) - 1) / power;  // (4.8)
  points.front_focus = points.first_principal_point - points.front_focal_length;
  points.back_focus = points.second_principal_point + points.back_focal_length;
  points.first_nodal_point = points.front_focus + points.back_focal_length;
  points.second_nodal_point = points.back_focus - points.front_focal_length;
  return points;
}

/// Nothing where the image is at infinity: rays from the object leave parallel, b00 = 0. The rows
/// of B are (n angle, height).
std::optional<AxialImage> axial_image(const System& system, double depth) {
  const Eigen::Matrix2d b = from_object(system, depth);
  if (std::abs(b(0, 0)) < kAfocal) return std::nullopt;
  AxialImage image;
  // All rays from the object's axial point meet again where b10 + (s / n_i) b00 = 0.
  image.distance = -back_index(system) * b(1, 0) / b(0, 0);
  image.magnification = 1 / b(0, 0);  // det B = 1
  // Longitudinal magnification: (n_i / n_v) m^2.
  image.longitudinal =
      image.magnification * image.magnification * back_index(system) / front_index(system);
  return image;
}

/// A change of the magnification's sign within the range means that the image passed infinity.
/// Of the image's position over depth, both in m: the mean of the longitudinal magnification over
/// the range.
std::optional<double> secant_slope(const System& system, double depth) {
  detail::require(depth > 0, "depth: must be positive");
  const auto from = axial_image(system, 0);
  const auto to = axial_image(system, depth);
  if (!from || !to || (from->magnification > 0) != (to->magnification > 0)) return std::nullopt;
  return (to->distance - from->distance) / depth;
}

}  // namespace vitreo::optics
