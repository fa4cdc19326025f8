// The driver of FireWire cameras, through the system's libdc1394, against doubles of cameras by
// another hand. On the wall clock.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/instruments/iidc/driver.h"
#include "devices/time/error.h"
#include "tests/devices/doubles/double_process.h"
#include "tests/devices/firewire/bus.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <ostream>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;
using Options = std::vector<std::string>;

constexpr std::uint64_t kGuid = 0x0030530001234567;
constexpr const char* kGuidText = "0030530001234567";
// Offsets of registers in the double's state.
constexpr const char* kShutter = "2076";
constexpr const char* kGain = "2080";
constexpr const char* kTransmission = "1556";
constexpr const char* kPosition = "16777224";
constexpr const char* kPacket = "16777284";

/// The number behind a name in a line of JSON.
double number_in(const std::string& json, const std::string& name) {
  const std::size_t at = json.find("\"" + name + "\": ");
  return at == std::string::npos ? NAN : std::strtod(json.c_str() + at + name.size() + 4, nullptr);
}

/// A camera on a bus of its own.
struct OneCamera {
  explicit OneCamera(const Options& options = {}, std::uint32_t sub_version = 0)
      : instrument(DoubleProcess::on_socket("iidc", options)) {
    identity.guid = kGuid;
    identity.sub_version = sub_version;
    bus.plug(identity, instrument.address());
    settings.shutter_unit = 20e-6;  // A600f and A620f, their manuals
    settings.frame_rate = 30;
  }
  std::unique_ptr<Camera> open() { return iidc::open(settings, *clock); }
  double reg(const char* offset) {
    return number_in(instrument.order(R"({"get": "registers"})"), offset);
  }
  /// The error of opening it.
  std::string refusal() {
    try {
      open();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused) << error.what();
      EXPECT_EQ(error.device, "camera");
      return error.what();
    }
    ADD_FAILURE() << "it was opened";
    return "";
  }

  std::unique_ptr<Clock> clock = wall_clock();
  DoubleProcess instrument;
  FireWireBus bus;
  FireWireCamera identity{};
  iidc::Settings settings{};
};

bool says(const std::string& text, const std::string& part) {
  return text.find(part) != std::string::npos;
}

struct Way {
  Options options;
  std::uint32_t sub_version = 0;
  int level = 102;  ///< 20000 gray levels a second for 5 ms, and a brightness of 8 quarters
};
std::ostream& operator<<(std::ostream& out, const Way& way) {
  for (const std::string& option : way.options) out << option << " ";
  return out << "IIDC 1.3" << way.sub_version / 16;
}
class IidcDouble : public testing::TestWithParam<Way> {};

// The gray level shows that shutter and gain have reached the sensor.
TEST_P(IidcDouble, KeepsTheContractOfACamera) {
  OneCamera one(GetParam().options, GetParam().sub_version);
  if (GetParam().options == Options{"absolute=True"}) one.settings.shutter_unit = 0;
  const auto camera = one.open();
  contract::CameraCheck how;
  how.may_repeat = true;  // even light
  how.content = [](const Frame& frame) -> std::string {
    double least = 0;
    double most = 0;
    cv::minMaxLoc(frame.image, &least, &most);
    if (least == GetParam().level && most == GetParam().level) return "";
    return std::to_string(least) + " to " + std::to_string(most);
  };
  EXPECT_EQ(contract::check(*camera, *one.clock, how), Findings{});
  EXPECT_EQ(camera->info().identity, "Basler A620f");
  EXPECT_EQ(one.reg(kShutter), 250);
  EXPECT_EQ(one.reg(kGain), 0);
  EXPECT_TRUE(one.bus.strays().empty());
}
std::string name_of(const testing::TestParamInfo<Way>& made) {
  std::string name = made.param.sub_version == 0 ? "iidc130" : "iidc131";
  for (const std::string& option : made.param.options) name += "_" + option;
  for (char& c : name)
    if (std::isalnum(static_cast<unsigned char>(c)) == 0) c = '_';
  return name;
}
INSTANTIATE_TEST_SUITE_P(Ways, IidcDouble,
                         testing::Values(Way{}, Way{{}, 0x10}, Way{{"late=0.01"}},
                                         Way{{"handshake=False"}}, Way{{"automatic=True"}},
                                         Way{{"absolute=True"}},
                                         Way{{"absolute=True", "automatic=True"}},
                                         Way{{"model=a602f"}, 0, 104}),
                         name_of);

// libdc1394 sets absolute values of a camera that has none without an error, and into NODE_IDS.
TEST(IidcExposure, IsRefusedWithoutAbsoluteControlAndWithoutAUnit) {
  OneCamera one;
  one.settings.shutter_unit = 0;
  EXPECT_TRUE(says(one.refusal(), "shutter_unit"));
  EXPECT_TRUE(one.bus.strays().empty());
  EXPECT_EQ(one.reg(kShutter), 200);
}

TEST(IidcExposure, BeyondTheRegistersRangeIsNamed) {
  OneCamera one;
  one.settings.exposure = 0.1;
  const std::string why = one.refusal();
  EXPECT_TRUE(says(why, "exposure: 0.1 is 5000 counts; the camera takes 1 to 4095")) << why;
  one.settings.exposure = 5e-6;
  EXPECT_TRUE(says(one.refusal(), "exposure: 5e-06 is 0 counts"));
  one.settings.exposure = 0.0819;
  one.open();
  EXPECT_EQ(one.reg(kShutter), 4095);
}

TEST(IidcExposure, InSecondsHasTheCamerasOwnLimits) {
  OneCamera one({"absolute=True"});
  one.settings.shutter_unit = 0;
  one.settings.exposure = 0.1;
  const std::string why = one.refusal();
  EXPECT_TRUE(says(why, "exposure: 0.1: the camera takes 2e-05 to 0.0819")) << why;
  one.settings.exposure = 10e-3;
  one.settings.gain = 6.02;
  const auto camera = one.open();
  EXPECT_EQ(one.reg(kShutter), 500);
  EXPECT_NEAR(one.reg(kGain), 740 / 9.23, 1);  // twice the light
  EXPECT_EQ(camera->info().settings.at(0).second, "0.01");
}

TEST(IidcGain, InCountsIsWholeAndWithinTheRegister) {
  OneCamera one;
  one.settings.gain = 741;
  EXPECT_TRUE(says(one.refusal(), "gain: 741 is 741 counts; the camera takes 0 to 740"));
  one.settings.gain = 1.5;
  EXPECT_TRUE(says(one.refusal(), "gain: the camera's is in whole counts"));
  one.settings.gain = 740;
  one.open();
  EXPECT_EQ(one.reg(kGain), 740);
}

TEST(IidcTrigger, ThatCannotBeSwitchedOffIsRefused) {
  OneCamera one({"trigger_fixed_on=True"});
  EXPECT_TRUE(says(one.refusal(), "trigger"));
}

TEST(IidcRegion, IsInTheSensorsMiddleInTheCamerasSteps) {
  OneCamera one;  // 1280 x 1024, steps of 4 and 1
  one.settings.width_px = 644;
  one.settings.height_px = 481;
  one.open();
  EXPECT_EQ(one.reg(kPosition), 316 * 65536 + 271);
  one.settings.width_px = 642;
  EXPECT_TRUE(says(one.refusal(), "width_px: the camera takes multiples of 4: 640 or 644"));
  one.settings.width_px = 1284;
  EXPECT_TRUE(says(one.refusal(), "the sensor has 1280 x 1024"));
}

TEST(IidcRegion, OfACameraWithoutStepsIsExact) {
  OneCamera one({"model=a602f"});  // 656 x 491
  one.settings.width_px = 101;
  one.settings.height_px = 99;
  const auto camera = one.open();
  EXPECT_EQ(one.reg(kPosition), 277 * 65536 + 196);
  EXPECT_EQ(camera->grab(2s).image.size(), cv::Size(101, 99));
}

// 8000 packets a second, whole ones: the rate that was asked for is the least that is given.
TEST(IidcRate, IsAtLeastWhatWasAskedFor) {
  OneCamera one;
  one.settings.frame_rate = 60;
  const auto camera = one.open();
  EXPECT_EQ(one.reg(kPacket), 2312 * 65536.);  // 640 * 480 bytes in 133 packets, in steps of 4
  EXPECT_NEAR(camera->info().frame_period, 133 * 125e-6, 1e-9);
  const auto now = [&] { return number_in(one.instrument.order(R"({"now": true})"), "now"); };
  const double begin = now();
  const double before = one.instrument.number("exposures");
  std::this_thread::sleep_for(1s);
  const double count = one.instrument.number("exposures") - before;
  EXPECT_GT(count / (now() - begin), 54);
}

TEST(IidcRate, BeyondTheBusIsRefusedWithWhatItCarries) {
  OneCamera one;
  one.settings.frame_rate = 120;
  const std::string why = one.refusal();
  EXPECT_TRUE(says(why, "frame_rate: the bus carries this region 106.667 times")) << why;
}

TEST(IidcRate, IsWhatALongExposureLeaves) {
  OneCamera one;
  one.settings.exposure = 80e-3;
  EXPECT_NEAR(one.open()->info().frame_period, 80e-3, 1e-6);
}

/// Of a camera that exposes for 40 ms and sends for 100: the double's own account of its exposures.
TEST(IidcFrame, CarriesTheTimesOfItsExposureAndOfItsLastPacket) {
  OneCamera one;
  one.settings.frame_rate = 10;
  one.settings.exposure = 40e-3;
  const auto camera = one.open();
  const std::string history = one.instrument.order(R"({"history": true})");
  const std::size_t line = history.rfind("\"transmitting\", true");
  const double begun = std::strtod(history.c_str() + history.rfind('[', line) + 1, nullptr);
  // A busy machine makes answers and packets late, never early: the best of ten counts.
  double offset = -1e9;
  for (int i = 0; i < 10; ++i) {
    const double here = to_seconds(one.clock->now());
    offset = std::max(offset, here - number_in(one.instrument.order(R"({"now": true})"), "now"));
  }
  double exposed = 1e9;
  double received = 1e9;
  for (int i = 0; i < 10; ++i) {
    const Frame frame = camera->grab(2s);
    const double start = begun + static_cast<double>(frame.number) * 0.1 + offset;
    exposed = std::min(exposed, to_seconds(frame.exposed) - start);
    received = std::min(received, to_seconds(frame.received) - start);
  }
  EXPECT_NEAR(exposed, 0.02, 0.015);
  EXPECT_NEAR(received, 0.14, 0.015);
}

// The ring has eight frames: full, it keeps the first ones.
TEST(IidcFrame, OfALateCallerIsANewOneAndItsNumberCountsTheOthers) {
  OneCamera one;
  one.settings.frame_rate = 10;
  const auto camera = one.open();
  const Frame first = camera->grab(2s);
  std::this_thread::sleep_for(1500ms);
  const Time asked = one.clock->now();
  const Frame late = camera->grab(2s);
  EXPECT_GT(to_seconds(late.exposed - asked), -0.4);
  const double period = camera->info().frame_period;
  EXPECT_NEAR(static_cast<double>(late.number - first.number),
              to_seconds(late.exposed - first.exposed) / period, 0.5);
  const CameraStatistics counts = camera->statistics();
  EXPECT_GT(counts.lost, 3u);
  EXPECT_EQ(counts.delivered + counts.lost, late.number + 1);
}

// libdc1394 says nothing of it: the image goes on behind the gap, its end is the next one's first
// packet, and that next image is gone.
TEST(IidcFrame, ThatLacksAPacketIsFollowedByAGap) {
  OneCamera one;
  one.settings.frame_rate = 10;
  const auto camera = one.open();
  camera->grab(2s);
  one.bus.lose_packet(kGuid, 50);
  for (int i = 0; i < 3; ++i) camera->grab(2s);  // some were whole already, and on their way
  const Frame first = camera->grab(2s);
  for (int i = 0; i < 3; ++i) camera->grab(2s);
  EXPECT_EQ(camera->grab(2s).number, first.number + 8);
  EXPECT_EQ(camera->statistics().torn, 0u);
  EXPECT_GE(camera->statistics().lost, 4u);
  one.bus.lose_packet(kGuid, -1);
  for (int i = 0; i < 3; ++i) camera->grab(2s);
  const Frame before = camera->grab(2s);
  EXPECT_EQ(camera->grab(2s).number, before.number + 1);
}

/// The kind of error of grabbing until there is one, and after how long.
std::pair<DeviceErrorKind, double> end_of(Camera& camera, Clock& clock) {
  const Time start = clock.now();
  for (int i = 0; i < 200; ++i) {
    try {
      camera.grab(2s);
    } catch (const DeviceError& error) {
      return {error.kind, to_seconds(clock.now() - start)};
    }
  }
  return {DeviceErrorKind::timeout, 1e9};
}

TEST(IidcCable, PulledIsALostCameraThatOpensAgain) {
  OneCamera one;
  auto camera = one.open();
  camera->grab(2s);
  one.instrument.order(R"({"unplug": true})");
  const auto [kind, after] = end_of(*camera, *one.clock);
  EXPECT_EQ(kind, DeviceErrorKind::lost);
  EXPECT_LT(after, 0.8);
  EXPECT_THROW(camera->grab(0s), DeviceError);
  const Time start = one.clock->now();
  camera.reset();
  EXPECT_LT(to_seconds(one.clock->now() - start), 1);
  EXPECT_EQ(one.bus.bandwidth(), 0);
  EXPECT_THROW(one.open(), DeviceError);  // its node is there still, and answers nothing
  one.instrument.order(R"({"power_cycle": true})");
  one.instrument.order(R"({"plug": true})");
  one.bus.plug(one.identity, one.instrument.address());
  EXPECT_EQ(one.open()->grab(2s).image.cols, 640);
}

std::ptrdiff_t descriptors() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
}

TEST(IidcCable, PulledForLongIsAnotherNode) {
  OneCamera one;
  auto camera = one.open();
  camera.reset();
  const std::ptrdiff_t open_before = descriptors();
  camera = one.open();
  one.instrument.order(R"({"unplug": true})");
  std::this_thread::sleep_for(2500ms);
  EXPECT_EQ(end_of(*camera, *one.clock).first, DeviceErrorKind::lost);
  camera.reset();
  EXPECT_EQ(descriptors(), open_before - 1);  // less the bus' own to the double
  try {
    one.open();
    ADD_FAILURE() << "it was opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found) << error.what();
  }
  one.instrument.order(R"({"plug": true})");
  one.bus.plug(one.identity, one.instrument.address());
  EXPECT_EQ(one.open()->grab(2s).image.cols, 640);
}

TEST(IidcCable, IsLeftWithACameraAtRest) {
  OneCamera one;
  one.open()->grab(2s);
  EXPECT_EQ(one.reg(kTransmission), 0);
  EXPECT_EQ(one.bus.bandwidth(), 0);
}

/// A second camera on the same bus.
struct TwoCameras : OneCamera {
  TwoCameras() {
    bus.plug({.guid = kGuid + 1, .model = "A602f"}, other.address());
    settings.guid = kGuidText;
    second = settings;
    second.guid = "0030530001234568";
    second.name = "side";
    second.width_px = 400;
    second.height_px = 300;
  }
  DoubleProcess other = DoubleProcess::on_socket("iidc", {"model=a602f"});
  iidc::Settings second;
};

TEST(IidcBus, CarriesSeveralCamerasByTheirGuids) {
  TwoCameras two;
  const auto top = iidc::open(two.settings, *two.clock);
  const auto side = iidc::open(two.second, *two.clock);
  EXPECT_EQ(top->info().identity, "Basler A620f");
  EXPECT_EQ(side->info().identity, "Basler A602f");
  for (int i = 0; i < 10; ++i) {
    EXPECT_EQ(top->grab(2s).image.cols, 640);
    EXPECT_EQ(side->grab(2s).image.cols, 400);
  }
  two.other.order(R"({"unplug": true})");  // the bus is reset under the first one
  EXPECT_EQ(end_of(*side, *two.clock).first, DeviceErrorKind::lost);
  EXPECT_EQ(top->grab(2s).image.cols, 640);
}

TEST(IidcBus, WithSeveralCamerasWantsAGuid) {
  TwoCameras two;
  two.settings.guid.clear();
  try {
    two.open();
    ADD_FAILURE() << "it was opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found);
    EXPECT_TRUE(says(error.what(), "guid")) << error.what();
  }
}

TEST(IidcBus, ThatIsFullIsNamed) {
  TwoCameras two;
  two.settings.frame_rate = 100;
  two.second.frame_rate = 200;
  const auto top = iidc::open(two.settings, *two.clock);
  try {
    iidc::open(two.second, *two.clock);
    ADD_FAILURE() << "it was opened";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_EQ(error.device, "side");
    EXPECT_TRUE(says(error.what(), "one bus share")) << error.what();
  }
  EXPECT_EQ(top->grab(2s).image.cols, 640);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
