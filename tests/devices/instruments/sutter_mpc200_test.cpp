// The MPC-200: its bytes, its driver over its emulator (contract, oddities by name, bad days).
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/stage.h"
#include "devices/instruments/sutter_mpc200/driver.h"
#include "devices/instruments/sutter_mpc200/emulator.h"
#include "devices/instruments/sutter_mpc200/wire.h"
#include "devices/links/serial_link.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::sutter_mpc200 {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Place = std::vector<double>;
using Findings = std::vector<std::string>;

TEST(Mpc200Wire, EncodesTheCommandsOfItsManual) {
  EXPECT_EQ(encode(GetDrive{}), ByteString{0x4B});
  EXPECT_EQ(encode(GetDrives{}), ByteString{0x55});
  EXPECT_EQ(encode(SelectDrive{3}), (ByteString{0x49, 3}));
  EXPECT_EQ(encode(GetPosition{}), ByteString{0x43});
  EXPECT_EQ(encode(Calibrate{}), ByteString{0x4E});
  EXPECT_EQ(encode(Interrupt{}), ByteString{0x03});
  EXPECT_EQ(encode(FastMove{{1, 400000, 13}}),
            (ByteString{0x4D, 1, 0, 0, 0, 0x80, 0x1A, 0x06, 0, 0x0D, 0, 0, 0}));
  EXPECT_EQ(encode(StraightMove{15, {16, 0, 0}}),
            (ByteString{0x53, 15, 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
}

TEST(Mpc200Wire, TakesEveryCommandBackAndNothingElse) {
  const std::vector<Command> all{
      GetDrive{},          GetDrives{}, SelectDrive{4}, GetPosition{}, FastMove{{-1, 2, 13}},
      StraightMove{3, {}}, Calibrate{}, Interrupt{}};
  for (const Command& command : all) {
    const auto back = decode_command(encode(command));
    ASSERT_TRUE(back);
    EXPECT_EQ(back->index(), command.index());
    EXPECT_EQ(encode(*back), encode(command));
  }
  for (const ByteString& bad :
       {ByteString{}, ByteString{'c'}, ByteString{'M', 1}, ByteString{'K', 0x0D},
        ByteString{'S', 16, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}})
    EXPECT_FALSE(decode_command(bad));
}

TEST(Mpc200Wire, ReadsRepliesByTheirLength) {
  const ByteString drive{2, 0x10, 0x01, 0x0D};  // firmware 1.10, the minor number first
  ASSERT_TRUE(decode_drive(drive));
  EXPECT_EQ(decode_drive(drive)->drive, 2);
  EXPECT_EQ(decode_drive(drive)->version, 110);
  EXPECT_EQ(encode_drive({2, 110}), drive);
  EXPECT_EQ(decode_drives(ByteString{2, 1, 0, 1, 0, 0x0D}), (Connected{true, false, true, false}));
  EXPECT_EQ(encode_drives({true, false, true, false}), (ByteString{2, 1, 0, 1, 0, 0x0D}));
  const Position place{1, {0x0D0D, 13, 0x0D000000}};  // any byte of it may be a CR
  ASSERT_TRUE(decode_position(encode_position(place)));
  EXPECT_EQ(decode_position(encode_position(place))->position, place.position);
  EXPECT_FALSE(decode_drive(ByteString{0, 0x10, 1, 0x0D}));
  EXPECT_FALSE(decode_drive(ByteString{1, 0x1A, 1, 0x0D}));
  EXPECT_FALSE(decode_drives(ByteString{2, 1, 0, 1, 0, 0}));
  EXPECT_FALSE(decode_position(ByteString(14, 0x0D)));
  EXPECT_FALSE(decode_position(ByteString(13, 1)));
}

TEST(Mpc200Wire, GoesAtTheSpeedsThatWereMeasured) {
  // The fit is good to 1 %; stages differ by more.
  EXPECT_NEAR(speed_of(0) / 0.3379e-3, 1, 0.01);
  EXPECT_NEAR(speed_of(8) / 0.6381e-3, 1, 0.01);
  EXPECT_NEAR(speed_of(15) / 2.767e-3, 1, 0.01);
}

struct Mpc200 : SerialBench {
  std::unique_ptr<ByteLink> usb_link_to(BytePeer& peer) {  // at 128000 baud
    return memory_byte_link(
        peer, *clock, {std::chrono::microseconds(200), std::chrono::microseconds(78)}, &faults);
  }
  std::unique_ptr<Stage> open_stage() { return open(usb_link_to(listener), settings, *clock); }
  Place place_at(Time now) const {
    const Usteps at = emulator->position(settings.drive, now);
    return {at[0] * kUstep, at[1] * kUstep, at[2] * kUstep};
  }
  Place place() const { return place_at(clock->now()); }

  Settings settings;
  std::unique_ptr<Emulator> emulator =
      make_emulator({.start = {160000, 160000, 160000}, .connected = {true, true}});
  Listener listener{*emulator};
};

TEST_F(Mpc200, KeepsTheContractOfAStage) {
  const auto stage = open_stage();
  contract::StageCheck how{.home = true};
  how.measured = [&] { return place(); };
  EXPECT_EQ(contract::check(*stage, *clock, how), Findings{});
}

TEST_F(Mpc200, KeepsTheContractOverAPseudoTerminal) {
  const auto real = virtual_clock(Pace::real_time);
  EmulatorSettings untimed{.start = {160000, 160000, 160000}};
  untimed.straight_pause = Time::zero();
  emulator = make_emulator(untimed);
  RealEnd end(*emulator, open_pty_end());
  const auto stage =
      open(open_serial(end.address().substr(7), {.baud_rate = 128000}, *real), settings, *real);
  contract::StageCheck how{.start = {10e-3, 10e-3, 10e-3}, .way = 0.3e-3, .speed = 2.77e-3};
  how.measured = [&] { return end.look([&] { return place_at(end.now()); }); };
  EXPECT_EQ(contract::check(*stage, *real, how), Findings{});
}

TEST_F(Mpc200, ShowsItsFirmwareAndTakesItsDrive) {
  settings.drive = 2;
  const auto stage = open_stage();
  EXPECT_EQ(to_string(stage->info().identity), "Sutter MPC-200, firmware 1.10");
  EXPECT_EQ(listener.count(std::string("I\x02", 2)), 1);
  EXPECT_EQ(stage->position(), (Place{10e-3, 10e-3, 10e-3}));
  settings.drive = 3;
  EXPECT_EQ(kind_of([&] { open_stage(); }, "drive 3 is not connected"), DeviceErrorKind::not_found);
}

TEST_F(Mpc200, TakesItsDriveBackWhenSomebodyAtThePanelChoseAnother) {
  const auto stage = open_stage();
  emulator->receive(encode(SelectDrive{2}), clock->now());
  emulator->say(clock->now());
  listener.heard.clear();
  EXPECT_EQ(stage->position(), (Place{10e-3, 10e-3, 10e-3}));
  EXPECT_EQ(listener.count(std::string("I\x01", 2)), 1);
}

TEST_F(Mpc200, AStraightMotionInOneWriteCrashesItSoItIsSentInTwo) {
  const auto stage = open_stage();
  move_to(*stage, Place{11e-3, 10e-3, 10e-3}, 1e-3, 5s, *clock);
  EXPECT_FALSE(emulator->crashed());
  EXPECT_NEAR(place()[0], 11e-3, kUstep);
  emulator->receive(encode(StraightMove{15, {0, 0, 0}}), clock->now());  // the emulator knows of it
  EXPECT_TRUE(emulator->crashed());
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::timeout);
}

TEST_F(Mpc200, AMotionBelowAMicrometreIsNotAnsweredSoItIsNotSent) {
  const auto stage = open_stage();
  listener.heard.clear();
  EXPECT_NO_THROW(move_to(*stage, Place{10e-3 + 0.9e-6, 10e-3, 10e-3}, 1e-3, 1s, *clock));
  EXPECT_EQ(listener.count("S"), 0);
  EXPECT_EQ(stage->position()[0], 10e-3);
  EXPECT_NO_THROW(move_to(*stage, Place{10e-3 + 1e-6, 10e-3, 10e-3}, 1e-3, 1s, *clock));
  EXPECT_NEAR(stage->position()[0], 10e-3 + 1e-6, 1e-12);
  EXPECT_NEAR(stage->info().axes[0].resolution, 1e-6, 1e-12);
}

TEST_F(Mpc200, SaysNothingDuringAMotion) {
  const auto stage = open_stage();
  stage->start(Place{12e-3, 10e-3, 10e-3}, 1.1e-3);  // goes at 0.95 mm/s, the next one below
  clock->sleep_for(20ms);                            // until the command's 13 bytes have arrived
  const std::size_t said = listener.heard.size();
  for (int i = 0; i < 50; ++i) {
    clock->sleep_for(20ms);
    EXPECT_TRUE(stage->moving());
    EXPECT_NEAR(stage->position()[0], place()[0],
                3e-6);  // an estimate, good to the bytes on their way
  }
  EXPECT_EQ(listener.heard.size(), said);
  stage->wait(5s);
  EXPECT_NEAR(place()[0], 12e-3, kUstep);
}

TEST_F(Mpc200, GoesAtTheNextSpeedBelowAndRefusesWhatIsTooSlow) {
  settings.max_speed = 4.65e-3;
  const auto stage = open_stage();
  const auto took = [&](double x, double speed) {
    const Time before = clock->now();
    move_to(*stage, Place{x, 10e-3, 10e-3}, speed, 60s, *clock);
    return to_seconds(clock->now() - before);
  };
  EXPECT_NEAR(took(15e-3, 0.34e-3), 5e-3 / speed_of(0), 0.1);
  EXPECT_NEAR(took(10e-3, 2.77e-3), 5e-3 / speed_of(15), 0.1);
  EXPECT_EQ(listener.count("M"), 0);
  EXPECT_NEAR(took(15e-3, 4.65e-3), 5e-3 / kFastMotion, 0.1);
  EXPECT_EQ(listener.count("M"), 1);
  EXPECT_EQ(kind_of([&] { took(10e-3, 0.3e-3); }, "slowest motion"), DeviceErrorKind::refused);
  EXPECT_FALSE(stage->moving());
}

TEST_F(Mpc200, AnInterruptedMotionMarksTheNextReply) {
  const auto stage = open_stage();
  stage->start(Place{12e-3, 10e-3, 10e-3}, 1e-3);
  clock->sleep_for(1s);
  stage->stop();  // the position after it came with the mark
  EXPECT_FALSE(emulator->moving(clock->now()));
  EXPECT_GT(stage->position()[0], 10.5e-3);
  EXPECT_EQ(kind_of([&] { stage->wait(1s); }, "stopped on its way"), DeviceErrorKind::refused);
  EXPECT_NO_THROW(move_to(*stage, Place{10e-3, 10e-3, 10e-3}, 1e-3, 5s, *clock));
}

TEST_F(Mpc200, ReportsAMotionThatSomebodyElseInterrupted) {
  const auto stage = open_stage();
  stage->start(Place{12e-3, 10e-3, 10e-3}, 1e-3);
  clock->sleep_for(1s);
  emulator->receive(std::array<std::uint8_t, 1>{kInterrupt}, clock->now());
  EXPECT_EQ(kind_of([&] { stage->wait(5s); }, "from its target"), DeviceErrorKind::refused);
  EXPECT_EQ(stage->position(), place());
}

TEST_F(Mpc200, SilentWhileMovingIsNoticedAtTheMovesDeadline) {
  const auto stage = open_stage();
  const Time before = clock->now();
  stage->start(Place{12e-3, 10e-3, 10e-3}, 1e-3);
  emulator->fall_silent();
  EXPECT_EQ(kind_of([&] { stage->wait(100s); }, "should have ended"), DeviceErrorKind::timeout);
  EXPECT_LT(to_seconds(clock->now() - before),
            1.5 * 2e-3 / speed_of(11) + 1 + 0.2);  // the bound of the driver
  clock->sleep_for(2ms);                           // of the interrupt on the line
  EXPECT_EQ(listener.heard.back(), '\x03');
}

TEST_F(Mpc200, NoticesAPulledCableWithinHalfASecondWhileItMoves) {
  const auto stage = open_stage();
  stage->start(Place{20e-3, 10e-3, 10e-3}, 1e-3);
  clock->sleep_for(1s);
  faults.unplugged = true;
  const Time before = clock->now();
  EXPECT_EQ(kind_of([&] { stage->wait(100s); }), DeviceErrorKind::lost);
  EXPECT_LE(clock->now() - before, 500ms);
}

TEST_F(Mpc200, OpensAgainAfterAPowerCutAndStandsStill) {
  settings.drive = 2;
  const auto stage = open_stage();
  stage->start(Place{20e-3, 10e-3, 10e-3}, 1e-3);
  clock->sleep_for(1s);
  faults.unplugged = true;
  EXPECT_FALSE(stage->moving());
  emulator->power_cycle(clock->now());
  faults.unplugged = false;
  listener.heard.clear();
  const Place after = stage->position();
  EXPECT_EQ(after, place());
  EXPECT_GT(after[0], 10.5e-3);
  EXPECT_EQ(listener.count(std::string("I\x02", 2)), 1);  // it woke up with drive 1
  EXPECT_EQ(listener.count("S") + listener.count("M"), 0);
  EXPECT_EQ(kind_of([&] { stage->wait(1s); }), DeviceErrorKind::lost);
  clock->sleep_for(5s);
  EXPECT_EQ(place(), after);
}

TEST_F(Mpc200, StopsWhatStillMovesWhenItIsOpened) {
  emulator->receive(encode(FastMove{{0, 0, 0}}), clock->now());
  const auto stage = open_stage();
  EXPECT_FALSE(emulator->moving(clock->now()));
  EXPECT_GT(stage->position()[0], 9.5e-3);
}

TEST_F(Mpc200, ReportsAStageThatStopsShort) {
  const auto stage = open_stage();
  emulator->stop_short(0.5);
  const auto move = [&] { move_to(*stage, Place{12e-3, 10e-3, 10e-3}, 1e-3, 5s, *clock); };
  EXPECT_EQ(kind_of(move, "axis x: it stands -1000 um"), DeviceErrorKind::refused);
}

TEST_F(Mpc200, FindsNoMpc200BehindSilenceOrForeignAnswers) {
  faults.silent = true;
  EXPECT_EQ(kind_of([&] { open_stage(); }), DeviceErrorKind::timeout);
  faults = {};
  for (const char* answer : {"KEPCO,BOP\r\n", "@01 0 OK IDLE -- 0\r\n"}) {
    Stranger stranger(answer);
    EXPECT_EQ(kind_of([&] { open(usb_link_to(stranger), settings, *clock); }, "no MPC-200"),
              DeviceErrorKind::not_found)
        << answer;
  }
}

TEST_F(Mpc200, FindsItsPlaceAgainAfterALateShortOrGarbledReply) {
  const auto stage = open_stage();
  const Place here{10e-3, 10e-3, 10e-3};
  faults.late = 700ms;
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::timeout);
  clock->sleep_for(1s);
  faults = {};
  EXPECT_EQ(stage->position(), here);
  faults.keep = 7;
  EXPECT_EQ(kind_of([&] { stage->position(); }, "bytes came in time"), DeviceErrorKind::timeout);
  faults = {};
  EXPECT_EQ(stage->position(), here);
  faults.garble = 13;
  EXPECT_EQ(kind_of([&] { stage->position(); }, "without its end"), DeviceErrorKind::protocol);
  faults = {};
  EXPECT_EQ(stage->position(), here);
}

TEST_F(Mpc200, ThrowsForSettingsThatMakeNoSense) {
  const auto bad = [&](auto change) {
    Settings wrong = settings;
    change(wrong);
    EXPECT_THROW(open(usb_link_to(*emulator), wrong, *clock), std::invalid_argument);
  };
  bad([](Settings& s) { s.name.clear(); });
  bad([](Settings& s) { s.drive = 5; });
  bad([](Settings& s) { s.travel_min[1] = -1e-3; });
  bad([](Settings& s) { s.travel_max[1] = 26e-3; });
  bad([](Settings& s) { s.max_speed = 6e-3; });
  bad([](Settings& s) { s.speed = 0.1e-3; });
  bad([](Settings& s) { s.reply_timeout = std::nan(""); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sutter_mpc200
