// Focus measures of the field, and their names.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>
#include <vector>

namespace vitreo::vision {

/// All are means over the window's pixels, so windows of different size compare. mu: mean gray
/// level, s^2: variance. Names as in the comparisons of Sun, Duthaler & Nelson (2004) and Pertuz,
/// Puig & Garcia (2013).
enum class FocusMeasure {
  /// s^2/mu, the thesis' (section 4.4.1, Sun 2004): follows the lamp's flicker.
  normalized_variance,
  variance_over_mean_squared,  ///< s^2/mu^2: independent of the lamp
  tenengrad,                   ///< Gx^2 + Gy^2 of Sobel's gradient (Tenenbaum 1970, Krotkov 1987)
  smoothed_tenengrad,  ///< the same on an image smoothed with sigma 1 px, over mu^2: the default
  brenner,             ///< (I(u+2) - I(u))^2 (Brenner et al. 1976)
  /// Variance of the 4-neighbor Laplacian (Pech-Pacheco et al. 2000); poor in little light.
  laplacian_variance,
  /// |2I - I(u-1) - I(u+1)| + |2I - I(v-1) - I(v+1)| (Nayar & Nakagawa 1994); poor in little light.
  modified_laplacian,
  vollath4,  ///< I(u) I(u+1) - I(u) I(u+2) (Vollath 1987, F4)
};
constexpr FocusMeasure kDefaultFocusMeasure = FocusMeasure::smoothed_tenengrad;

const std::vector<FocusMeasure>& focus_measures();
std::string_view name_of(FocusMeasure measure);
/// By name, as written above. Throws std::invalid_argument that lists the names.
FocusMeasure focus_measure(std::string_view name);

}  // namespace vitreo::vision
