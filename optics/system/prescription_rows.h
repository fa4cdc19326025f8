// Prescription as a plain table of rows, the form that scripts and files use.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/prescriptions.h"

#include <string>
#include <vector>

namespace vitreo::optics {

/// One surface with the names of itself and of the medium behind it. SI as everywhere: lengths in
/// m, a4 to a10 in m^-3 to m^-9.
struct PrescriptionRow : Surface {
  std::string surface;  // empty: "surface_N"
  std::string medium;   // empty: "medium_N"
};

struct PrescriptionTable {
  std::string name;
  std::string title;
  std::string source;
  std::vector<PrescriptionRow> rows;  // the first is the retina
  int stop_surface = 0;               // counted from 1; 0: no stop
  double stop_radius = 0;
  double wavelength = kReferenceWavelength;  // m, of the light that the indices are for
};

/// Both directions keep every bit. from_rows throws std::invalid_argument naming the row's surface
/// and its field, also for a table that is too long to be meant.
PrescriptionTable to_rows(const Prescription& prescription);
Prescription from_rows(const PrescriptionTable& table);

}  // namespace vitreo::optics
