// Result of a lens design: prescription, status, changed parameters and image quality before and
// after.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/analysis/field_curves.h"
#include "optics/design/design_options.h"
#include "optics/system/prescriptions.h"

#include <string>
#include <vector>

namespace vitreo::optics {

/// converged: least merit, all constraints kept. The others name the obstacle, and the
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
  // SI
  double before = 0;
  double after = 0;
  bool at_bound = false;  // to a thousandth
};

struct LensDesign {
  Prescription prescription;
  DesignStatus status = DesignStatus::not_converged;
  std::string reason;  // empty when converged; else what fails, named with its figures
  LensImage before;
  LensImage after;
  std::vector<DesignedParameter> parameters;
  int iterations = 0;
};

/// The figures of a lens as it stands, to compare with.
LensImage lens_image(const System& system, const LensDesignOptions& options);

}  // namespace vitreo::optics
