// The far end of a USB-3103's wire as the fact sheet has it: keeps every report that came, and what
// is at the terminals.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/usb3103/driver.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <deque>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::usb3103::reference {

using Bytes = std::vector<std::uint8_t>;

struct Terminals {
  explicit Terminals(Clock& the_clock) : clock(the_clock) { slope.fill(1); }

  Clock& clock;
  std::array<float, 8> slope{}, offset{};  // in its flash
  bool slave = false;                      // whatever it is told
  bool silent = false, gone = false, hung_up = false;
  Time answer_after{}, write_takes{};
  std::function<bool(const Bytes&)> refuses;  // a report that is not taken
  std::function<Bytes()> foreign;             // comes before anything else, without end

  std::vector<Bytes> tried, taken;  // reports, in their order
  std::array<double, 8> volts{};
  std::array<bool, 8> output_line{}, high_line{};
  int reads = 0;

  void write(std::span<const std::uint8_t> report) {
    const Bytes b(report.begin(), report.end());
    tried.push_back(b);
    if (gone) throw DeviceError(DeviceErrorKind::lost, "the cable", "it is out");
    if (refuses && refuses(b)) throw DeviceError(DeviceErrorKind::timeout, "the bus", "not taken");
    taken.push_back(b);
    act(b);
    if (write_takes > Time::zero()) clock.sleep_for(write_takes);
  }
  std::optional<Bytes> read(Time timeout) {
    ++reads;
    if (gone) throw DeviceError(DeviceErrorKind::lost, "the cable", "it is out");
    if (foreign) return foreign();
    const Time until = later(clock.now(), timeout);
    if (answers_.empty() || answers_.front().first > until) {
      clock.sleep_until(until);
      return std::nullopt;
    }
    clock.sleep_until(answers_.front().first);
    Bytes answer = std::move(answers_.front().second);
    answers_.pop_front();
    return answer;
  }
  void answer(Bytes bytes) { answers_.emplace_back(clock.now() + answer_after, std::move(bytes)); }
  bool line_is_high(int line) const {
    const auto i = static_cast<std::size_t>(line);
    return output_line.at(i) && high_line.at(i);
  }
  std::unique_ptr<HidLink> link();
  /// What was tried since the last call.
  std::vector<Bytes> news() { return std::exchange(tried, {}); }

 private:
  void act(const Bytes& b) {
    const std::size_t channel = b.size() > 1 ? b[1] : 0;
    switch (b.at(0)) {
      case 0x02:
        output_line.at(channel) = b.at(2) == 0;
        break;
      case 0x06:
        high_line.at(channel) = b.at(2) == 1;
        break;
      case 0x14: {
        const int counts = b.at(2) + 256 * b.at(3);
        // The DAC's own error undone, then 20 V over 65536 steps.
        const double there =
            ((counts - double{offset.at(channel)}) / double{slope[channel]} - 32768) * 20 / 65536;
        (b.at(4) == 1 ? held_ : volts).at(channel) = there;
        if (b.at(4) == 0) held_[channel] = there;
        break;
      }
      case 0x15:
        volts = held_;
        break;
      case 0x1C:
        volts.at(channel) = held_.at(channel) = 0;
        break;
      case 0x43:
        master_ = b.at(1) == 0 && !slave;
        break;
      case 0x44:
        if (!silent) answer({0x44, static_cast<std::uint8_t>(master_ ? 1 : 0)});
        break;
      case 0x30: {
        Bytes memory(63, 0xA5);
        memory[0] = 0x30;
        const int at = b.at(1) + 256 * b.at(2);
        const auto index = static_cast<std::size_t>(at - 0x108) / 16;
        std::memcpy(&memory[1], &slope.at(index), 4);
        std::memcpy(&memory[5], &offset.at(index), 4);
        if (!silent) answer(std::move(memory));
        break;
      }
      default:
        ADD_FAILURE() << "unknown report " << int{b[0]};
    }
  }

  std::array<double, 8> held_{};
  bool master_ = false;
  std::deque<std::pair<Time, Bytes>> answers_;
};

class TerminalsLink final : public HidLink {
 public:
  explicit TerminalsLink(Terminals& terminals) : terminals_(terminals) {}
  void write(std::span<const std::uint8_t> report) override { terminals_.write(report); }
  std::optional<Bytes> read(Time timeout) override { return terminals_.read(timeout); }
  bool hung_up() const override { return terminals_.hung_up; }

 private:
  Terminals& terminals_;
};

inline std::unique_ptr<HidLink> Terminals::link() { return std::make_unique<TerminalsLink>(*this); }

/// What the call throws: "lost: text of the error", "invalid: text", "" where it throws nothing.
inline std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const DeviceError& error) {
    return std::string(to_string(error.kind)) + ": " + error.device + ": " + error.text;
  } catch (const std::invalid_argument& error) {
    return std::string("invalid: ") + error.what();
  } catch (const Stopped&) {
    return "stopped";
  }
  return "";
}

}  // namespace vitreo::usb3103::reference
