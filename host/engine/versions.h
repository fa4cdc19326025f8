// Versions of the program and of the libraries that it is built on.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>

namespace vitreo {

nlohmann::json versions();

}  // namespace vitreo
