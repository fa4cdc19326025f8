// SPDX-License-Identifier: Apache-2.0
#include "optics/system/system.h"

#include "optics/system/profile.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

[[noreturn]] void refuse(int surface, const std::string& why) {
  throw std::invalid_argument("surface " + std::to_string(surface) + ": " + why);
}

/// Refuses values that no real surface or medium has; the limits are far beyond any eye or lens.
/// `number` counts from 1, as the thesis does; the last surface's thickness is of no consequence
/// and not checked.
void check_surface(const Surface& surface, int number, bool last) {
  if (std::isnan(surface.radius) || surface.radius == 0)
    refuse(number, "radius must not be zero or NaN");
  if (!std::isfinite(surface.conic)) refuse(number, "conic must be finite");
  for (double a : surface.aspheric) {
    if (!std::isfinite(a)) refuse(number, "aspheric coefficients must be finite");
  }
  if (!last && !(surface.thickness >= 0 && std::isfinite(surface.thickness))) {
    refuse(number, "thickness must be finite and not negative");
  }
  constexpr double kLargestIndex = 10;  // of anything that light passes
  if (!(surface.index >= 1 && surface.index <= kLargestIndex))
    refuse(number, "index must lie within 1 and 10");
  if (!(surface.semi_diameter > 0)) refuse(number, "semi_diameter must be positive");
}

template <std::size_t kCount>
bool all_finite(const std::array<double, kCount>& values) {
  return std::all_of(values.begin(), values.end(), [](double x) { return std::isfinite(x); });
}

/// What a surface of revolution in a homogeneous medium does not have.
void check_skew(const Surface& surface, int number, bool last) {
  constexpr double kMostTilt = 1.2;    // rad; light that goes along the axis must meet its front
  constexpr double kMostDecenter = 1;  // m
  const Placement& placed = surface.placement;
  if (!(placed.tilt.allFinite() && placed.tilt.head<2>().cwiseAbs().maxCoeff() <= kMostTilt))
    refuse(number, "tilt must lie within -1.2 and 1.2 rad about x and y");
  if (!(placed.decenter.allFinite() && placed.decenter.cwiseAbs().maxCoeff() <= kMostDecenter))
    refuse(number, "decenter must lie within -1 and 1 m");
  if (std::isnan(surface.radius_y)) refuse(number, "radius_y must not be NaN");
  if (!std::isfinite(surface.conic_y)) refuse(number, "conic_y must be finite");
  if (number == 1 && (!placed.is_none() || surface.is_toric())) {
    refuse(number,
           "the retina is centered and no toric: the eye frame is its own, so place the others");
  }
  if (!all_finite(surface.gradient.along) || !all_finite(surface.gradient.across))
    refuse(number, "gradient must be finite");
  if ((number == 1 || last) && !surface.gradient.is_none())
    refuse(number, "gradient: the vitreous and what is behind the last surface have none");
}

/// Where both surfaces have a rim, the medium between them must have a thickness up to the smaller
/// rim. Surfaces without a rim may meet somewhere outside; rays that come there are lost as missed,
/// and so are those of surfaces off the axis. Sampled at 16 heights, since two aspheres may meet
/// between axis and rim.
void check_gap(const Surface& front, const Surface& behind, int number) {
  constexpr int kSteps = 16;
  constexpr double kRounding = 1e-12;  // m: of surfaces in contact
  const double rim = std::min(front.semi_diameter, behind.semi_diameter);
  const bool centered = front.placement.is_none() && behind.placement.is_none();
  if (!std::isfinite(rim) || !centered || front.is_toric() || behind.is_toric()) return;
  for (int i = 1; i <= kSteps; ++i) {
    const double r = rim * i / kSteps;
    const double gap = front.thickness + behind.sag(r) - front.sag(r);
    if (gap < -kRounding) {
      refuse(number, "thickness is too small: it crosses surface " + std::to_string(number + 1) +
                         " at " + std::to_string(r * 1e3) + " mm from the axis");
    }
  }
}

}  // namespace

/// (3.1)
/// NaN where the conic part does not reach out to r.
double Surface::sag(double r) const {
  return detail::profile(1 / radius, conic, aspheric, r * r).sag;
}

bool System::is_symmetric() const {
  return std::all_of(surfaces.begin(), surfaces.end(),
                     [](const Surface& one) { return one.placement.is_none() && !one.is_toric(); });
}

bool System::is_graded() const {
  return std::any_of(surfaces.begin(), surfaces.end(),
                     [](const Surface& one) { return !one.gradient.is_none(); });
}

void System::require_centered() const {
  for (int i = 0; i < size(); ++i) {
    const Surface& one = surfaces[i];
    if (!one.placement.is_none()) refuse(i + 1, "is off the axis, which is not supported here");
    if (one.is_toric()) refuse(i + 1, "is toric, which is not supported here");
    if (!one.gradient.is_none())
      refuse(i + 1, "has a gradient behind it, which is not supported here");
  }
}

/// The sum of the thicknesses before it.
double System::vertex(int surface) const {
  if (surface < 1 || surface > size()) {
    throw std::invalid_argument("surface: " + std::to_string(surface) + " is not in 1.." +
                                std::to_string(size()));
  }
  double z = 0;
  for (int i = 0; i < surface - 1; ++i) z += surfaces[i].thickness;
  return z;
}

/// Surface 1 is the retina, which does not refract: only its thickness and index count in a trace.
/// Called once by what keeps a system, so that a trace need not test its surfaces.
void System::check() const {
  if (size() < 2)
    throw std::invalid_argument(
        "surfaces: a system needs the retina and at least one refracting surface");
  for (int i = 0; i < size(); ++i) {
    check_surface(surfaces[i], i + 1, i + 1 == size());
    check_skew(surfaces[i], i + 1, i + 1 == size());
  }
  if (!(wavelength > 0)) throw std::invalid_argument("wavelength: must be positive");
  for (int i = 1; i + 1 < size(); ++i) check_gap(surfaces[i], surfaces[i + 1], i + 1);
  if (!stop) return;
  if (stop->surface < 2 || stop->surface > size()) {
    throw std::invalid_argument("stop: surface " + std::to_string(stop->surface) +
                                " does not refract in this system");
  }
  if (!(stop->radius > 0 && std::isfinite(stop->radius))) {
    refuse(stop->surface, "stop radius must be finite and positive");
  }
}

/// By differences, so that two steps of wavelength are as one and the way back leads to the same
/// index.
System at_wavelength(const System& system, double wavelength) {
  System made = system;
  for (Surface& surface : made.surfaces) {
    surface.index += model_index(surface.dispersion, wavelength) -
                     model_index(surface.dispersion, system.wavelength);
  }
  made.wavelength = wavelength;
  made.check();
  return made;
}

}  // namespace vitreo::optics
