// Registration refinement: Gauss-Newton on the gray values of two flattened views.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/registration_view.h"

#include <Eigen/Geometry>

#include <optional>

namespace vitreo::vision {

struct ViewOverlap {
  double correlation = 0;
  double share = 0;
};

/// Pearson's correlation of the two views in their overlap at this level, and the overlap's share;
/// sampled at every `step`-th pixel; `second_from_first` in pixels of the level.
ViewOverlap overlap_of(const RegistrationView& first, const RegistrationView& second,
                       const Eigen::Affine2d& second_from_first, int level, int step);

/// Improves `second_from_first`, in pixels of the level: inverse compositional Gauss-Newton (Baker
/// & Matthews 2004) on gray values standardized over the overlap, with Cauchy weights. Returns the
/// standard deviation of the overlap's points by the noise, as a distance, px of the level, or
/// nothing when the views slid off each other.
std::optional<double> refine_at_level(const RegistrationView& first, const RegistrationView& second,
                                      Eigen::Affine2d& second_from_first, int level,
                                      ViewModel model);

/// How the overlap's parts, each on its own, agree with a pose: how many show structure, how many
/// of them correlate, and by how much these would be moved, px of the level. What is smooth in it
/// is what the pose's model cannot follow: a quadratic field is fitted, which two shifted views of
/// one distortion (of third order) differ by.
struct PartAgreement {
  int parts = 0;
  int agreeing = 0;
  double rms_px = 0;          // root mean square of a coordinate
  double field_px = 0;        // of the field, root mean square distance over the parts
  double field_noise_px = 0;  // of that, what noise alone brings
};
PartAgreement agreement_of(const RegistrationView& first, const RegistrationView& second,
                           const Eigen::Affine2d& second_from_first, int level);

}  // namespace vitreo::vision
