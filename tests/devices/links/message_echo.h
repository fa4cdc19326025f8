// Message echo: an instrument that returns each message that it receives, after a while; for tests
// of the links themselves.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/message_link.h"

#include <deque>
#include <span>
#include <vector>

namespace vitreo {

struct MessageEcho final : MessagePeer {
  explicit MessageEcho(Time its_delay = {}) : delay(its_delay) {}
  void receive(std::span<const std::uint8_t> message, Time now) override {
    heard.emplace_back(message.begin(), message.end());
    sayings.push_back({later(now, delay), heard.back()});
  }
  std::vector<TimedMessage> say(Time now) override {
    std::vector<TimedMessage> said;
    while (!sayings.empty() && sayings.front().at <= now) {
      said.push_back(sayings.front());
      sayings.pop_front();
    }
    return said;
  }
  Time next() const override { return sayings.empty() ? kForever : sayings.front().at; }
  void clear(Time) override { sayings.clear(); }

  Time delay;
  std::vector<ByteString> heard;
  std::deque<TimedMessage> sayings;
};

}  // namespace vitreo
