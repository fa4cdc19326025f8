// Frames of the record's writer read back byte by byte, and those for which there is no room,
// against its header and docs/records.md.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_writer.h"
#include "tests/host/record/record_writer_reference.h"

#include <gtest/gtest.h>
#include <opencv2/core/mat.hpp>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <functional>
#include <map>
#include <memory>
#include <random>
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
using reference::Rows;
using reference::small_limits;
using reference::within;

std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

/// An image of noise that is part of a larger one, so that its rows do not follow each other.
cv::Mat noise(int rows, int columns, int type, int largest, std::mt19937_64& random) {
  cv::Mat whole(rows + 3, columns + 4, type);
  std::uniform_int_distribution<int> value(0, largest);
  const int channels = whole.channels();
  for (int v = 0; v < whole.rows; ++v) {
    for (int u = 0; u < whole.cols * channels; ++u) {
      if (whole.depth() == CV_16U) {
        whole.ptr<std::uint16_t>(v)[u] = static_cast<std::uint16_t>(value(random));
      } else {
        whole.ptr<std::uint8_t>(v)[u] = static_cast<std::uint8_t>(value(random));
      }
    }
  }
  return whole(cv::Rect(2, 1, columns, rows));
}
std::vector<std::uint8_t> bytes_of(const cv::Mat& image) {
  std::vector<std::uint8_t> bytes;
  for (int v = 0; v < image.rows; ++v) {
    const std::uint8_t* row = image.ptr(v);
    bytes.insert(bytes.end(), row, row + static_cast<std::size_t>(image.cols) * image.elemSize());
  }
  return bytes;
}

TEST(RecordFramesReference, pixels_rows_and_checksums_are_those_that_came) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.largest_stack = 6000;  // several files
  RecordWriter writer(folder.path(), {}, limits);
  RecordedCameraInfo deep = camera_of("deep");
  deep.identity = "it's one";
  deep.every = 3;
  deep.frame_period = 0.04;
  deep.effective_pixel = 9.9e-6;
  deep.bits = 12;
  deep.offset_x_px = 17;
  deep.offset_y_px = 8;
  writer.add_camera(deep);
  writer.add_camera(camera_of("gray"));
  writer.add_camera(camera_of("color"));
  std::mt19937_64 random(11);
  std::vector<std::vector<std::uint8_t>> pixels;  // as the camera gave them, by row
  Rows expected;
  for (int i = 0; i < 12; ++i) {
    const std::size_t camera = static_cast<std::size_t>(i * 7 + 1) % 3;
    Frame frame;
    frame.number = 40 + 3U * static_cast<unsigned>(i);
    frame.exposed = Time(1000000007LL * (i + 1));
    frame.received = frame.exposed + 12345us;
    if (i % 2 == 0) frame.device = Time(555 + i);
    frame.image = noise(13, 21, camera == 2 ? CV_8UC3 : CV_8UC1, 255, random);
    if (camera == 0) {
      frame.deep = noise(13, 21, CV_16UC1, 4095, random);
      frame.bits = 12;
    }
    const std::uint64_t lost = i % 4 == 3 ? 5 : 0;
    EXPECT_TRUE(writer.frame(camera, frame, lost));
    pixels.push_back(bytes_of(camera == 0 ? frame.deep : frame.image));
    const char* const names[] = {"deep", "gray", "color"};
    expected.push_back(
        {std::to_string(i + 1), names[camera], std::to_string(frame.number),
         std::to_string(frame.exposed.count()), std::to_string(frame.received.count()),
         frame.device ? std::to_string(frame.device->count()) : "NULL", "21", "13",
         std::to_string(pixels.back().size()), std::to_string(reference::crc32(pixels.back())), "0",
         std::to_string(lost)});
  }
  const std::vector<FrameRow> rows = writer.frames();  // all of them are written by now
  ASSERT_EQ(rows.size(), 12U);
  std::map<std::string, std::size_t> pages_of;
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const FrameRow& row = rows[i];
    const auto file = reference::bytes_of(folder.path() / row.file);
    EXPECT_LE(file.size(), 6000U) << row.file;
    EXPECT_EQ(row.file.rfind("frames/" + row.camera + "/" + row.camera + "_NDTiffStack", 0), 0U);
    ASSERT_LE(row.offset + row.bytes, file.size());
    std::vector<std::uint8_t> there(
        file.begin() + static_cast<std::ptrdiff_t>(row.offset),
        file.begin() + static_cast<std::ptrdiff_t>(row.offset + row.bytes));
    if (row.camera == "color")  // TIFF's order is red, green, blue
      for (std::size_t k = 0; k + 2 < there.size(); k += 3) std::swap(there[k], there[k + 2]);
    EXPECT_EQ(there, pixels[i]) << i;
    // The page in the file's own chain.
    const auto pages = reference::pages(file);
    const std::size_t page = pages_of[row.file]++;
    ASSERT_LT(page, pages.size());
    EXPECT_EQ(pages[page].width, 21U);
    EXPECT_EQ(pages[page].height, 13U);
    EXPECT_EQ(pages[page].offset, row.offset);
    EXPECT_EQ(pages[page].bytes, row.bytes);
    EXPECT_EQ(pages[page].samples, row.camera == "color" ? 3U : 1U);
    EXPECT_EQ(row.pixel_type, row.camera == "color" ? 2 : row.camera == "deep" ? 1 : 0);
  }
  EXPECT_GT(pages_of.size(), 3U);
  for (const auto& [file, count] : pages_of)
    EXPECT_EQ(reference::pages(reference::bytes_of(folder.path() / file)).size(), count) << file;
  writer.stop();
  writer.finish({}, {});
  EXPECT_EQ(folder.rows("select seq, camera, number, t_ns, t_received_ns, t_device_ns, width_px, "
                        "height_px, bytes, crc32, dropped_before, lost_before from frame"),
            expected);
  EXPECT_EQ(folder.rows("select * from camera where name = 'deep'"),
            (Rows{{"deep", "it's one", "3", "0.040000000000000001", "9.9000000000000001e-06", "12",
                   "17", "8"}}));
  EXPECT_EQ(folder.rows("select * from camera").size(), 3U);
  EXPECT_EQ(writer.dropped(), (std::vector<std::uint64_t>{0, 0, 0}));
  EXPECT_EQ(writer.lost(), (std::vector<std::uint64_t>{5, 5, 5}));
}

TEST(RecordFramesReference, in_real_time_a_frame_without_room_is_dropped_counted_and_alarmed) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_frame_bytes = 150;  // three of them
  limits.drop_frames = true;
  RecordWriter writer(folder.path(), {}, limits);
  writer.add_camera(camera_of("left"));
  writer.add_camera(camera_of("right"));
  {
    const HeldDisk held(writer);
    for (std::uint64_t i = 0; i < 3; ++i) EXPECT_TRUE(writer.frame(1, gray(i)));
    EXPECT_FALSE(writer.frame(1, gray(3)));
    EXPECT_FALSE(writer.frame(1, gray(4), 2));
    EXPECT_FALSE(writer.frame(0, gray(70)));
    EXPECT_EQ(writer.dropped(), (std::vector<std::uint64_t>{1, 2}));
    EXPECT_EQ(writer.lost(), (std::vector<std::uint64_t>{0, 2}));
    EXPECT_EQ(writer.held(), 0);
  }
  EXPECT_EQ(writer.frames().size(), 3U);
  EXPECT_TRUE(writer.frame(1, gray(8), 3));
  EXPECT_TRUE(writer.frame(1, gray(9)));
  EXPECT_TRUE(writer.frame(0, gray(71)));
  const auto rows = writer.frames();
  ASSERT_EQ(rows.size(), 6U);
  EXPECT_EQ(rows[3].number, 8U);
  EXPECT_EQ(rows[3].dropped_before, 2U);
  EXPECT_EQ(rows[3].lost_before, 5U);  // those before a dropped frame are lost all the same
  EXPECT_EQ(rows[4].dropped_before + rows[4].lost_before, 0U);
  EXPECT_EQ(rows[5].dropped_before, 1U);
  EXPECT_EQ(writer.dropped(), (std::vector<std::uint64_t>{1, 2}));
  EXPECT_EQ(writer.lost(), (std::vector<std::uint64_t>{0, 5}));
  const auto alarms = writer.drain_alarms();
  ASSERT_FALSE(alarms.empty());
  EXPECT_EQ(alarms[0], "right: frame 3 is not recorded: the disk is behind");
  EXPECT_TRUE(writer.drain_alarms().empty());
}

TEST(RecordFramesReference, a_run_ends_when_less_than_the_limit_of_its_kind_is_left) {
  struct Case {
    bool frames;
    std::uint64_t left;
    bool ends;
    std::atomic<int> asked{0};
    Folder folder{};
    std::unique_ptr<RecordWriter> writer{};
  };
  Case cases[] = {{false, 3001, false}, {false, 2999, true}, {true, 6999, true}};
  for (Case& c : cases) {  // side by side, for the disk is asked once a second
    RecordLimits limits = small_limits();
    limits.disk.stop_bytes = 3000;
    limits.disk.stop_bytes_with_frames = 7000;
    limits.disk.stop_seconds = limits.disk.warn_seconds = 0;
    limits.disk.free_bytes = [&c](const auto&) {
      ++c.asked;
      return c.left;
    };
    c.writer = std::make_unique<RecordWriter>(c.folder.path(), RunStart{}, limits);
    c.writer->add_camera(camera_of("top"));
    if (c.frames) c.writer->frame(0, gray(1));
  }
  for (Case& c : cases) {
    const auto seen = [&c] { return c.ends ? !c.writer->fault().empty() : c.asked > 0; };
    ASSERT_TRUE(within(5s, seen));
  }
  std::this_thread::sleep_for(20ms);
  for (Case& c : cases) {
    const std::string fault = c.writer->fault();
    EXPECT_EQ(fault.find("the disk is nearly full") != std::string::npos, c.ends) << fault;
    EXPECT_EQ(fault.empty(), !c.ends) << fault;
    EXPECT_EQ(error_of([&] { c.writer->frame(0, gray(2)); }), fault);
  }
  Case& last = cases[2];
  const std::string fault = last.writer->fault();
  last.writer->stop();
  last.writer->finish({Outcome::aborted, fault, 1, 2}, {});
  EXPECT_EQ(last.folder.rows("select reason from stop"), (Rows{{fault}}));
  last.writer->close();
  EXPECT_FALSE(std::filesystem::exists(last.folder.path() / "reserve.room"));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
