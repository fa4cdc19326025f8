// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/exact_projection.h"

#include "optics/numerics/preconditions.h"
#include "optics/system/frames.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// A traced ray as the line x = at_retina + slope z.
/// The function refers to the system and the microscope and must not outlive them.
detail::TraceLine tracer_of(const System& system, const Microscope& microscope) {
  return [&system, microscope](const Eigen::Vector2d& m) -> std::optional<detail::TracedLine> {
    const auto ray = isopixel_line(system, microscope, m);
    if (!ray) return std::nullopt;
    const Eigen::Vector2d slope = ray->direction.head<2>() / ray->direction.z();
    return detail::TracedLine{ray->origin.head<2>() - ray->origin.z() * slope, slope};
  };
}

}  // namespace

/// A decentered telecentric microscope takes the same rays as a centered one; only m counts from
/// its own axis, which shift_ undoes.
/// Throws std::invalid_argument naming max_m where too few rays come through. `tabulated` asks for
/// the grid even of a symmetric chain, so that a test can compare both.
ExactProjection::ExactProjection(const System& system, const Microscope& microscope, double max_m,
                                 bool tabulated) {
  system.check();
  microscope.check();
  detail::require_positive(max_m, "max_m");
  const bool telecentric = !std::isfinite(microscope.pupil_distance);
  symmetric_ = !tabulated && system.is_symmetric() && microscope.tilt.isZero(0) &&
               (telecentric || microscope.decenter.isZero(0));
  Microscope traced = microscope;
  if (symmetric_) {
    traced.decenter.setZero();
    shift_ = microscope.decenter;
  }
  vitreous_.surfaces.assign(system.surfaces.begin(), system.surfaces.begin() + 2);
  const detail::TraceLine trace = tracer_of(system, traced);
  if (symmetric_) {
    radial_ = detail::RadialLines(trace, max_m);
  } else {
    grid_ = detail::GridLines(trace, max_m);
  }
  find_max_z(system);
  check_against_trace(trace);
}

/// The largest z at which neighboring lines keep apart: x = a(m) + z s(m) has the derivative A + z
/// S by m, which is singular where an eigenvalue of A^-1 S is -1 / z. Beyond, one point has several
/// images.
/// Sampled over the whole table of a microscope without symmetry; one meridian stands for all of a
/// symmetric one.
void ExactProjection::find_max_z(const System& system) {
  constexpr int kSteps = 64;
  const int across = symmetric_ ? 0 : kSteps;
  constexpr double kNearViewpoint = 0.95;  // beyond, the image of a point grows without bound
  double crossing = system.vertex(2) / kNearViewpoint;
  for (int i = -kSteps; i <= kSteps; ++i) {
    for (int j = -across; j <= across; ++j) {
      const Eigen::Vector2d m = max_m() / kSteps * Eigen::Vector2d(i, j);
      if (symmetric_ ? !radial_.covers(m) : !grid_.covers(m)) continue;
      const detail::IsopixelLine line = symmetric_ ? radial_.line(m) : grid_.line(m);
      const Eigen::Matrix2d per_z = line.at_retina_per_m.inverse() * line.slope_per_m;
      for (const std::complex<double>& power : per_z.eigenvalues()) {
        if (power.real() < 0) crossing = std::min(crossing, -1 / power.real());
      }
    }
  }
  max_z_ = kNearViewpoint * crossing;
}

/// Largest distance of the table from traced lines, in m of the aerial image, at both ends of the
/// vitreous, as the difference of two straight lines is largest at an end.
/// Nodes would agree by construction, so the test looks between them. The line's distance is turned
/// into one of m by (dx/dm)^-1.
void ExactProjection::check_against_trace(const detail::TraceLine& trace) {
  constexpr int kAcross = 23;  // no divisor of the table's own nodes
  for (int i = 0; i <= kAcross; ++i) {
    for (int j = 0; j <= (symmetric_ ? 0 : kAcross); ++j) {
      const Eigen::Vector2d m(max_m() * (2.0 * i / kAcross - 1),
                              symmetric_ ? 0 : max_m() * (2.0 * j / kAcross - 1));
      if (symmetric_ ? !radial_.covers(m) : !grid_.covers(m)) continue;
      const auto traced = trace(m);
      if (!traced) continue;
      const detail::IsopixelLine line = symmetric_ ? radial_.line(m) : grid_.line(m);
      for (const double z : {0.0, max_z_}) {
        const Eigen::Vector2d off = line.per_m(z).inverse() * (line.at(z) - traced->at(z));
        max_residual_ = std::max(max_residual_, off.norm());
      }
    }
  }
}

/// By the implicit function theorem dm/dx = (dx/dm)^-1 at constant z.
/// m counts from the table's own axis here; project_with_jacobian undoes the shift.
bool ExactProjection::solve(const Eigen::Vector3d& point, Solution& found) const {
  if (!(point.z() <= max_z_)) return false;
  if (!(symmetric_ ? radial_.solve(point, found.m, found.line)
                   : grid_.solve(point, found.m, found.line)))
    return false;
  const Eigen::Matrix2d per_m = found.line.per_m(point.z());
  found.m_per_point = per_m.inverse();
  return true;
}

/// The public projection is bounded by retina and lens too.
/// Nothing behind the retina, in the lens, beyond max_z, or where no line of the table leads.
std::optional<ExactProjection::WithJacobian> ExactProjection::project_with_jacobian(
    const Eigen::Vector3d& point_in_eye) const {
  detail::require(point_in_eye.allFinite(), "point_in_eye: must be finite");
  constexpr double kRounding = 1e-9;  // m: a point computed to lie on the retina is on it
  const double r = point_in_eye.head<2>().norm();
  if (!(point_in_eye.z() >= vitreous_.surfaces[0].sag(r) - kRounding))
    return std::nullopt;  // NaN: beyond the retina's edge
  const double lens = surface_height(vitreous_, 2, point_in_eye.head<2>());
  if (!(point_in_eye.z() <= (std::isnan(lens) ? vitreous_.vertex(2) : lens)))
    return std::nullopt;  // NaN: it does not reach so far out
  Solution found;
  if (!solve(point_in_eye, found)) return std::nullopt;
  WithJacobian made;
  made.m = found.m - shift_;
  // x(m, z) = x: dm/dz = -(dx/dm)^-1 slope.
  made.per_point << found.m_per_point, -found.m_per_point * found.line.slope;
  return made;
}

std::optional<Eigen::Vector2d> ExactProjection::project(const Eigen::Vector3d& point_in_eye) const {
  const auto projected = project_with_jacobian(point_in_eye);
  if (!projected) return std::nullopt;
  return projected->m;
}

/// The isopixel line of m: the inverse of the projection but for the depth.
/// Nothing outside the table. `z` (m) only chooses the point of the line that is its origin.
std::optional<Ray> ExactProjection::line(const Eigen::Vector2d& m, double z) const {
  detail::require(m.allFinite() && std::isfinite(z), "m: must be finite");
  detail::IsopixelLine line;
  if (!this->line(m, line)) return std::nullopt;
  const Eigen::Vector2d at = line.at(z);
  return Ray{{at.x(), at.y(), z}, Eigen::Vector3d(line.slope.x(), line.slope.y(), 1).normalized()};
}

/// A grid with lost nodes has NaNs there.
bool ExactProjection::line(const Eigen::Vector2d& m, detail::IsopixelLine& line) const {
  const Eigen::Vector2d in_table = m + shift_;
  if (symmetric_) {
    if (!radial_.covers(in_table)) return false;
    line = radial_.line(in_table);
    return true;
  }
  if (!grid_.covers(in_table)) return false;
  line = grid_.line(in_table);
  return true;
}

}  // namespace vitreo::optics
