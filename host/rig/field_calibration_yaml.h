// Field calibrations (MPEM) as YAML, the format of ETH's software: reader and writer.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_calibration.h"

#include <string>
#include <string_view>

namespace vitreo {

/// Keys: Coil_List; per coil Source_List and per source A_Coeff, B_Coeff (a list, or ~ for none),
/// Source_Position (m), Source_Direction; Workspace_Dimensions, [low, high] in m for x, y, z;
/// optional System_Name. A coil of Coil_List whose name contains "Offset" is the field without
/// current, in T where the others are T/A. Coils come in the order of Coil_List. Other keys are
/// passed over. As in ETH's reader (mpem's ElectromagnetCalibration) a vector may be a column,
/// [[x], [y], [z]], and a direction is normalized: silently when its norm is 1 within 1e-3, with a
/// warning within 5 %; beyond it is refused.
/// The text has at most 1 MiB, nodes are nested at most 32 deep, and there are at most 50 000 of
/// them, aliases counted as what they stand for.
/// Throws std::invalid_argument that begins with "line N: " and names the key.
control::FieldCalibration parse_field_calibration(std::string_view text);

/// The same format; parses back to the same numbers, to the bit.
std::string field_calibration_text(const control::FieldCalibration& calibration);

}  // namespace vitreo
