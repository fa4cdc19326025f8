// Registration of two views of one retina: searched without a guess, then refined to a fraction of
// a pixel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/registration_view.h"

#include <Eigen/Geometry>

#include <optional>

namespace vitreo::vision {

struct Registration {
  Eigen::Affine2d first_from_second = Eigen::Affine2d::Identity();  ///< px
  double correlation = 0;
  double overlap = 0;  ///< share of the second view
  /// Standard deviation of the overlap's points, as a distance: from the images' noise, from the
  /// smooth part of what parts of the overlap, each on its own, would be moved, and, of a retina at
  /// rest, from what the sensor's own structure moves.
  double sigma_px = 0;
  double agreeing = 1;  ///< share of the parts with structure that correlate
  /// Score of the search's other pose over that of this one; 0 without a search. Above 0.8 both
  /// are verified, and where both pass there is no answer; above 1 the better one did not pass.
  double second_peak = 0;
};

/// Without any guess: phase correlation (Kuglin & Hines 1975), partly whitened, at each angle of a
/// sweep and at a quarter of the resolution, then refine_registration(). Nothing when no pose fits.
/// Throws std::invalid_argument for views of different size.
std::optional<Registration> register_views(const RegistrationView& first,
                                           const RegistrationView& second,
                                           const RegistrationSettings& settings);

/// From a guess that is right within about 8 pixels: Gauss-Newton on the gray values, coarse to
/// fine (registration_refine.h). Throws std::invalid_argument when the guess is not finite or not
/// invertible, or for views of different size.
std::optional<Registration> refine_registration(const RegistrationView& first,
                                                const RegistrationView& second,
                                                const Eigen::Affine2d& first_from_second,
                                                const RegistrationSettings& settings);

}  // namespace vitreo::vision
