// Camera model: projection of points, lines of sight and viewpoints by the single viewpoint (5.2)
// to (5.14) or by the exact projection, behind one interface that is not templated.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/projection/exact_projection.h"
#include "optics/projection/single_viewpoint.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo::optics::detail {

/// Borrows both. With `exact`, the single viewpoint is not used.
class ProjectionModel {
 public:
  ProjectionModel(const SingleViewpoint& view, const std::optional<ExactProjection>& exact,
                  const ImageScale& image)
      : view_(view), exact_(exact), image_(image) {}
  /// The pixel of a point; bounded by the projection's table alone, not by retina and lens.
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector3d& point) const;
  /// The viewpoint for a body near the point: where the lines of sight past it meet.
  std::optional<Eigen::Vector3d> viewpoint(const Eigen::Vector3d& point) const;
  /// The line of the points that a pixel shows. Nothing outside the projection.
  std::optional<Ray> line_of_sight(const Eigen::Vector2d& pixel_px) const;
  /// The same as x = at_retina + slope z, with its derivatives by the pixel in place of m: what
  /// silhouettes are computed from. False outside the projection.
  bool sight(const Eigen::Vector2d& pixel_px, IsopixelLine& line) const;
  /// Whether the point is in the vitreous, or up to `behind_retina` m behind the retina, and has an
  /// image.
  bool inside(const Eigen::Vector3d& point, double behind_retina = 0) const;
  double max_z() const { return exact_ ? exact_->max_z() : view_.max_z; }

 private:
  const SingleViewpoint& view_;
  const std::optional<ExactProjection>& exact_;
  const ImageScale& image_;
};

}  // namespace vitreo::optics::detail
