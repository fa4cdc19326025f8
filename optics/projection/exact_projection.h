// Exact projection: the aerial-image point of an intraocular point by the chain's own chief rays.
// It replaces the thesis' single viewpoint (5.2) to (5.11), whose simplification costs tens of
// micrometers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/numerics/scalar.h"
#include "optics/projection/isopixel_lines.h"
#include "optics/rays/observer.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics {

/// Isopixel lines are straight in the vitreous, so a table of them, by m, is the projection at
/// every depth; a point's m is found by Newton. Any microscope and any system: where all is
/// symmetric, or the microscope is telecentric and decentered only, by polynomials; else by a
/// grid. Outside the table, behind the retina, in the
/// lens, in the iris' shadow and beyond where lines cross it gives nothing.
class ExactProjection {
 public:
  /// Covers |m| up to max_m (of each component without symmetry; telecentric, from the eye's axis),
  /// or as far as rays come through. `tabulated`: forces the grid, for comparison. Throws
  /// std::invalid_argument for bad arguments, and when too few rays come through.
  ExactProjection(const System& system, const Microscope& microscope, double max_m,
                  bool tabulated = false);

  /// m of the aerial image. Throws std::invalid_argument when the point is not finite.
  std::optional<Eigen::Vector2d> project(const Eigen::Vector3d& point_in_eye) const;
  struct WithJacobian {
    Eigen::Vector2d m;
    Eigen::Matrix<double, 2, 3> per_point;
  };
  std::optional<WithJacobian> project_with_jacobian(const Eigen::Vector3d& point_in_eye) const;
  /// The line of m in the vitreous: a point on it at z and the unit direction, towards +z. Nothing
  /// outside the table.
  std::optional<Ray> line(const Eigen::Vector2d& m, double z = 0) const;
  /// The same line as x = at_retina + slope z, with its derivatives by m. False outside the table.
  bool line(const Eigen::Vector2d& m, detail::IsopixelLine& line) const;

  double max_m() const { return symmetric_ ? radial_.max_m() : grid_.max_m(); }
  double max_z() const { return max_z_; }  // m; beyond, lines cross or the lens is
  /// m in the aerial image, table against trace, where checked.
  double max_residual() const { return max_residual_; }
  bool symmetric() const { return symmetric_; }

  /// For Ceres' Jets too. Only the table bounds it: a silhouette's point may lie behind the retina.
  template <class T>
  bool project(const detail::Vector3<T>& point, detail::Vector2<T>& m) const {
    Solution found;
    if (!solve(value(point), found)) return false;
    m = lift(found, point);
    m.x() -= shift_.x();
    m.y() -= shift_.y();
    return true;
  }

  /// The point near which the lines that pass `point` closely all meet: half-way, in power, between
  /// their two foci. With x = a(m) + z s(m), a line that passes at dx from the point has the slope
  /// change ds/dm (dx/dm)^-1 dx; minus half the trace of that matrix is the mean power (1/m).
  template <class T>
  bool viewpoint_near(const detail::Vector3<T>& point, detail::Vector3<T>& viewpoint) const {
    Solution found;
    if (!solve(value(point), found)) return false;
    const Eigen::Matrix2d per_z = found.m_per_point * found.line.slope_per_m;
    const double power = -per_z.trace() / 2;  // 1/m, of the distance along z
    if (!(power > 0)) return false;
    detail::Vector2<T> off = lift(found, point);
    off.x() -= found.m.x();
    off.y() -= found.m.y();
    const Eigen::Matrix2d& change = found.line.slope_per_m;
    const double far = 1 / power;
    viewpoint.x() =
        point.x() + (found.line.slope.x() + change(0, 0) * off.x() + change(0, 1) * off.y()) * far;
    viewpoint.y() =
        point.y() + (found.line.slope.y() + change(1, 0) * off.x() + change(1, 1) * off.y()) * far;
    viewpoint.z() = point.z() + far;
    return true;
  }

 private:
  struct Solution {
    Eigen::Vector2d m;  // in the table's coordinates: m + shift_
    detail::IsopixelLine line;
    Eigen::Matrix2d m_per_point;
  };
  bool solve(const Eigen::Vector3d& point, Solution& found) const;
  void find_max_z(const System& system);
  void check_against_trace(const detail::TraceLine& trace);

  template <class T>
  static Eigen::Vector3d value(const detail::Vector3<T>& point) {
    return {detail::scalar(point.x()), detail::scalar(point.y()), detail::scalar(point.z())};
  }
  /// One Newton step in T from the solution: changes nothing in the value and gives the derivative.
  template <class T>
  static detail::Vector2<T> lift(const Solution& found, const detail::Vector3<T>& point) {
    const T x = point.x() - (found.line.at_retina.x() + found.line.slope.x() * point.z());
    const T y = point.y() - (found.line.at_retina.y() + found.line.slope.y() * point.z());
    return {found.m.x() + found.m_per_point(0, 0) * x + found.m_per_point(0, 1) * y,
            found.m.y() + found.m_per_point(1, 0) * x + found.m_per_point(1, 1) * y};
  }

  bool symmetric_;
  Eigen::Vector2d shift_{0, 0};  // m; of the table against the microscope's object plane
  detail::RadialLines radial_;
  detail::GridLines grid_;
  System vitreous_;  // retina and surface 2, between which a point must lie
  double max_z_ = 0;
  double max_residual_ = 0;
};

}  // namespace vitreo::optics
