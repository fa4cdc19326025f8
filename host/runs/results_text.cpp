// SPDX-License-Identifier: Apache-2.0
#include "host/runs/results_text.h"

#include "host/text/columns.h"

#include <fmt/format.h>

namespace vitreo {

// First joined, then shown: a value and its uncertainty take one unit, and digits that fit the
// uncertainty.
std::vector<ShownResult> shown_results(const std::vector<StatedResult>& results) {
  std::vector<NamedQuantity> quantities;
  for (const StatedResult& one : results) quantities.push_back({one.name, one.value, one.unit});
  quantities = join_uncertainties(quantities);
  const std::vector<Shown> values = show_list(quantities);
  std::vector<ShownResult> shown;
  for (std::size_t i = 0; i < values.size(); ++i) shown.push_back({quantities[i].name, values[i]});
  return shown;
}

std::string results_text(const std::vector<StatedResult>& results) {
  std::string text;
  for (const ShownResult& one : shown_results(results))
    text += fmt::format("{:<28} {}\n", one.name, with_unit(one.value));
  return text;
}

}  // namespace vitreo
