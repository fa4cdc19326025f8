// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/emulator.h"

#include "devices/instruments/kepco_bop/wire.h"

#include <cmath>
#include <deque>
#include <map>
#include <utility>
#include <vector>

namespace vitreo::kepco_bop {
namespace {

/// Errors; one more turns the last into -350.
constexpr std::size_t kQueueLength = 15;

std::string limit_name(const char* level, const char* kind, const char* sign) {
  return std::string(level) + ":" + kind + ":" + sign;
}

/// A supply without a load of its own: in current mode with its output on, the set current times
/// `gain` flows.
class EmulatedBop final : public Emulator {
 public:
  // A call-back for the currents, since the plant of the simulator must know of a change when it
  // happens.
  EmulatedBop(EmulatorSettings settings, std::function<void(Time, double)> on_current)
      : settings_(std::move(settings)), on_current_(std::move(on_current)) {
    power_up();
  }

  // CR or LF ends a line; of CR LF the second finds an empty line and is skipped. A line is kept
  // beyond kMaxLine, so that obey_line() can refuse it.
  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    for (const std::uint8_t byte : bytes) {
      const char c = static_cast<char>(byte);
      if (c == kClearInput) {
        line_.clear();
        speak("", now);
      } else if (c == '\r' || c == '\n') {
        if (!line_.empty()) obey_line(std::exchange(line_, {}), now);
      } else if (line_.size() <= kMaxAnswer) {
        line_.push_back(c);
      }
    }
  }
  std::vector<TimedBytes> say(Time) override { return std::exchange(said_, {}); }
  Time next() const override { return said_.empty() ? kForever : said_.front().at; }
  double current() const override { return flows_; }
  bool output() const override { return on_; }
  void power_cycle(Time now) override {
    power_up();
    said_.clear();
    update(now);
  }

 private:
  /// As after power-up: voltage mode, local control, output off.
  void power_up() {
    values_ = {{"CURR", 0}, {"VOLT", 0}};
    for (const char* sign : {"POS", "NEG"})
      for (const char* kind : {"LIM", "PROT"}) {
        values_[limit_name("CURR", kind, sign)] = settings_.max_current;
        values_[limit_name("VOLT", kind, sign)] = settings_.max_voltage;
      }
    mode_ = "VOLT";
    load_ = "RESISTIVE";
    on_ = remote_ = false;
    errors_.clear();
    line_.clear();
  }

  /// Commands between semicolons, in order; the answers to its questions form one line.
  void obey_line(const std::string& line, Time now) {
    std::string answer;
    bool asked = false;
    if (line.size() > kMaxLine) {
      complain(-100, "Command error");
    } else {
      std::string path;  // of the unit before: a unit without a leading colon is within it
      for (const std::string& one : scpi::parts(line, ';')) {
        Command command = decode_command(one);
        if (command.header.empty()) continue;
        if (command.header.front() != '*') {
          if (one.front() != ':') command.header = path + command.header;
          path = command.header.substr(0, command.header.rfind(':') + 1);
        }
        const bool question = !command.header.empty() && command.header.back() == '?';
        if (question) answer += (asked ? ";" : "") + answer_to(command.header);
        asked = asked || question;
        if (!question) obey(command);
      }
    }
    update(now);
    // On RS-232 every line is answered, if only by CR LF; on the network only questions are.
    if (asked || !settings_.network) speak(answer, now);
  }

  /// Questions are answered under local control too. Numbers are in scientific notation, modes as 0
  /// and 1.
  std::string answer_to(const std::string& question) {
    const std::string name = question.substr(0, question.size() - 1);
    if (name == "*IDN") return settings_.identity;
    if (name == "*OPC") return "1";
    if (name == "*ESR" || name == "*STB") return "0";
    if (name == "FUNC:MODE") return mode_ == "CURR" ? "1" : "0";
    if (name == "OUTP") return on_ ? "1" : "0";
    if (name == "OUTP:MODE") return load_;
    if (name == "SYST:REM") return remote_ ? "1" : "0";
    if (name == "MEAS:CURR") return encode_number(flows_);
    if (name == "MEAS:VOLT") return encode_number(flows_ * 0.5);
    if (name == "SYST:ERR") {
      if (errors_.empty()) return "0,\"No error\"";
      std::string first = errors_.front();
      errors_.pop_front();
      return first;
    }
    if (const auto value = values_.find(name); value != values_.end())
      return encode_number(value->second);
    if (const auto value = values_.find(name + ":POS"); value != values_.end())
      return encode_number(value->second) + "," + encode_number(values_.at(name + ":NEG"));
    complain(-113, "Undefined header");
    return "";
  }

  /// Unknown headers and wrong values go to the error queue; only SYST:REM and the * commands act
  /// under local control.
  void obey(const Command& command) {
    if (command.header == "*CLS") return errors_.clear();
    if (command.header == "*RST") return power_up();
    if (command.header == "SYST:REM") {
      remote_ = command.value == "1" || command.value == "ON";
      return;
    }
    const auto value = scpi::number(command.value);
    const bool pair = values_.contains(command.header + ":POS");
    const bool known = pair || values_.contains(command.header) || command.header == "FUNC:MODE" ||
                       command.header == "OUTP" || command.header == "OUTP:MODE";
    if (!known) return complain(-113, "Undefined header");
    if (!remote_) return;  // under local control set commands are ignored, without an error
    if (command.header == "FUNC:MODE") {
      mode_ = command.value;
    } else if (command.header == "OUTP") {
      on_ = command.value == "ON" || command.value == "1";
    } else if (command.header == "OUTP:MODE") {
      load_ = command.value;
    } else if (!value) {
      complain(-109, "Missing parameter");
    } else if (!within(command.header, *value)) {
      complain(-222, "Data out of range");
    } else if (pair) {
      values_[command.header + ":POS"] = values_[command.header + ":NEG"] = *value;
    } else {
      values_[command.header] = *value;
    }
  }

  /// A current within the set-point limit, everything within the model's rating; limits are not
  /// negative.
  bool within(const std::string& name, double value) const {
    const double most = name[0] == 'C' ? settings_.max_current : settings_.max_voltage;
    if (name == "CURR" &&
        (value > values_.at("CURR:LIM:POS") || value < -values_.at("CURR:LIM:NEG")))
      return false;
    return std::abs(value) <= most && (name.find(':') == std::string::npos || value >= 0);
  }

  /// Into the error queue.
  void complain(int code, const char* text) {
    if (errors_.size() == kQueueLength) errors_.back() = "-350,\"Queue overflow\"";
    if (errors_.size() < kQueueLength)
      errors_.push_back(std::to_string(code) + ",\"" + text + "\"");
  }

  /// The current follows its set-point at once; without output, or in voltage mode, none flows.
  void update(Time now) {
    const double flows = on_ && mode_ == "CURR" ? settings_.gain * values_["CURR"] : 0;
    if (flows == flows_) return;
    flows_ = flows;
    if (on_current_) on_current_(now, flows_);
  }

  // 0x13 is XOFF and 0x11 XON.
  void speak(const std::string& answer, Time now) {
    std::string text = answer + "\r\n";
    if (settings_.flow_control) text = "\x13" + text + "\x11";
    said_.push_back({now, {text.begin(), text.end()}});
  }

  const EmulatorSettings settings_;
  const std::function<void(Time, double)> on_current_;
  std::map<std::string, double> values_;
  std::string mode_;
  std::string load_;  // what an output that is off means
  std::string line_;
  bool on_ = false;
  bool remote_ = false;
  std::deque<std::string> errors_;
  double flows_ = 0;  // A
  std::vector<TimedBytes> said_;
};

}  // namespace

std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings,
                                        std::function<void(Time, double)> on_current) {
  return std::make_unique<EmulatedBop>(settings, std::move(on_current));
}

}  // namespace vitreo::kepco_bop
