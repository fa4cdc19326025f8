// Prescription as a plain table of rows, the form that scripts and files use.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/system/prescriptions.h"

#include <array>
#include <limits>
#include <string>
#include <vector>

namespace vitreo::optics {

/// One surface. SI as everywhere: lengths in m, a4 to a10 in m^-3 to m^-9. What is left out has
/// these values.
struct PrescriptionRow {
  std::string surface;  // empty: "surface_N"
  std::string medium;   // empty: "medium_N"
  double radius = std::numeric_limits<double>::infinity();
  double conic = 0;
  std::array<double, 4> aspheric{};
  double thickness = 0;
  double index = 1;
  double semi_diameter = std::numeric_limits<double>::infinity();
};

struct PrescriptionTable {
  std::string name;
  std::string title;
  std::string source;
  std::vector<PrescriptionRow> rows;  // the first is the retina
  int stop_surface = 0;               // counted from 1; 0: no stop
  double stop_radius = 0;
};

/// Both directions keep every bit. from_rows throws std::invalid_argument naming the row's surface
/// and its field, also for a table that is too long to be meant.
PrescriptionTable to_rows(const Prescription& prescription);
Prescription from_rows(const PrescriptionTable& table);

}  // namespace vitreo::optics
