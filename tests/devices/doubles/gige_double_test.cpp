// The GenICam driver against a GigE Vision camera by another hand: real packets, a clock of the
// camera's own, an exposure that is known.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/instruments/genicam/driver.h"
#include "devices/time/error.h"
#include "tests/devices/doubles/double_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fcntl.h>
#include <functional>
#include <map>
#include <sys/file.h>
#include <unistd.h>

namespace vitreo::genicam {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;
using Json = nlohmann::json;

struct GigeDouble : ::testing::Test {
  // The port is fixed and tests run side by side: one at a time.
  GigeDouble() : lock(::open("/tmp/vitreo_gige_test.lock", O_CREAT | O_RDWR | O_CLOEXEC, 0666)) {
    flock(lock, LOCK_EX);
  }
  ~GigeDouble() override { ::close(lock); }

  static DoubleProcess serve(const std::vector<std::string>& options = {}) {
    std::vector<std::string> words{"--camera", "127.0.0.1"};
    for (const std::string& option : options) {
      words.emplace_back("--option");
      words.push_back(option);
    }
    return DoubleProcess::of_server("gige_serve.py", words);
  }
  static Settings small() {
    Settings settings;
    settings.camera = "127.0.0.1";
    settings.width_px = 160;
    settings.height_px = 120;
    settings.frame_rate = 50;
    settings.exposure = 4e-3;
    settings.packet_size = 8000;
    return settings;
  }
  std::string refused(const Settings& settings) {
    try {
      open(settings, *clock);
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused);
      return error.what();
    }
    return "";
  }
  int lock;
  std::unique_ptr<Clock> clock = wall_clock();
};

TEST_F(GigeDouble, KeepsTheContractOfACamera) {
  const DoubleProcess camera = serve();
  const auto driver = open(small(), *clock);
  contract::CameraCheck how;
  how.may_repeat = true;
  EXPECT_EQ(contract::check(*driver, *clock, how), Findings{});
}

/// What the double says of each of its frames, by the ticks of its stamp; "first_ns" is when the
/// first packet left.
std::map<std::int64_t, Json> frames_of(DoubleProcess& camera) {
  std::map<std::int64_t, Json> by_block;
  const Json told = Json::parse(camera.order(R"({"history": 0})"));
  for (const Json& line : told["history"]) {
    if (line[1] == "frame") by_block[line[2]["block"].get<std::int64_t>()] = line[2];
    if (line[1] == "sent")
      by_block[line[2]["block"].get<std::int64_t>()]["first_ns"] = line[2]["first_ns"];
  }
  std::map<std::int64_t, Json> frames;
  for (const auto& [block, frame] : by_block)
    if (frame.contains("ticks")) frames[frame["ticks"].get<std::int64_t>()] = frame;
  return frames;
}

/// Median and largest of magnitudes, ms.
struct Errors {
  std::vector<double> all;
  double median() {
    std::nth_element(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(all.size() / 2),
                     all.end());
    return all[all.size() / 2];
  }
  double largest() const { return *std::max_element(all.begin(), all.end()); }
};

/// The host's monotonic clock is the double's judge, and the driver's clock a constant away from
/// it.
double monotonic_zero_ns(const Clock& clock) {
  const auto steady = std::chrono::steady_clock::now().time_since_epoch();
  return static_cast<double>(std::chrono::duration_cast<std::chrono::nanoseconds>(steady).count() -
                             clock.now().count());
}

/// What the double says of a frame, or nothing and a failure.
const Json* said_of(const Frame& frame, const std::map<std::int64_t, Json>& truth) {
  constexpr double kTick = 8;  // ns
  const double start = static_cast<double>((frame.device.value_or(0s) - 2ms).count()) / kTick;
  const auto found = truth.lower_bound(std::llround(start) - 9);  // Aravis rounds to a tick or so
  if (found != truth.end() && static_cast<double>(found->first) <= start + 10)
    return &found->second;
  ADD_FAILURE() << "frame " << frame.number << " is none of the camera's";
  return nullptr;
}

/// How far `of(frame)` is behind the middle of the frame's true exposure of 4 ms, ms.
double behind(Time of, const Json& said, double zero_ns) {
  const double middle = said["start_ns"].get<double>() / 2 + said["end_ns"].get<double>() / 2;
  return (static_cast<double>(of.count()) + zero_ns - middle) * 1e-6;
}

TEST_F(GigeDouble, KnowsWhenAFrameWasExposedThoughItsPacketsJitterByTwentyMilliseconds) {
  for (const char* const by : {"latch", "arrivals"}) {
    DoubleProcess camera = serve({"jitter=uniform", "drift_ppm=50", "clock_offset=1234.5"});
    Settings settings = small();
    settings.device_clock = by;
    const auto driver = open(settings, *clock);
    std::vector<Frame> frames;
    for (int i = 0; i < 300; ++i) frames.push_back(driver->grab(5s));
    const double zero_ns = monotonic_zero_ns(*clock);
    const auto truth = frames_of(camera);
    Errors dated;
    Errors arrived;
    // By arrivals alone a constant stays, from the exposure's end to the first packet: as little as
    // it was for any frame so far, which a busy machine makes more than the readout.
    const bool alone = std::string(by) == "arrivals";
    double least = alone ? 1e9 : 0;
    for (std::size_t i = 0; i < frames.size(); ++i) {
      const Json* said = said_of(frames[i], truth);
      ASSERT_TRUE(said != nullptr && said->contains("first_ns"));
      if (alone)
        least = std::min(
            least, ((*said)["first_ns"].get<double>() - (*said)["end_ns"].get<double>()) * 1e-6);
      if (i < 100) continue;  // 2 s to learn
      dated.all.push_back(std::abs(behind(frames[i].exposed, *said, zero_ns) - least));
      arrived.all.push_back(
          std::abs(behind(frames[i].received - 2ms, *said, zero_ns) - (alone ? least : 0)));
    }
    std::printf(
        "by %s: exposure known to %.3f ms (median), %.3f (worst of %zu), after %.3f of the least "
        "way; each arrival alone %.1f, %.1f\n",
        by, dated.median(), dated.largest(), dated.all.size(), least, arrived.median(),
        arrived.largest());
    EXPECT_LT(dated.median(), alone ? 1 : 0.1);
    EXPECT_GT(arrived.median(), 1) << "the jitter is not there, and nothing was tested";
  }
}

/// Frames are looked up by their leader's stamp; the exposure is the frame's own.
double off_by(const Frame& frame, const Json& truth, double zero_ns) {
  const double middle = truth["start_ns"].get<double>() / 2 + truth["end_ns"].get<double>() / 2;
  return std::abs(static_cast<double>(frame.exposed.count()) + zero_ns - middle) * 1e-6;
}

// The leader's stamp is of the end of the readout, as some makers have it; the chunk's is of the
// exposure's begin by definition. And the exposure is changed while frames are on their way.
TEST_F(GigeDouble, SaysInItsChunkDataWhenAndForHowLongAFrameWasExposed) {
  for (const char* const names : {"new", "old"}) {
    DoubleProcess camera = serve(
        {"jitter=uniform", "drift_ppm=50", "stamp_at=readout", std::string("names=") + names});
    const auto driver = open(small(), *clock);
    for (int i = 0; i < 100; ++i) driver->grab(5s);  // 2 s to learn
    std::vector<Frame> frames;
    for (int i = 0; i < 100; ++i) {
      if (i % 20 == 10)
        driver->set_feature(std::string(names) == "new" ? "ExposureTime" : "ExposureTimeAbs",
                            i % 40 == 10 ? "12000" : "2000");
      frames.push_back(driver->grab(5s));
    }
    const double zero_ns = monotonic_zero_ns(*clock);
    const auto truth = frames_of(camera);
    Errors errors;
    std::map<std::int64_t, int> lengths;
    for (const Frame& frame : frames) {
      // The nearest in time: frames are 20 ms apart, and none is off by half of that.
      const Json* nearest = nullptr;
      for (const auto& [ticks, one] : truth)
        if (nearest == nullptr || off_by(frame, one, zero_ns) < off_by(frame, *nearest, zero_ns))
          nearest = &one;
      ASSERT_NE(nearest, nullptr);
      errors.all.push_back(off_by(frame, *nearest, zero_ns));
      ++lengths[std::llround((*nearest)["exposure_us"].get<double>())];
    }
    std::printf(
        "by chunk data (%s names): exposure known to %.3f ms (median), %.3f (worst of %zu)\n",
        names, errors.median(), errors.largest(), frames.size());
    EXPECT_GE(lengths.size(), 3U) << "the exposure was not changed, and nothing was tested";
    EXPECT_LT(errors.largest(), 0.3);
    EXPECT_LT(errors.median(), 0.1);
  }
}

TEST_F(GigeDouble, WithChunkDataInWhichAnImageHasNoSizeIsRefusedByName) {
  const DoubleProcess camera = serve({"chunk_payload=chunk"});
  Settings settings = small();
  settings.chunks = "on";
  const auto driver = open(settings, *clock);
  try {
    driver->grab(5s);
    FAIL() << "a frame without a size";
  } catch (const DeviceError& error) {
    EXPECT_NE(std::string(error.what()).find("chunks"), std::string::npos) << error.what();
  }
}

TEST_F(GigeDouble, WithoutChunkDataIsTheSameButForTheExposuresOnTheirWay) {
  const DoubleProcess camera = serve();
  Settings settings = small();
  settings.chunks = "off";
  const auto driver = open(settings, *clock);
  EXPECT_TRUE(driver->grab(5s).device);
  EXPECT_EQ(driver->feature("ChunkModeActive"), "false");
}

TEST_F(GigeDouble, FollowsAMastersClockBeforeItsFirstFrame) {
  for (const char* const names : {"new", "old"}) {
    const DoubleProcess camera =
        serve({"ptp_lock_time=1", "ptp_error=0.000001", std::string("names=") + names});
    Settings settings = small();
    settings.ptp = true;
    const auto driver = open(settings, *clock);
    std::map<std::string, std::string> said(driver->info().settings.begin(),
                                            driver->info().settings.end());
    EXPECT_EQ(said[std::string(names) == "new" ? "PtpStatus" : "GevIEEE1588Status"], "Slave");
    if (std::string(names) == "new") {
      EXPECT_EQ(said["PtpOffsetFromMaster"], "1000");
    }
    const Frame frame = driver->grab(5s);
    // TAI is 37 s ahead of the computer's wall clock.
    const auto wall = std::chrono::system_clock::now().time_since_epoch();
    EXPECT_NEAR(to_seconds(*frame.device), std::chrono::duration<double>(wall).count() + 37, 0.5);
    EXPECT_LT(clock->now() - frame.exposed, 500ms);
  }
}

TEST_F(GigeDouble, WithoutAMasterOnItsNetworkIsRefusedWithItsStatus) {
  const DoubleProcess camera = serve({"ptp_lock_time=100"});
  Settings settings = small();
  settings.ptp = true;
  settings.ptp_timeout = 0.5;
  const std::string said = refused(settings);
  EXPECT_NE(said.find("ptp: its clock is Listening"), std::string::npos) << said;
}

TEST_F(GigeDouble, WithoutAClockIsDatedByItsArrival) {
  const DoubleProcess camera = serve({"tick_frequency=0"});
  const auto driver = open(small(), *clock);
  const Frame frame = driver->grab(5s);
  EXPECT_FALSE(frame.device);
  EXPECT_LT(clock->now() - frame.exposed, 500ms);
}

// It comes with exposure and gain automatic, as cameras do, and changes them in mid-run.
TEST_F(GigeDouble, IsMadeNeutralAndSaysWhatItWasSetTo) {
  DoubleProcess camera = serve();
  const auto driver = open(small(), *clock);
  EXPECT_EQ(driver->feature("ExposureAuto"), "Off");
  EXPECT_EQ(driver->feature("GainAuto"), "Off");
  for (int i = 0; i < 20; ++i) driver->grab(5s);
  const auto exposed = frames_of(camera);
  EXPECT_GE(exposed.size(), 20U);
  for (const auto& [ticks, frame] : exposed)
    EXPECT_DOUBLE_EQ(frame["exposure_us"].get<double>(), 4000) << "frame at " << ticks;
  const auto& said = driver->info().settings;
  const auto exposure = std::find_if(said.begin(), said.end(),
                                     [](const auto& one) { return one.first == "ExposureTime"; });
  ASSERT_NE(exposure, said.end());
  EXPECT_EQ(std::stod(exposure->second), 4000);
}

TEST_F(GigeDouble, OfOldNamesIsTheSame) {
  const DoubleProcess camera = serve({"names=old"});
  const auto driver = open(small(), *clock);
  driver->grab(5s);
  EXPECT_EQ(std::stod(driver->feature("ExposureTimeAbs")), 4000);
}

/// One frame of a scene that stands still.
Frame still(Clock& clock, const Settings& settings) {
  const auto driver = open(settings, clock);
  return driver->grab(5s);
}
const std::vector<std::string> kStill{"strip=false", "dot_period=0"};

TEST_F(GigeDouble, ShowsThePartOfTheSensorThatIsAskedFor) {
  const DoubleProcess camera = serve(kStill);
  Settings whole = small();
  whole.width_px = 640;
  whole.height_px = 480;
  const cv::Mat all = still(*clock, whole).image;
  Settings part = small();
  part.offset_x_px = 301;
  part.offset_y_px = 77;
  const cv::Mat seen = still(*clock, part).image;
  EXPECT_EQ(cv::norm(seen, all(cv::Rect(301, 77, 160, 120)), cv::NORM_INF), 0);
  EXPECT_GT(cv::norm(seen, all(cv::Rect(0, 0, 160, 120)), cv::NORM_INF), 0);
  part.offset_x_px = 500;
  EXPECT_NE(refused(part).find("offset_x_px"), std::string::npos);
}

TEST_F(GigeDouble, OfTwelveBitsIsTheSameInEachPacking) {
  const DoubleProcess camera = serve(kStill);
  Settings settings = small();
  settings.pixel_format = "Mono12";
  const Frame twelve = still(*clock, settings);
  EXPECT_EQ(twelve.bits, 12);
  ASSERT_EQ(twelve.deep.type(), CV_16UC1);
  double most = 0;
  cv::minMaxLoc(twelve.deep, nullptr, &most);
  EXPECT_GT(most, 255);
  EXPECT_LT(most, 4096);
  for (const char* const packing : {"Mono12p", "Mono12Packed"}) {
    settings.pixel_format = packing;
    EXPECT_EQ(cv::norm(still(*clock, settings).deep, twelve.deep, cv::NORM_INF), 0) << packing;
  }
  settings.pixel_format = "Mono10p";
  cv::Mat fourth;
  cv::Mat ten;
  twelve.deep.convertTo(fourth, CV_32F, 0.25);
  still(*clock, settings).deep.convertTo(ten, CV_32F);
  EXPECT_LE(cv::norm(ten, fourth, cv::NORM_INF), 1);
}

TEST_F(GigeDouble, OfColorHasTheColorsOfTheSceneWhereverTheImageBegins) {
  std::vector<std::string> options = kStill;
  options.emplace_back("color=true");
  options.emplace_back("offset_step=2");
  const DoubleProcess camera = serve(options);
  Settings settings = small();
  settings.pixel_format = "BayerRG8";
  settings.width_px = 320;
  settings.height_px = 240;
  const cv::Mat all = still(*clock, settings).image;
  ASSERT_EQ(all.type(), CV_8UC3);
  settings.width_px = 160;
  settings.height_px = 120;
  settings.offset_x_px = 82;
  settings.offset_y_px = 46;
  const cv::Mat part = still(*clock, settings).image;
  const cv::Rect inner(2, 2, 156, 116);  // the border is interpolated from fewer pixels
  EXPECT_LE(cv::norm(part(inner), all(inner + cv::Point(82, 46)), cv::NORM_INF), 1);
  settings.offset_x_px = 81;  // it would shift the mosaic
  EXPECT_THROW(settings.check(), std::invalid_argument);
}

TEST_F(GigeDouble, ExposesWhenItIsTriggeredAndIsNotLostMeanwhile) {
  DoubleProcess camera = serve();
  Settings settings = small();
  settings.trigger = "Software";
  const auto driver = open(settings, *clock);
  try {
    driver->grab(700ms);
    ADD_FAILURE() << "a frame without a trigger";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::timeout) << error.what();
  }
  std::uint64_t last = 0;
  for (int i = 0; i < 10; ++i) {
    driver->set_feature("TriggerSoftware", "");
    const Frame frame = driver->grab(5s);
    EXPECT_EQ(frame.number, last + 1);
    last = frame.number;
  }
  EXPECT_EQ(camera.number("frames_sent"), 10);
}

TEST_F(GigeDouble, TakesWhatItsOwnDescriptionSaysAndNoMore) {
  const DoubleProcess camera = serve();
  const auto driver = open(small(), *clock);
  const auto reason = [&](const std::string& name, const std::string& value) -> std::string {
    try {
      driver->set_feature(name, value);
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused);
      return error.what();
    }
    return "taken";
  };
  EXPECT_EQ(reason("ExposureTime", "2000"), "taken");
  EXPECT_EQ(std::stod(driver->feature("ExposureTime")), 2000);
  for (const auto& [name, value] :
       std::vector<std::pair<std::string, std::string>>{{"ExposureTime", "1e12"},
                                                        {"ExposureTime", "two"},
                                                        {"Width", "320"},
                                                        {"PixelFormat", "Mono16"},
                                                        {"NoSuchThing", "1"},
                                                        {"ExposureAuto", "Sometimes"}})
    EXPECT_NE(reason(name, value).find(name), std::string::npos) << reason(name, value);
}

TEST_F(GigeDouble, RefusesARigFileThatItCannotFollow) {
  const DoubleProcess camera = serve();
  Settings wrong = small();
  wrong.width_px = 641;
  EXPECT_NE(refused(wrong).find("width_px"), std::string::npos);
  wrong = small();
  wrong.features = {{"Gamma", "1000"}};
  EXPECT_NE(refused(wrong).find("Gamma"), std::string::npos);
}

TEST_F(GigeDouble, CountsOnWhenItsNumbersBeginAnew) {
  const DoubleProcess camera = serve({"first_block=65530"});
  const auto driver = open(small(), *clock);
  const std::uint64_t first = driver->grab(5s).number;
  Frame frame;
  while (frame.number < first + 15) frame = driver->grab(5s);
  EXPECT_EQ(driver->statistics().lost, 0U);
}

TEST_F(GigeDouble, AsksForPacketsThatWereLostAndCountsImagesThatStayTorn) {
  {
    DoubleProcess camera = serve({"packet_loss=0.02"});
    const auto driver = open(small(), *clock);
    for (int i = 0; i < 40; ++i) driver->grab(5s);
    EXPECT_GT(camera.number("packets_resent"), 0);
  }
  const DoubleProcess silent = serve({"packet_loss=0.05", "resend=silent"});
  const auto driver = open(small(), *clock);
  for (int i = 0; i < 40; ++i) driver->grab(5s);
  EXPECT_GT(driver->statistics().torn + driver->statistics().lost, 0U);
}

/// Two cameras of one server; the second needs a second address of the loopback net for Aravis,
/// which finds interfaces by getifaddrs(): run with libvitreo_loopback preloaded.
struct GigePair : GigeDouble {};

TEST_F(GigePair, OneOfWhichTriggersTheOtherAreInStep) {
  DoubleProcess both = DoubleProcess::of_server(
      "gige_serve.py", {"--camera", "127.0.0.1,serial=A", "--camera",
                        "127.0.0.2,serial=B,drift_ppm=-40,clock_offset=99", "--option",
                        "jitter=uniform", "--wire", "1:Line1=0:Line2"});
  Settings first = small();
  first.name = "top_camera";
  first.frame_rate = 25;
  first.exposure_output = "Line2";
  Settings second = first;
  second.name = "side_camera";
  second.camera = "127.0.0.2";
  second.exposure_output.clear();
  second.trigger = "Line1";
  const auto side = open(second, *clock);
  const auto top = open(first, *clock);
  std::vector<Time> sides;
  std::vector<Time> tops;
  const auto watch = clock->spawn("side", [&] {
    for (int i = 0; i < 120; ++i) sides.push_back(side->grab(5s).exposed);
  });
  for (int i = 0; i < 120; ++i) tops.push_back(top->grab(5s).exposed);
  watch->join();
  Errors skews;
  for (std::size_t i = 30; i < 110; ++i) {
    double least = 1e9;
    for (const Time other : sides)
      least = std::min(least, std::abs(to_seconds(other - tops[i])) * 1e3);
    skews.all.push_back(least);
  }
  std::printf("pair skew %.3f ms (median), %.3f (worst of %zu)\n", skews.median(), skews.largest(),
              skews.all.size());
  EXPECT_LT(skews.median(), 0.2);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::genicam
