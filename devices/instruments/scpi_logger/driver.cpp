// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_logger/driver.h"

#include "devices/instruments/scpi_logger/wire.h"
#include "devices/links/dialogue.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <set>
#include <stdexcept>
#include <utility>

namespace vitreo::scpi_logger {
namespace {

/// After which nothing more of an older answer comes: a sweep answers at its end only, so it is
/// waited for where one may be under way.
constexpr Time kLineSilence = std::chrono::milliseconds(30);
constexpr Time kSweepSilence = std::chrono::milliseconds(400);

std::string plain(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", number);
  return text.data();
}

class Logger final : public CurrentSensor {
 public:
  Logger(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : settings_(settings), dialogue_(std::move(link), settings.name, clock) {
    for (const SensedCoil& one : settings_.coils) {
      info_.coils.push_back(one.coil);
      channels_.push_back(one.channel);
    }
    const Dialogue::Turn turn(dialogue_);
    info_.identity = dialogue_.opening([this] { return configure(); });
  }
  const CurrentSensorInfo& info() const override { return info_; }
  std::vector<double> measure(Time timeout) override;

 private:
  std::string ask(const std::string& question, Time timeout);
  Identity identify();
  Identity configure();
  std::vector<double> currents_of(const std::string& answer) const;

  const Settings settings_;
  Dialogue dialogue_;
  CurrentSensorInfo info_;
  std::vector<int> channels_;
  Time silence_ = kSweepSilence;  // an older answer may come until then; zero: none is due
};

/// One line, one answer. Where the last answer did not come in time it may come now, and would be
/// taken for that of this question: so the line must be silent first. Empty lines are skipped.
std::string Logger::ask(const std::string& question, Time timeout) {
  const Time deadline = later(dialogue_.clock().now(), timeout);
  if (silence_ > Time::zero()) dialogue_.settle(silence_);
  dialogue_.discard();
  silence_ = kSweepSilence;
  dialogue_.send(question + "\n");
  for (;;) {
    std::string line = scpi::trimmed(dialogue_.line('\n', kMaxAnswer, deadline));
    if (line.empty()) continue;
    silence_ = Time::zero();
    return line;
  }
}

Identity Logger::identify() {
  const std::string said = ask("*IDN?", from_seconds(settings_.reply_timeout));
  const auto who = scpi::identity(said);
  if (!who || who->name.find(settings_.model) == std::string::npos)
    dialogue_.fail(DeviceErrorKind::not_found,
                   "this is no " + (settings_.model.empty() ? "data logger" : settings_.model) +
                       ": " + printable(said));
  dialogue_.identified();
  return *who;
}

/// What was left in it is set anew: each reading with its channel and nothing else. CONF comes
/// first, for it redefines the scan list and switches the channel's number off. Set commands have
/// no answers of their own, so the error queue and the list's length are asked for.
Identity Logger::configure() {
  silence_ = kLineSilence;
  Identity who = identify();
  const std::string list = channel_list(channels_);
  for (const std::string& line :
       {std::string("*CLS"), "CONF:VOLT:DC " + plain(settings_.range) + "," + list,
        "VOLT:DC:NPLC " + plain(settings_.line_cycles) + "," + list,
        std::string("FORM:READ:UNIT OFF"), std::string("FORM:READ:TIME OFF"),
        std::string("FORM:READ:ALAR OFF"), std::string("FORM:READ:CHAN ON"),
        std::string("TRIG:SOUR IMM"), std::string("TRIG:COUN 1"), "ROUT:SCAN " + list})
    dialogue_.send(line + "\n");
  const Time timeout = from_seconds(settings_.reply_timeout);
  const std::string told = ask("SYST:ERR?", timeout);
  const auto error = scpi::error(told);
  if (!error)
    dialogue_.fail(DeviceErrorKind::protocol, "its error queue cannot be read: " + printable(told));
  if (error->code != 0)
    dialogue_.fail(DeviceErrorKind::refused, "it does not take its setup: " + printable(told));
  const std::string size = ask("ROUT:SCAN:SIZE?", timeout);
  if (scpi::number(size) != static_cast<double>(channels_.size()))
    dialogue_.fail(DeviceErrorKind::refused,
                   "its scan list has " + printable(size) + " channels, not those of " + list);
  return who;
}

std::vector<double> Logger::measure(Time timeout) {
  const Dialogue::Turn turn(dialogue_);
  dialogue_.be_open(info_.identity, [this] { return configure(); });
  return currents_of(ask("READ?", timeout));
}

/// By the channels' numbers: a logger may scan in another order than that of the list.
std::vector<double> Logger::currents_of(const std::string& answer) const {
  const auto volts = decode_sweep(answer);
  if (!volts || volts->size() != channels_.size())
    dialogue_.fail(DeviceErrorKind::protocol,
                   "not " + std::to_string(channels_.size()) +
                       " readings with their channels: " + printable(answer));
  std::vector<double> currents;
  for (const SensedCoil& one : settings_.coils) {
    const auto found = volts->find(one.channel);
    if (found == volts->end())
      dialogue_.fail(
          DeviceErrorKind::protocol,
          "no reading of channel " + std::to_string(one.channel) + ": " + printable(answer));
    if (std::abs(found->second) >= kOverload)
      dialogue_.fail(DeviceErrorKind::refused, "coil " + std::to_string(one.coil + 1) +
                                                   " (channel " + std::to_string(one.channel) +
                                                   ") is beyond its range of " +
                                                   plain(settings_.range) + " V");
    currents.push_back(found->second * one.amperes_per_volt);
  }
  return currents;
}

}  // namespace

void Settings::check() const {
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (coils.empty()) throw std::invalid_argument("channels: must not be empty");
  std::set<int> seen_channels, seen_coils;
  for (const SensedCoil& one : coils) {
    if (one.coil < 0) throw std::invalid_argument("coils: count from 1");
    if (one.channel < 101 || one.channel > 399)
      throw std::invalid_argument("channels: must be slot and channel, 101 to 399");
    if (!seen_channels.insert(one.channel).second)
      throw std::invalid_argument("channels: has " + std::to_string(one.channel) + " twice");
    if (!seen_coils.insert(one.coil).second)
      throw std::invalid_argument("coils: has " + std::to_string(one.coil + 1) + " twice");
    if (!std::isfinite(one.amperes_per_volt) || one.amperes_per_volt == 0)
      throw std::invalid_argument("amperes_per_volt: must be a number other than zero");
  }
  if (!(range > 0 && range <= 300)) throw std::invalid_argument("range: must be in (0, 300] V");
  constexpr std::array kCycles{0.02, 0.2, 1., 2., 10.};
  if (std::find(kCycles.begin(), kCycles.end(), line_cycles) == kCycles.end())
    throw std::invalid_argument("line_cycles: must be 0.02, 0.2, 1, 2 or 10");
  if (!(reply_timeout > 0 && reply_timeout <= 30))
    throw std::invalid_argument("reply_timeout: must be in (0, 30] s");
}

std::unique_ptr<CurrentSensor> open(std::unique_ptr<ByteLink> link, const Settings& settings,
                                    Clock& clock) {
  settings.check();
  return std::make_unique<Logger>(std::move(link), settings, clock);
}

}  // namespace vitreo::scpi_logger
