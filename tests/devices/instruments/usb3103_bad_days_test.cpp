// The USB-3103's driver on bad days: silence, nonsense, pulled cables, stopped tasks. The outputs
// end at zero.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <gtest/gtest.h>

#include <algorithm>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct Usb3103BadDay : Usb3103Driver {};

TEST_F(Usb3103BadDay, GivesUpOnASilentDeviceAtTheDeadline) {
  bench.answer = [](Bytes) { return std::vector<Report>{}; };
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), kLatency + from_seconds(settings.reply_timeout));
}

TEST_F(Usb3103BadDay, TakesNoAnswerThatComesTooLate) {
  const auto slow = [&] { return open(memory_hid_link(bench, *clock, 200ms), settings, *clock); };
  EXPECT_EQ(kind_of(slow), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), 200ms + from_seconds(settings.reply_timeout));
}

TEST_F(Usb3103BadDay, FindsNoUsb3103BehindForeignAnswers) {
  bench.answer_with(kGetStatus, {{0x03, 1}, {}, {0x77, 1, 2}});
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::not_found);
  EXPECT_EQ(bench.sent.size(), 1U);  // and tells a stranger nothing
  bench.answer_with(kGetStatus, std::vector<Report>(1000, {0x03, 1}));
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::not_found);
  bench.answer_with(kGetStatus, {{0x44}});
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::not_found);
}

TEST_F(Usb3103BadDay, SaysOfAnOpeningThatFailedWhichZerosWereSentAndThatNoneIsConfirmed) {
  const auto said = [&] {
    try {
      open_on(bench);
    } catch (const DeviceError& error) {
      return std::string(error.what());
    }
    return std::string("no error");
  };
  cable.writes_left = 0;
  EXPECT_EQ(said(),
            "coils: hid:09db:009c: no such device; no zero was sent to its outputs, so a current "
            "that was set before may still flow (lost)");
  cable.writes_left = 1 + 3;  // the question for its status, and three zeros
  EXPECT_EQ(said(),
            "coils: hid:09db:009c: no such device; a zero was sent to 3 of its 8 outputs, so a "
            "current may still flow (lost)");
  cable.writes_left = -1;
  bench.answer_with(kMemoryRead, {{0x30, 0, 0, 0x80}});
  EXPECT_EQ(said(),
            "coils: its calibration is cut short: \"0\\x00\\x00\\x80\"; zeros were sent to its "
            "outputs, and it has no "
            "read-back to confirm them (protocol)");
}

TEST_F(Usb3103BadDay, PassesOverForeignAnswersBeforeTheRightOne) {
  bench.answer_with(kGetStatus, {{0x03, 1}, {}, {0x44, 1}});
  const auto coils = open_on(bench);
  EXPECT_NO_THROW(coils->set_currents(kSomeCurrents));
}

TEST_F(Usb3103BadDay, DoesNotTakeALeftOverAnswerForANewOne) {
  const auto coils = open_on(bench);
  bench.answer_with(kGetStatus, {{0x44, 1}, {0x44, 1}});  // one too many
  coils->set_currents(kSomeCurrents);
  clock->sleep_for(1s);
  bench.answer_with(kGetStatus, {});
  EXPECT_EQ(kind_of([&] { coils->set_currents(kSomeCurrents); }), DeviceErrorKind::timeout);
}

TEST_F(Usb3103BadDay, RefusesADeviceThatStaysASlave) {
  bench.answer_with(kGetStatus, {{0x44, 0}});
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::refused);
}

TEST_F(Usb3103BadDay, TellsACalibrationThatIsCutShortFromNone) {
  bench.answer_with(kMemoryRead, {{0x30, 0, 0, 0x80}});
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::protocol);
  bench.answer_with(kMemoryRead, {});
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::timeout);
}

TEST_F(Usb3103BadDay, ReportsACableThatWasNeverThere) {
  cable.writes_left = 0;
  EXPECT_EQ(kind_of([&] { open_on(bench); }), DeviceErrorKind::lost);
}

TEST_F(Usb3103BadDay, NoticesADeviceThatDiesBetweenUpdates) {
  const auto coils = open_on(bench);
  bench.answer = [](Bytes) { return std::vector<Report>{}; };
  EXPECT_EQ(kind_of([&] { coils->set_currents(kSomeCurrents); }), DeviceErrorKind::timeout);
}

TEST_F(Usb3103BadDay, EndsAtZeroWhereverInAnUpdateTheCableWasPulled) {
  const Currents others{-3, 3, -3, 3, -3, 3, -3, 3};
  for (int writes = 0; writes <= 9; ++writes) {
    const auto coils = open_on(bench);
    coils->set_currents(kSomeCurrents);
    const Voltages before = bench.outputs();
    cable.writes_left = writes;
    EXPECT_EQ(kind_of([&] { coils->set_currents(others); }), DeviceErrorKind::lost);
    EXPECT_EQ(bench.outputs() == before, writes < 9);  // no coil stepped alone
    EXPECT_EQ(coils->currents(), writes < 8 ? kSomeCurrents : others);
    EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
    cable.writes_left = -1;
    coils->make_safe();
    EXPECT_EQ(bench.outputs(), Voltages{});
    coils->set_currents(others);
    EXPECT_NEAR(bench.outputs()[0], -1.5, kCount);
  }
}

TEST_F(Usb3103BadDay, TriesTheOtherChannelsWhenOneZeroDoesNotGetThrough) {
  struct Hiccup final : HidLink {
    Hiccup(std::unique_ptr<HidLink> its_link, int& its_failing)
        : link(std::move(its_link)), failing(its_failing) {}
    void write(std::span<const std::uint8_t> report) override {
      if (failing > 0 && report[0] == kAnalogOut && report[1] == 2) {
        --failing;
        throw DeviceError(DeviceErrorKind::lost, "hid", "pipe error");
      }
      link->write(report);
    }
    std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
      return link->read(timeout);
    }
    std::unique_ptr<HidLink> link;
    int& failing;
  };
  int failing = 0;
  const auto coils =
      open(std::make_unique<Hiccup>(memory_hid_link(bench, *clock, kLatency), failing), settings,
           *clock);
  coils->set_currents(kSomeCurrents);
  failing = 2;
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  EXPECT_EQ(bench.outputs()[1], 0);
  EXPECT_NE(bench.outputs()[2], 0);
  EXPECT_EQ(bench.outputs()[3], 0);
  coils->set_currents(kSomeCurrents);
  failing = 1;
  EXPECT_NO_THROW(coils->make_safe());
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103BadDay, EndsAtZeroInATaskThatIsStopped) {
  const auto servo = clock->spawn("servo", [&] {
    const auto coils = open_on(bench);
    for (;; clock->sleep_for(3ms)) coils->set_currents(kSomeCurrents);
  });
  clock->sleep_for(1s);
  EXPECT_NE(bench.outputs(), Voltages{});
  servo->request_stop();
  servo->join();
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103BadDay, MakesSafeInSpiteOfAnInterruptAndPassesItOn) {
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  clock->interrupt();
  EXPECT_THROW(coils->make_safe(), Stopped);
  EXPECT_EQ(bench.outputs(), Voltages{});
  EXPECT_EQ(coils->currents(), Currents(8));
}

// A stop that comes with the very report which takes the amplifiers' enable line away.
TEST_F(Usb3103BadDay, PassesOnAnInterruptThatComesWithItsLastReport) {
  settings.enable_line = 3;
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  const Report off = encode(DigitalOut{3, false});
  const Report on = encode(DigitalOut{3, true});
  const std::uint8_t zero = encode(AnalogOut{0, 0, false})[0];
  int zeros = 0;
  bench.answer = [&](Bytes report) -> std::optional<std::vector<Report>> {
    if (report[0] == zero && ++zeros == 8) clock->interrupt();
    return std::nullopt;
  };
  EXPECT_THROW(coils->make_safe(), Stopped);
  bench.answer = nullptr;
  EXPECT_EQ(bench.sent.back(), off);
  EXPECT_EQ(coils->currents(), Currents(8));
  // It counts as taken away: the next currents raise it again.
  bench.sent.clear();
  coils->set_currents(kSomeCurrents);
  EXPECT_EQ(std::ranges::count(bench.sent, on), 1);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
