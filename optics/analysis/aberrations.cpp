// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/aberrations.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/first_order.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A paraxial ray before a surface.
struct Paraxial {
  double height;  // m, at the surface
  double slope;   // u, before it
};

/// The two rays that third-order sums need: every other paraxial ray is a linear combination of
/// them.
struct Pair {
  Paraxial marginal;
  Paraxial chief;
};

/// Marginal ray from the axis to the rim of the stop, chief ray from the object's edge through the
/// stop's center, both at surface 2.
/// Object in the plane `depth` (m) before the retina's vertex, its edge `object_height` (m) off the
/// axis. The second row of b gives heights at the stop: the chief ray is the one with height 0
/// there, the marginal ray the one with the stop's radius.
Pair start(const System& system, double object_height, double depth) {
  const double index = system.surfaces.front().index;
  const double distance = system.surfaces.front().thickness - depth;
  // Height at the stop = b10 (n u) + b11 y of the object.
  const Eigen::Matrix2d b =
      system_matrix(system, 2, system.stop->surface) * transfer_matrix(distance, index);
  const double marginal = system.stop->radius / (b(1, 0) * index);
  const double chief = -b(1, 1) * object_height / (b(1, 0) * index);
  return {{marginal * distance, marginal}, {object_height + chief * distance, chief}};
}

/// What a surface does to light up to third order in height and angle; terms of r^6 and beyond have
/// no part in it.
struct Refraction {
  // indices
  double before;
  double behind;
  double curvature;  // 1/m
  double fourth;     // m^-3, coefficient of r^4 beyond the sphere's
};

/// Paraxial refraction, n' u' = n u - h c (n' - n).
double slope_behind(const Refraction& at, const Paraxial& ray) {
  return (at.before * ray.slope - ray.height * at.curvature * (at.behind - at.before)) / at.behind;
}

/// Seidel sums of one surface (Welford 1986, ch. 8), with A = n i = n (h c + u), Abar likewise of
/// the chief ray, D(.) the change at the surface and H = n (u hbar - ubar h) the Lagrange
/// invariant:
///  S_I = -A^2 h D(u/n), S_II = -A Abar h D(u/n), S_III = -Abar^2 h D(u/n), S_IV = -H^2 c D(1/n).
/// An asphere adds 8 a4' (n' - n) h^4 to S_I, and powers of hbar / h times that to the others.
/// `lagrange` is H; the caller takes it once, since it is the same at all surfaces.
SeidelSums sums_of(const Refraction& at, const Pair& rays, double lagrange) {
  const double h = rays.marginal.height;
  const double hbar = rays.chief.height;
  const double c = at.curvature;
  const double a = at.before * (h * c + rays.marginal.slope);
  const double abar = at.before * (hbar * c + rays.chief.slope);
  // D(u/n)
  const double by_slope =
      slope_behind(at, rays.marginal) / at.behind - rays.marginal.slope / at.before;
  const double by_index = 1 / at.behind - 1 / at.before;  // D(1/n)
  const double by_square = 1 / (at.behind * at.behind) - 1 / (at.before * at.before);
  SeidelSums sums;
  sums.spherical = -a * a * h * by_slope;
  sums.coma = -a * abar * h * by_slope;
  sums.astigmatism = -abar * abar * h * by_slope;
  sums.petzval = -lagrange * lagrange * c * by_index;
  // The form that stays finite where the marginal ray meets the surface at right angles (A = 0).
  sums.distortion =
      -abar * (abar * abar * by_square * h - (abar * h - lagrange) * hbar * c * by_index);
  // g = (k c^3 + 8 a4) (n' - n) of the asphere. A surface at the stop has hbar = 0, so there it
  // adds to S_I alone.
  const double g = 8 * at.fourth * (at.behind - at.before);
  sums.spherical += g * h * h * h * h;
  sums.coma += g * h * h * h * hbar;
  sums.astigmatism += g * h * h * hbar * hbar;
  sums.distortion += g * h * hbar * hbar * hbar;
  return sums;
}

/// Refraction and transfer to the next surface.
Paraxial advanced(const Paraxial& ray, const Refraction& at, double thickness) {
  const double slope = slope_behind(at, ray);
  return {ray.height + slope * thickness, slope};
}

}  // namespace

SeidelSums& SeidelSums::operator+=(const SeidelSums& other) {
  spherical += other.spherical;
  coma += other.coma;
  astigmatism += other.astigmatism;
  petzval += other.petzval;
  distortion += other.distortion;
  return *this;
}

/// From the wavefront at the rim of the pupil to focus: longitudinal shifts divide by n' u'^2, in
/// terms of n'u' as n' / (n' u')^2.
double Aberrations::longitudinal_spherical() const {
  return -index * total.spherical / (2 * marginal_slope * marginal_slope);
}
double Aberrations::tangential_field() const {
  return -index * (3 * total.astigmatism + total.petzval) / (2 * marginal_slope * marginal_slope);
}
double Aberrations::sagittal_field() const {
  return -index * (total.astigmatism + total.petzval) / (2 * marginal_slope * marginal_slope);
}
/// Positive means away from the axis, which for an inverted image is towards negative heights.
double Aberrations::distortion_height() const {
  const double across = total.distortion / (2 * marginal_slope);
  return image_height < 0 ? -across : across;
}

/// The pair is carried from surface to surface and the sums are added up as it goes, so that a
/// caller sees which surface causes what. The retina (surface 1) does not refract and has no sums.
Aberrations third_order_aberrations(const System& system, double object_height, double depth) {
  system.check();
  system.require_centered();
  if (!system.stop) throw std::invalid_argument("stop: the system has none");
  detail::require_finite(object_height, "object_height");
  const auto image = axial_image(system, depth);
  if (!image) throw std::invalid_argument("depth: the image of it lies at infinity");
  Pair rays = start(system, object_height, depth);
  const double n = system.surfaces.front().index;
  // H before surface 2, where both rays are known; refraction and transfer leave it unchanged.
  const double lagrange =
      n * (rays.marginal.slope * rays.chief.height - rays.chief.slope * rays.marginal.height);
  Aberrations result;
  double petzval = 0;
  for (int i = 1; i < system.size(); ++i) {
    const Surface& surface = system.surfaces[i];
    const double c = 1 / surface.radius;
    // A conic's r^4 term beyond the sphere's is k c^3 / 8, from the expansion of (3.1).
    const Refraction at{system.surfaces[i - 1].index, surface.index, c,
                        c * c * c * surface.conic / 8 + surface.aspheric[0]};
    result.surfaces.push_back(sums_of(at, rays, lagrange));
    result.total += result.surfaces.back();
    // Petzval's sum: curvature of the image is n' * sum c D(1/n).
    petzval += c * (1 / at.behind - 1 / at.before);
    // Behind the last surface only the slopes are wanted, so the pair is not carried on to the
    // image.
    const double thickness = i + 1 < system.size() ? surface.thickness : 0;
    rays = {advanced(rays.marginal, at, thickness), advanced(rays.chief, at, thickness)};
  }
  result.index = system.surfaces.back().index;
  result.image_distance = image->distance;
  result.image_height = image->magnification * object_height;
  result.marginal_slope = result.index * rays.marginal.slope;
  result.petzval_curvature = result.index * petzval;
  return result;
}

}  // namespace vitreo::optics
