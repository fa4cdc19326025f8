// SPDX-License-Identifier: Apache-2.0
#include "optics/projection/projection_model.h"

namespace vitreo::optics::detail {

/// (5.13): the pixel is K P(X), P the projection and K the microscope's matrix (5.12).
/// Nothing where the point has no image.
std::optional<Eigen::Vector2d> ProjectionModel::pixel(const Eigen::Vector3d& point) const {
  Eigen::Vector2d m;
  const bool projected =
      exact_ ? exact_->project<double>(point, m)
             : project<double>(view_, point - Eigen::Vector3d(0, 0, view_.viewpoint), m);
  if (!projected) return std::nullopt;
  return image_.pixel_from_m(m);
}

/// The thesis' viewpoint is one for all points; without that simplification each neighborhood of
/// lines has its own.
std::optional<Eigen::Vector3d> ProjectionModel::viewpoint(const Eigen::Vector3d& point) const {
  if (!exact_) return Eigen::Vector3d(0, 0, view_.viewpoint);
  Eigen::Vector3d from;
  if (!exact_->viewpoint_near<double>(point, from)) return std::nullopt;
  return from;
}

/// The direction leads away from the retina.
std::optional<Ray> ProjectionModel::line_of_sight(const Eigen::Vector2d& pixel_px) const {
  const Eigen::Vector2d m = image_.m_from_pixel(pixel_px);
  if (exact_) return exact_->line(m);
  const Eigen::Vector2d from_axis = m - view_.axis_m;
  const double height = from_axis.norm();
  if (!(height <= view_.max_m)) return std::nullopt;
  // The inverse of (5.10), (5.11): the azimuth of m, turned by pi, and the slope (5.2) of |m|.
  Eigen::Vector2d across(0, 0);
  if (height > 0) across = from_axis * (slope_at(view_, height) / height);
  return Ray{{0, 0, view_.viewpoint}, Eigen::Vector3d(across.x(), across.y(), 1).normalized()};
}

namespace {

/// The line through the viewpoint p_0 with the slope (5.2) of |m|, turned by pi in azimuth:
/// dx/dz = f m, f = slope(h) / h, h = |m|; its derivative is f I + f' m m^T / h.
bool single_sight(const SingleViewpoint& view, const Eigen::Vector2d& from_axis,
                  IsopixelLine& line) {
  constexpr double kOnAxis = 1e-9;  // m; the cubic is its tangent there
  const double h = from_axis.norm();
  if (!(h <= view.max_m)) return false;
  const double per = slope_derivative_at(view, h);
  const double ratio = h > kOnAxis ? slope_at(view, h) / h : slope_derivative_at(view, 0);
  line.slope = ratio * from_axis;
  line.slope_per_m = ratio * Eigen::Matrix2d::Identity();
  if (h > kOnAxis) line.slope_per_m += (per - ratio) / (h * h) * from_axis * from_axis.transpose();
  line.at_retina = -view.viewpoint * line.slope;
  line.at_retina_per_m = -view.viewpoint * line.slope_per_m;
  return true;
}

}  // namespace

/// m falls with u and grows with v (ImageScale).
bool ProjectionModel::sight(const Eigen::Vector2d& pixel_px, IsopixelLine& line) const {
  const Eigen::Vector2d m = image_.m_from_pixel(pixel_px);
  if (!(exact_ ? exact_->line(m, line) : single_sight(view_, m - view_.axis_m, line))) return false;
  for (Eigen::Matrix2d* by : {&line.at_retina_per_m, &line.slope_per_m}) {
    by->col(0) *= -image_.pixel;
    by->col(1) *= image_.pixel;
  }
  return true;
}

/// By an attempt: both projections know their own limits. The lines are straight, and go on behind
/// the retina.
bool ProjectionModel::inside(const Eigen::Vector3d& point, double behind_retina) const {
  const auto shown = [this](const Eigen::Vector3d& at) {
    return exact_ ? exact_->project(at).has_value() : view_.project(at).has_value();
  };
  return shown(point) || (behind_retina > 0 && pixel(point) &&
                          shown(point + behind_retina * Eigen::Vector3d::UnitZ()));
}

}  // namespace vitreo::optics::detail
