// Parts of emulated instruments that can break: lines, USB and HID devices, cameras, motors and the
// amplifiers of the coils.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/camera_server.h"
#include "devices/links/byte_link.h"
#include "devices/links/hid_link.h"
#include "devices/links/peer_end.h"
#include "devices/links/usb_link.h"
#include "host/rig/emulated_world.h"
#include "host/rig/fault.h"

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace vitreo {

class EmulatedPart {
 public:
  virtual ~EmulatedPart() = default;
  /// "line", "usb", "hid", "camera", "motor", "lens motor", "amplifiers": what can happen to it
  /// (emulated_faults()).
  virtual const char* type() const = 0;
  /// Begins or ends a fault of a kind that its type has. `by`: how much, as the kind has it. Called
  /// by one thread, without any lock. Throws DeviceError where it cannot be plugged in again.
  virtual void set(const Fault& fault, double by, bool on) = 0;
  /// Exchanges the cables with a part of the same type, lines and cameras only.
  virtual void exchange(EmulatedPart& /*other*/) {}
  /// Whether the command has spoken to it. Any thread.
  virtual bool touched() const { return false; }
  /// Moves the bytes of its line; touches no emulator. By a thread of its own, without the world's
  /// lock. When the next of them is due.
  virtual Time transfer(Time /*now*/) { return kForever; }
  /// Lets its emulator hear and answer; in EmulatedWorld::with().
  virtual void serve(Time /*now*/) {}
};

/// Opens the far end of a wire, at the same address each time; and takes it away.
struct Plug {
  std::function<std::unique_ptr<PeerEnd>()> open;
  std::function<void()> pulled;
};
/// A serial line or a TCP connection; `opened` is what `plug` opened first.
std::unique_ptr<EmulatedPart> make_line(EmulatedWorld& world, std::unique_ptr<PeerEnd> opened,
                                        Plug plug, std::shared_ptr<BytePeer> instrument);

/// Plugged in at once; `instrument` must outlive it.
/// `frame`: the least time between two transfers.
std::unique_ptr<EmulatedPart> make_usb(EmulatedWorld& world, UsbPeer& instrument, Time frame);
struct HidUsage {
  int page = 0xFF00;
  int usage = 1;
};
/// The instrument lives on the bus: what unplugs it switches it off.
std::unique_ptr<EmulatedPart> make_hid(EmulatedWorld& world, HidPeer& instrument,
                                       const UsbIdentity& identity, const HidUsage& usage,
                                       Time frame);

/// What a camera sees, exposed at a time, as its image of that number, in EmulatedWorld::with(); it
/// is drawn outside of that.
using CameraView = std::function<sim::Picture(Time exposed, std::uint64_t number)>;
/// Throws DeviceError{refused} where the interface is not to be had.
std::unique_ptr<EmulatedPart> make_camera(EmulatedWorld& world,
                                          const genicam::ServerSettings& settings, CameraView view);

/// The motor of a stage, where the laboratory knows how to hold it, or of the lens mover.
std::unique_ptr<EmulatedPart> make_motor(EmulatedWorld& world, const std::string& role);
std::unique_ptr<EmulatedPart> make_amplifiers(EmulatedWorld& world);

}  // namespace vitreo
