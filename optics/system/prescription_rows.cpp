// SPDX-License-Identifier: Apache-2.0
#include "optics/system/prescription_rows.h"

#include <stdexcept>

namespace vitreo::optics {
namespace {

/// No lens has so many surfaces; a longer table is a mistake, and tracing it would take long.
constexpr std::size_t kMostRows = 1000;

/// So that each surface and medium has a name that parameters can be found by.
std::string name_or(const std::string& name, const char* otherwise, std::size_t number) {
  return name.empty() ? otherwise + std::to_string(number) : name;
}

}  // namespace

/// Copies of the same doubles, no units converted: the round trip keeps every bit.
PrescriptionTable to_rows(const Prescription& prescription) {
  prescription.check();
  PrescriptionTable table{prescription.name, prescription.title, prescription.source, {}, 0, 0, 0};
  table.wavelength = prescription.system.wavelength;
  for (std::size_t i = 0; i < prescription.surfaces.size(); ++i) {
    table.rows.push_back(
        {prescription.system.surfaces[i], prescription.surfaces[i], prescription.media[i]});
  }
  if (prescription.system.stop) {
    table.stop_surface = prescription.system.stop->surface;
    table.stop_radius = prescription.system.stop->radius;
  }
  return table;
}

/// Names left out are numbered from 1, as the thesis counts surfaces.
/// Rows may come from a script: they are bounded and checked before anything is traced.
Prescription from_rows(const PrescriptionTable& table) {
  if (table.rows.size() > kMostRows) {
    throw std::invalid_argument("rows: " + std::to_string(table.rows.size()) + " are more than " +
                                std::to_string(kMostRows));
  }
  Prescription made{table.name, table.title, table.source, {}, {}, {}};
  made.system.name = table.title.empty() ? table.name : table.title;
  for (const PrescriptionRow& row : table.rows) {
    const std::size_t number = made.surfaces.size() + 1;
    made.surfaces.push_back(name_or(row.surface, "surface_", number));
    made.media.push_back(name_or(row.medium, "medium_", number));
    made.system.surfaces.push_back(row);
  }
  made.system.wavelength = table.wavelength;
  if (table.stop_surface != 0) made.system.stop = Stop{table.stop_surface, table.stop_radius};
  made.check();
  return made;
}

}  // namespace vitreo::optics
