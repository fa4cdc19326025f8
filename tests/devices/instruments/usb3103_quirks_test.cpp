// Quirks of the USB-3103, one test each.
// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/instruments/usb3103_test_bench.h"

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

struct Usb3103Quirk : Usb3103Driver {
  Usb3103Quirk() { settings.enable_line = 3; }
  bool enabled() const { return bench.emulator->line_is_high(3); }
};

TEST_F(Usb3103Quirk, HasNoReadBackSoOnlyItsLifeIsVerified) {
  const auto coils = open_on(bench);
  bench.answer = [](Bytes report) -> std::optional<std::vector<Report>> {
    if (report[0] == kAnalogOutSync)
      return std::vector<Report>{};  // the sync gets lost inside the device
    return std::nullopt;
  };
  coils->set_currents(kSomeCurrents);  // nothing can be noticed
  EXPECT_EQ(coils->currents(), kSomeCurrents);
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103Quirk, HasNoWatchdogAndHoldsItsLastVoltages) {
  const auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  const Voltages held = bench.outputs();
  cable.writes_left = 0;
  clock->sleep_for(std::chrono::hours(1));
  EXPECT_EQ(bench.outputs(), held);
  EXPECT_TRUE(enabled());  // this is what the enable line's own switch is for
  cable.writes_left = -1;
}

TEST_F(Usb3103Quirk, EnablesTheAmplifiersOnlyWhenCurrentsAreSet) {
  const auto coils = open_on(bench);
  EXPECT_FALSE(enabled());
  coils->set_currents(kSomeCurrents);
  EXPECT_TRUE(enabled());
  coils->make_safe();
  EXPECT_FALSE(enabled());
  coils->set_currents(kSomeCurrents);
  EXPECT_TRUE(enabled());
}

TEST_F(Usb3103Quirk, EnablesTheAmplifiersBeforeTheStepAndOnce) {
  const auto coils = open_on(bench);
  bench.sent.clear();
  coils->set_currents(kSomeCurrents);
  EXPECT_EQ(bench.sent.front(), (Report{0x06, 3, 1}));
  EXPECT_EQ(bench.sent.size(), 11U);
  coils->set_currents(kSomeCurrents);
  EXPECT_EQ(bench.sent.size(), 21U);
}

TEST_F(Usb3103Quirk, DisablesWhatAHostThatDiedLeftEnabled) {
  auto coils = open_on(bench);
  coils->set_currents(kSomeCurrents);
  cable.writes_left = 0;
  coils.reset();
  EXPECT_TRUE(enabled());
  cable.writes_left = -1;
  coils = open_on(bench);
  EXPECT_FALSE(enabled());
  EXPECT_EQ(bench.outputs(), Voltages{});
}

TEST_F(Usb3103Quirk, DisablesTheAmplifiersEvenWhenNoZeroGetsThrough) {
  struct Deaf final : HidLink {
    Deaf(std::unique_ptr<HidLink> its_link, const bool& its_deaf)
        : link(std::move(its_link)), deaf(its_deaf) {}
    void write(std::span<const std::uint8_t> report) override {
      if (deaf && report[0] == kAnalogOut)
        throw DeviceError(DeviceErrorKind::lost, "hid", "pipe error");
      link->write(report);
    }
    std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
      return link->read(timeout);
    }
    std::unique_ptr<HidLink> link;
    const bool& deaf;
  };
  bool deaf = false;
  const auto coils = open(std::make_unique<Deaf>(memory_hid_link(bench, *clock, kLatency), deaf),
                          settings, *clock);
  coils->set_currents(kSomeCurrents);
  deaf = true;
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  EXPECT_NE(bench.outputs(), Voltages{});
  EXPECT_FALSE(enabled());
  deaf = false;
}

TEST_F(Usb3103Quirk, HasEightDigitalLines) {
  settings.enable_line = 8;
  EXPECT_THROW(open_on(bench), std::invalid_argument);
  EXPECT_FALSE(decode_command(Report{0x06, 8, 1}));
  EXPECT_FALSE(decode_command(Report{0x02, 0}));
  EXPECT_EQ(encode(DigitalConfig{3, false}), (Report{0x02, 3, 0}));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
