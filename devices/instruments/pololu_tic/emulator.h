// Emulator of the Tic: its end of the wire, with a motor, a home switch, the command timeout and
// the safe start behind it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/usb_link.h"
#include "devices/time/clock.h"

#include <cstdint>
#include <memory>
#include <string>

namespace vitreo::pololu_tic {

struct EmulatorSettings {
  std::uint16_t product = 0x00B3;
  std::string serial = "00123456";
  bool position_known = false;  ///< as if it had been homed since it was powered
  std::int32_t position = 0;    ///< usteps, of the controller's counter at first
  std::uint8_t step_mode = 0;   ///< as its settings have it
  /// Position of the home switch, in usteps from where the motor stands at first.
  std::int64_t home_usteps = 0;
  bool home_switch_works = true;  ///< else homing never ends
  double vin = 12;                ///< V
  std::uint8_t soft_error_response = 2;
  std::uint16_t command_timeout_ms = 1000;
};

/// Not safe for several threads at a time. `clock` is asked only for the time.
class Emulator : public UsbPeer {
 public:
  /// True position of the motor, in usteps from where it stood at first.
  virtual double motor_usteps() = 0;
  virtual bool moving() = 0;
  virtual bool energized() = 0;
  /// The knob was turned, or steps were lost: the controller does not notice.
  virtual void slip(std::int64_t usteps) = 0;
  /// The motor stands where it stood; the counter is 0 there, and uncertain. Its settings are kept.
  void power_cycle() override = 0;
  /// The motor's supply goes and comes back; the controller lives on USB.
  virtual void set_vin(double volts) = 0;
  /// While it is jammed the motor loses every step: the controller counts them, and does not
  /// notice.
  virtual void set_jammed(bool jammed) = 0;
  /// The kill switch, or a limit switch that is wired to it.
  virtual void set_kill_switch(bool pressed) = 0;
};
std::unique_ptr<Emulator> make_emulator(const EmulatorSettings& settings, const Clock& clock);

}  // namespace vitreo::pololu_tic
