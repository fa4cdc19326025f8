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
  /// Of the emulated instruments, in words (host/rig/emulated_faults.h); only in place.
  std::vector<std::string> faults{};
};

/// What is really so in the emulated laboratory.
struct EmulatedTruth {
  std::optional<sim::Truth> robot;  // nothing while none is there
  sim::CoilTruth coils;
};

/// USB and HID devices, serial ports, TCP ports on 127.0.0.1, and GigE Vision cameras for
/// genicam:127.x.y.z that stream the simulated eye; what is there is listed, "ROLE: ADDRESS" a
/// line. All act on one simulated laboratory, in real time. USB, HID and serial nodes in place want
/// umockdev-wrapper: see restart_in_testbed() (host/rig/testbed_process.h).
class Emulation {
 public:
  /// Throws ConfigError, DeviceError; ConfigError for a fault that is not known.
  Emulation(const RigDescription& description, const EmulationSettings& settings);
  ~Emulation();
  Emulation(const Emulation&) = delete;
  Emulation& operator=(const Emulation&) = delete;

  /// Does to the sample what a question's task asks for (Question::task), as a person would. Any
  /// thread. Throws std::invalid_argument for a task that is not known.
  void handle(const nlohmann::json& task);
  /// At a moment of the machine's monotonic clock (std::chrono::steady_clock), at most a second
  /// back. Any thread.
  EmulatedTruth truth(Time monotonic);

 private:
  class State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
