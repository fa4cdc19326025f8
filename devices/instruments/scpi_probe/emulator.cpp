// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/emulator.h"

#include "devices/instruments/scpi_probe/wire.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <utility>

namespace vitreo::scpi_probe {
namespace {

/// A measurement is of its middle, as the mean over its duration is; its answer comes at its end.
class EmulatedProbe final : public BytePeer {
 public:
  EmulatedProbe(EmulatorSettings settings, std::function<std::vector<double>(Time)> field)
      : settings_(std::move(settings)), field_(std::move(field)) {}

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) {
      if (byte == '\r' || byte == '\n') {
        if (!line_.empty()) obey(scpi::trimmed(std::exchange(line_, {})), now);
      } else if (line_.size() < kMaxAnswer) {
        line_.push_back(static_cast<char>(byte));
      }
    }
  }
  // In the order of the questions: a measurement that takes its time holds up the answers behind
  // it.
  std::vector<TimedBytes> say(Time now) override {
    for (Answer& answer : answers_)
      if (answer.measures <= now) read(answer, now);
    std::vector<TimedBytes> said;
    while (!answers_.empty() && answers_.front().at <= now) {
      said.push_back({answers_.front().at, std::move(answers_.front().bytes)});
      answers_.pop_front();
    }
    return said;
  }
  Time next() const override {
    if (answers_.empty()) return kForever;
    Time first = answers_.front().at;
    for (const Answer& answer : answers_) first = std::min(first, answer.measures);
    return first;
  }
  void power_cycle(Time) override {
    line_.clear();
    complaint_.clear();
    answers_.clear();
  }

 private:
  /// Set commands have no answer; what is not known goes to the error queue.
  /// A setup of the rig file that this emulator does not know is refused like one that an
  /// instrument would not know.
  void obey(const std::string& line, Time now) {
    if (line == "*IDN?") return speak(settings_.identity, now);
    if (line == "*CLS") {
      complaint_.clear();
    } else if (line == "SYST:ERR?") {
      speak(complaint_.empty() ? "0,\"No error\"" : std::exchange(complaint_, {}), now);
    } else if (line == settings_.question) {
      answers_.push_back({later(now, settings_.duration), later(now, settings_.duration / 2), {}});
    } else {
      complaint_ = "-113,\"Undefined header\"";
    }
  }
  void speak(const std::string& text, Time at) {
    answers_.push_back({at, kForever, to_line(text)});
  }

  struct Answer {
    Time at;
    Time measures;  // when the field is to be read; never, or no more: kForever
    ByteString bytes;
  };
  void read(Answer& answer, Time now) {
    std::vector<double> field = field_(now);
    for (double& component : field)
      if (std::abs(component) > settings_.range) component = kOverload;
    answer.bytes = to_line(encode_field(field));
    answer.measures = kForever;
  }
  static ByteString to_line(const std::string& text) {
    ByteString bytes(text.begin(), text.end());
    bytes.push_back('\n');
    return bytes;
  }

  const EmulatorSettings settings_;
  const std::function<std::vector<double>(Time)> field_;
  std::string line_;
  std::string complaint_;  // the error queue, of one entry
  std::deque<Answer> answers_;
};

}  // namespace

std::unique_ptr<BytePeer> make_emulator(const EmulatorSettings& settings,
                                        std::function<std::vector<double>(Time)> field) {
  return std::make_unique<EmulatedProbe>(settings, std::move(field));
}

}  // namespace vitreo::scpi_probe
