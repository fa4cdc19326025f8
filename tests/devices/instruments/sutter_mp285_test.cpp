// The MP-285: its bytes, its driver over its emulator (contract, oddities by name, bad days).
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/stage.h"
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mp285/wire.h"
#include "devices/links/serial_link.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::sutter_mp285 {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Place = std::vector<double>;
using Findings = std::vector<std::string>;

template <class Kind>
Kind decoded(const ByteString& bytes) {
  const auto command = decode_command(bytes);
  EXPECT_TRUE(command && std::holds_alternative<Kind>(*command));
  return command ? std::get<Kind>(*command) : Kind{};
}

TEST(Mp285Wire, EncodesTheCommandsOfItsManual) {
  EXPECT_EQ(encode(GetPosition{}), (ByteString{0x63, 0x0D}));
  EXPECT_EQ(encode(SetOrigin{}), (ByteString{0x6F, 0x0D}));
  EXPECT_EQ(encode(Absolute{}), (ByteString{0x61, 0x0D}));
  EXPECT_EQ(encode(Relative{}), (ByteString{0x62, 0x0D}));
  EXPECT_EQ(encode(Refresh{}), (ByteString{0x6E, 0x0D}));
  EXPECT_EQ(encode(GetStatus{}), (ByteString{0x73, 0x0D}));
  EXPECT_EQ(encode(Interrupt{}), ByteString{0x03});
  EXPECT_EQ(encode(SetVelocity{777, true}),
            (ByteString{0x56, 0x09, 0x83, 0x0D}));  // 777 = 0x309; bit 15: fine
  EXPECT_EQ(encode(SetVelocity{3000, false}), (ByteString{0x56, 0xB8, 0x0B, 0x0D}));
  EXPECT_EQ(encode(Move{{1, -1, 25000}}),
            (ByteString{0x6D, 1, 0, 0, 0, 0xFF, 0xFF, 0xFF, 0xFF, 0xA8, 0x61, 0, 0, 0x0D}));
}

TEST(Mp285Wire, TakesEveryCommandBack) {
  EXPECT_EQ(decoded<Move>(encode(Move{{13, -1300000, 0x0D0D0D0D}})).target,
            (Usteps{13, -1300000, 0x0D0D0D0D}));
  EXPECT_EQ(decoded<SetVelocity>(encode(SetVelocity{1310, true})).speed, 1310);
  EXPECT_FALSE(decoded<SetVelocity>(encode(SetVelocity{1310, false})).fine);
  decoded<GetPosition>(encode(GetPosition{}));
  decoded<Interrupt>(encode(Interrupt{}));
  for (const ByteString& bad :
       {ByteString{}, ByteString{'c'}, ByteString{'c', 'c'}, ByteString{'x', 0x0D}})
    EXPECT_FALSE(decode_command(bad));
}

TEST(Mp285Wire, PositionsMayContain0x0D) {
  const Usteps place{0x0D0D, 0x0D000000, -13};
  const ByteString reply = encode_position(place);
  EXPECT_EQ(reply.size(), 13U);
  EXPECT_EQ(decode_position(reply), place);
  EXPECT_FALSE(decode_position(ByteString(13, 0)));
  EXPECT_FALSE(decode_position(ByteString(12, 0x0D)));
}

TEST(Mp285Wire, ReadsTheStatusAtItsOffsets) {
  const ByteString reply = encode_status({true, {777, true}, 25, 312});
  EXPECT_EQ(reply.size(), 33U);
  EXPECT_EQ(reply[28], 0x09);
  EXPECT_EQ(reply[29], 0x83);
  const auto status = decode_status(reply);
  ASSERT_TRUE(status);
  EXPECT_TRUE(status->absolute);
  EXPECT_EQ(status->velocity.speed, 777);
  EXPECT_TRUE(status->velocity.fine);
  EXPECT_EQ(status->usteps_per_um, 25);
  EXPECT_EQ(status->version, 312);
  EXPECT_FALSE(decode_status(ByteString(33, 0)));
}

TEST(Mp285Wire, ReadsErrorsAsBits) {
  EXPECT_EQ(encode_fault({.bad_command = true, .interrupted = true}), (ByteString{'<', 0x0D}));
  EXPECT_TRUE(decode_fault('8')->interrupted);
  EXPECT_TRUE(decode_fault('4')->bad_command);
  EXPECT_FALSE(decode_fault('c'));
}

/// m at 1 mm/s in the time of a motion's command on the bench's line: 14 characters of 1.042 ms and
/// 0.2 ms of latency. The driver counts from the moment at which it handed the command over.
constexpr double kOnTheLine = 15e-6;

struct Mp285 : SerialBench {
  std::unique_ptr<Stage> open_stage() { return open(link_to(listener), settings, *clock); }
  std::unique_ptr<Emulator> emulated(Usteps start) { return make_emulator({.start = start}); }
  Place place() const {
    const Usteps at = emulator->position(clock->now());
    return {at[0] * kUstep, at[1] * kUstep, at[2] * kUstep};
  }

  Settings settings;
  std::unique_ptr<Emulator> emulator = make_emulator();
  Listener listener{*emulator};
};

TEST_F(Mp285, KeepsTheContractOfAStage) {
  const auto stage = open_stage();
  contract::StageCheck how;
  how.measured = [&] { return place(); };
  EXPECT_EQ(contract::check(*stage, *clock, how), Findings{});
}

TEST_F(Mp285, KeepsTheContractOverAPseudoTerminal) {
  const auto real = virtual_clock(Pace::real_time);
  RealEnd end(*emulator, open_pty_end());
  settings.opening_pause = 0;
  const auto stage = open(open_serial(end.address().substr(7), {}, *real), settings, *real);
  contract::StageCheck how{.start = {0, 0, 0}, .way = 0.3e-3, .speed = 3e-3};
  how.measured = [&] {
    return end.look([&] {
      const Usteps at = emulator->position(end.now());
      return Place{at[0] * kUstep, at[1] * kUstep, at[2] * kUstep};
    });
  };
  EXPECT_EQ(contract::check(*stage, *real, how), Findings{});
}

TEST_F(Mp285, FirstCommandAfterPowerUpIsAVelocity) {
  const auto stage = open_stage();  // the emulator is deaf to all else before one
  EXPECT_EQ(listener.heard.substr(0, 5), std::string("\x03V\x09\x83\r"));
  EXPECT_EQ(to_string(stage->info().identity), "Sutter MP-285, firmware 3.12");
  EXPECT_EQ(stage->position(), (Place{0, 0, 0}));
}

TEST_F(Mp285, AByteSentDuringAMoveAbortsItSoNoneIs) {
  const auto stage = open_stage();
  stage->start(Place{2e-3, 0, 0}, 1e-3);
  clock->sleep_for(20ms);  // until the command has arrived
  const std::size_t said = listener.heard.size();
  for (int i = 0; i < 50; ++i) {
    clock->sleep_for(20ms);
    EXPECT_TRUE(stage->moving());
    EXPECT_NEAR(stage->position()[0], place()[0], kOnTheLine);  // an estimate
  }
  EXPECT_EQ(listener.heard.size(), said);
  stage->wait(5s);
  EXPECT_NEAR(place()[0], 2e-3, kUstep);
}

TEST_F(Mp285, ReportsAMotionThatSomebodyElseInterrupted) {
  const auto stage = open_stage();
  stage->start(Place{2e-3, 0, 0}, 1e-3);
  clock->sleep_for(1s);
  emulator->receive(std::array<std::uint8_t, 1>{'c'}, clock->now());
  EXPECT_EQ(kind_of([&] { stage->wait(5s); }, "interrupted"), DeviceErrorKind::refused);
  EXPECT_NEAR(stage->position()[0], 1e-3, kOnTheLine);
  EXPECT_NO_THROW(move_to(*stage, Place{0, 0, 0}, 1e-3, 5s, *clock));
}

TEST_F(Mp285, ReadsAPositionThatContains0x0D) {
  for (const Usteps start :
       {Usteps{0x0D0D0D, 13, 0x0D00}, Usteps{0x0D34, 0, 0}, Usteps{0x0D3C, 1, 1}}) {
    const auto other = emulated(start);
    const auto stage = open(link_to(*other), settings, *clock);
    EXPECT_EQ(stage->position(), (Place{start[0] * kUstep, start[1] * kUstep, start[2] * kUstep}));
  }
}

TEST_F(Mp285, SilentWhileMovingIsNoticedAtTheMovesDeadline) {
  const auto stage = open_stage();
  const Time before = clock->now();
  stage->start(Place{2e-3, 0, 0}, 1e-3);
  emulator->fall_silent();
  EXPECT_EQ(kind_of([&] { stage->wait(100s); }, "should have ended"), DeviceErrorKind::timeout);
  const double took = to_seconds(clock->now() - before);
  EXPECT_GT(took, 2);
  EXPECT_LT(took, 1.25 * 2 + 1 + 0.2);  // the bound of the driver, and the commands before
  clock->sleep_for(2ms);                // of the interrupt on the line
  EXPECT_EQ(listener.heard.back(), '\x03');
}

TEST_F(Mp285, NoticesAPulledCableWithinHalfASecondWhileItMoves) {
  const auto stage = open_stage();
  stage->start(Place{10e-3, 0, 0}, 1e-3);
  clock->sleep_for(1s);
  faults.unplugged = true;
  const Time before = clock->now();
  EXPECT_EQ(kind_of([&] { stage->wait(100s); }), DeviceErrorKind::lost);
  EXPECT_LE(clock->now() - before, 500ms);
}

TEST_F(Mp285, StopsWithTheInterruptAndAnswersAfterIt) {
  const auto stage = open_stage();
  stage->start(Place{2e-3, 0, 0}, 1e-3);
  clock->sleep_for(1s);
  stage->stop();
  EXPECT_FALSE(emulator->moving(clock->now()));
  EXPECT_NEAR(stage->position()[0], 1e-3, kOnTheLine);
}

TEST_F(Mp285, StopsWhatStillMovesWhenItIsOpened) {
  emulator->receive(encode(SetVelocity{1000, true}), clock->now());
  emulator->receive(encode(Move{{250000, 0, 0}}), clock->now());
  emulator->say(clock->now());
  const auto stage = open_stage();
  EXPECT_FALSE(emulator->moving(clock->now()));
  EXPECT_GT(stage->position()[0], 0.9e-3);
  EXPECT_EQ(listener.count("m"), 0);
}

TEST_F(Mp285, GoesCoarselyOnlyWhereItMust) {
  const auto stage = open_stage();
  listener.heard.clear();
  move_to(*stage, Place{1e-3, 0, 0}, 1.31e-3, 5s, *clock);
  EXPECT_EQ(listener.count("V\x1E\x85\r"), 1);  // 1310 with bit 15
  move_to(*stage, Place{0, 0, 0}, 2e-3, 5s, *clock);
  EXPECT_EQ(listener.count("V\xD0\x07\r"), 1);  // 2000 without
}

TEST_F(Mp285, ReportsAStageThatStopsShort) {
  const auto stage = open_stage();
  emulator->stop_short(0.5);
  EXPECT_EQ(kind_of(
                [&] {
                  move_to(*stage, Place{2e-3, 0, 0}, 1e-3, 5s, *clock);
                },
                "axis x: it stands -1000 um"),
            DeviceErrorKind::refused);
}

TEST_F(Mp285, HasNoHome) {
  const auto stage = open_stage();
  EXPECT_EQ(kind_of([&] { stage->home(1s); }, "no reference"), DeviceErrorKind::refused);
  EXPECT_FALSE(stage->moving());
}

TEST_F(Mp285, FindsNoMp285BehindSilenceOrForeignAnswers) {
  faults.silent = true;
  EXPECT_EQ(kind_of([&] { open_stage(); }), DeviceErrorKind::timeout);
  faults = {};
  for (const char* answer : {"KEPCO,BOP\r\n", "4\r", "\xFF"}) {
    Stranger stranger(answer);
    EXPECT_EQ(kind_of([&] { open(link_to(stranger), settings, *clock); }),
              DeviceErrorKind::not_found)
        << answer;
  }
  Stranger echo("\r");  // takes everything, tells nothing
  EXPECT_EQ(kind_of([&] { open(link_to(echo), settings, *clock); }), DeviceErrorKind::timeout);
}

TEST_F(Mp285, HearsOutAReplyThatCameTooLateBeforeItAsksAgain) {
  settings.reply_timeout = 0.5;
  const auto stage = open_stage();
  faults.late = 700ms;
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::timeout);
  clock->sleep_for(1s);
  faults.late = 0ms;
  EXPECT_EQ(stage->position(), (Place{0, 0, 0}));
}

TEST_F(Mp285, FindsItsPlaceAgainAfterAShortOrGarbledReply) {
  const auto stage = open_stage();
  faults.keep = 7;
  EXPECT_EQ(kind_of([&] { stage->position(); }, "bytes came in time"), DeviceErrorKind::timeout);
  faults = {};
  EXPECT_EQ(stage->position(), (Place{0, 0, 0}));
  faults.garble = 12;
  EXPECT_EQ(kind_of([&] { stage->position(); }, "without its end"), DeviceErrorKind::protocol);
  faults = {};
  EXPECT_EQ(stage->position(), (Place{0, 0, 0}));
}

TEST_F(Mp285, OpensAgainAfterAPowerCutWithItsSettingsAndStandsStill) {
  const auto stage = open_stage();
  stage->start(Place{10e-3, 0, 0}, 1e-3);
  clock->sleep_for(1s);
  faults.unplugged = true;
  EXPECT_FALSE(stage->moving());
  emulator->power_cycle(clock->now());
  faults.unplugged = false;
  listener.heard.clear();
  EXPECT_NEAR(stage->position()[0], 1e-3, 20e-6);
  EXPECT_EQ(listener.count("m"), 0);
  EXPECT_GE(listener.count("V"), 2);  // the handshake, and the usual speed again
  EXPECT_GE(listener.count("s\r"), 2);
  EXPECT_EQ(kind_of([&] { stage->wait(1s); }), DeviceErrorKind::lost);
  clock->sleep_for(5s);
  EXPECT_NEAR(place()[0], 1e-3, 20e-6);
}

TEST_F(Mp285, ThrowsForSettingsThatMakeNoSense) {
  const auto bad = [&](auto change) {
    Settings wrong = settings;
    change(wrong);
    EXPECT_THROW(open(link_to(*emulator), wrong, *clock), std::invalid_argument);
  };
  bad([](Settings& s) { s.name.clear(); });
  bad([](Settings& s) { s.travel_min[1] = 1; });
  bad([](Settings& s) { s.max_speed = 4e-3; });
  bad([](Settings& s) { s.speed = 0; });
  bad([](Settings& s) { s.opening_pause = -1; });
  bad([](Settings& s) { s.reply_timeout = std::nan(""); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::sutter_mp285
