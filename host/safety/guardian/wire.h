// Messages between host and guardian: one packet each, over a socket pair.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <map>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::guardian {

constexpr int kSocket = 3;  // the guardian's end has this descriptor
/// Between two heartbeats of a host whose outputs are energized.
constexpr std::chrono::milliseconds kBeat{20};
/// Without a heartbeat: then the host hangs. Ten periods, for a host that is only late.
constexpr std::chrono::milliseconds kSilence{200};
/// Turns of the host, kBeat each, without an acknowledgement that is owed: then the guardian does
/// not answer. Turns and not a time: a machine that stood still as a whole had none.
constexpr int kUnanswered = 5;
constexpr std::size_t kLongest = 16384;  // bytes of a message

// From the guardian.
constexpr char kReady = 'R';        // and in a control group of its own, where that matters
constexpr char kReadyShared = 'r';  // but in the host's control group: what kills that kills both
constexpr char kPulse = 'p';        // to each kBeatMessage, kArm and kDisarm
// From the host.
constexpr char kBeatMessage = 'b';
constexpr char kArm = 'a';         // something is about to be energized
constexpr char kDisarm = 'd';      // everything is at zero
constexpr char kQuit = 'q';        // leave
constexpr char kQuitUnsure = 'x';  // leave, but bring to zero first

/// What must be at zero when the host is gone. `settings`: numbers of the driver's own
/// (enable_line, baud_rate).
struct Output {
  std::string driver;
  std::string address;
  std::map<std::string, double> settings{};
  /// Of an instrument without a row in devices/instruments/rescues.h: its rescue as text
  /// (devices/instruments/byte_script.h).
  std::string script{};
  bool operator==(const Output&) const = default;
};

constexpr std::string_view kScript = "script:";

/// A line each, fields between tabs. Addresses hold no control characters
/// (devices/links/address.h).
inline std::string encode(const std::vector<Output>& outputs) {
  std::ostringstream text;
  text.precision(17);
  for (const Output& output : outputs) {
    text << output.driver << '\t' << output.address;
    for (const auto& [name, value] : output.settings) text << '\t' << name << '=' << value;
    if (!output.script.empty()) text << '\t' << kScript << output.script;
    text << '\n';
  }
  return text.str();
}

/// Throws std::invalid_argument for another text.
inline std::vector<Output> decode(const std::string& text) {
  std::vector<Output> outputs;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream fields(line);
    Output output;
    if (!std::getline(fields, output.driver, '\t') || !std::getline(fields, output.address, '\t'))
      throw std::invalid_argument("an output is a driver and an address, not: " + line);
    for (std::string field; std::getline(fields, field, '\t');) {
      if (field.starts_with(kScript)) {
        output.script = field.substr(kScript.size());
        continue;
      }
      const std::size_t at = field.find('=');
      if (at == std::string::npos)
        throw std::invalid_argument("a setting is name=number, not: " + field);
      output.settings[field.substr(0, at)] =
          std::stod(field.substr(at + 1));  // throws std::invalid_argument
    }
    outputs.push_back(output);
  }
  return outputs;
}

}  // namespace vitreo::guardian
