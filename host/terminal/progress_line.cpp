// SPDX-License-Identifier: Apache-2.0
#include "host/terminal/progress_line.h"

#include "devices/time/clock.h"
#include "host/text/terminal_text.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <iostream>
#include <poll.h>
#include <sys/ioctl.h>
#include <unistd.h>

namespace vitreo {
namespace {

constexpr double kRedraw = 0.1;  // s of wall time
constexpr int kBar = 24;         // characters

// An estimate needs no hours: what takes longer is still read in minutes.
std::string duration_text(double seconds) {
  const long whole = std::lround(seconds);
  return whole < 60 ? fmt::format("{} s", whole)
                    : fmt::format("{} min {:02} s", whole / 60, whole % 60);
}

/// Width of the terminal on the standard error; at least enough for a few words.
/// Asked anew for each line: a window may be resized. The standard error is where the line goes;
/// the standard output may be a file.
std::size_t columns() {
  winsize window = {};
  constexpr std::size_t kUsual = 80;
  constexpr std::size_t kLeast = 10;
  if (ioctl(STDERR_FILENO, TIOCGWINSZ, &window) != 0 || window.ws_col == 0) return kUsual;
  return std::max<std::size_t>(window.ws_col, kLeast);
}

}  // namespace

ProgressLine::ProgressLine(std::ostream& out, bool animate) : out_(out), animate_(animate) {}
ProgressLine::~ProgressLine() { clear(); }

// The label is a script's text: no escape sequence and no line end of it reaches the terminal.
std::string ProgressLine::text(double fraction, const std::string& label,
                               std::optional<double> remaining) const {
  const int filled = static_cast<int>(std::lround(fraction * kBar));
  std::string bar;
  for (int i = 0; i < kBar; ++i) bar += i < filled ? "#" : ".";
  const std::string left = remaining && fraction < 1 ? duration_text(*remaining) + " left" : "";
  std::string words = harmless(label);
  // A tab has the width of what stands before it.
  std::replace_if(
      words.begin(), words.end(), [](char c) { return c == '\n' || c == '\t'; }, ' ');
  const std::string rest = fmt::format("{:3.0f} %  {}{}{}", 100 * fraction, words,
                                       label.empty() || left.empty() ? "" : ", ", left);
  return animate_ ? "[" + bar + "] " + rest : rest;
}

// At most ten lines a second on a terminal, and eleven in all elsewhere: a log file is not filled
// by a fast loop.
void ProgressLine::progress(double fraction, const std::string& label) {
  const std::lock_guard lock(mutex_);
  fraction = std::clamp(fraction, 0.0, 1.0);
  const std::optional<double> left = remaining_.told(fraction);
  if (!animate_) {
    const int tenth = static_cast<int>(fraction * 10);
    if (tenth == shown_tenth_) return;
    shown_tenth_ = tenth;
    out_ << text(fraction, label, left) << std::endl;
    return;
  }
  const double now = wall_seconds();
  if (now - shown_at_ < kRedraw && fraction < 1) return;
  shown_at_ = now;
  // A line that wraps could not be drawn over; in the last column some terminals wrap at once.
  const std::size_t room = columns() - 1;
  std::string line = text(fraction, label, left);
  if (columns_of(line) > room)
    line.erase(0, line.find(']') + 2);  // the words say more than the bar
  line = first_columns(line, room);
  // What the line before had more is overwritten by blanks.
  const std::size_t width = columns_of(line);
  out_ << '\r' << line << std::string(width_ > width ? width_ - width : 0, ' ') << std::flush;
  width_ = width;
}

void ProgressLine::message(const std::string& line) {
  const std::lock_guard lock(mutex_);
  wipe();
  out_ << harmless(line) << std::endl;
}

// The question stays on its line, and the answer is typed behind it. Without a terminal nothing can
// be typed: the way by which it can be answered is said.
void ProgressLine::question(const Question& asked) {
  const std::lock_guard lock(mutex_);
  wipe();
  out_ << harmless(shown(asked)) << ": " << std::flush;
  if (!isatty(STDIN_FILENO)) out_ << "\n(answer with: vitreo control answer TEXT)" << std::endl;
}

// Never waits for the first character: the run goes on beside the question.
std::optional<std::string> ProgressLine::typed() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (!isatty(STDIN_FILENO) || poll(&input, 1, 0) <= 0) return std::nullopt;
  std::string line;
  if (std::getline(std::cin, line)) return line;
  std::cin.clear();  // Ctrl-D is no answer, and no reason to be deaf to the next line
  std::clearerr(stdin);
  return std::nullopt;
}

void ProgressLine::clear() {
  const std::lock_guard lock(mutex_);
  wipe();
}

// With the lock held by the caller. By blanks and not by an escape sequence, which a plain terminal
// would print.
void ProgressLine::wipe() {
  if (width_ == 0) return;
  out_ << '\r' << std::string(width_, ' ') << '\r' << std::flush;
  width_ = 0;
}

}  // namespace vitreo
