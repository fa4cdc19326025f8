// Gauss-Newton on the gray values of two flattened views: the last step of a registration.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/registration.h"

namespace vitreo::vision {

struct ViewOverlap {
  double correlation = 0, share = 0;
};

/// Of the two views at this level, sampled at every `step`-th pixel; `second_from_first` in pixels
/// of the level.
ViewOverlap overlap_of(const RegistrationView& first, const RegistrationView& second,
                       const Eigen::Affine2d& second_from_first, int level, int step);

/// Improves `second_from_first`, in pixels of the level; the standard deviation of the overlap's
/// points, px of the level, or nothing when the views slid off each other.
std::optional<double> refine_at_level(const RegistrationView& first, const RegistrationView& second,
                                      Eigen::Affine2d& second_from_first, int level,
                                      ViewModel model);

}  // namespace vitreo::vision
