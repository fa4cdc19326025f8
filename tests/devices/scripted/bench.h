// Bench for instruments written in Lua: a far end by the test's hand that keeps what it hears, and
// answers what it is told to, late, too long or not at all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"
#include "devices/scripted/declaration.h"
#include "devices/scripted/instrument.h"
#include "devices/time/error.h"

#include <algorithm>
#include <deque>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::scripted {

inline std::optional<DeclaredUnit> unit_of(std::string_view symbol) {
  const std::map<std::string_view, DeclaredUnit> all{{"mm", {"mm", "m", 1e-3}},
                                                     {"um", {"um", "m", 1e-6}},
                                                     {"deg", {"deg", "rad", 0.0174532925199432957}},
                                                     {"A", {"A", "A"}},
                                                     {"mA", {"mA", "A", 1e-3}},
                                                     {"T", {"T", "T"}},
                                                     {"degC", {"degC", "K", 1, 273.15}}};
  const auto found = all.find(symbol);
  return found == all.end() ? std::nullopt : std::optional(found->second);
}

/// Lines that end with "\n". A message that no answer is known for has none.
class FarEnd final : public BytePeer {
 public:
  struct Answer {
    std::string bytes;
    Time late{};
  };
  std::map<std::string, Answer> answers{};
  std::vector<std::string> heard{};
  std::function<std::optional<Answer>(const std::string&)> other{};

  int count(const std::string& message) const {
    return static_cast<int>(std::count(heard.begin(), heard.end(), message));
  }

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) {
      if (byte != '\n') {
        line_.push_back(static_cast<char>(byte));
        continue;
      }
      heard.push_back(std::exchange(line_, {}));
      const auto found = answers.find(heard.back());
      if (found != answers.end()) say_later(found->second, now);
      if (found == answers.end() && other)
        if (const auto made = other(heard.back())) say_later(*made, now);
    }
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said;
    while (!planned_.empty() && planned_.front().at <= now) {
      said.push_back(std::move(planned_.front()));
      planned_.pop_front();
    }
    return said;
  }
  Time next() const override { return planned_.empty() ? kForever : planned_.front().at; }

 private:
  void say_later(const Answer& answer, Time now) {
    planned_.push_back({later(now, answer.late), {answer.bytes.begin(), answer.bytes.end()}});
    std::stable_sort(planned_.begin(), planned_.end(),
                     [](const TimedBytes& a, const TimedBytes& b) { return a.at < b.at; });
  }
  std::string line_;
  std::deque<TimedBytes> planned_;
};

/// Puts `with` in the place of each "@NAME@" of a text; what is not given is nothing.
inline std::string filled(std::string text, const std::map<std::string, std::string>& with) {
  for (std::size_t at = text.find('@'); at != std::string::npos; at = text.find('@', at)) {
    const std::size_t end = text.find('@', at + 1);
    const auto found = with.find(text.substr(at + 1, end - at - 1));
    const std::string piece = found == with.end() ? "" : found->second;
    text.replace(at, end + 1 - at, piece);
    at += piece.size();
  }
  return text;
}

}  // namespace vitreo::scripted
