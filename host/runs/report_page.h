// Static parts of the report, as the build embedded them (host/runs/report/,
// host/runs/embed.cmake).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

namespace vitreo {

/// The HTML document, with {{title}}, {{style}}, {{script_hash}}, {{sections}}, {{run}} and
/// {{script}} where the run's own parts go.
std::string_view report_page();
/// The style sheet, for screen and paper.
std::string_view report_style();
/// What makes the plots answer to a pointer; the page is complete without it.
std::string_view report_script();

/// A page of that look.
struct PageParts {
  std::string title;     // plain text
  std::string sections;  // HTML
  std::string foot;      // plain text
  std::string style{};   // CSS beyond the report's
};
std::string filled_page(const PageParts& parts);

}  // namespace vitreo
