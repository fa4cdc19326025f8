// Instruments that come back: opened again with their settings, at zero and standing, and never the
// wrong one.
// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/reopening.h"

#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/led_lamp/driver.h"
#include "tests/devices/instruments/pololu_tic_test_bench.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <gtest/gtest.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct ReopenedCoils : usb3103::Usb3103Driver {
  std::unique_ptr<CoilAmplifier> coils = reopen();
  std::unique_ptr<CoilAmplifier> reopen() {
    settings.enable_line = 3;
    return reopening([this] { return open_on(bench); }, {.name = "coils"}, *clock);
  }
  void pull() { cable.writes_left = 0; }
  void put_back() { cable.writes_left = -1; }
};

TEST_F(ReopenedCoils, ComeBackAtZeroByMakeSafeAloneAndDropTheirSetPoint) {
  coils->set_currents(usb3103::kSomeCurrents);
  pull();
  EXPECT_EQ(kind_of([&] { coils->set_currents(usb3103::kSomeCurrents); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { coils->make_safe(); }), DeviceErrorKind::lost);
  EXPECT_NE(bench.outputs(), usb3103::Voltages{}) << "it holds what it was told last";
  EXPECT_EQ(coils->currents(), usb3103::kSomeCurrents) << "and so nobody says that it is at zero";
  put_back();
  clock->sleep_for(1s);
  EXPECT_EQ(kind_of([&] { coils->set_currents(usb3103::kSomeCurrents); }), DeviceErrorKind::lost);
  EXPECT_NE(bench.outputs(), usb3103::Voltages{}) << "a set-point opens nothing";
  bench.sent.clear();
  coils->make_safe();
  EXPECT_EQ(bench.outputs(), usb3103::Voltages{});
  EXPECT_EQ(coils->currents(), usb3103::Currents(8));
  const auto configured = [&](usb3103::Report start) {
    return std::any_of(bench.sent.begin(), bench.sent.end(), [&](const usb3103::Report& one) {
      return one.size() >= start.size() && std::equal(start.begin(), start.end(), one.begin());
    });
  };
  EXPECT_TRUE(configured(usb3103::encode(usb3103::DigitalConfig{3, false})))
      << "its settings are applied again";
  EXPECT_TRUE(configured(usb3103::encode(usb3103::SetSync{.master = true})));
  coils->set_currents(usb3103::kSomeCurrents);
  EXPECT_NE(bench.outputs(), usb3103::Voltages{});
}

TEST_F(ReopenedCoils, AreNotAskedAgainAndAgainWhileTheyAreGone) {
  int opened = 0;
  const auto other = reopening(
      [&] {
        ++opened;
        return open_on(bench);
      },
      {.name = "coils", .retry = 100ms}, *clock);
  pull();
  for (int i = 0; i < 50; ++i, clock->sleep_for(10ms))
    EXPECT_EQ(kind_of([&] { other->make_safe(); }), DeviceErrorKind::lost);
  EXPECT_GE(opened, 5);
  EXPECT_LE(opened, 7);
  put_back();
  clock->sleep_for(100ms);
  EXPECT_NO_THROW(other->make_safe());
}

TEST_F(ReopenedCoils, SayWhyTheyCannotBeOpenedAgainAndNameTheRoleOnce) {
  pull();
  EXPECT_EQ(kind_of([&] { coils->set_currents(usb3103::kSomeCurrents); }), DeviceErrorKind::lost);
  try {
    coils->make_safe();
    FAIL() << "it is still gone";
  } catch (const DeviceError& error) {
    EXPECT_STREQ(error.what(),
                 "coils: it was lost, and cannot be opened again: hid:09db:009c: no such device; "
                 "no zero was sent to its outputs, so a current that was set before may still flow "
                 "(lost)");
  }
}

TEST_F(ReopenedCoils, OnALampComeBackDark) {
  led_lamp::Settings lamp_settings;
  lamp_settings.full_current = 1;
  const auto lamp = reopening([&] { return led_lamp::open(open_on(bench), lamp_settings); },
                              {.name = "lamp"}, *clock);
  lamp->set_level(0.5);
  pull();
  EXPECT_THROW(lamp->set_level(0.6), DeviceError);
  EXPECT_EQ(lamp->level(), 0.5);
  put_back();
  clock->sleep_for(1s);
  EXPECT_THROW(lamp->set_level(0.6), DeviceError) << "it does not light up by itself";
  lamp->set_level(0);
  EXPECT_EQ(bench.outputs(), usb3103::Voltages{});
  EXPECT_EQ(lamp->level(), 0);
  lamp->set_level(0.6);
  EXPECT_EQ(lamp->level(), 0.6);
}

struct ReopenedTic : pololu_tic::TicDriver {
  std::unique_ptr<LensMover> lens_mover =
      reopening([this] { return open_it(); }, {.name = "lens_mover"}, *clock);
};

TEST_F(ReopenedTic, StandsWhenItIsBackAndHasItsSettings) {
  lens_mover->home(60s);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(100ms);
    failure = DeviceErrorKind::lost;
  });
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(5e-3, 60s); }), DeviceErrorKind::lost);
  hand->join();
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::lost);
  clock->sleep_for(5s);
  failure.reset();
  bench.sent.clear();
  const double before = lens();
  EXPECT_TRUE(lens_mover->homed()) << "the controller kept its supply";
  EXPECT_GE(bench.count(pololu_tic::Code::get_setting), 1) << "settings are read back";
  clock->sleep_for(5s);
  EXPECT_EQ(lens(), before) << "it goes on by itself";
  lens_mover->move_to(5e-3, 60s);
  EXPECT_NEAR(lens_mover->position(), 5e-3, 1e-6);
}

TEST_F(ReopenedTic, WantsHomingWhenItLostItsSupplyMeanwhile) {
  lens_mover->home(60s);
  failure = DeviceErrorKind::lost;
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::lost);
  bench.emulator = make_emulator(fresh(), *clock);
  failure.reset();
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(1e-3, 60s); }), DeviceErrorKind::refused);
  EXPECT_FALSE(lens_mover->homed());
  EXPECT_EQ(lens(), 0);
}

TEST_F(ReopenedTic, IsLetGoWhenAnotherOneCameInItsPlace) {
  lens_mover->home(60s);
  failure = DeviceErrorKind::lost;
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::lost);
  auto other = fresh();
  other.serial = "99";
  bench.emulator = make_emulator(other, *clock);
  failure.reset();
  try {
    lens_mover->home(60s);
    FAIL() << "it moved somebody else's motor";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(std::string(error.what()).find("serial 99 instead of"), std::string::npos)
        << error.what();
  }
  EXPECT_EQ(lens(), 0);
}

/// Two tasks in the same instrument: the one that is still inside when the other has opened it
/// again meets what it knew, and does not take the new one down.
TEST(Reopening, LeavesACallUnderWayWithTheInstrumentThatItBeganWith) {
  struct Motor final : LensMover {
    Motor(Clock& its_clock, bool& its_cable) : clock(its_clock), pulled(its_cable) {}
    std::string identity() const override { return "a motor"; }
    double position() const override { return look(), 0; }
    void move_to(double, Time timeout) override { clock.sleep_for(timeout), throw gone(); }
    double travel_min() const override { return -1; }
    double travel_max() const override { return 1; }
    bool homed() const override { return look(), true; }
    void home(Time) override {}
    void make_safe() override { look(); }
    void look() const {
      if (pulled) throw gone();
    }
    static DeviceError gone() { return {DeviceErrorKind::lost, "motor", "is gone"}; }
    Clock& clock;
    bool& pulled;
    std::vector<int> memory = std::vector<int>(100, 1);  // freed too early, the sanitizer sees it
  };
  const auto clock = virtual_clock();
  bool pulled = false;
  int opened = 0;
  const auto motor = reopening(
      [&]() -> std::unique_ptr<LensMover> {
        ++opened;
        return std::make_unique<Motor>(*clock, pulled);
      },
      {.name = "motor"}, *clock);
  const auto mover =
      clock->spawn("mover", [&] { EXPECT_THROW(motor->move_to(1, 2s), DeviceError); });
  clock->sleep_for(100ms);
  pulled = true;
  EXPECT_THROW(motor->make_safe(), DeviceError);
  pulled = false;
  EXPECT_TRUE(motor->homed());
  EXPECT_EQ(opened, 2);
  mover->join();
  EXPECT_TRUE(motor->homed());
  EXPECT_EQ(opened, 2) << "the old call's end took the new instrument down";
}

TEST(Reopening, OfACameraGoesOnCounting) {
  struct Short final : Camera {
    const CameraInfo& info() const override { return about; }
    Frame grab(Time) override {
      if (++count > 3) throw DeviceError(DeviceErrorKind::lost, "top_camera", "has fallen silent");
      return {cv::Mat(), count, Time(count), Time(count)};
    }
    CameraStatistics statistics() const override { return {count, 1, 0}; }
    CameraInfo about{"a camera", 4, 3, 0.1, 1e-6};
    std::uint64_t count = 0;
  };
  const auto clock = virtual_clock();
  const auto camera =
      reopening([]() -> std::unique_ptr<Camera> { return std::make_unique<Short>(); },
                {.name = "top_camera"}, *clock);
  std::vector<std::uint64_t> numbers;
  int lost = 0;
  for (int i = 0; i < 8; ++i) {
    try {
      numbers.push_back(camera->grab(1s).number);
    } catch (const DeviceError&) {
      ++lost;
    }
  }
  EXPECT_EQ(numbers, (std::vector<std::uint64_t>{1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(lost, 2);
  EXPECT_EQ(camera->statistics().delivered, 6U);
  EXPECT_EQ(camera->statistics().lost, 2U);
  EXPECT_EQ(camera->info().width_px, 4);
}

TEST(Reopening, OfAPedalForgetsThatItWasHeld) {
  struct Loose final : HidLink {
    Loose(std::unique_ptr<HidLink> its_link, const bool& its_pulled)
        : link(std::move(its_link)), pulled(its_pulled) {}
    void write(std::span<const std::uint8_t>) override {}
    std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
      if (pulled) throw DeviceError(DeviceErrorKind::lost, "hid", "no such device");
      return link->read(timeout);
    }
    std::unique_ptr<HidLink> link;
    const bool& pulled;
  };
  const auto clock = virtual_clock();
  bool pulled = false;
  foot_pedal::Emulator emulator;
  const auto pedal = reopening(
      [&] {
        return foot_pedal::open(
            std::make_unique<Loose>(memory_hid_link(emulator, *clock, Time(0)), pulled), {});
      },
      {.name = "pedal"}, *clock);
  emulator.press(2);
  EXPECT_TRUE(is_held(pedal.get(), 2));
  pulled = true;
  EXPECT_FALSE(is_held(pedal.get(), 2));
  pulled = false;
  clock->sleep_for(1s);
  EXPECT_FALSE(is_held(pedal.get(), 2)) << "nobody has stepped on it since";
  emulator.press(0);
  emulator.press(2);
  EXPECT_TRUE(is_held(pedal.get(), 2));
}

TEST(Reopening, ThrowsAtFirstWhatOpeningThrows) {
  const auto clock = virtual_clock();
  const auto nobody = []() -> std::unique_ptr<Lamp> {
    throw DeviceError(DeviceErrorKind::not_found, "lamp", "nobody is there");
  };
  EXPECT_THROW(reopening(nobody, {.name = "lamp"}, *clock), DeviceError);
  EXPECT_THROW(reopening(std::function<std::unique_ptr<Lamp>()>(), {.name = "lamp"}, *clock),
               std::invalid_argument);
  EXPECT_THROW(reopening(nobody, {.name = ""}, *clock), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
