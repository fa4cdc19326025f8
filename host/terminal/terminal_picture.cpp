// SPDX-License-Identifier: Apache-2.0
#include "host/terminal/terminal_picture.h"

#include "host/text/markup.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <string_view>
#include <sys/ioctl.h>
#include <unistd.h>
#include <vector>

namespace vitreo {
namespace {

// px of a character's cell, for terminals that do not tell it.
constexpr int kCellWidth = 9, kCellHeight = 18;

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value != nullptr ? value : "";
}

Graphics graphics_of_terminal() {
  const std::string wish = environment("VITREO_GRAPHICS"), term = environment("TERM"),
                    program = environment("TERM_PROGRAM");
  // A wish comes before all guesses: a terminal may go by the name of another.
  if (wish == "kitty") return Graphics::kitty;
  if (wish == "sixel") return Graphics::sixel;
  if (wish == "blocks") return Graphics::blocks;
  if (wish == "braille" || term.empty() || term == "dumb") return Graphics::braille;
  // Multiplexers swallow graphics.
  const bool between = !environment("TMUX").empty() || term.starts_with("screen");
  if (!between && (!environment("KITTY_WINDOW_ID").empty() || term == "xterm-ghostty" ||
                   program == "WezTerm" || program == "ghostty"))
    return Graphics::kitty;
  if (!between &&
      (term.starts_with("foot") || term.starts_with("mlterm") || term == "yaft-256color"))
    return Graphics::sixel;
  // NO_COLOR asks programs for no colors (https://no-color.org): dots of Braille need none.
  const bool colors = environment("COLORTERM") == "truecolor" ||
                      term.find("256color") != std::string::npos ||
                      term.find("direct") != std::string::npos;
  return colors && environment("NO_COLOR").empty() ? Graphics::blocks : Graphics::braille;
}

/// To at most `width` x `height` px, where a pixel is `aspect` times as high as it is wide.
cv::Mat fitted_to(const cv::Mat& image, int width, int height, double aspect) {
  const double scale = std::min(static_cast<double>(width) / image.cols,
                                height * aspect / static_cast<double>(image.rows));
  const cv::Size size(std::max(1, static_cast<int>(image.cols * scale)),
                      std::max(1, static_cast<int>(image.rows * scale / aspect)));
  cv::Mat made;
  // INTER_AREA takes the mean of the pixels that fall together, so that thin lines are not lost;
  // enlarged pixels stay sharp squares.
  cv::resize(image, made, size, 0, 0, scale < 1 ? cv::INTER_AREA : cv::INTER_NEAREST);
  return made;
}

cv::Mat in_color(const cv::Mat& image) {
  cv::Mat color;
  if (image.channels() == 3) return image;
  cv::cvtColor(image, color, cv::COLOR_GRAY2BGR);
  return color;
}

/// The PNG in parts of 4096 bytes of base64, as the protocol asks
/// (https://sw.kovidgoyal.net/kitty/graphics-protocol/).
std::string kitty_text(const cv::Mat& image, const Screen& screen) {
  constexpr std::size_t kPart = 4096;
  const cv::Mat shown = fitted_to(image, std::min(image.cols, screen.columns * kCellWidth),
                                  screen.rows * kCellHeight * 2 / 3, 1);
  std::vector<unsigned char> png;
  cv::imencode(".png", shown, png);
  const std::string text = base64(png);
  std::string out;
  for (std::size_t at = 0; at < text.size(); at += kPart) {
    const bool more = at + kPart < text.size();
    // a=T: sent and shown; f=100: a PNG; q=2: no answer, which would come in as if it were typed.
    // m=1 says that more parts follow.
    const std::string keys = at == 0 ? "a=T,f=100,q=2," : "";
    out += fmt::format("\033_G{}m={};{}\033\\", keys, more ? 1 : 0, text.substr(at, kPart));
  }
  return out + "\n";
}

/// A run of one sixel: "!12~" for twelve.
void add_run(std::string& out, int count, char sixel) {
  // Up to three sixels a count would be no shorter than they are.
  if (count > 3)
    out += fmt::format("!{}{}", count, sixel);
  else
    out.append(static_cast<std::size_t>(count), sixel);
}

/// Six rows of pixels a band, a pass for each color in it (DEC STD 070; VT330/VT340 manual, chapter
/// 14): 6 levels of red, green and blue, or 32 of gray.
/// Colors are defined in percent of red, green and blue (system 2): a cube of `levels` a channel,
/// or a ramp of grays.
std::string sixel_palette(int colors, int levels, bool gray) {
  const auto percent = [levels](int level) { return level * 100 / (levels - 1); };
  std::string out;
  for (int color = 0; color < colors; ++color)
    out += fmt::format("#{};2;{};{};{}", color, percent(gray ? color : color / levels / levels),
                       percent(gray ? color : color / levels % levels),
                       percent(gray ? color : color % levels));
  return out;
}

std::string sixel_text(const cv::Mat& image, const Screen& screen) {
  const bool gray = image.channels() == 1;
  const cv::Mat shown = fitted_to(image, std::min(image.cols, screen.columns * kCellWidth),
                                  screen.rows * kCellHeight * 2 / 3, 1);
  const int levels = gray ? 32 : 6, colors = gray ? 32 : 216;
  // OpenCV keeps blue, green, red: channel 2 is red, the highest digit of the color's number.
  const auto color_at = [&](int row, int column) {
    if (gray) return shown.at<unsigned char>(row, column) * levels / 256;
    const auto pixel = shown.at<cv::Vec3b>(row, column);
    const auto level = [&](int channel) { return pixel[channel] * levels / 256; };
    return (level(2) * levels + level(1)) * levels + level(0);
  };
  // P2 = 1: what is not drawn keeps the background. The raster attributes say that pixels are
  // square, and how many there are.
  std::string out = fmt::format("\033P0;1q\"1;1;{};{}", shown.cols, shown.rows);
  out += sixel_palette(colors, levels, gray);
  for (int top = 0; top < shown.rows; top += 6) {
    // Only the colors that occur in a band get a pass: of 216 most bands have few.
    std::vector<bool> there(static_cast<std::size_t>(colors));
    const int foot = std::min(top + 6, shown.rows);
    for (int row = top; row < foot; ++row)
      for (int column = 0; column < shown.cols; ++column)
        there[static_cast<std::size_t>(color_at(row, column))] = true;
    for (int color = 0; color < colors; ++color) {
      if (!there[static_cast<std::size_t>(color)]) continue;
      out += fmt::format("#{}", color);
      int run = 0, last = -1;
      for (int column = 0; column < shown.cols; ++column) {
        int bits = 0;
        for (int row = top; row < foot; ++row)
          if (color_at(row, column) == color) bits |= 1 << (row - top);
        // A sixel is '?' plus its six bits, of which the lowest is the uppermost pixel.
        if (bits != last && run > 0) add_run(out, run, static_cast<char>('?' + last)), run = 0;
        last = bits;
        ++run;
      }
      add_run(out, run, static_cast<char>('?' + last));
      // $ goes back to the left edge for the next color, - goes down to the next band.
      out += '$';
    }
    out += '-';
  }
  return out + "\033\\\n";
}

/// Two pixels a character: the upper half block in the upper's color on the lower's.
std::string blocks_text(const cv::Mat& image, const Screen& screen) {
  const cv::Mat shown = in_color(fitted_to(image, screen.columns, screen.rows * 2 * 2 / 3, 1));
  std::string out;
  for (int row = 0; row < shown.rows; row += 2) {
    for (int column = 0; column < shown.cols; ++column) {
      const auto upper = shown.at<cv::Vec3b>(row, column);
      // Below the last row of an odd number there is black.
      const auto lower = row + 1 < shown.rows ? shown.at<cv::Vec3b>(row + 1, column) : cv::Vec3b();
      out += fmt::format("\033[38;2;{};{};{};48;2;{};{};{}m\u2580", upper[2], upper[1], upper[0],
                         lower[2], lower[1], lower[0]);
    }
    out += "\033[0m\n";
  }
  return out;
}

/// Dots of a cell of Braille: bit by column and row (Unicode 15, U+2800).
constexpr int kDots[4][2] = {{0x01, 0x08}, {0x02, 0x10}, {0x04, 0x20}, {0x40, 0x80}};

std::string braille(int dots) {
  const int code = 0x2800 + dots;
  return {static_cast<char>(0xE0 | (code >> 12)), static_cast<char>(0x80 | ((code >> 6) & 0x3F)),
          static_cast<char>(0x80 | (code & 0x3F))};
}

/// Eight dots a character; the levels are spread over the whole range first, then dithered (Floyd
/// and Steinberg 1976).
std::string braille_picture(const cv::Mat& image, const Screen& screen) {
  cv::Mat gray = fitted_to(image, screen.columns * 2, screen.rows * 4 * 2 / 3, 1);
  if (gray.channels() == 3) cv::cvtColor(gray, gray, cv::COLOR_BGR2GRAY);
  cv::Mat level;
  // Grays in a narrow range, as of a dim picture, would be all dark or all lit otherwise.
  cv::normalize(gray, level, 0, 255, cv::NORM_MINMAX, CV_32F);
  cv::Mat dots = cv::Mat::zeros(level.size(), CV_8U);
  for (int row = 0; row < level.rows; ++row)
    for (int column = 0; column < level.cols; ++column) {
      const float now = level.at<float>(row, column);
      const bool lit = now > 127;
      dots.at<unsigned char>(row, column) = lit ? 1 : 0;
      const float error = now - (lit ? 255.0F : 0.0F);
      const auto spread = [&](int down, int right, float share) {
        if (row + down < level.rows && column + right >= 0 && column + right < level.cols)
          level.at<float>(row + down, column + right) += error * share / 16;
      };
      // Sixteenths of the error, to pixels only that are still to be decided: right, and in the row
      // below to the left, straight down and to the right.
      spread(0, 1, 7), spread(1, -1, 3), spread(1, 0, 5), spread(1, 1, 1);
    }
  std::string out;
  for (int row = 0; row < dots.rows; row += 4) {
    for (int column = 0; column < dots.cols; column += 2) {
      int bits = 0;
      for (int down = 0; down < 4 && row + down < dots.rows; ++down)
        for (int right = 0; right < 2 && column + right < dots.cols; ++right)
          if (dots.at<unsigned char>(row + down, column + right)) bits |= kDots[down][right];
      out += braille(bits);
    }
    out += "\n";
  }
  return out;
}

}  // namespace

Screen screen_of(int descriptor) {
  if (isatty(descriptor) == 0) return {};
  Screen screen{graphics_of_terminal(), 80, 24};
  winsize size{};
  // A tiny size, or 0 as of a serial console, is not believed. One less of each is used: some
  // terminals wrap a line that is full, and the prompt needs a row.
  if (ioctl(descriptor, TIOCGWINSZ, &size) == 0 && size.ws_col > 20 && size.ws_row > 8) {
    screen.columns = size.ws_col - 1;
    screen.rows = size.ws_row - 1;
  }
  return screen;
}

std::string picture_text(const cv::Mat& image, const Screen& screen) {
  if (image.empty()) return "";
  switch (screen.graphics) {
    case Graphics::kitty:
      return kitty_text(image, screen);
    case Graphics::sixel:
      return sixel_text(image, screen);
    case Graphics::blocks:
      return blocks_text(image, screen);
    case Graphics::braille:
      return braille_picture(image, screen);
  }
  return "";
}

}  // namespace vitreo
