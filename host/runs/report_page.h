// Static parts of the report, as the build embedded them (host/runs/report/,
// host/runs/embed.cmake).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string_view>

namespace vitreo {

/// The HTML document, with {{title}}, {{style}}, {{sections}} and {{run}} where the run's own parts
/// go.
std::string_view report_page();
/// The style sheet, for screen and paper.
std::string_view report_style();

}  // namespace vitreo
