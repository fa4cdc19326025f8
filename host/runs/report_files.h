// Parts of the report that also stand by themselves: the timeline of events, and the plots as
// files.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

/// A strip from the run's start to its end with a mark for each event, at most 500: a disc for what
/// was planned, a diamond for errors, alarms and the interlock. SVG; "" where there is no event or
/// no time passed.
std::string timeline_svg(const RunData& data);

/// Events that devices and the loop wrote as JSON, with four digits: "axis = (1, 0, 0), field =
/// 0.01"; other texts as they are.
std::string event_text(const std::string& text);

enum class PlotFiles { svg, png };

/// Each drawing and plot as a file in `folder`, which is made, under the name that it has in the
/// run's folder (figures.h): 01_Path_in_depth.svg ... Returns the files. Throws std::runtime_error
/// naming the file that cannot be written.
std::vector<std::filesystem::path> write_plots(const RunData& data,
                                               const std::filesystem::path& folder,
                                               PlotFiles kind = PlotFiles::svg);

/// Draws an SVG document as PNG, two pixels a CSS px, by the program rsvg-convert (Debian's
/// librsvg2-bin). Throws std::runtime_error naming the file, or the program where there is none.
void write_png_of_svg(const std::string& svg, const std::filesystem::path& file);

}  // namespace vitreo
