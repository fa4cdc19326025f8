// SPDX-License-Identifier: Apache-2.0
#include "host/record/figures.h"

#include "host/files/run_folder.h"
#include "host/plot/plot_svg.h"

#include <fmt/format.h>

#include <utility>

namespace vitreo {

// Two titles may give one name: the number in front tells them apart.
std::vector<Figure> figures_of(const RunData& data) {
  std::vector<Figure> figures;
  const auto add = [&](const std::string& title, std::function<std::string()> svg) {
    figures.push_back(
        {fmt::format("{:02}_{}", figures.size() + 1, slug(title, "plot")), std::move(svg)});
  };
  for (const SvgDrawing& one : data.drawings) add(one.title, [&one] { return one.svg; });
  for (const Plot& one : data.plots) add(one.title, [&one] { return to_svg(one); });
  return figures;
}

}  // namespace vitreo
