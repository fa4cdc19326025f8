// Filling of the report's page: the slots of the document replaced by their values.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"
#include "host/runs/report_page.h"
#include "host/text/markup.h"

#include <algorithm>
#include <map>
#include <string>
#include <vector>

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

/// Bytes of hexadecimal digits.
std::vector<unsigned char> bytes_of(const std::string& hex) {
  std::vector<unsigned char> bytes;
  for (std::size_t i = 0; i + 1 < hex.size(); i += 2)
    bytes.push_back(static_cast<unsigned char>(std::stoi(hex.substr(i, 2), nullptr, 16)));
  return bytes;
}

}  // namespace

std::string filled_page(const PageParts& parts) {
  const std::string title = escape_markup(parts.title);
  const std::string foot = escape_markup(parts.foot);
  const std::string style = std::string(report_style()) + parts.style;
  // By its digest alone a script runs in the page (Content Security Policy 3, 2.3.1): none that a
  // run's texts might have smuggled in.
  const std::string hash = "sha256-" + base64(bytes_of(sha256(report_script())));
  return filled(report_page(), {{"title", title},
                                {"style", style},
                                {"script_hash", hash},
                                {"sections", parts.sections},
                                {"run", foot},
                                {"script", report_script()}});
}

}  // namespace vitreo
