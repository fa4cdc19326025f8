// Parameters of a run as text, with their units.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <string>

namespace vitreo {

/// Enough for every value that was typed, too few for the last bit of 0.1 + 0.2.
constexpr int kParameterDigits = 6;

/// The unit as the protocol declares it, "mm/s"; "" for plain numbers and what is no number.
std::string parameter_unit(const RunStart& start, const std::string& name);

/// For people: "1 mm", "100 µm", "true"; "" where nothing was chosen. `value` is the SI value in
/// RunStart::parameters.
std::string parameter_text(const RunStart& start, const std::string& name,
                           const nlohmann::json& value);
/// As it can be typed back: "100 um".
std::string plain_parameter_text(const RunStart& start, const std::string& name,
                                 const nlohmann::json& value);

}  // namespace vitreo
