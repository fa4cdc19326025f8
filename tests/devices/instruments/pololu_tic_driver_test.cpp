// The Tic's driver over its emulator: the contract, its quirks by name, and bad days. The motor
// ends standing.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/lens_mover.h"
#include "tests/devices/instruments/pololu_tic_test_bench.h"

#include <stdexcept>

namespace vitreo::pololu_tic {
namespace VITREO_TEST_FILE {

TEST_F(TicDriver, KeepsTheContractOfALensMover) {
  const auto lens_mover = open_it();
  contract::LensMoverCheck how;
  how.measured = [this] { return lens(); };
  EXPECT_EQ(contract::check(*lens_mover, how), std::vector<std::string>{});
  EXPECT_FALSE(bench.emulator->moving());
}

TEST_F(TicDriver, SaysWhoItIs) {
  EXPECT_EQ(open_it()->identity(), "Pololu Tic T825, firmware 1.06, serial 00123456");
}

TEST_F(TicDriver, OpensWithoutMovingOrEnergizing) {
  const auto lens_mover = open_it();
  clock->sleep_for(5s);
  EXPECT_EQ(bench.count(Code::energize), 0);
  EXPECT_EQ(bench.count(Code::exit_safe_start), 0);
  EXPECT_EQ(bench.emulator->motor_usteps(), 0);
  EXPECT_FALSE(bench.emulator->energized());
}

TEST_F(TicDriver, WritesSettingsOnlyWhereTheyDiffer) {
  open_it();
  EXPECT_EQ(bench.count(Code::set_setting),
            0);  // the emulator comes with the defaults that we want
  settings.command_timeout = 0.5;
  open_it();
  EXPECT_EQ(bench.count(Code::set_setting), 5);
  open_it();
  EXPECT_EQ(bench.count(Code::set_setting), 5);
}

TEST_F(TicDriver, RefusesToMoveBeforeItWasHomed) {
  const auto lens_mover = open_it();
  EXPECT_FALSE(lens_mover->homed());
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(0, 10s); }), DeviceErrorKind::refused);
  EXPECT_EQ(bench.count(Code::set_target_position), 0);
}

TEST_F(TicDriver, HomesByItsSwitch) {
  const auto lens_mover = open_it();
  lens_mover->home(60s);
  EXPECT_TRUE(lens_mover->homed());
  EXPECT_DOUBLE_EQ(lens_mover->position(), settings.home_position);
  EXPECT_NEAR(lens(), -10e-3, 1e-6);
}

TEST_F(TicDriver, TakesTheHandSetPlaceForHomeWithoutASwitch) {
  settings.home = Home::none;
  settings.home_position = 2e-3;
  const auto lens_mover = open_it();
  lens_mover->home(1s);
  EXPECT_TRUE(lens_mover->homed());
  EXPECT_DOUBLE_EQ(lens_mover->position(), 2e-3);
  EXPECT_EQ(bench.emulator->motor_usteps(), 0);
}

TEST_F(TicDriver, FeedsTheCommandTimeoutOnlyWhileACallIsInProgress) {
  const auto lens_mover = open_homed();
  const long before = bench.count(Code::reset_command_timeout);
  lens_mover->move_to(0, 10s);  // 2 s: longer than the timeout
  EXPECT_GE(bench.count(Code::reset_command_timeout) - before, 8);
  const long after = bench.count(Code::reset_command_timeout);
  clock->sleep_for(10s);
  EXPECT_EQ(bench.count(Code::reset_command_timeout), after);
  EXPECT_DOUBLE_EQ(lens_mover->position(),
                   0);  // reads do not feed it, and it still knows where it is
  EXPECT_TRUE(lens_mover->homed());
  lens_mover->move_to(1e-3, 10s);
  EXPECT_DOUBLE_EQ(lens_mover->position(), 1e-3);
}

TEST_F(TicDriver, StopsByItselfWhenTheHostHangs) {
  const auto lens_mover = open_homed();
  failure.reset();
  bool hung = false;
  bench.answer = [&](const UsbSetup& setup, std::optional<Bench::Bytes_> right) {
    if (!hung && setup.request == static_cast<std::uint8_t>(Code::set_target_position)) {
      hung = true;
      clock->sleep_for(5s);  // the host does nothing at all
    }
    return right;
  };
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(10e-3, 20s); }), DeviceErrorKind::refused);
  EXPECT_FALSE(bench.emulator->moving());
  EXPECT_LT(lens(), -10e-3 + 5e-3 * 1.3);  // a second and the way of slowing down
}

TEST_F(TicDriver, LeavesTheMotorToItsTimeoutWhenTheCableIsPulledInAMove) {
  const auto lens_mover = open_homed();
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(500ms);
    failure = DeviceErrorKind::lost;
  });
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(10e-3, 20s); }), DeviceErrorKind::lost);
  EXPECT_LT(clock->now() - start, 1s);  // noticed within 0.5 s of the pull
  clock->sleep_for(2s);
  EXPECT_FALSE(bench.emulator->moving());
}

TEST_F(TicDriver, ComesBackAfterAReplugWithoutMoving) {
  auto lens_mover = open_homed();
  lens_mover->move_to(0, 10s);
  failure = DeviceErrorKind::lost;
  EXPECT_EQ(kind_of([&] { lens_mover->move_to(1e-3, 10s); }), DeviceErrorKind::lost);
  lens_mover.reset();
  failure.reset();
  const double there = lens();
  lens_mover = open_it();
  clock->sleep_for(5s);
  EXPECT_EQ(lens(), there);
  EXPECT_TRUE(lens_mover->homed());  // it was never without power
  lens_mover->move_to(1e-3, 10s);
}

TEST_F(TicDriver, StopsWhatAHostThatDiedLeftMoving) {
  auto lens_mover = open_homed();
  // The dead host's last words: a target far away, on a link that is neither fed nor stopped.
  bench.emulator->control(encode(Command{Code::energize}), {}, 0);
  bench.emulator->control(encode(Command{Code::exit_safe_start}), {}, 0);
  bench.emulator->control(encode(Command{Code::set_target_position, 32000}), {}, 0);
  clock->sleep_for(300ms);
  EXPECT_TRUE(bench.emulator->moving());
  const auto again = open_it();
  clock->sleep_for(200ms);
  EXPECT_FALSE(bench.emulator->moving());
}

TEST_F(TicDriver, StandsStillAfterAStop) {
  const auto lens_mover = open_homed();
  const auto operator_ = clock->spawn("operator", [&] {
    clock->sleep_for(700ms);
    clock->interrupt();
  });
  EXPECT_THROW(lens_mover->move_to(10e-3, 20s), Stopped);
  EXPECT_FALSE(bench.emulator->moving());
  EXPECT_TRUE(lens_mover->homed());
  const double there = lens();
  clock->sleep_for(5s);
  EXPECT_EQ(lens(), there);
}

TEST_F(TicDriver, NamesTheControllersReasonForNotMoving) {
  const auto lens_mover = open_homed();
  bench.emulator->set_vin(0);
  try {
    lens_mover->home(10s);
    FAIL() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(std::string(error.what()).find("low supply voltage"), std::string::npos)
        << error.what();
  }
  bench.emulator->set_vin(12);
  EXPECT_FALSE(lens_mover->homed());  // without power it may have been turned by hand
}

TEST_F(TicDriver, ForgetsItsPlaceWhenItsStepsChangeTheirSize) {
  open_homed();
  settings.usteps_per_step = 16;
  EXPECT_FALSE(open_it()->homed());
}

TEST_F(TicDriver, GivesUpHomingAtTheDeadline) {
  EmulatorSettings broken = fresh();
  broken.home_switch_works = false;
  Bench other(*clock, broken);
  const auto lens_mover = open(memory_usb_link(other, *clock, 300us), settings, *clock);
  EXPECT_EQ(kind_of([&] { lens_mover->home(3s); }), DeviceErrorKind::timeout);
  EXPECT_FALSE(other.emulator->moving());
  EXPECT_FALSE(lens_mover->homed());
}

TEST_F(TicDriver, IsNoOtherDevice) {
  EmulatorSettings stranger = fresh();
  stranger.product = 0x0001;
  Bench other(*clock, stranger);
  EXPECT_EQ(kind_of([&] { open(memory_usb_link(other, *clock, 300us), settings, *clock); }),
            DeviceErrorKind::not_found);
  EXPECT_TRUE(other.sent.empty());  // and a stranger is told nothing
}

TEST_F(TicDriver, TellsShortAndGarbledAnswersFromGoodOnes) {
  const auto lens_mover = open_it();
  bench.answer = [](const UsbSetup&, std::optional<Bench::Bytes_> right) {
    if (right && !right->empty()) right->pop_back();
    return right;
  };
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::protocol);
  bench.answer = [](const UsbSetup&, std::optional<Bench::Bytes_> right) {
    if (right && !right->empty()) (*right)[0] = 0x77;
    return right;
  };
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::protocol);
}

TEST_F(TicDriver, ReportsAStallAsARefusal) {
  const auto lens_mover = open_it();
  bench.answer = [](const UsbSetup&, std::optional<Bench::Bytes_>) { return std::nullopt; };
  EXPECT_EQ(kind_of([&] { lens_mover->position(); }), DeviceErrorKind::refused);
}

TEST_F(TicDriver, GivesUpOnASilentDeviceAtTheDeadline) {
  const auto slow = [&] { open(memory_usb_link(bench, *clock, 1s), settings, *clock); };
  EXPECT_EQ(kind_of(slow), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), from_seconds(settings.transfer_timeout));
}

TEST_F(TicDriver, RefusesAControllerThatDoesNotKeepItsSettings) {
  settings.command_timeout = 0.5;
  bench.answer = [](const UsbSetup& setup, std::optional<Bench::Bytes_> right) {
    if (setup.request == static_cast<std::uint8_t>(Code::get_setting))
      (*right)[kCommandTimeoutSetting] = 7;
    return right;
  };
  EXPECT_EQ(kind_of([&] { open_it(); }), DeviceErrorKind::refused);
}

TEST(TicSettings, AreCheckedByName) {
  const auto complaint = [](Settings settings) -> std::string {
    try {
      settings.check();
    } catch (const std::invalid_argument& error) {
      return std::string(error.what()).substr(0, std::string(error.what()).find(':'));
    }
    return "";
  };
  EXPECT_EQ(complaint({}), "");
  EXPECT_EQ(complaint({.name = ""}), "name");
  EXPECT_EQ(complaint({.step_length = 0}), "step_length");
  EXPECT_EQ(complaint({.usteps_per_step = 3}), "usteps_per_step");
  EXPECT_EQ(complaint({.speed = 1}), "speed");
  EXPECT_EQ(complaint({.acceleration = -1}), "acceleration");
  EXPECT_EQ(complaint({.travel_min = 1}), "travel_min");
  EXPECT_EQ(complaint({.current_limit = 0}), "current_limit");
  EXPECT_EQ(complaint({.home_position = 1e9}), "home_position");
  EXPECT_EQ(complaint({.command_timeout = 0}), "command_timeout");
  EXPECT_EQ(complaint({.transfer_timeout = 2}), "transfer_timeout");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::pololu_tic
