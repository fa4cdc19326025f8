// The field calibrations that ETH's software writes (MPEM, YAML): read and write.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/multipole_field.h"

#include <string>
#include <string_view>

namespace vitreo::control {

struct FieldCalibrationFile {
  std::string system_name;  // may be empty
  MultipoleField field;
};

/// Keys: Coil_List; per coil Source_List and per source A_Coeff, B_Coeff (a list, or ~ for none),
/// Source_Position (m), Source_Direction; Workspace_Dimensions, [low, high] in m for x, y, z;
/// optional System_Name. A coil named Offset in Coil_List is the field without current, in T where
/// the others are T/A. Coils come in the order of Coil_List. Other keys are passed over. Throws
/// std::invalid_argument that begins with "line N: " and names the key.
FieldCalibrationFile parse_field_calibration(std::string_view text);

/// The same format; parses back to the same numbers, to the bit.
std::string field_calibration_text(const FieldCalibrationFile& file);

}  // namespace vitreo::control
