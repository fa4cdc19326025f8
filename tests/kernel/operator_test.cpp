// Pedals through /dev/uhid, a SpaceMouse by USB: reports of every length that may come, a pulled
// cable.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/spacemouse/driver.h"
#include "devices/time/error.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <thread>

namespace vitreo::kernel_guest {
namespace {

class OperatorGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load_gadgets();
    load({"uhid", "usb_f_hid", "usbhid", "hid-generic", "hid-logitech"});
  }
  std::unique_ptr<HidLink> link(const std::string& address) {
    wait_for_node("/dev/hidraw0");
    return open_hid_link(parse_usb_address("hid", address), *clock);
  }
  std::unique_ptr<OperatorInput> pedal(const std::string& product, foot_pedal::Layout layout) {
    foot_pedal::Settings settings;
    settings.layout = std::move(layout);
    return foot_pedal::open(link("hid:05f3:" + product), settings);
  }
  const std::unique_ptr<Clock> clock = wall_clock();
};

constexpr std::uint32_t kMiddle = 2;

/// Pressed and released again; ms from the foot to the host.
void press(Gadget& device, OperatorInput& input, const char* what) {
  EXPECT_FALSE(is_held(&input, kMiddle));
  const auto began = Steady::now();
  device.order({{"set", {{"middle", true}}}});
  EXPECT_TRUE(time_until(1s, [&] { return is_held(&input, kMiddle); })) << what;
  const double down = Milliseconds(Steady::now() - began).count();
  EXPECT_FALSE(is_held(&input, 1));
  EXPECT_FALSE(is_held(&input, 4));
  device.order({{"set", {{"middle", false}}}});
  EXPECT_TRUE(time_until(1s, [&] { return !is_held(&input, kMiddle); })) << what;
  row("%s: pressed is seen after %.1f ms", what, down);
}

TEST_F(OperatorGuest, APedalWhoseReportsHave19BytesIsSeen) {
  Gadget device({"uhid", "foot_pedal", "--option", "model=xkeys_0268", "--size", "19"});
  press(device, *pedal("0268", foot_pedal::xkeys_xk3()), "19 bytes");
}

TEST_F(OperatorGuest, APedalWhoseReportsHave18BytesIsSeen) {
  Gadget device({"uhid", "foot_pedal", "--option", "model=xkeys_0268", "--option", "constant=no",
                 "--size", "18"});
  press(device, *pedal("0268", foot_pedal::xkeys_xk3()), "18 bytes, without the constant one");
}

TEST_F(OperatorGuest, ThePedalThatIsSoldTodayIsSeen) {
  Gadget device({"uhid", "foot_pedal", "--size", "32"});
  press(device, *pedal("0438", foot_pedal::xkeys_xk3_0438()), "XK-3, 32 bytes");
}

// The kernel hands over what is longer than the descriptor says, and keeps what is shorter.
TEST_F(OperatorGuest, AReportThatIsAByteTooLongIsNotDropped) {
  Gadget device({"uhid", "foot_pedal", "--option", "model=xkeys_0268", "--size", "19"});
  const auto input = pedal("0268", foot_pedal::xkeys_xk3());
  device.order({{"raw", "0004" + std::string(36, '0')}});
  EXPECT_TRUE(time_until(1s, [&] { return is_held(input.get(), kMiddle); }));
  device.order({{"raw", "0000" + std::string(36, '0')}});
  EXPECT_TRUE(time_until(1s, [&] { return !is_held(input.get(), kMiddle); }));
  device.order({{"raw", "0004" + std::string(30, '0')}});
  EXPECT_FALSE(time_until(200ms, [&] { return is_held(input.get(), kMiddle); }));
  row("20 bytes for 19: taken; 17 for 19: dropped by the kernel (%d lines in its log)",
      kernel_log_lines("too short"));
}

TEST_F(OperatorGuest, APulledPedalIsAReleasedOne) {
  Gadget device({"uhid", "foot_pedal", "--size", "32"});
  const auto input = pedal("0438", foot_pedal::xkeys_xk3_0438());
  device.order({{"set", {{"middle", true}}}});
  ASSERT_TRUE(time_until(1s, [&] { return is_held(input.get(), kMiddle); }));
  const auto began = Steady::now();
  device.unplug();
  ASSERT_TRUE(time_until(2s, [&] { return !is_held(input.get(), kMiddle); }));
  const double released = Milliseconds(Steady::now() - began).count();
  EXPECT_LT(released, 100);
  try {
    input->state();
    ADD_FAILURE() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::lost);
    row("pedal pulled while it is held: released after %.1f ms, \"%s\"", released, error.what());
  }
}

TEST_F(OperatorGuest, ASpaceMouseThatFallsSilentOrIsPulledStandsStill) {
  Gadget device({"hid", "spacemouse"});  // hid-logitech takes it from a USB bus alone
  const auto input = spacemouse::open(link("hid:046d:c626"), {}, *clock);
  const auto still = [&] { return input->state().translation.norm() == 0; };
  device.order({{"set", {{"deflection", {350, 0, 0, 0, 0, 0}}}}});
  ASSERT_TRUE(time_until(1s, [&] { return input->state().translation.x() > 0.9; }));
  EXPECT_FALSE(time_until(300ms, still)) << "while it is held";
  device.order({{"set", {{"frozen", true}}}});
  const auto silent = time_until(2s, still);
  ASSERT_TRUE(silent);
  EXPECT_LT(silent->count(), 250);
  device.order({{"set", {{"frozen", false}}}});
  ASSERT_TRUE(time_until(1s, [&] { return !still(); }));
  device.unplug();
  std::string said;
  const auto gone = time_until(2s, [&] {
    try {
      return still();
    } catch (const DeviceError& error) {
      said = error.what();
      return true;
    }
  });
  ASSERT_TRUE(gone);
  row("SpaceMouse silent: still after %.1f ms; pulled: after %.1f ms, \"%s\"", silent->count(),
      gone->count(), said.c_str());
}

}  // namespace
}  // namespace vitreo::kernel_guest
