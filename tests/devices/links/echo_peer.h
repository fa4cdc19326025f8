// Echo peer: an instrument that returns what it receives, after a while; for tests of the links
// themselves.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/byte_link.h"

#include <deque>
#include <span>
#include <string_view>
#include <vector>

namespace vitreo {

struct EchoPeer final : BytePeer {
  explicit EchoPeer(Time its_delay = {}) : delay(its_delay) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    heard.insert(heard.end(), bytes.begin(), bytes.end());
    sayings.push_back({later(now, delay), {bytes.begin(), bytes.end()}});
  }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said;
    while (!sayings.empty() && sayings.front().at <= now) {
      said.push_back(sayings.front());
      sayings.pop_front();
    }
    return said;
  }
  Time next() const override { return sayings.empty() ? kForever : sayings.front().at; }

  Time delay;
  ByteString heard;
  std::deque<TimedBytes> sayings;
};

inline ByteString bytes(std::string_view text) { return {text.begin(), text.end()}; }

}  // namespace vitreo
