// SPDX-License-Identifier: Apache-2.0
#include "host/progress_line.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <iostream>
#include <poll.h>
#include <unistd.h>

namespace vitreo {
namespace {

constexpr double kRedraw = 0.1;  // s of wall time
constexpr int kBar = 24;         // characters

double wall_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

/// What a script says may not steer the terminal.
std::string harmless(const std::string& text) {
  std::string out;
  for (const char c : text) {
    const auto byte = static_cast<unsigned char>(c);
    out += (byte < 0x20 && c != '\n' && c != '\t') || byte == 0x7F ? fmt::format("\\x{:02x}", byte) : std::string(1, c);
  }
  return out;
}

std::string duration_text(double seconds) {
  const long whole = std::lround(seconds);
  return whole < 60 ? fmt::format("{} s", whole) : fmt::format("{} min {:02} s", whole / 60, whole % 60);
}

}  // namespace

ProgressLine::ProgressLine(std::ostream& out, bool animate) : out_(out), animate_(animate), began_(wall_seconds()) {}
ProgressLine::~ProgressLine() { clear(); }

std::string ProgressLine::text(double fraction, const std::string& label) const {
  const int filled = static_cast<int>(std::lround(fraction * kBar));
  std::string bar;
  for (int i = 0; i < kBar; ++i) bar += i < filled ? "#" : ".";
  const double elapsed = wall_seconds() - began_;
  // The first percent says little about the rest.
  const std::string left =
      fraction > 0.01 && fraction < 1 ? duration_text(elapsed * (1 - fraction) / fraction) + " left" : "";
  return fmt::format("[{}] {:3.0f} %  {}{}{}", bar, 100 * fraction, harmless(label), left.empty() ? "" : ", ", left);
}

void ProgressLine::progress(double fraction, const std::string& label) {
  fraction = std::clamp(fraction, 0.0, 1.0);
  if (!animate_) {
    const int tenth = static_cast<int>(fraction * 10);
    if (tenth == shown_tenth_) return;
    shown_tenth_ = tenth;
    out_ << text(fraction, label) << std::endl;
    return;
  }
  const double now = wall_seconds();
  if (now - shown_at_ < kRedraw && fraction < 1) return;
  shown_at_ = now;
  const std::string line = text(fraction, label);
  out_ << '\r' << line << std::string(width_ > line.size() ? width_ - line.size() : 0, ' ') << std::flush;
  width_ = line.size();
}

void ProgressLine::message(const std::string& line) {
  clear();
  out_ << harmless(line) << std::endl;
}

void ProgressLine::question(const Question& asked) {
  clear();
  out_ << harmless(shown(asked)) << ": " << std::flush;
  if (!isatty(STDIN_FILENO)) out_ << "\n(answer with: vitreo control answer TEXT)" << std::endl;
}

std::optional<std::string> ProgressLine::typed() {
  pollfd input{STDIN_FILENO, POLLIN, 0};
  if (!isatty(STDIN_FILENO) || poll(&input, 1, 0) <= 0) return std::nullopt;
  std::string line;
  if (!std::getline(std::cin, line)) return std::nullopt;
  return line;
}

void ProgressLine::clear() {
  if (width_ == 0) return;
  out_ << '\r' << std::string(width_, ' ') << '\r' << std::flush;
  width_ = 0;
}

}  // namespace vitreo
