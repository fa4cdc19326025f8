// Record writer: frames that a failed disk did not take are counted, the reserve is given back, and
// the disk is asked once a second for what is recorded in all.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_writer.h"
#include "tests/host/record/record_writer_reference.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using reference::camera_of;
using reference::Folder;
using reference::gray;
using reference::HeldDisk;
using reference::small_limits;
using reference::within;
using Counts = std::vector<std::uint64_t>;

TEST(RecordWriterRoom, AWriterThatGoesWithoutAnEndLeavesNoReserve) {
  const Folder folder;
  {
    const RecordWriter writer(folder.path(), {}, small_limits());
    EXPECT_TRUE(std::filesystem::exists(folder.path() / "reserve.room"));
  }
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "reserve.room"));
}

TEST(RecordWriterRoom, FramesBehindWhatTheDiskRefusedAreCountedAsDropped) {
  const Folder folder;
  RecordWriter writer(folder.path(), {}, small_limits());
  writer.add_camera(camera_of("top"));
  writer.add_camera(camera_of("side"));
  {
    HeldDisk held(writer);  // so that all of it is one turn
    writer.frame(0, gray(1));
    writer.post([](RecordFile&) { throw std::runtime_error("the disk burns"); }, false);
    for (std::uint64_t i = 2; i < 5; ++i) writer.frame(0, gray(i));
    writer.frame(1, gray(1));
  }
  ASSERT_TRUE(within(4s, [&] { return writer.fault() == "the disk burns"; }));
  EXPECT_EQ(writer.dropped(), (Counts{3, 1}));
  writer.stop();
  EXPECT_EQ(writer.frames().size(), 1U);
}

TEST(RecordWriterRoom, AFrameThatTheDiskItselfRefusesIsCountedAsDropped) {
  const Folder folder;
  RecordWriter writer(folder.path(), {}, small_limits());
  writer.add_camera(camera_of("top"));
  std::ofstream(folder.path() / "frames") << "a file where the frames' folder should be";
  writer.frame(0, gray(1));
  ASSERT_TRUE(within(4s, [&] { return !writer.fault().empty(); }));
  EXPECT_EQ(writer.dropped(), (Counts{1}));
}

// Ten frames of 1 MB a second, or what the machine's disk takes. Asked at every turn, it would be
// twenty times a second.
TEST(RecordWriterRoom, TheDiskIsAskedOnceASecondForTheRateOfRowsAndFramesTogether) {
  const Folder folder;
  RecordLimits limits = small_limits();
  std::atomic<int> asked{0};
  std::atomic<std::uint64_t> left{1'000'000'000'000'000};
  limits.disk.free_bytes = [&](const std::filesystem::path&) {
    ++asked;
    return left.load();
  };
  RecordWriter writer(folder.path(), {}, limits);
  writer.add_camera(camera_of("top"));
  const int before = asked;
  Frame large = gray(1);
  large.image = cv::Mat(1000, 1000, CV_8UC1, cv::Scalar(7));
  const auto begun = std::chrono::steady_clock::now();
  std::uint64_t written = 0;
  const auto record = [&](std::chrono::milliseconds until) {
    while (std::chrono::steady_clock::now() - begun < until) {
      ++large.number;
      writer.frame(0, large);
      written += large.image.total();
      std::this_thread::sleep_for(100ms);
    }
  };
  record(3700ms);
  EXPECT_GE(asked - before, 2);
  EXPECT_LE(asked - before, 4);
  EXPECT_EQ(writer.drain_alarms(), std::vector<std::string>{});
  const double rate = static_cast<double>(written) / 3.7;
  left = static_cast<std::uint64_t>(300 * rate) + limits.disk.stop_bytes_with_frames;
  record(5200ms);
  EXPECT_EQ(writer.fault(), "") << "300 s and more are left, and it ends a run for 120";
  const std::vector<std::string> alarms = writer.drain_alarms();
  ASSERT_EQ(alarms.size(), 1U) << "it warns of 600 s";
  EXPECT_EQ(alarms[0].substr(0, 16), "the disk fills: ");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
