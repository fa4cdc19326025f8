// SPDX-License-Identifier: Apache-2.0
#include "optics/rays/observer.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Geometry>

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {

/// Throws std::invalid_argument naming the value. An infinite pupil distance is telecentric and
/// allowed, a negative one lies on the eye's side.
void Microscope::check() const {
  constexpr double kMaxTilt = 0.5;  // rad; no microscope stands more obliquely to an eye
  detail::require(numerical_aperture > 0 && numerical_aperture < 1,
                  "numerical_aperture: must lie between 0 and 1");
  detail::require_finite(focus, "focus");
  if (std::isnan(pupil_distance) || pupil_distance == 0) {
    throw std::invalid_argument("pupil_distance: must not be zero or NaN");
  }
  detail::require(decenter.allFinite(), "decenter: must be finite");
  detail::require(tilt.allFinite() && tilt.cwiseAbs().maxCoeff() < kMaxTilt,
                  "tilt: must be below 0.5 rad");
}

/// The chief ray goes through the center of the microscope's entrance pupil: for a telecentric one
/// (pupil at infinity) it is parallel to the microscope's axis, else it points from m to the pupil.
/// `m` in the plane in focus, m from the microscope's axis; the ray is in the eye frame and goes
/// outwards.
Ray chief_ray_in_air(const System& system, const Microscope& microscope, const Eigen::Vector2d& m) {
  detail::require(m.allFinite(), "m: must be finite");
  const Eigen::Vector3d center(microscope.decenter.x(), microscope.decenter.y(),
                               system.vertex(system.size()) + microscope.focus);
  Eigen::Matrix3d eye_from_microscope = Eigen::Matrix3d::Identity();
  if (!microscope.tilt.isZero(0)) {
    // Tilt about x first, then about y, as the header says; rotations act right to left.
    eye_from_microscope = (Eigen::AngleAxisd(microscope.tilt.y(), Eigen::Vector3d::UnitY()) *
                           Eigen::AngleAxisd(microscope.tilt.x(), Eigen::Vector3d::UnitX()))
                              .toRotationMatrix();
  }
  Eigen::Vector3d direction(0, 0, 1);
  if (std::isfinite(microscope.pupil_distance)) {
    direction = Eigen::Vector3d(-m.x(), -m.y(), microscope.pupil_distance).normalized();
    if (direction.z() < 0)
      direction = -direction;  // the pupil lies on the eye's side: light comes from its direction
  }
  return {center + eye_from_microscope * Eigen::Vector3d(m.x(), m.y(), 0),
          eye_from_microscope * direction};
}

/// By the reversibility of light: the chief ray is traced inwards and its direction turned round.
/// Nothing where the ray is lost on its way in. The line's origin lies on surface 2, from where it
/// is straight in the vitreous.
std::optional<Ray> isopixel_line(const System& system, const Microscope& microscope,
                                 const Eigen::Vector2d& m) {
  // m. The plane in focus may lie before the last vertex (a virtual aerial image), so start well
  // outside.
  constexpr double kOutside = 0.1;
  const Ray chief = chief_ray_in_air(system, microscope, m);
  if (!(chief.direction.z() > 0)) return std::nullopt;
  const double ahead =
      (system.vertex(system.size()) + kOutside - chief.origin.z()) / chief.direction.z();
  const TraceResult back =
      trace_in(system, {chief.origin + ahead * chief.direction, -chief.direction});
  if (back.status != TraceStatus::ok) return std::nullopt;
  return Ray{back.ray.origin, -back.ray.direction};
}

}  // namespace vitreo::optics
