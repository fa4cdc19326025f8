// Assets: the files of the page, as the build embedded them (host/view/embed.cmake).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/view/web_server.h"

#include <vector>

namespace vitreo::view {

/// Where the build had no Node, one page that says how to get the real one.
std::vector<Asset> page_assets();

}  // namespace vitreo::view
