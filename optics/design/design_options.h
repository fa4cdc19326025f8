// Options of a lens design: variables with bounds, fields, weights of the merit and constraints.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <limits>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::optics {

/// What may change: a ".radius", ".conic", ".a4" to ".a10" or ".thickness" of a prescription by its
/// name there, and between what (SI, both inside). A bounded radius keeps its sign; an unbounded
/// one may pass through the plane.
struct DesignVariable {
  std::string parameter;
  double lower = -std::numeric_limits<double>::infinity();
  double upper = std::numeric_limits<double>::infinity();
};

/// What of the system as given must stay, to 1 um and to 1e-4 of the focal length.
enum class DesignKeeps { nothing, image_distance, focal_length };

struct LensDesignOptions {
  std::vector<DesignVariable> variables;
  /// rad, at the stop's center: the fields that count, alike. The first is where image_distance is
  /// kept.
  std::vector<double> angles = default_angles();
  double depth = 0;  // m before the retina: the surface whose image is to be flat
  // of each bundle: disc_samples
  int rings = 6;
  int arms = 12;
  double flatness_weight = 1;  // of a best focus' distance from the mean of all
  double spot_weight = 0.3;    // of a spot's rms radius at its best focus
  // m, rms radius at best focus, of any field
  double max_spot = std::numeric_limits<double>::infinity();
  DesignKeeps keeps = DesignKeeps::focal_length;
  /// m; out to here designed surfaces rise or fall without turning, and thicknesses hold. Nothing:
  /// as far as bundles reach, at least.
  std::optional<double> aperture;
  // m, of glass between designed surfaces, at the aperture; air: no crossing
  double min_edge_thickness = 0.5e-3;
  double min_center_thickness = 0.1e-3;         // m, of any medium whose thickness is a variable
  int max_iterations = 500;                     // in all
  void check() const;                           // throws std::invalid_argument naming the option
  static std::vector<double> default_angles();  // 0, 5, ... 30 degrees
};

}  // namespace vitreo::optics
