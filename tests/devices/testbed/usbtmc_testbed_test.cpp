// USBTMC through libusb and the kernel's interface, on umockdev's bus: under umockdev-wrapper.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/address.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/usbtmc_stand_in.h"

#include <gtest/gtest.h>

#include <functional>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct UsbtmcOnABus : ::testing::Test {
  std::unique_ptr<MessageLink> open(const std::string& place = "1bfa:0498") {
    return open_message_link("usbtmc:" + place, *clock);
  }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device.rfind("usbtmc:1bfa:0498", 0), 0U) << error.device;
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::protocol;
  }
  std::unique_ptr<Clock> clock = wall_clock();
  UsbtmcStandIn instrument;
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
  const int plug = testbed->plug(instrument);
};

TEST_F(UsbtmcOnABus, CarriesMessages) {
  auto link = open("1bfa:0498:0417");
  ByteString large(3000);
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<std::uint8_t>(i * 7);
  for (const ByteString& one : {bytes("*IDN?"), large, ByteString(64 - 12, 'x')}) {
    link->write(one, 1s);
    EXPECT_EQ(link->read(5000, 1s), one);
  }
}

TEST_F(UsbtmcOnABus, WaitsAsLongAsItIsToldAndGoesOn) {
  testbed->with_emulators([&] { instrument.silent = true; });
  const auto link = open();
  link->write(bytes("a?"), 1s);
  const Time before = clock->now();
  EXPECT_EQ(link->read(99, 250ms), std::nullopt);
  EXPECT_GE(clock->now() - before, 250ms);
  EXPECT_LT(clock->now() - before, 1s);
  link->write(bytes("b?"), 1s);  // ends the read that is under way
  testbed->with_emulators([&] {
    instrument.silent = false;
    instrument.output.pop_front();
  });
  EXPECT_EQ(link->read(99, 1s), bytes("b?"));
  link->clear(1s);
  link->write(bytes("c?"), 1s);
  EXPECT_EQ(link->read(99, 1s), bytes("c?"));
}

TEST_F(UsbtmcOnABus, HasOneOwner) {
  const auto link = open();
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::refused);
}

TEST_F(UsbtmcOnABus, IsLostWhenItIsUnpluggedAndComesBack) {
  const auto link = open();
  int again = 0;
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { link->write(bytes("a"), 1s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->read(9, 1s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { link->reopen(); }), DeviceErrorKind::not_found);
  again = testbed->plug(instrument);
  link->reopen();
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
  testbed->unplug(again);
}

TEST_F(UsbtmcOnABus, AnotherDeviceIsNotTakenForIt) {
  EXPECT_EQ(kind_of([&] { open("1bfa:0498:0418"); }), DeviceErrorKind::not_found);
  struct Plain final : UsbPeer {
    const UsbIdentity& identity() const override { return who; }
    std::optional<std::vector<std::uint8_t>> control(const UsbSetup&, std::span<const std::uint8_t>,
                                                     std::uint16_t) override {
      return std::nullopt;
    }
    UsbIdentity who{0x1BFA, 0x0498, 0x0100, "9", "Metrolab", "none", ""};
  } plain;
  const int other = testbed->plug(plain);
  EXPECT_EQ(kind_of([&] { open("1bfa:0498:9"); }), DeviceErrorKind::not_found);
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::not_found) << "there are several";
  testbed->unplug(other);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
