// Emulated instruments of a rig on real endpoints of the operating system, with the simulated
// laboratory behind them: `vitreo emulate RIG`.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "host/config/config.h"

#include <nlohmann/json.hpp>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct EmulationSettings {
  /// Of the machine, the eye and the noise: a run of this seed on a simulated rig has the same.
  std::uint64_t seed = 1;
  /// At the addresses that the rig file has, for a command that run_among() starts; else at new
  /// ones, that any program can open, which are listed on the standard output.
  bool in_place = false;
};

/// USB and HID devices, serial ports, TCP ports on 127.0.0.1, and GigE Vision cameras for
/// genicam:127.x.y.z that stream the simulated eye; what is there is listed, "ROLE: ADDRESS" a
/// line. All act on one simulated laboratory, in real time. USB, HID and serial nodes in place want
/// umockdev-wrapper: see restart_in_testbed().
class Emulation {
 public:
  /// Throws ConfigError, DeviceError.
  Emulation(const RigDescription& description, const EmulationSettings& settings);
  ~Emulation();
  Emulation(const Emulation&) = delete;
  Emulation& operator=(const Emulation&) = delete;

  /// Does to the sample what a question's task asks for (Question::task), as a person would. Any
  /// thread. Throws std::invalid_argument for a task that is not known.
  void handle(const nlohmann::json& task);
  /// The robot as it really is; nothing while none is there. Any thread.
  std::optional<sim::Truth> truth();

 private:
  class State;
  std::unique_ptr<State> state_;
};

/// Runs a command among the emulated instruments that stand in place; its exit code. Ctrl-C goes to
/// the command. Throws ConfigError when it cannot be run.
int run_among(const std::vector<std::string>& command);

/// Serves until SIGINT, SIGTERM or SIGHUP; blocks them from its construction on, so that threads
/// made later do not take them.
class EndingSignals {
 public:
  EndingSignals();
  ~EndingSignals();
  EndingSignals(const EndingSignals&) = delete;
  EndingSignals& operator=(const EndingSignals&) = delete;
  void wait() const;

 private:
  struct Sets;
  std::unique_ptr<Sets> sets_;
};

/// Starts this program again, with the same words, under umockdev-wrapper; returns only when that
/// is not needed, or not to be had.
void restart_in_testbed(char** words);

}  // namespace vitreo
