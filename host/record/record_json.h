// JSON of the record: plots, and the one form in which JSON is written.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"

#include <nlohmann/json.hpp>

#include <string>

namespace vitreo {

/// On one line; what is not UTF-8 is replaced, never thrown about.
std::string dumped(const nlohmann::json& json);

nlohmann::json plot_json(const Plot& plot);
/// Throws nlohmann::json::exception for what plot_json() did not write.
Plot plot_from_json(const nlohmann::json& json);

}  // namespace vitreo
