// Pictures and plots in a terminal: its own graphics where it has some (kitty, sixel), else half
// blocks in color, else Braille dots, which are plain text.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/plot/plot.h"

#include <opencv2/core/mat.hpp>

#include <string>

namespace vitreo {

enum class Graphics { braille, blocks, sixel, kitty };

struct Screen {
  Graphics graphics = Graphics::braille;
  int columns = 80;
  int rows = 24;
};

/// What the terminal at `descriptor` can show, by its own words in the environment (TERM,
/// KITTY_WINDOW_ID, COLORTERM ...); VITREO_GRAPHICS names one of kitty, sixel, blocks, braille
/// where they mislead. No terminal: 80 columns of Braille.
Screen screen_of(int descriptor);

/// The picture as text for the terminal, ended by a line's end; at most as wide as the screen and
/// two thirds of its height. CV_8UC1 or CV_8UC3 (BGR).
std::string picture_text(const cv::Mat& image, const Screen& screen);

/// The plot in Braille dots with ticks and names at its axes; series in colors where there are
/// some, and then one legend. Logarithmic axes and bars are not drawn here.
/// Throws std::invalid_argument for an unknown unit.
std::string plot_text(const Plot& plot, const Screen& screen);

}  // namespace vitreo
