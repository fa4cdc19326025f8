// Filling of the report's page: the slots of the document replaced by their values.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/report_page.h"
#include "host/text/markup.h"

#include <algorithm>
#include <map>

namespace vitreo {
namespace {

/// The document's {{name}}s replaced by their values. One pass: what stands in a value is not
/// looked at, so no text of a run can name a part of the page.
/// Every name must be known: a page with a slot that has no value throws std::out_of_range at the
/// first report.
std::string filled(std::string_view page,
                   const std::map<std::string_view, std::string_view>& values) {
  constexpr std::string_view kOpen = "{{";
  constexpr std::string_view kClose = "}}";
  std::string out;
  for (std::size_t at = 0; at < page.size();) {
    const std::size_t open = std::min(page.find(kOpen, at), page.size());
    out += page.substr(at, open - at);
    if (open == page.size()) break;
    const std::size_t name = open + kOpen.size();
    const std::size_t close = page.find(kClose, name);
    out += values.at(page.substr(name, close - name));
    at = close + kClose.size();
  }
  return out;
}

}  // namespace

std::string filled_page(const PageParts& parts) {
  const std::string title = escape_markup(parts.title);
  const std::string foot = escape_markup(parts.foot);
  const std::string style = std::string(report_style()) + parts.style;
  return filled(report_page(),
                {{"title", title}, {"style", style}, {"sections", parts.sections}, {"run", foot}});
}

}  // namespace vitreo
