// SPDX-License-Identifier: Apache-2.0
#include "devices/links/line_history.h"

#include "devices/links/likeness.h"
#include "devices/links/printable.h"

#include <algorithm>
#include <array>
#include <cstdio>

namespace vitreo {
namespace {

constexpr std::size_t kKept = 256;

void keep(ByteString& kept, std::span<const std::uint8_t> bytes) {
  const std::size_t room = kKept - std::min(kKept, kept.size());
  const auto part = bytes.first(std::min(room, bytes.size()));
  kept.insert(kept.end(), part.begin(), part.end());
}

/// "0.5 s": two digits, for a deadline is noticed a little after it.
std::string duration_text(Time time) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%.2g s", to_seconds(time));
  return text.data();
}

std::string quoted(const std::string& text) { return '"' + text + '"'; }

std::span<const std::uint8_t> without_end(std::span<const std::uint8_t> bytes) {
  while (!bytes.empty() && (bytes.back() == '\r' || bytes.back() == '\n'))
    bytes = bytes.first(bytes.size() - 1);
  return bytes;
}

}  // namespace

void LineHistory::begin() { *this = {}; }

void LineHistory::sent(std::span<const std::uint8_t> bytes, std::string_view called, Time now) {
  keep(opening_.sent, bytes);
  exchange_.sent.clear();
  exchange_.heard.clear();
  keep(exchange_.sent, bytes);
  called_ = called;
  asked_ = now;
  given_up_.reset();
  late_now_ = false;
}

// When the bytes came is known only as far as somebody listened: at the latest now.
void LineHistory::heard(std::span<const std::uint8_t> bytes, Time now) {
  if (bytes.empty()) return;
  // The rest of an answer that began late is as late.
  late_now_ = late_now_ || given_up_;
  if (!late_now_) lateness_.clear();
  if (given_up_)
    lateness_ = quoted(printable(bytes)) + " came within " + duration_text(now - asked_) + " of " +
                question() + ", and not within " + duration_text(*given_up_ - asked_);
  given_up_.reset();
  keep(opening_.heard, bytes);
  keep(exchange_.heard, bytes);
}

void LineHistory::gave_up(Time now) {
  if (!exchange_.sent.empty()) given_up_ = now;
}

/// Without the line's end, which every command has.
std::string LineHistory::question() const {
  return quoted(called_.empty() ? printable(without_end(exchange_.sent)) : called_);
}

std::string LineHistory::last_heard() const { return printable(without_end(exchange_.heard)); }

std::string LineHistory::silence(Time now) const {
  const std::string within = " within " + duration_text(now - asked_);
  if (exchange_.sent.empty()) return "says nothing";
  if (silent()) return "says nothing to " + question() + within;
  return "says " + quoted(printable(exchange_.heard)) + " to " + question() + " and no more" +
         within;
}

// An instrument in terminal mode answers behind the echo of each question; a loop-back plug may
// bring back less than a whole one in time.
std::string LineHistory::appearance() const {
  constexpr std::size_t kWhole = 3;  // bytes of a question whose echo is no chance
  const bool in_exchange = exchange_.sent.size() >= kWhole &&
                           exchange_.heard.size() >= exchange_.sent.size() &&
                           is_echo(exchange_.sent, exchange_.heard);
  if (in_exchange || is_echo(opening_.sent, opening_.heard))
    return "the line echoes what is sent: a loop-back plug, an RS-485 adapter with echo, or an "
           "instrument in terminal mode";
  const auto like = likeness(opening_.heard);
  return like ? quoted(all_heard()) + " looks like " + *like : "";
}

std::string LineHistory::all_heard() const { return printable(opening_.heard); }

}  // namespace vitreo
