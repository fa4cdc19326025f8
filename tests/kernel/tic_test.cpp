// Tic by libusb through the kernel's usbfs, on a bus of QEMU's with the double outside.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/pololu_tic/driver.h"
#include "devices/time/error.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <cmath>
#include <thread>

namespace vitreo::kernel_guest {
namespace {

class TicGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load({"xhci-pci"});
    start_udevd();  // libusb hears of new devices from it alone
  }
  std::unique_ptr<LensMover> open() {
    pololu_tic::Settings settings;
    settings.home = pololu_tic::Home::none;
    settings.home_position = 0;
    std::unique_ptr<UsbLink> link;
    time_until(10s, [&] {
      try {
        link = open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock);
      } catch (const DeviceError& error) {
        if (error.kind != DeviceErrorKind::not_found) throw;
      }
      return link != nullptr;
    });
    if (link == nullptr) throw std::runtime_error("no Tic within 10 s");
    return pololu_tic::open(std::move(link), settings, *clock);
  }
  double position() { return std::abs(device.state("position").get<double>()); }
  Outside device{"tic"};
  const std::unique_ptr<Clock> clock = wall_clock();
};

TEST_F(TicGuest, MovesTheCarriageAndIsLostWithItsCable) {
  auto lens = open();
  row("%s", lens->identity().c_str());
  lens->home(from_seconds(5));
  lens->move_to(1e-3, from_seconds(10));
  EXPECT_NEAR(position(), 1600, 1);  // 1 mm in steps of 5 um, eight microsteps each
  EXPECT_NEAR(lens->position(), 1e-3, 1e-6);
  // Counted from the moment at which it is out: the time of the order is this machine's.
  Steady::time_point out;
  std::thread puller([&] {
    std::this_thread::sleep_for(300ms);
    device.unplug();
    out = Steady::now();
  });
  std::string said;
  Steady::time_point told;
  try {
    lens->move_to(9e-3, from_seconds(10));  // 1.7 s
  } catch (const DeviceError& error) {
    said = error.what();
    told = Steady::now();
    EXPECT_EQ(error.kind, DeviceErrorKind::lost) << said;
  }
  puller.join();
  const double took = Milliseconds(told - out).count();
  row("cable out in a move: \"%s\" after %.0f ms", said.c_str(), took);
  EXPECT_FALSE(said.empty());
  EXPECT_LT(took, 300);
  // Its own command timeout ends the motion: docs/instruments.md.
  std::this_thread::sleep_for(1500ms);
  EXPECT_EQ(device.state("velocity").get<double>(), 0);
  EXPECT_LT(position(), 9e-3 / 5e-6 * 8 - 100);
  lens.reset();
  device.plug();
  lens = open();
  EXPECT_NEAR(lens->position(), position() / 8 * 5e-6, 1e-6);  // it has kept its own count
}

TEST_F(TicGuest, HasOneOwner) {
  const auto lens = open();
  const std::string said = elsewhere(0, [&]() -> std::string {
    open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock);
    return "opened";
  });
  row("second opener: %s", said.c_str());
  EXPECT_NE(said.find("another program has it open"), std::string::npos) << said;
}

}  // namespace
}  // namespace vitreo::kernel_guest
