// Global adjustment of a mosaic (bundle adjustment): the poses of all views that agree best with
// all links between them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/mosaic_plan.h"

#include <opencv2/core/types.hpp>

namespace vitreo::vision {

/// Improves plan.mosaic_from_view, of which the view `fixed` stays, and fills the links' and the
/// plan's residuals. Every link joins views that have a pose. Least squares with Huber's loss over
/// a 5 x 5 grid of points per link, Ceres; then the worst link is dropped while one is off by more
/// than 3 px.
void adjust_mosaic(MosaicPlan& plan, const cv::Size& view_size, int fixed, ViewModel model);

/// Points of the second view, on a grid, that lie in the first as well.
std::vector<Eigen::Vector2d> common_points(const Eigen::Affine2d& first_from_second,
                                           const cv::Size& view_size);

}  // namespace vitreo::vision
