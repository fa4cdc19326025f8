// Checks of USB: speed of the connection, sleep of idle devices, memory for cameras' frames.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/machine/checks.h"

#include <fmt/format.h>

#include <cstdlib>

namespace vitreo::machine {
namespace {

constexpr double kSuperSpeed = 5e9;  // bit/s, USB 3.0
constexpr int kUsbBuffers = 1000;    // MB: FLIR, "Understanding USBFS on Linux"
const std::string kBuffers = "/sys/module/usbcore/parameters/usbfs_memory_mb";

std::string speed_text(double speed) {
  return speed >= 1e9 ? fmt::format("{:g} Gbit/s", speed / 1e9)
                      : fmt::format("{:g} Mbit/s", speed / 1e6);
}

}  // namespace

// A USB 3 device on a USB 2 connection announces version 2.10 (USB 3.2 specification, 9.2.6.6); one
// that is made for USB 2 alone announces 2.00.
Findings check_usb_speed(const Scene& scene) {
  Findings found;
  std::vector<std::string> fine;
  for (const Use& use : scene.uses) {
    if (use.usb == nullptr) continue;
    const UsbDevice& device = *use.usb;
    const std::string at = fmt::format("{} (usb {}) is connected at {}", use.name,
                                       device.identity.place, speed_text(device.speed));
    const bool slow = device.speed > 0 && device.speed < kSuperSpeed;
    if (device.speed <= 0)
      found.push_back(said(State::unknown, use.name + ": the kernel does not tell its speed"));
    else if (device.is_usb3_vision() && slow)
      found.push_back(said(State::fault, at + ", a USB3 Vision camera wants 5 Gbit/s: another port "
                                              "(blue), another cable, no hub between"));
    else if (device.version == "2.10" && slow)
      found.push_back(said(State::warning, at + ", though it could do USB 3: another port (blue), "
                                                "another cable"));
    else
      fine.push_back(use.name + " " + speed_text(device.speed));
  }
  if (!found.empty()) return found;
  return {fine.empty() ? nothing_plugged_in(scene) : said(State::good, listed(fine))};
}

// A camera of the system is let sleep: its driver wakes it, and a laptop has one built in.
Findings check_usb_power(const Scene& scene) {
  std::vector<std::string> asleep, commands, unseen;
  bool any = false;
  for (const Use& use : scene.uses) {
    if (use.usb == nullptr || use.bus == "video") continue;
    any = true;
    const std::string name = use.name + " (usb " + use.usb->identity.place + ")";
    if (!use.usb->may_sleep) unseen.push_back(name);
    if (!use.usb->may_sleep.value_or(false)) continue;
    asleep.push_back(name);
    commands.push_back("echo on | sudo tee /sys/bus/usb/devices/" + use.usb->identity.place +
                       "/power/control");
  }
  if (!asleep.empty())
    return {said(State::warning,
                 listed(asleep) + " may be suspended when idle: our udev rules forbid it, a power "
                                  "saver (TLP, powertop) allows it again",
                 commands)};
  if (!any) return {nothing_plugged_in(scene)};
  if (!unseen.empty())
    return {said(State::unknown, "the kernel does not tell of " + listed(unseen))};
  return {said(State::good, "nothing is suspended when idle")};
}

Findings check_usb_buffers(const Scene& scene) {
  std::vector<std::string> cameras;
  for (const Use& use : scene.uses)
    if (use.usb != nullptr && use.usb->is_usb3_vision()) cameras.push_back(use.name);
  if (cameras.empty())
    return {scene.devices.seen ? said(State::good, "no USB3 Vision camera is plugged in")
                               : nothing_plugged_in(scene)};
  const std::string text = scene.machine.line(kBuffers);
  if (text.empty()) return {said(State::unknown, kBuffers + " cannot be read")};
  const int size = std::atoi(text.c_str());
  // 0: no limit (kernel, parameters of usbcore).
  if (size == 0 || size >= kUsbBuffers)
    return {said(State::good, size == 0 ? "no limit" : text + " MB")};
  const std::string file = "/etc/tmpfiles.d/60-vitreo.conf";
  return {said(State::warning,
               fmt::format("{} MB for the frames of all USB cameras ({}); {} MB are wanted", text,
                           listed(cameras), kUsbBuffers),
               {fmt::format("echo 'w {} - - - - {}' | sudo tee {}", kBuffers, kUsbBuffers, file),
                "sudo systemd-tmpfiles --create " + file})};
}

}  // namespace vitreo::machine
