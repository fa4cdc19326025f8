// Assets: the files of the workbench's page, as the build embedded them (host/serve/page.cmake).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/web_server.h"

#include <vector>

namespace vitreo::serve {

/// Where the build had no Node, one page that says how to get the real one; always with
/// /openapi.json.
std::vector<view::Asset> workbench_assets();

}  // namespace vitreo::serve
