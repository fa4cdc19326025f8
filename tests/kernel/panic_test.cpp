// A kernel that panics while an output is energized; the interface stands outside of the machine,
// and run.py judges what it does then.
// SPDX-License-Identifier: Apache-2.0
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <thread>

namespace vitreo::kernel_guest {
namespace {

TEST(PanicGuest, OfTheKernelWhileACurrentFlows) {
  load({"xhci-pci", "usbhid", "hid-generic"});
  ASSERT_TRUE(time_until(10s, [] { return std::filesystem::exists("/dev/hidraw0"); }));
  Voltages amplifier(std::make_unique<Outside>("usb3103"));
  Host host(amplifier);
  host.energize();
  send_line("LEAVE", "");
  write_text("/proc/sysrq-trigger", "c");
  std::this_thread::sleep_for(10s);
  FAIL() << "the kernel goes on";
}

}  // namespace
}  // namespace vitreo::kernel_guest
