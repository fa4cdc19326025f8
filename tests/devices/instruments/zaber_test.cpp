// The Zaber driver over its emulator: the contract of its roles, the oddities of the protocol, and
// bad days.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/stage.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/instruments/zaber/wire.h"
#include "devices/links/serial_link.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/links/real_end.h"

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::zaber {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Place = std::vector<double>;

constexpr double kStep = 3.048e-6 / 64;  // m per microstep of an X-LSM

struct Zaber : SerialBench {
  std::unique_ptr<Stage> open_stage() { return open(link_to(listener), settings, *clock); }
  double place(std::size_t device = 0, std::size_t axis = 0) const {
    return emulator->position(device, axis, clock->now()) * kStep;
  }
  void expect_contract(Stage& stage, contract::StageCheck how) {
    how.measured = [&] {
      Place place;
      for (std::size_t i = 0; i < settings.axes.size(); ++i)
        place.push_back(emulator->position(static_cast<std::size_t>(settings.axes[i].device - 1),
                                           static_cast<std::size_t>(settings.axes[i].axis - 1),
                                           clock->now()) *
                        kStep);
      return place;
    };
    EXPECT_EQ(contract::check(stage, *clock, how), std::vector<std::string>{});
  }

  Settings settings;
  std::unique_ptr<Emulator> emulator = make_emulator();
  Listener listener{*emulator};
};

TEST_F(Zaber, KeepsTheContractOfAStage) {
  const auto stage = open_stage();
  expect_contract(*stage, {.home = true});
}

TEST_F(Zaber, KeepsTheContractWithThreeAxesInAChainOfTwoDevices) {
  emulator = make_emulator(
      {EmulatedDevice{}, {.address = 2, .serial = 7, .version = "6.28", .axes = {{}, {}}}});
  Listener other(*emulator);
  settings.axes = {
      {.name = "x", .device = 2, .axis = 1}, {.name = "y", .device = 2, .axis = 2}, {.name = "z"}};
  const auto stage = open(link_to(other), settings, *clock);
  expect_contract(*stage, {});
}

TEST_F(Zaber, KeepsTheContractOverAPseudoTerminal) {
  const auto real = virtual_clock(Pace::real_time);
  RealEnd end(*emulator, open_pty_end());
  const auto stage =
      open(open_serial(end.address().substr(7), {.baud_rate = 115200}, *real), settings, *real);
  contract::StageCheck how{.start = {1e-3}, .way = 0.2e-3, .speed = 5e-3};
  how.measured = [&] {
    return end.look([&] { return Place{emulator->position(0, 0, end.now()) * kStep}; });
  };
  EXPECT_EQ(contract::check(*stage, *real, how), std::vector<std::string>{});
}

TEST_F(Zaber, KeepsTheContractOfARotationStage) {
  constexpr double kTurn = 2 * std::numbers::pi;
  EmulatedDevice table{.axes = {{.limit_min = -1e9, .limit_max = 1e9, .referenced = false}}};
  emulator = make_emulator({table});
  settings.name = "rotation_stage";
  settings.axes = {{.name = "theta",
                    .step = kTurn / 76800 * 64,
                    .travel_min = -kTurn,
                    .travel_max = kTurn,
                    .max_speed = 0.4,
                    .speed = 0.2}};
  const auto stage = open_rotary(link_to(*emulator), settings, *clock);
  contract::StageCheck how{.home = true};
  how.measured = [&] { return Place{emulator->position(0, 0, clock->now()) * kTurn / 76800}; };
  EXPECT_EQ(contract::check(*stage, *clock, how), std::vector<std::string>{});
  EXPECT_EQ(stage->info().axis.name, "theta");
  EXPECT_DOUBLE_EQ(stage->info().axis.resolution, kTurn / 76800);
}

TEST_F(Zaber, ShowsWhoItIsAndTheNarrowerLimits) {
  settings.axes[0].travel_max = 20e-3;
  const auto stage = open_stage();
  EXPECT_EQ(to_string(stage->info().identity), "Zaber device 50081, serial 12345, firmware 7.14");
  EXPECT_DOUBLE_EQ(stage->info().axes[0].travel_min, 0);
  EXPECT_DOUBLE_EQ(stage->info().axes[0].travel_max, 20e-3);
  settings.axes[0].travel_max = 1;
  const auto whole = open_stage();
  EXPECT_NEAR(whole->info().axes[0].travel_max, 50.625e-3, 1e-6);
}

TEST_F(Zaber, TakesTheStepFromTheResolutionThatTheDeviceTells) {
  emulator = make_emulator({{.axes = {{.resolution = 128}}}});
  const auto stage = open(link_to(*emulator), settings, *clock);
  move_to(*stage, Place{1e-3}, 2e-3, 5s, *clock);
  EXPECT_NEAR(emulator->position(0, 0, clock->now()), 1e-3 / (3.048e-6 / 128), 0.5);
}

TEST_F(Zaber, MovesAtTheSpeedItWasGiven) {
  const auto stage = open_stage();
  stage->start(Place{4e-3}, 2e-3);
  const double from = place();
  clock->sleep_for(1s);
  EXPECT_NEAR(place() - from, 2e-3, 1e-6);
  stage->stop();
}

TEST_F(Zaber, ArrivesWithAllAxesAtTheSameTime) {
  emulator = make_emulator({{.axes = {{}, {}}}});
  settings.axes = {{.name = "x", .axis = 1}, {.name = "y", .axis = 2}};
  const auto stage = open(link_to(*emulator), settings, *clock);
  stage->start(Place{2e-3, 1e-3}, 2e-3);
  clock->sleep_for(700ms);
  EXPECT_TRUE(emulator->moving(0, 1, clock->now()));
  EXPECT_NEAR(place(0, 1), place(0, 0) / 2,
              60e-6);  // but for the 25 ms in which the axes are told, one after the other
  stage->wait(2s);
  EXPECT_NEAR(place(0, 1), 1e-3, kStep);
}

TEST_F(Zaber, TakesNoLongerForAnAxisThatIsThereAlready) {
  emulator = make_emulator({{.axes = {{}, {}}}});
  settings.axes = {{.name = "x", .axis = 1}, {.name = "y", .axis = 2}};
  const auto stage = open(link_to(*emulator), settings, *clock);
  move_to(*stage, Place{1e-3, 1e-3}, 2e-3, 10s, *clock);
  const Time before = clock->now();
  move_to(*stage, Place{2e-3, 1e-3}, 2e-3, 10s, *clock);  // 1 mm is no whole number of microsteps
  EXPECT_LT(to_seconds(clock->now() - before),
            1.5);  // half a second, and the exchanges at 9600 baud
  EXPECT_NEAR(place(0, 1), 1e-3, kStep);
}

TEST_F(Zaber, MovesNothingWhenItIsOpened) {
  emulator = make_emulator({{.axes = {{.start = 5000}}}});
  Listener other(*emulator);
  const auto stage = open(link_to(other), settings, *clock);
  EXPECT_EQ(other.count("move"), 0);
  EXPECT_EQ(other.count("home"), 0);
  EXPECT_DOUBLE_EQ(emulator->position(0, 0, clock->now()), 5000);
}

TEST_F(Zaber, StopsWhatStillMovesWhenItIsOpened) {
  const std::string move = "/1 1 move abs 1000000\n";
  emulator->receive({reinterpret_cast<const std::uint8_t*>(move.data()), move.size()},
                    clock->now());
  emulator->say(clock->now());
  const auto stage = open_stage();
  EXPECT_FALSE(emulator->moving(0, 0, clock->now()));
}

TEST_F(Zaber, RefusesToMoveWithoutAReferenceUntilItIsHomed) {
  emulator = make_emulator({{.axes = {{.start = 5000, .referenced = false}}}});
  Listener other(*emulator);
  const auto stage = open(link_to(other), settings, *clock);
  EXPECT_EQ(kind_of([&] { stage->start(Place{1e-3}, 1e-3); }, "home it first"),
            DeviceErrorKind::refused);
  EXPECT_EQ(other.count("move"), 0);
  stage->home(10s);
  EXPECT_NO_THROW(move_to(*stage, Place{1e-3}, 1e-3, 5s, *clock));
}

TEST_F(Zaber, TakesTheReplyOfItsOwnCommandOnly) {
  struct Chatter final : BytePeer {
    explicit Chatter(BytePeer& its_peer) : peer(its_peer) {}
    void receive(std::span<const std::uint8_t> bytes, Time now) override {
      peer.receive(bytes, now);
    }
    std::vector<TimedBytes> say(Time now) override {
      std::vector<TimedBytes> said = peer.say(now);
      if (said.empty()) return said;
      for (const std::string line :
           {"!01 1 IDLE --\r\n", "#01 0 hello\r\n", "@01 1 98 OK IDLE -- 777:9C\r\n"}) {
        said.insert(said.begin(), TimedBytes{said.front().at, {line.begin(), line.end()}});
      }
      return said;
    }
    Time next() const override { return peer.next(); }
    BytePeer& peer;
  } chatter(*emulator);
  const auto stage = open(link_to(chatter), settings, *clock);
  EXPECT_EQ(stage->position(), Place{0});
}

TEST_F(Zaber, AsksAgainWhenAReplyIsLostOrGarbled) {
  const auto stage = open_stage();
  faults.garble = 5;
  EXPECT_EQ(stage->position(), Place{0});
  faults = {};
  faults.keep = 10;
  const auto fix = clock->spawn("hand", [&] {
    clock->sleep_for(600ms);
    faults.keep = -1;
  });
  EXPECT_EQ(stage->position(), Place{0});
}

TEST_F(Zaber, GivesUpOnASilentDeviceAtTheDeadline) {
  faults.silent = true;
  EXPECT_EQ(kind_of([&] { open_stage(); }, "device 1: emulated says nothing to \"get version\""),
            DeviceErrorKind::timeout);
  // Then it is listened to for 2 s more: it may only be slow.
  EXPECT_LE(clock->now(), 3 * 500ms + 200ms + 2s);
}

TEST_F(Zaber, FindsNoZaberBehindForeignAnswers) {
  for (const char* answer :
       {"KEPCO,BOP 36-12\r\n", "\r", "\x01\x02\xFF\n", "@01 0 RJ IDLE -- BADCOMMAND\r\n"}) {
    Stranger stranger(answer);
    const DeviceErrorKind kind = kind_of([&] { open(link_to(stranger), settings, *clock); });
    EXPECT_TRUE(kind == DeviceErrorKind::not_found || kind == DeviceErrorKind::timeout) << answer;
  }
}

TEST_F(Zaber, FindsTheWrongDevice) {
  settings.axes[0].device_id = 50082;
  EXPECT_EQ(kind_of([&] { open_stage(); }, "is a Zaber 50081, not a 50082"),
            DeviceErrorKind::not_found);
  settings.axes[0].device_id = 50081;
  settings.axes[0].device = 2;
  EXPECT_EQ(kind_of([&] { open_stage(); }, "device 2"), DeviceErrorKind::timeout);
}

TEST_F(Zaber, FindsAFirmwareThatIsTooOld) {
  emulator = make_emulator({{.version = "6.03"}});
  EXPECT_EQ(kind_of([&] { open(link_to(*emulator), settings, *clock); }, "too old"),
            DeviceErrorKind::not_found);
}

TEST_F(Zaber, ReportsAStageThatStopsShort) {
  const auto stage = open_stage();
  emulator->jam(0, 0, 10000);
  EXPECT_EQ(
      kind_of([&] { move_to(*stage, Place{2e-3}, 2e-3, 5s, *clock); }, "stalled and stopped (FS)"),
      DeviceErrorKind::refused);
  EXPECT_FALSE(stage->moving());
  EXPECT_NEAR(stage->position()[0], 10000 * kStep, kStep);
  EXPECT_NO_THROW(move_to(*stage, Place{0.1e-3}, 2e-3, 5s, *clock));  // away from it
}

TEST_F(Zaber, StopsTheOtherAxesWhenOneStalls) {
  emulator = make_emulator({{.axes = {{}, {}}}});
  settings.axes = {{.name = "x", .axis = 1}, {.name = "y", .axis = 2}};
  const auto stage = open(link_to(*emulator), settings, *clock);
  emulator->jam(0, 0, 1000);
  EXPECT_EQ(kind_of(
                [&] {
                  move_to(*stage, Place{10e-3, 10e-3}, 2e-3, 10s, *clock);
                },
                "axis x"),
            DeviceErrorKind::refused);
  EXPECT_FALSE(emulator->moving(0, 1, clock->now()));
  EXPECT_LT(place(0, 1), 2e-3);
}

TEST_F(Zaber, NoticesAPulledCableWithinHalfASecondWhileItMoves) {
  const auto stage = open_stage();
  stage->start(Place{20e-3}, 2e-3);
  const auto hand = clock->spawn("hand", [&] {
    clock->sleep_for(1s);
    faults.unplugged = true;
  });
  const Time before = clock->now();
  EXPECT_EQ(kind_of([&] { stage->wait(20s); }), DeviceErrorKind::lost);
  EXPECT_LE(clock->now() - before, 1500ms);
}

TEST_F(Zaber, OpensAgainAfterALostLinkWithItsSettingsAndStandsStill) {
  auto stage = open_stage();
  stage->start(Place{20e-3}, 2e-3);
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::lost);
  clock->sleep_for(1s);
  faults.unplugged = false;
  listener.heard.clear();
  const double here = stage->position()[0];  // opens it again
  EXPECT_GT(here, 1e-3);
  EXPECT_FALSE(emulator->moving(0, 0, clock->now()));
  EXPECT_EQ(listener.count("move"), 0);
  EXPECT_GE(listener.count("set comm.checksum 1"), 1);
  EXPECT_GE(listener.count("set maxspeed"), 1);
  EXPECT_GE(listener.count("get maxspeed"), 1);
  EXPECT_EQ(kind_of([&] { stage->wait(1s); }, "lost while it moved"), DeviceErrorKind::lost);
  stage->wait(1s);  // told once
  clock->sleep_for(1s);
  EXPECT_EQ(stage->position()[0], here);
  EXPECT_NO_THROW(move_to(*stage, Place{1e-3}, 2e-3, 20s, *clock));
}

TEST_F(Zaber, WantsHomingAgainAfterAPowerCut) {
  const auto stage = open_stage();
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::lost);
  emulator->power_cycle(clock->now());
  faults.unplugged = false;
  EXPECT_EQ(kind_of([&] { stage->start(Place{1e-3}, 1e-3); }, "home it first"),
            DeviceErrorKind::refused);
}

TEST_F(Zaber, TakesNoOtherInstrumentForTheOneThatWasLost) {
  const auto stage = open_stage();
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { stage->position(); }), DeviceErrorKind::lost);
  const auto other = make_emulator({{.serial = 999}});
  struct Switch final : BytePeer {
    void receive(std::span<const std::uint8_t> bytes, Time now) override {
      peer->receive(bytes, now);
    }
    std::vector<TimedBytes> say(Time now) override { return peer->say(now); }
    Time next() const override { return peer->next(); }
    BytePeer* peer = nullptr;
  } cable;
  cable.peer = emulator.get();
  faults.unplugged = false;
  const auto swapped = open(link_to(cable), settings, *clock);
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { swapped->position(); }), DeviceErrorKind::lost);
  faults.unplugged = false;
  cable.peer = other.get();
  EXPECT_EQ(kind_of([&] { swapped->position(); }, "serial 999"), DeviceErrorKind::not_found);
}

TEST_F(Zaber, TellsASilentStageToStop) {
  const auto stage = open_stage();
  stage->start(Place{20e-3}, 2e-3);
  faults.silent = true;
  EXPECT_EQ(kind_of([&] { stage->wait(20s); }), DeviceErrorKind::timeout);
  clock->sleep_for(30ms);  // of the command on the line, about 20 bytes
  EXPECT_FALSE(emulator->moving(0, 0, clock->now() + 10ms));
}

TEST_F(Zaber, StopsFromAnotherTaskWhileOneWaits) {
  const auto stage = open_stage();
  DeviceErrorKind kind = DeviceErrorKind::not_found;
  const auto mover = clock->spawn("mover", [&] {
    kind = kind_of([&] { move_to(*stage, Place{20e-3}, 2e-3, 20s, *clock); }, "stopped on its way");
  });
  clock->sleep_for(1s);
  const Time before = clock->now();
  stage->stop();
  mover->join();
  EXPECT_EQ(kind, DeviceErrorKind::refused);
  EXPECT_LE(clock->now() - before, 300ms);
}

TEST_F(Zaber, StandsStillWhenItIsDestroyed) {
  auto stage = open_stage();
  stage->start(Place{20e-3}, 2e-3);
  EXPECT_TRUE(emulator->moving(0, 0, clock->now()));
  stage.reset();
  EXPECT_FALSE(emulator->moving(0, 0, clock->now()));
}

TEST_F(Zaber, ThrowsForSettingsThatMakeNoSense) {
  const auto bad = [&](auto change) {
    Settings wrong = settings;
    change(wrong);
    EXPECT_THROW(open(link_to(*emulator), wrong, *clock), std::invalid_argument);
  };
  bad([](Settings& s) { s.axes.clear(); });
  bad([](Settings& s) { s.axes[0].device = 0; });
  bad([](Settings& s) { s.axes[0].axis = 10; });
  bad([](Settings& s) { s.axes[0].step = 0; });
  bad([](Settings& s) { s.axes[0].speed = 1; });
  bad([](Settings& s) { s.axes[0].travel_min = 1, s.axes[0].travel_max = 0; });
  bad([](Settings& s) { s.reply_timeout = std::nan(""); });
  bad([](Settings& s) { s.axes.push_back(s.axes[0]); });
  settings.axes.push_back(settings.axes[0]);
  settings.axes[1].device = 2;
  EXPECT_THROW(open_rotary(link_to(*emulator), settings, *clock), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::zaber
