// The drivers over the operating system's own path: unmodified libusb and hidapi, emulated devices
// behind the kernel's interface. ctest starts this program under umockdev-wrapper; these tests wait
// for real, a few milliseconds each.
// SPDX-License-Identifier: Apache-2.0
#include "devices/testbed/usb_testbed.h"

#include "devices/contract/coil_amplifier.h"
#include "devices/contract/lens_mover.h"
#include "devices/contract/operator_input.h"
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/pololu_tic/driver.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/spacemouse/driver.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/roles/reopening.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;
const UsbIdentity kUsb3103{0x09DB,     0x009C, 0x0100, "01A2B3C4", "Measurement Computing Corp",
                           "USB-3103", ""};

struct UsbTestbedTest : ::testing::Test {
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }
  std::unique_ptr<Clock> clock = wall_clock();
  std::unique_ptr<UsbTestbed> testbed = make_usb_testbed();
};

struct TicOverLibusb : UsbTestbedTest {
  ~TicOverLibusb() override { testbed.reset(); }  // before the emulator that is plugged in
  static pololu_tic::EmulatorSettings near_home() {
    pololu_tic::EmulatorSettings settings;
    settings.home_usteps = -160;  // 0.1 mm below: the tests wait for real
    return settings;
  }
  static pololu_tic::Settings small() {
    pololu_tic::Settings settings;
    settings.travel_max = 0.1e-3;
    settings.travel_min = settings.home_position = -0.1e-3;
    settings.acceleration = 0.5;
    return settings;
  }
  std::unique_ptr<LensMover> open() {
    return pololu_tic::open(open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock),
                            small(), *clock);
  }
  std::unique_ptr<pololu_tic::Emulator> emulator = pololu_tic::make_emulator(near_home(), *clock);
  int plug = testbed->plug(*emulator);
};

TEST_F(TicOverLibusb, IsListedWithItsStrings) {
  const auto found = list_usb_devices();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].vendor, 0x1FFB);
  EXPECT_EQ(found[0].serial, "00123456");
  EXPECT_EQ(found[0].name, "Tic");
}

TEST_F(TicOverLibusb, KeepsTheContractOfALensMover) {
  const auto lens_mover = open();
  EXPECT_EQ(lens_mover->identity(), "Pololu Tic T825, firmware 1.06, serial 00123456");
  contract::LensMoverCheck how;
  how.measured = [this] {
    double usteps = 0;
    testbed->with_emulators([&] { usteps = emulator->motor_usteps(); });
    return usteps * 5e-6 / 8;
  };
  EXPECT_EQ(contract::check(*lens_mover, how), Findings{});
}

// As for HID reports, and a control transfer's setup, data and status share a frame.
TEST_F(TicOverLibusb, ATransferTakesAFrame) {
  const auto link = open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock);
  double fastest = 1;
  for (int i = 0; i < 20; ++i) {
    const Time start = clock->now();
    for (int k = 0; k < 10; ++k) link->read({0xC0, 0xA1, 0, 0}, 4, 1s);
    fastest = std::min(fastest, to_seconds(clock->now() - start));
  }
  std::printf("10 control transfers over libusb: fastest %.2f ms\n", fastest * 1e3);
  EXPECT_GE(fastest, 9e-3) << "ten frames, of which the first may have begun";
  // Each frame is ended by a thread that wakes up: the machine's lateness. Exact on the virtual
  // clock (LinkTimes).
  EXPECT_LE(fastest, 1.5 * 10e-3);
}

TEST_F(TicOverLibusb, IsNotThereUnderAnotherSerialNumber) {
  const auto other = [&] { open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3:99"), *clock); };
  EXPECT_EQ(kind_of(other), DeviceErrorKind::not_found);
}

TEST_F(TicOverLibusb, AnswersAgainWhenItIsPluggedInAgainAndStandsUntilItIsToldToMove) {
  const auto lens_mover = reopening([this] { return open(); }, {.name = "lens_mover"}, *clock);
  lens_mover->home(10s);
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(0, 10s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::lost);  // unplugged
  testbed->plug(*emulator);
  clock->sleep_for(100ms);
  EXPECT_TRUE(lens_mover->homed());
  EXPECT_DOUBLE_EQ(lens_mover->position(), -0.1e-3);
  lens_mover->move_to(0, 10s);
  EXPECT_NEAR(lens_mover->position(), 0, 1e-6);
}

TEST_F(TicOverLibusb, MustBeNamedByItsSerialNumberWhenThereAreTwo) {
  auto settings = near_home();
  settings.serial = "2";
  const auto second = pololu_tic::make_emulator(settings, *clock);
  const int other = testbed->plug(*second);
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::not_found);
  EXPECT_EQ(open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3:2"), *clock)->identity().serial,
            "2");
  testbed->unplug(other);
}

TEST_F(TicOverLibusb, ReportsAStalledTransferAsARefusal) {
  const auto link = open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock);
  EXPECT_EQ(kind_of([&] { link->write({0x40, 0x77, 0, 0}, {}, 1s); }), DeviceErrorKind::refused);
}

TEST_F(TicOverLibusb, GivesUpOnASilentDeviceAtTheDeadline) {
  const auto lens_mover = open();
  testbed->set_fault(plug, UsbFault::silent);
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::timeout);
  EXPECT_GE(clock->now() - start, 90ms);
  testbed->set_fault(plug, UsbFault::none);
  EXPECT_NO_THROW(lens_mover->position());
}

TEST_F(TicOverLibusb, IsWaitedForWhileItAnswersLateAndGivenUpOnBeyondTheDeadline) {
  const auto lens_mover = open();
  lens_mover->position();
  testbed->set_latency(plug, 20ms);
  const Time start = clock->now();
  EXPECT_NO_THROW(lens_mover->position());
  EXPECT_GE(clock->now() - start, 20ms);
  testbed->set_latency(plug, 10s);
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::timeout);
  testbed->set_latency(plug, 0ms);
  EXPECT_NO_THROW(lens_mover->position()) << "the transfer that was given up is forgotten";
}

TEST_F(TicOverLibusb, AfterAPowerCutItsPositionIsUncertain) {
  const auto lens_mover = open();
  lens_mover->home(10s);
  ASSERT_TRUE(lens_mover->homed());
  double before = 0, after = 0;
  testbed->with_emulators([&] {
    before = emulator->motor_usteps();
    emulator->power_cycle();
    after = emulator->motor_usteps();
  });
  EXPECT_FALSE(lens_mover->homed());
  EXPECT_EQ(before, after) << "the motor stands where it stood";
}

TEST_F(TicOverLibusb, NoticesAnUnplugInsideATransfer) {
  const auto link = open_usb_link(parse_usb_address("usb", "usb:1ffb:00b3"), *clock);
  testbed->set_fault(plug, UsbFault::silent);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(20ms);
    clock->outside([&] { testbed->unplug(plug); });
  });
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] { link->read({0xC0, 0xA1, 0, 0}, 4, 10s); }), DeviceErrorKind::lost);
  EXPECT_LT(clock->now() - start, 500ms);  // it takes a few ms
}

TEST_F(TicOverLibusb, OpensAgainAfterAReplugWithoutMoving) {
  auto lens_mover = open();
  lens_mover->home(10s);
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(0, 10s); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::not_found);
  lens_mover.reset();
  testbed->plug(*emulator);
  lens_mover = open();
  EXPECT_TRUE(lens_mover->homed());
  EXPECT_DOUBLE_EQ(lens_mover->position(), -0.1e-3);
}

struct Usb3103OverHidraw : UsbTestbedTest {
  ~Usb3103OverHidraw() override { testbed.reset(); }
  std::unique_ptr<CoilAmplifier> open() {
    return usb3103::open(open_hid_link(parse_usb_address("hid", "hid:09db:009c"), *clock), {},
                         *clock);
  }
  usb3103::Voltages outputs() {
    usb3103::Voltages volts{};
    testbed->with_emulators([&] { volts = emulator->outputs(); });
    return volts;
  }
  std::unique_ptr<usb3103::Emulator> emulator = usb3103::make_emulator({}, nullptr);
  int plug = testbed->plug(*emulator, kUsb3103);
};

TEST_F(Usb3103OverHidraw, IsListedWithItsStrings) {
  const auto found = list_hid_devices();
  ASSERT_EQ(found.size(), 1U);
  EXPECT_EQ(found[0].product, 0x009C);
  EXPECT_EQ(found[0].serial, "01A2B3C4");
  EXPECT_EQ(found[0].name, "USB-3103");
}

TEST_F(Usb3103OverHidraw, KeepsTheContractOfACoilAmplifier) {
  const auto coils = open();
  contract::CoilAmplifierCheck how;
  how.measured = [this] {
    const usb3103::Voltages volts = outputs();
    std::vector<double> amperes(volts.begin(), volts.end());
    for (double& current : amperes) current *= 2;
    return amperes;
  };
  EXPECT_EQ(contract::check(*coils, how), Findings{});
}

// Eleven frames of 1 ms, of which the first may have begun. The machine's lateness only adds, and
// differs from try to try: the fastest of many is the bus' own.
TEST_F(Usb3103OverHidraw, AnUpdateTakesAFrameForEachReport) {
  const auto coils = open();
  std::vector<double> took;
  for (int i = 0; i < 50; ++i) {
    const Time start = clock->now();
    coils->set_currents(std::vector<double>(8, i % 2 == 0 ? 1. : -1.));
    took.push_back(to_seconds(clock->now() - start));
  }
  std::sort(took.begin(), took.end());
  std::printf("update of 8 coils over hidraw: fastest %.2f ms, median %.2f ms\n", took[0] * 1e3,
              took[25] * 1e3);
  EXPECT_GE(took.front(), 10e-3);
  EXPECT_LE(took.front(), 1.5 * 11e-3);  // as of ATransferTakesAFrame
}

// A set point, a heartbeat and a watch write to one device: a report on its way is another task's.
TEST_F(Usb3103OverHidraw, ReportsOfTwoTasksAllArrive) {
  struct Counter : HidPeer {
    std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t> report) override {
      ++counts[report[1]];
      return {};
    }
    std::map<int, int> counts;
  } counter;
  UsbIdentity identity = kUsb3103;
  identity.serial = "counter";
  const int plugged = testbed->plug(counter, identity);
  constexpr int kReports = 300;
  {
    const auto link = open_hid_link(parse_usb_address("hid", "hid:09db:009c:counter"), *clock);
    const auto write = [&](std::uint8_t who) {
      for (int i = 0; i < kReports; ++i)
        link->write(std::vector<std::uint8_t>{0x06, who, std::uint8_t(i % 2)});
    };
    const auto other = clock->spawn("other", [&] { write(2); });
    write(1);
    other->join();
  }
  testbed->with_emulators([&] {
    EXPECT_EQ(counter.counts[1], kReports);
    EXPECT_EQ(counter.counts[2], kReports);
  });
  testbed->unplug(plugged);
}

// Each device has its own place in a frame, and no handler sleeps while another's transfer waits.
/// A loop sets currents while the interlock's watch asks whether the amplifier is still there: no
/// report of one may be lost by the other.
TEST_F(Usb3103OverHidraw, IsSetAndAskedByTwoTasksAtOnce) {
  const auto coils = open();
  std::vector<std::string> errors;
  const auto times = [&](int count, Time pause, const std::function<void()>& work) {
    for (int i = 0; i < count; ++i) {
      try {
        work();
      } catch (const DeviceError& error) {
        errors.emplace_back(error.what());
      }
      clock->sleep_for(pause);
    }
  };
  const auto watch =
      clock->spawn("watch", [&] { times(60, 3ms, [&] { coils->measured_currents(); }); });
  times(40, 2ms, [&] { coils->set_currents(std::vector<double>(8, 0.1)); });
  watch->join();
  EXPECT_EQ(errors, Findings{});
}

TEST_F(Usb3103OverHidraw, FramesOfOneDeviceDoNotHoldUpAnother) {
  const auto second = usb3103::make_emulator({}, nullptr);
  const UsbIdentity identity{0x09DB, 0x009C, 0x0100, "2", "MCC", "USB-3103", ""};
  const int other = testbed->plug(*second, identity, kVendorUsage, 1, 200ms);
  {
    const auto slow = open_hid_link({0x09DB, 0x009C, "2"}, *clock);
    const auto fast = open_hid_link({0x09DB, 0x009C, "01A2B3C4"}, *clock);
    bool written = false;
    const auto writer = clock->spawn("writer", [&] {
      slow->write(usb3103::encode(usb3103::GetStatus{}));
      written = true;
    });
    int reports = 0;
    for (; !written && reports < 1000; ++reports)
      fast->write(usb3103::encode(usb3103::GetStatus{}));
    EXPECT_GE(reports, 5) << "while one report of the other waited for its frame of 200 ms";
    writer->join();
  }
  testbed->unplug(other);
}

TEST_F(Usb3103OverHidraw, IsNotThereUnderAnotherSerialNumber) {
  EXPECT_EQ(kind_of([&] { open_hid_link(parse_usb_address("hid", "hid:09db:009c:7"), *clock); }),
            DeviceErrorKind::not_found);
}

TEST_F(Usb3103OverHidraw, GivesUpOnASilentDeviceAtTheDeadline) {
  const auto coils = open();
  testbed->set_fault(plug, UsbFault::silent);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 1)); }),
            DeviceErrorKind::timeout);
  testbed->set_fault(plug, UsbFault::none);
  coils->make_safe();
  EXPECT_EQ(outputs(), usb3103::Voltages{});
}

TEST_F(Usb3103OverHidraw, ComesBackAtZeroWhenItIsMadeSafeAfterAReplug) {
  const auto coils = reopening([this] { return open(); }, {.name = "coils"}, *clock);
  coils->set_currents(std::vector<double>(8, 1));
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 2)); }),
            DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);  // unplugged
  EXPECT_NE(outputs(), usb3103::Voltages{});
  testbed->plug(*emulator, kUsb3103);
  clock->sleep_for(100ms);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 2)); }),
            DeviceErrorKind::lost);
  coils->make_safe();
  EXPECT_EQ(outputs(), usb3103::Voltages{});
  coils->set_currents(std::vector<double>(8, 2));
  EXPECT_NE(outputs(), usb3103::Voltages{});
}

TEST_F(Usb3103OverHidraw, NoticesAnUnplugInsideARead) {
  const auto link = open_hid_link(parse_usb_address("hid", "hid:09db:009c"), *clock);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(20ms);
    clock->outside([&] { testbed->unplug(plug); });
  });
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] { link->read(10s); }), DeviceErrorKind::lost);
  EXPECT_LT(clock->now() - start, 500ms);  // it takes a few ms
  hand->join();
}

TEST_F(Usb3103OverHidraw, ComesBackAtZeroAfterAnUnplug) {
  auto coils = open();
  coils->set_currents(std::vector<double>(8, 1));
  testbed->unplug(plug);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 2)); }),
            DeviceErrorKind::lost);
  coils.reset();
  EXPECT_NE(outputs(), usb3103::Voltages{});  // no watchdog: it holds what it was told last
  testbed->plug(*emulator, kUsb3103);
  coils = open();
  EXPECT_EQ(outputs(), usb3103::Voltages{});
}

// Opening zeroes, so a second program that got that far would spoil the first one's run unseen.
TEST_F(Usb3103OverHidraw, HasOneOwnerWhoseOutputsASecondOpenerDoesNotTouch) {
  const auto coils = open();
  coils->set_currents(std::vector<double>(8, 1));
  const usb3103::Voltages before = outputs();
  EXPECT_EQ(kind_of([&] { open(); }), DeviceErrorKind::refused);
  EXPECT_EQ(outputs(), before);
  EXPECT_NO_THROW(coils->set_currents(std::vector<double>(8, 1)));
}

TEST_F(Usb3103OverHidraw, GivesUpOnAReportThatDoesNotGetThroughWithinHalfASecond) {
  auto coils = open();
  testbed->set_fault(plug, UsbFault::stuck);
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 1)); }),
            DeviceErrorKind::timeout);
  EXPECT_GE(clock->now() - start, 490ms);
  EXPECT_LT(clock->now() - start, 2s);  // the kernel alone would hold it for 5 s
  const Time again = clock->now();
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }),
            DeviceErrorKind::lost);  // nor does what follows wait for each
  EXPECT_LT(clock->now() - again, 400ms);
  coils.reset();
  testbed->set_fault(plug, UsbFault::none);
  coils = open();
  EXPECT_EQ(outputs(), usb3103::Voltages{});
  EXPECT_NO_THROW(coils->set_currents(std::vector<double>(8, 1)));
}

TEST_F(Usb3103OverHidraw, AnAmplifierWhoseLinkGotStuckIsOpenedAgainByMakingItSafe) {
  const auto coils = reopening([this] { return open(); }, {.name = "coils"}, *clock);
  coils->set_currents(std::vector<double>(8, 1));
  testbed->set_fault(plug, UsbFault::stuck);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 2)); }),
            DeviceErrorKind::timeout);
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  // it stays so for as long as it takes nothing: the enable line's business
  EXPECT_NE(outputs(), usb3103::Voltages{});
  testbed->set_fault(plug, UsbFault::none);
  clock->sleep_for(100ms);
  EXPECT_EQ(kind_of([&] { coils->set_currents(std::vector<double>(8, 2)); }),
            DeviceErrorKind::lost);
  coils->make_safe();
  EXPECT_EQ(outputs(), usb3103::Voltages{});
  EXPECT_NO_THROW(coils->set_currents(std::vector<double>(8, 1)));
}

struct OperatorOverHidraw : UsbTestbedTest {
  ~OperatorOverHidraw() override { testbed.reset(); }
  std::unique_ptr<OperatorInput> open_pedal() {
    return foot_pedal::open(open_hid_link(parse_usb_address("hid", "hid:05f3:0268"), *clock), {});
  }
  std::unique_ptr<OperatorInput> open_mouse() {
    return spacemouse::open(open_hid_link(parse_usb_address("hid", "hid:256f:c635"), *clock), {},
                            *clock);
  }
  /// Until it says so, or half a second is over.
  bool soon(const std::function<bool()>& says) {
    const Time end = clock->now() + 500ms;
    while (clock->now() < end) {
      if (says()) return true;
      clock->sleep_for(2ms);
    }
    return false;
  }
  foot_pedal::Emulator foot;
  spacemouse::Emulator hand;
  int pedal = testbed->plug(foot, {0x05F3, 0x0268, 0x0100, "", "P.I. Engineering", "XK-3", ""});
  int mouse = testbed->plug(
      hand, {0x256F, 0xC635, 0x0100, "", "3Dconnexion", "SpaceMouse Compact", ""}, 0x01, 0x08);
};

TEST_F(OperatorOverHidraw, KeepTheContractOfAnOperatorInput) {
  EXPECT_EQ(contract::check(*open_pedal(), *clock), Findings{});
  EXPECT_EQ(contract::check(*open_mouse(), *clock), Findings{});
}

TEST_F(OperatorOverHidraw, APedalThatIsPluggedInAgainWorksAgainAndIsNotHeldBecauseItWas) {
  const auto input = reopening([this] { return open_pedal(); }, {.name = "pedal"}, *clock);
  testbed->with_emulators([&] { foot.press(2); });
  EXPECT_TRUE(soon([&] { return is_held(input.get(), 2); }));
  testbed->unplug(pedal);
  EXPECT_TRUE(soon([&] { return !is_held(input.get(), 2); }));
  EXPECT_EQ(kind_of([&] { input->state(); }), DeviceErrorKind::lost);
  foot_pedal::Emulator other;  // its foot is still on it: it says so when that changes
  testbed->plug(other, {0x05F3, 0x0268, 0x0100, "", "P.I. Engineering", "XK-3", ""});
  clock->sleep_for(120ms);
  EXPECT_EQ(input->state().pressed, 0U);
  testbed->with_emulators([&] { other.press(2); });
  EXPECT_TRUE(soon([&] { return is_held(input.get(), 2); }));
  testbed.reset();  // before `other`
}

TEST_F(OperatorOverHidraw, TheMouseIsFeltInOurAxesAndLetGoWhenItFallsSilent) {
  const auto input = open_mouse();
  testbed->with_emulators([&] {
    hand.deflect({350, 0, 0}, {0, 0, 0});
    hand.press(1);
  });
  EXPECT_TRUE(
      soon([&] { return input->state().translation.x() == 1 && input->state().pressed == 1; }));
  EXPECT_TRUE(soon([&] { return input->state().translation.x() == 0; }));
}

TEST_F(OperatorOverHidraw, APedalThatIsPulledIsAReleasedOneWithinHalfASecond) {
  const auto input = open_pedal();
  testbed->with_emulators([&] { foot.press(0b10); });
  EXPECT_TRUE(soon([&] { return is_held(input.get(), 0b10); }));
  testbed->unplug(pedal);
  EXPECT_TRUE(soon([&] { return !is_held(input.get(), 0b10); }));
  EXPECT_EQ(kind_of([&] { input->state(); }), DeviceErrorKind::lost);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
