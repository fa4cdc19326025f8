// Input devices through libevdev and the kernel's interface, on umockdev's testbed: under
// umockdev-wrapper.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <functional>
#include <linux/input-event-codes.h>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct EvdevOnATestbed : ::testing::Test {
  std::unique_ptr<EventLink> open(const std::string& place = "054c:09cc") {
    return open_event_link("evdev:" + place, *clock);
  }
  std::string node() const { return "/dev/input/event" + std::to_string(plug); }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device.rfind("evdev:", 0), 0U) << error.device;
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::protocol;
  }
  void turn(int x) {
    pad.axes[0].value = x;
    testbed->change(plug, pad, {{EV_ABS, ABS_X, x}, {EV_SYN, SYN_REPORT, 0}});
  }
  std::unique_ptr<Clock> clock = wall_clock();
  InputNode pad{"Wireless Controller",
                "40:1b",
                0x054C,
                0x09CC,
                {{ABS_X, 128, 0, 255, 15}, {ABS_Y, 127, 0, 255, 15}},
                {BTN_SOUTH, BTN_EAST},
                {BTN_EAST}};
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  const int plug = testbed->plug(pad);
};

TEST_F(EvdevOnATestbed, TellsItsAxesAndButtonsAndTheirState) {
  const auto link = open();
  const EventDevice& device = link->device();
  EXPECT_EQ(device.name, "Wireless Controller");
  EXPECT_EQ(device.serial, "40:1b");
  EXPECT_EQ(device.axes, (std::vector<EventAxis>{{"ABS_X", 0, 255, 15}, {"ABS_Y", 0, 255, 15}}));
  EXPECT_EQ(device.buttons, (std::vector<std::string>{"BTN_SOUTH", "BTN_EAST"}));
  EXPECT_EQ(link->state().axes, (std::vector<int>{128, 127}));
  EXPECT_EQ(link->state().pressed, (std::vector<bool>{false, true}));
  EXPECT_EQ(link->state().at, 0s);
}

TEST_F(EvdevOnATestbed, TellsWhatChangesAndWhen) {
  const auto link = open(node());
  EXPECT_FALSE(link->wait(20ms));
  const Time before = clock->now();
  turn(200);
  EXPECT_TRUE(link->wait(1s));
  EXPECT_EQ(link->state().axes[0], 200);
  EXPECT_GE(link->state().at, before - 1ms);
  EXPECT_LE(link->state().at, clock->now());
  EXPECT_FALSE(link->wait(0s));
  pad.held = {BTN_SOUTH};
  testbed->change(plug, pad,
                  {{EV_KEY, BTN_SOUTH, 1}, {EV_KEY, BTN_EAST, 0}, {EV_SYN, SYN_REPORT, 0}});
  EXPECT_EQ(link->state().pressed, (std::vector<bool>{true, false}));
}

// The kernel's queue was full: what is held now is asked anew, or a button that was let go
// meanwhile would stay pressed for ever.
TEST_F(EvdevOnATestbed, AsksAnewWhereEventsWereDropped) {
  const auto link = open();
  pad.axes[1].value = 3;
  pad.held = {BTN_SOUTH};
  testbed->change(plug, pad, {{EV_SYN, SYN_DROPPED, 0}, {EV_SYN, SYN_REPORT, 0}});
  EXPECT_TRUE(link->wait(1s));
  EXPECT_EQ(link->state().axes, (std::vector<int>{128, 3}));
  EXPECT_EQ(link->state().pressed, (std::vector<bool>{true, false}));
  turn(9);
  EXPECT_EQ(link->state().axes, (std::vector<int>{9, 3})) << "and goes on";
}

TEST_F(EvdevOnATestbed, HasOneOwner) {
  const auto link = open();
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::refused);
}

TEST_F(EvdevOnATestbed, IsLostWhenItIsUnpluggedAndComesBack) {
  const auto link = open();
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { link->wait(1s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->state(); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::not_found);
  InputNode other = pad;
  other.keys = {BTN_SOUTH};
  const int wrong = testbed->plug(other);
  EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::not_found) << "other buttons";
  testbed->unplug(wrong);
  pad.axes[0].value = 77;
  const int again = testbed->plug(pad);
  link->reopen();
  EXPECT_EQ(link->state().axes[0], 77);
  testbed->unplug(again);
}

TEST_F(EvdevOnATestbed, OfSeveralNodesOfADeviceThePadIsMeant) {
  InputNode motion = pad;
  motion.name = "Wireless Controller Motion Sensors";
  motion.keys = {};
  const int sensors = testbed->plug(motion);
  EXPECT_EQ(open()->device().name, "Wireless Controller");
  const int twin = testbed->plug(pad);
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::not_found) << "two pads";
  EXPECT_EQ(kind_of([&] { open("054c:09cc:other"); }), DeviceErrorKind::not_found);
  testbed->unplug(twin);
  testbed->unplug(sensors);
}

TEST_F(EvdevOnATestbed, AddressesThatAreNoneAreNamed) {
  EXPECT_THROW(open("pad"), std::invalid_argument);
  EXPECT_THROW(open_event_link("hid:054c:09cc", *clock), std::invalid_argument);
  EXPECT_EQ(kind_of([&] { open("/dev/input/event99"); }), DeviceErrorKind::not_found);
  EXPECT_EQ(kind_of([&] { open("/dev/null"); }), DeviceErrorKind::not_found);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
