// SPDX-License-Identifier: Apache-2.0
#include "optics/design/design_options.h"

#include "optics/numerics/preconditions.h"

#include <cmath>
#include <numbers>

namespace vitreo::optics {

/// The field of thesis 3.2, 60 degrees in all, every 5 degrees.
std::vector<double> LensDesignOptions::default_angles() {
  std::vector<double> angles;
  for (int degrees = 0; degrees <= 30; degrees += 5)
    angles.push_back(degrees * std::numbers::pi / 180);
  return angles;
}

/// Throws std::invalid_argument naming the option; whether a variable exists is known to the
/// Designer alone, which has the prescription.
void LensDesignOptions::check() const {
  const auto length = [](double x) { return std::isfinite(x) && x >= 0; };
  detail::require(!variables.empty(), "variables: nothing to design");
  for (const DesignVariable& v : variables) {
    detail::require(v.lower <= v.upper,
                    ("variables: " + v.parameter + " has bounds that leave nothing").c_str());
  }
  detail::require(angles.size() >= 2 && angles.size() <= 1000,
                  "angles: at least 2, at most 1000 fields");
  for (double angle : angles) {
    detail::require(angle >= 0 && angle < std::numbers::pi / 2,
                    "angles: must lie between 0 and 90 degrees");
  }
  detail::require_not_negative(depth, "depth");
  detail::require(rings >= 2 && rings <= 100, "rings: must lie within 2 and 100");
  detail::require(arms >= 4 && arms <= 1000 && arms % 2 == 0,
                  "arms: an even number within 4 and 1000");
  detail::require_not_negative(flatness_weight, "flatness_weight");
  detail::require_not_negative(spot_weight, "spot_weight");
  detail::require(flatness_weight > 0 || spot_weight > 0,
                  "spot_weight: and flatness_weight are zero");
  detail::require(max_spot > 0, "max_spot: must be positive");
  detail::require(!aperture || (length(*aperture) && *aperture > 0), "aperture: must be positive");
  detail::require_not_negative(min_edge_thickness, "min_edge_thickness");
  detail::require_not_negative(min_center_thickness, "min_center_thickness");
  detail::require(max_iterations >= 1, "max_iterations: must be at least 1");
}

}  // namespace vitreo::optics
