// Lens design (thesis 3.2): shapes of chosen surfaces that flatten the aerial image of the retina.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/analysis/field_curves.h"
#include "optics/system/prescriptions.h"

#include <limits>
#include <numbers>
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
  double depth = 0;            // m before the retina: the surface whose image is to be flat
  int rings = 6, arms = 12;    // of each bundle: disc_samples
  double flatness_weight = 1;  // of a best focus' distance from the mean of all
  double spot_weight = 0.3;    // of a spot's rms radius at its best focus
  double max_spot =
      std::numeric_limits<double>::infinity();  // m, rms radius at best focus, of any field
  DesignKeeps keeps = DesignKeeps::focal_length;
  /// m; out to here designed surfaces rise or fall without turning, and thicknesses hold. Nothing:
  /// as far as bundles reach, at least.
  std::optional<double> aperture;
  double min_edge_thickness =
      0.5e-3;  // m, of glass between designed surfaces, at the aperture; air: no crossing
  double min_center_thickness = 0.1e-3;         // m, of any medium whose thickness is a variable
  int max_iterations = 500;                     // in all
  void check() const;                           // throws std::invalid_argument naming the option
  static std::vector<double> default_angles();  // 0, 5, ... 30 degrees
};

/// converged: least merit, all constraints kept. The others name what stands in the way, and the
/// prescription is the best so far. rays_lost: a field's bundle does not come through whole.
/// constraint_violated: no lens near the start keeps all constraints.
enum class DesignStatus { converged, not_converged, rays_lost, constraint_violated };
const char* to_string(DesignStatus status);

/// How a lens images the fields, traced by the plain tracer.
struct LensImage {
  double merit = 0;  // m; sqrt(mean over fields of (flatness_weight off)^2 + (spot_weight rms)^2)
  double span = 0;   // m, largest less smallest best focus
  double max_spot = 0;  // m, rms radius at best focus
  double focal_length = 0;
  double image_distance = 0;  // m, best focus of the first field
  int lost_fields = 0;        // with rays lost; the figures above are of the others' rays
  std::vector<FieldPoint> fields;
};

struct DesignedParameter {
  std::string parameter;
  double before = 0, after = 0;  // SI
  bool at_bound = false;         // to a thousandth
};

struct LensDesign {
  Prescription prescription;
  DesignStatus status = DesignStatus::not_converged;
  std::string reason;  // empty when converged; else what fails, named with its figures
  LensImage before, after;
  std::vector<DesignedParameter> parameters;
  int iterations = 0;
};

/// Least squares of distances from a common focus, spot sizes and penalties on constraints, by
/// Ceres with derivatives of the traced system; four ways are gone (all at once, fields from the
/// axis outwards, low orders first, both) and the best end is kept. Fields whose bundles the start
/// loses (a spherical lens loses its edge) join as soon as they come through. Finds the optimum
/// near the start, no global one. Throws std::invalid_argument for bad options, naming them, and
/// when not one bundle comes through at the start.
LensDesign design_lens(const Prescription& start, const LensDesignOptions& options);

/// The figures of a lens as it stands, to compare with.
LensImage lens_image(const System& system, const LensDesignOptions& options);

}  // namespace vitreo::optics
