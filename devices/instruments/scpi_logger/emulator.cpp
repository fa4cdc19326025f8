// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_logger/emulator.h"

#include "devices/instruments/scpi_logger/wire.h"

#include <array>
#include <cmath>
#include <cstdio>
#include <deque>
#include <utility>

namespace vitreo::scpi_logger {
namespace {

/// Takes the commands that the driver sends, and no others; they take no time, a sweep does.
class EmulatedLogger final : public BytePeer {
 public:
  EmulatedLogger(EmulatorSettings settings, std::function<double(int, Time)> volts)
      : settings_(std::move(settings)), volts_(std::move(volts)) {}

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) {
      if (byte != '\n') {
        if (line_.size() < kMaxAnswer) line_.push_back(static_cast<char>(byte));
        continue;
      }
      if (const std::string line = scpi::trimmed(std::exchange(line_, {})); !line.empty())
        obey(line, now);
    }
  }
  std::vector<TimedBytes> say(Time now) override {
    sweep(now);
    return std::exchange(said_, {});
  }
  Time next() const override {
    if (!said_.empty()) return said_.front().at;
    return left_.empty() ? kForever : due_;
  }
  void power_cycle(Time) override {
    line_.clear();
    complaint_.clear();
    channels_.clear();
    left_.clear();
    said_.clear();
    with_channel_ = false;
  }

 private:
  void obey(const std::string& line, Time now) {
    const std::size_t blank = line.find(' ');
    const std::string header = line.substr(0, blank);
    const std::string argument = blank == std::string::npos ? "" : line.substr(blank + 1);
    if (line == "*IDN?") return speak(settings_.identity, now);
    if (line == "SYST:ERR?")
      return speak(complaint_.empty() ? "+0,\"No error\"" : std::exchange(complaint_, {}), now);
    if (line == "ROUT:SCAN:SIZE?") return speak(std::to_string(channels_.size()), now);
    if (line == "READ?") return begin(now);
    if (line == "*CLS")
      complaint_.clear();
    else if (header == "CONF:VOLT:DC")
      with_channel_ = !read_range(argument);
    else if (header == "VOLT:DC:NPLC")
      cycles_ = scpi::number(scpi::parts(argument).front()).value_or(1);
    else if (header == "ROUT:SCAN")
      channels_ = channels_of(argument);
    else if (header == "FORM:READ:CHAN")
      with_channel_ = argument == "ON";
    else if (!header.starts_with("FORM:READ:") && !header.starts_with("TRIG:"))
      complaint_ = "-113,\"Undefined header\"";
  }
  bool read_range(const std::string& argument) {
    range_ = scpi::number(scpi::parts(argument).front()).value_or(300);
    const std::size_t list = argument.find('(');
    channels_ = list == std::string::npos ? std::vector<int>{} : channels_of(argument.substr(list));
    return true;
  }
  static std::vector<int> channels_of(const std::string& list) {
    std::vector<int> channels;
    if (list.size() < 3) return channels;
    for (const std::string& one : scpi::parts(list.substr(2, list.size() - 3)))
      if (const auto channel = scpi::number(one)) channels.push_back(static_cast<int>(*channel));
    return channels;
  }

  void begin(Time now) {
    if (channels_.empty()) {
      complaint_ = "-221,\"Settings conflict\"";
      return;
    }
    left_.assign(channels_.begin(), channels_.end());
    answer_.clear();
    due_ = later(now, per_reading());
  }
  Time per_reading() const {
    return settings_.per_channel + from_seconds(cycles_ / settings_.mains);
  }
  /// Channel by channel, each at its own time.
  void sweep(Time now) {
    while (!left_.empty() && due_ <= now) {
      double volts = volts_(left_.front(), due_);
      if (std::abs(volts) > 1.2 * range_) volts = std::copysign(kOverload, volts);
      std::array<char, 32> number{};
      std::snprintf(number.data(), number.size(), "%+.8E", volts);
      answer_ += (answer_.empty() ? "" : ",") + std::string(number.data());
      if (with_channel_) answer_ += "," + std::to_string(left_.front());
      left_.pop_front();
      if (left_.empty())
        speak(answer_, due_);
      else
        due_ = later(due_, per_reading());
    }
  }
  void speak(const std::string& text, Time at) {
    ByteString bytes(text.begin(), text.end());
    bytes.push_back('\n');
    said_.push_back({at, std::move(bytes)});
  }

  const EmulatorSettings settings_;
  const std::function<double(int, Time)> volts_;
  std::string line_;
  std::string complaint_;  // the error queue, of one entry
  std::vector<int> channels_;
  std::deque<int> left_;  // of the sweep under way
  Time due_{};            // of the next of them
  std::string answer_;
  std::vector<TimedBytes> said_;
  double range_ = 300;
  double cycles_ = 1;
  bool with_channel_ = false;
};

}  // namespace

std::unique_ptr<BytePeer> make_emulator(const EmulatorSettings& settings,
                                        std::function<double(int channel, Time now)> volts) {
  return std::make_unique<EmulatedLogger>(settings, std::move(volts));
}

}  // namespace vitreo::scpi_logger
