// Time on the wire: what an exchange with each emulated instrument takes, against the arithmetic of
// its line, counted by hand from the bytes and reports that a sniffer saw; and the drivers' own
// arithmetic against the same.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/link_time.h"

#include "devices/instruments/genicam/timing.h"
#include "devices/instruments/iidc/timing.h"
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/kepco_bop/timing.h"
#include "devices/instruments/pololu_tic/driver.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/pololu_tic/timing.h"
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mp285/timing.h"
#include "devices/instruments/sutter_mpc200/timing.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/instruments/usb3103/timing.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/instruments/zaber/timing.h"
#include "devices/links/address.h"
#include "devices/links/serial_line.h"
#include "devices/links/usb_frames.h"
#include "devices/time/error.h"
#include "tests/devices/instruments/wire_sniffer.h"
#include "tests/devices/links/real_end.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <functional>
#include <memory>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct LinkTimes : ::testing::Test {
  /// s on the clock.
  double time_of(const std::function<void()>& work) {
    const Time before = clock->now();
    work();
    return to_seconds(clock->now() - before);
  }
  std::unique_ptr<ByteLink> line_to(BytePeer& peer, int baud_rate) {
    return memory_byte_link(peer, *clock, {0s, character_time(baud_rate)});
  }
  static void print(const char* what, double arithmetic, double measured) {
    std::printf("%-40s by hand %8.3f ms, emulated %8.3f ms\n", what, arithmetic * 1e3,
                measured * 1e3);
  }
  std::unique_ptr<Clock> clock = virtual_clock();
};

// The rounding of a character's time to nanoseconds, over a hundred bytes.
constexpr double kRounding = 1e-7;

struct Supplies {
  Supplies(Clock& clock, int count, int baud_rate) {
    for (int i = 0; i < count; ++i) {
      emulators.push_back(kepco_bop::make_emulator());
      sniffers.push_back(std::make_unique<ByteSniffer>(*emulators.back()));
      links.push_back(memory_byte_link(*sniffers.back(), clock, {0s, character_time(baud_rate)}));
    }
  }
  void clear() {
    for (const auto& sniffer : sniffers) sniffer->clear();
  }
  std::vector<std::unique_ptr<kepco_bop::Emulator>> emulators;
  std::vector<std::unique_ptr<ByteSniffer>> sniffers;
  std::vector<std::unique_ptr<ByteLink>> links;
};

TEST_F(LinkTimes, ASetPointOfABopTakesTheTimeOfItsBytesAt9600And19200Baud) {
  for (const int baud_rate : {9600, 19200}) {
    Supplies one(*clock, 1, baud_rate);
    const auto coils = kepco_bop::open(std::move(one.links), {}, *clock);
    one.clear();
    const double took = time_of([&] { coils->set_currents(std::vector<double>{-2.5}); });
    const double by_hand = one.sniffers[0]->seconds(baud_rate);
    EXPECT_GT(one.sniffers[0]->heard.size(), 30U);
    EXPECT_GT(one.sniffers[0]->said.size(), 20U);
    EXPECT_NEAR(took, by_hand, kRounding);
    print(baud_rate == 9600 ? "BOP set point, 9600 baud" : "BOP set point, 19200 baud", by_hand,
          took);
  }
}

TEST_F(LinkTimes, EightBopsOnEightPortsTakeAsLongAsOne) {
  Supplies eight(*clock, 8, 9600);
  std::vector<Time> changed;
  const auto coils = kepco_bop::open(std::move(eight.links), {}, *clock);
  eight.clear();
  const std::vector<double> currents{1, -1, 2, -2, 1.5, -1.5, 0.5, -0.5};
  const double took = time_of([&] { coils->set_currents(currents); });
  double longest = 0;
  for (const auto& sniffer : eight.sniffers) longest = std::max(longest, sniffer->seconds(9600));
  EXPECT_NEAR(took, longest, kRounding);
  for (std::size_t i = 0; i < currents.size(); ++i)
    EXPECT_EQ(eight.emulators[i]->current(), currents[i]);
}

// The current changes when the line's end has arrived, not when the driver has its answer.
TEST_F(LinkTimes, ASetPointActsWhenItsLineHasArrived) {
  Time acted{};
  const auto emulator = kepco_bop::make_emulator({}, [&acted](Time now, double) { acted = now; });
  ByteSniffer sniffer(*emulator);
  std::vector<std::unique_ptr<ByteLink>> links;
  links.push_back(line_to(sniffer, 9600));
  const auto coils = kepco_bop::open(std::move(links), {}, *clock);
  sniffer.clear();
  const Time begun = clock->now();
  coils->set_currents(std::vector<double>{2});
  EXPECT_NEAR(to_seconds(acted - begun), static_cast<double>(sniffer.heard.size()) * 10 / 9600,
              kRounding);
}

// Both take a rest before they ask: the line's time begins with the first byte's first bit.
TEST_F(LinkTimes, AQuestionToAnMp285TakesTheTimeOfItsBytes) {
  const auto emulator = sutter_mp285::make_emulator();
  ByteSniffer sniffer(*emulator);
  sutter_mp285::Settings settings;
  settings.opening_pause = 0;
  const auto stage = sutter_mp285::open(line_to(sniffer, 9600), settings, *clock);
  sniffer.clear();
  stage->position();
  const double took = to_seconds(clock->now() - (sniffer.first - character_time(9600)));
  EXPECT_EQ(sniffer.heard.size() + sniffer.said.size(), 15U)
      << "c CR, twelve bytes of position and a CR";
  EXPECT_NEAR(took, sniffer.seconds(9600), kRounding);
  print("MP-285 position, 9600 baud", sniffer.seconds(9600), took);
}

TEST_F(LinkTimes, AQuestionToAZaberStageTakesTheTimeOfItsBytes) {
  const auto emulator = zaber::make_emulator();
  ByteSniffer sniffer(*emulator);
  const auto stage = zaber::open(line_to(sniffer, 115200), {}, *clock);
  sniffer.clear();
  stage->position();
  const double took = to_seconds(clock->now() - (sniffer.first - character_time(115200)));
  EXPECT_GT(sniffer.heard.size() + sniffer.said.size(), 30U);
  EXPECT_NEAR(took, sniffer.seconds(115200), kRounding);
  print("Zaber position, 115200 baud", sniffer.seconds(115200), took);
}

TEST_F(LinkTimes, AnUpdateOfAUsb3103TakesAFrameForEachReport) {
  const auto emulator = usb3103::make_emulator({}, nullptr);
  HidSniffer sniffer(*emulator);
  const auto coils = usb3103::open(memory_hid_link(sniffer, *clock, kUsbFrame), {}, *clock);
  clock->sleep_until(1s);  // at the begin of a frame
  sniffer.transfers = 0;
  const double took = time_of([&] { coils->set_currents(std::vector<double>(8, 1.)); });
  EXPECT_EQ(sniffer.transfers, 11) << "eight writes, sync, status, its answer";
  EXPECT_NEAR(took, 11e-3, kRounding);
  print("USB-3103 update, 1 ms frames", 11e-3, took);
  // In the middle of a frame only the rest of it is waited for.
  clock->sleep_until(2s + 700us);
  EXPECT_NEAR(time_of([&] { coils->set_currents(std::vector<double>(8, 2.)); }), 10.3e-3,
              kRounding);
}

// An update takes eleven frames, in which another task may want zero. What was latched by then must
// not come out, and neither of the two may take the other's answer.
TEST_F(LinkTimes, AUsb3103ThatIsMadeSafeDuringAnUpdateStaysAtZero) {
  for (int ms = 0; ms < 12; ++ms) {
    const auto emulator = usb3103::make_emulator({}, nullptr);
    const auto coils = usb3103::open(memory_hid_link(*emulator, *clock, kUsbFrame), {}, *clock);
    bool refused = false;
    const auto loop = clock->spawn("loop", [&] {
      try {
        coils->set_currents(std::vector<double>(8, 3.));
      } catch (const DeviceError& error) {
        refused = error.kind == DeviceErrorKind::refused;
      }
    });
    clock->sleep_for(std::chrono::milliseconds(ms) + 500us);
    const Time before = clock->now();
    EXPECT_NO_THROW(coils->make_safe());
    EXPECT_LE(clock->now() - before, 25ms);
    loop->join();
    clock->sleep_for(20ms);
    EXPECT_EQ(emulator->outputs(), usb3103::Voltages{}) << ms << " ms into it";
    // From the sync on it is out, which is in frame 8 or 9: as the first report met its frame.
    if (ms < 8 || ms > 9) {
      EXPECT_EQ(refused, ms < 8) << ms << " ms into it";
    }
  }
}

// 24 A in steps of 4 A at 9600 baud are six set points of 64 ms: zero waits for one of them.
TEST_F(LinkTimes, ARampOfBopsIsBrokenOffWhenTheyAreMadeSafe) {
  Supplies one(*clock, 1, 9600);
  const auto coils = kepco_bop::open(std::move(one.links), {}, *clock);
  coils->set_currents(std::vector<double>{-12});
  bool refused = false;
  const auto loop = clock->spawn("loop", [&] {
    try {
      coils->set_currents(std::vector<double>{12});
    } catch (const DeviceError& error) {
      refused = error.kind == DeviceErrorKind::refused;
    }
  });
  clock->sleep_for(80ms);
  const Time before = clock->now();
  coils->make_safe();
  EXPECT_EQ(one.emulators[0]->current(), 0);
  EXPECT_LE(clock->now() - before, 64ms + 40ms);
  loop->join();
  EXPECT_TRUE(refused);
  EXPECT_EQ(one.emulators[0]->current(), 0);
}

TEST_F(LinkTimes, AQuestionToATicTakesAFrame) {
  const auto emulator = pololu_tic::make_emulator({}, *clock);
  UsbSniffer sniffer(*emulator);
  const auto lens = pololu_tic::open(memory_usb_link(sniffer, *clock, kUsbFrame), {}, *clock);
  clock->sleep_until(2s);
  sniffer.transfers = 0;
  const double took = time_of([&] { lens->position(); });
  EXPECT_EQ(sniffer.transfers, 1);
  EXPECT_NEAR(took, 1e-3, kRounding);
}

// Over a real pseudo-terminal in real time. The line is never faster than its arithmetic; the
// machine's lateness only ever adds, and differs from try to try, so the fastest of several is the
// line's own. Within 10 %: the far end looks every 0.2 ms, the host's link every 4 ms at most.
TEST_F(LinkTimes, ASetPointOfABopOverAPseudoTerminalTakesTheTimeOfItsBytes) {
  const auto real = wall_clock();
  const auto emulator = kepco_bop::make_emulator();
  ByteSniffer sniffer(*emulator);
  RealEnd end(sniffer, open_pty_end(character_time(9600)));
  std::vector<std::unique_ptr<ByteLink>> links;
  links.push_back(open_byte_link(end.address(), {.baud_rate = 9600, .xon_xoff = true}, *real));
  const auto coils = kepco_bop::open(std::move(links), {}, *real);
  std::vector<double> took;
  double by_hand = 0;
  for (int i = 0; i < 9; ++i) {
    end.look([&] { sniffer.clear(); });
    const Time before = real->now();
    coils->set_currents(std::vector<double>{i % 2 == 0 ? 1.5 : -1.5});
    took.push_back(to_seconds(real->now() - before));
    by_hand = end.look([&] { return sniffer.seconds(9600); });
    EXPECT_GE(took.back(), by_hand);
  }
  std::sort(took.begin(), took.end());
  EXPECT_LE(took.front(), 1.1 * by_hand);
  print("BOP set point, pseudo-terminal, median", by_hand, took[took.size() / 2]);
}

// What `check` computes against what a sniffer counts: never less, and no more than a tenth above.
TEST_F(LinkTimes, TheDriversArithmeticIsThatOfTheLongestSetPoint) {
  const kepco_bop::Settings settings;
  for (const int baud_rate : {9600, 19200, 115200}) {
    const auto emulator = kepco_bop::make_emulator({.flow_control = true});
    ByteSniffer sniffer(*emulator);
    std::vector<std::unique_ptr<ByteLink>> links;
    links.push_back(line_to(sniffer, baud_rate));
    const auto coils = kepco_bop::open(std::move(links), settings, *clock);
    coils->set_currents(std::vector<double>{-settings.current_limit});
    sniffer.clear();
    coils->set_currents(std::vector<double>{-settings.current_limit});
    const LinkTime said = kepco_bop::update_time(settings, baud_rate);
    EXPECT_NEAR(said.seconds, sniffer.seconds(baud_rate), 1e-6) << said.arithmetic;
  }
  EXPECT_EQ(kepco_bop::update_time(settings, 0).seconds, 0) << "TCP";
  EXPECT_NEAR(usb3103::update_time(1e-3).seconds, 11e-3, 1e-12);
  EXPECT_EQ(usb3103::update_time(0).seconds, 0);
  // m, twelve bytes, CR; and CR at the end.
  EXPECT_NEAR(sutter_mp285::move_time(9600).seconds, 15 * 10 / 9600., 1e-6);
  // S, the speed, twelve bytes; and CR at the end.
  EXPECT_NEAR(sutter_mpc200::move_time(128000).seconds, 15 * 10 / 128000., 1e-6);
}

TEST_F(LinkTimes, AMoveOfAZaberStageIsAsLongOnItsLineAsItsArithmeticSays) {
  const auto emulator = zaber::make_emulator();
  ByteSniffer sniffer(*emulator);
  const zaber::Settings settings;
  const auto stage = zaber::open(line_to(sniffer, 115200), settings, *clock);
  stage->home(100s);
  stage->start(std::vector<double>{5e-3}, 1e-3);
  clock->sleep_for(10s);
  const std::size_t move = sniffer.heard.rfind("/", sniffer.heard.find("move abs "));
  const std::string command = sniffer.heard.substr(move, sniffer.heard.find('\n', move) + 1 - move);
  const std::string id = command.substr(5, command.find(' ', 5) - 5);
  const std::size_t reply = sniffer.said.find("@01 1 " + id + " OK BUSY");
  ASSERT_NE(reply, std::string::npos) << command << sniffer.said;
  const std::size_t bytes = command.size() + sniffer.said.find('\n', reply) + 1 - reply;
  // The number of the target may have a digit or two fewer or more.
  EXPECT_NEAR(zaber::move_time(115200).seconds * 115200 / 10, static_cast<double>(bytes), 3)
      << command;
}

TEST_F(LinkTimes, AMoveOfATicSetsOffAfterAsManyTransfersAsItsArithmeticSays) {
  const auto emulator = pololu_tic::make_emulator({.home_usteps = 0}, *clock);
  UsbSniffer sniffer(*emulator);
  pololu_tic::Settings settings;
  settings.home = pololu_tic::Home::none;
  const auto lens = pololu_tic::open(memory_usb_link(sniffer, *clock, kUsbFrame), settings, *clock);
  lens->home(10s);
  lens->move_to(settings.home_position + 1e-3, 10s);  // from here on the motor is energized
  clock->sleep_until(clock->now() + 1s);
  sniffer.transfers = 0;
  int until_it_moves = 0;
  const double before = emulator->motor_usteps();
  const auto watch = clock->spawn("watch", [&] {
    while (emulator->motor_usteps() == before) {
      until_it_moves = sniffer.transfers;
      clock->sleep_for(100us);
    }
  });
  lens->move_to(settings.home_position + 3e-3, 10s);
  watch->join();
  EXPECT_NEAR(until_it_moves * 1e-3, pololu_tic::move_time(1e-3).seconds, 1.5e-3)
      << "a step may take longer than a frame";
}

TEST(LinkTimeOfCameras, AnImageTakesItsBytesOrItsExposure) {
  genicam::Settings camera;
  camera.camera = "192.168.1.7";
  camera.width_px = 1384;
  camera.height_px = 1036;
  camera.exposure = 5e-3;
  camera.packet_size = 1400;
  // 1 433 824 pixels in 1051.2 packets of 1364 bytes, each 1438 on the wire, at 125 MB/s.
  EXPECT_NEAR(genicam::image_time(camera, 1e9).seconds, 1433824. / 1364 * 1438 / 125e6, 1e-9);
  EXPECT_NEAR(genicam::image_time(camera, 1e10).seconds, 5e-3, 1e-12) << "the exposure";
  camera.camera = "127.0.0.1";
  EXPECT_NEAR(genicam::image_time(camera, 1e9).seconds, 5e-3, 1e-12);
  iidc::Settings firewire;
  firewire.width_px = 656;
  firewire.height_px = 490;
  firewire.exposure = 1e-3;
  EXPECT_NEAR(iidc::image_time(firewire).seconds, 656 * 490 / (8000 * 4096.), 1e-9);
  firewire.fast_bus = true;
  EXPECT_NEAR(iidc::image_time(firewire).seconds, 656 * 490 / (8000 * 8192.), 1e-9);
}

TEST(RampOfBops, IsSlowerThanAskedWhereASetPointTakesLongerThanAStep) {
  kepco_bop::Settings settings;  // 200 A/s in steps of 20 ms
  const LinkTime update = kepco_bop::update_time(settings, 9600);
  EXPECT_NEAR(kepco_bop::ramp_slope(settings, update), 200 * 20e-3 / update.seconds, 1e-9);
  EXPECT_NE(kepco_bop::slow_ramp(settings, update).find("not at max_slope = 200 A/s"),
            std::string::npos)
      << kepco_bop::slow_ramp(settings, update);
  settings.step_time = 70e-3;
  EXPECT_EQ(kepco_bop::ramp_slope(settings, update), 200);
  EXPECT_EQ(kepco_bop::slow_ramp(settings, update), "");
}

// The driver's own ramp, timed: 12 A at 200 A/s ask for 60 ms; three set points at 9600 baud make
// it three times as slow.
TEST_F(LinkTimes, ARampAt9600BaudIsAsSlowAsItsArithmeticSays) {
  Supplies one(*clock, 1, 9600);
  const kepco_bop::Settings settings;
  const auto coils = kepco_bop::open(std::move(one.links), settings, *clock);
  const double took = time_of([&] { coils->set_currents(std::vector<double>{12}); });
  const double slope = kepco_bop::ramp_slope(settings, kepco_bop::update_time(settings, 9600));
  EXPECT_NEAR(12 / took, slope, 0.1 * slope);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
