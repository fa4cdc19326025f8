// Exports of frames of more than 8 bits, and of color, read by other programs' readers: libtiff's
// (by OpenCV, and tiffinfo) and HDF5's own (h5dump).
// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <array>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using test::servo_start;
using test::TemporaryFolder;

cv::Mat noise(int rows, int columns, int type, int seed) {
  cv::Mat image(rows, columns, type);
  cv::RNG random(static_cast<std::uint64_t>(seed));
  random.fill(image, cv::RNG::UNIFORM, 0, 255);
  return image;
}

Frame frame_of(const cv::Mat& image, std::uint64_t number) {
  return {image, number, Time(number * 1000), Time(number * 1000 + 5)};
}

std::string said(const std::string& command) {
  std::string text;
  FILE* const pipe = ::popen(command.c_str(), "r");
  std::array<char, 4096> part{};
  while (std::size_t size = std::fread(part.data(), 1, part.size(), pipe))
    text.append(part.data(), size);
  ::pclose(pipe);
  return text;
}

/// Three frames of one camera, in a record of their own.
struct ExportBits : testing::Test {
  void record(const std::vector<Frame>& frames, int bits) {
    Recorder recorder(parent.path(), servo_start());
    RecordedCameraInfo info{"top_camera", "test", 1, 0.01, 1e-6};
    info.bits = bits;
    const int camera = recorder.add_camera(info);
    for (const Frame& frame : frames) recorder.frame(camera, frame);
    recorder.finish({Outcome::completed, "", 1, 1});
    data = read_run(recorder.folder());
  }
  Files files_of(void (*format)(const RunData&, ExportFolder&)) const {
    ExportFolder folder(parent.path() / "export", true);
    format(data, folder);
    return folder.publish();
  }
  std::vector<cv::Mat> exported(void (*format)(const RunData&, ExportFolder&) = export_tiff) {
    const Files files = files_of(format);
    EXPECT_EQ(files.size(), 1U);
    tags = said("tiffinfo '" + files.at(0).string() + "' 2>&1");
    std::vector<cv::Mat> pages;
    cv::imreadmulti(files.at(0).string(), pages, cv::IMREAD_UNCHANGED);
    return pages;
  }
  TemporaryFolder parent;
  RunData data;
  std::string tags;
};

TEST_F(ExportBits, OfTwelveAreAllThereAndTheLargestValueIsTold) {
  std::vector<Frame> frames;
  for (int i = 0; i < 3; ++i) {
    frames.push_back(frame_of(noise(12, 8, CV_8UC1, 10 + i), i));
    cv::Mat deep = noise(12, 8, CV_16UC1, 20 + i);
    for (auto pixel = deep.begin<std::uint16_t>(); pixel != deep.end<std::uint16_t>(); ++pixel)
      *pixel = static_cast<std::uint16_t>(*pixel * 37 & 0xFFF);
    deep.at<std::uint16_t>(0, 0) = 0xFFF;
    frames.back().deep = deep;
    frames.back().bits = 12;
  }
  record(frames, 12);
  const std::vector<cv::Mat> pages = exported();
  ASSERT_EQ(pages.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    ASSERT_EQ(pages[i].type(), CV_16UC1);
    EXPECT_EQ(cv::norm(pages[i], frames[i].deep, cv::NORM_INF), 0) << i;
  }
  EXPECT_NE(tags.find("Bits/Sample: 16"), std::string::npos) << tags;
  EXPECT_NE(tags.find("Max Sample Value: 4095"), std::string::npos) << tags;
  EXPECT_NE(tags.find("max=4095"), std::string::npos) << "ImageJ's range: " << tags;
}

TEST_F(ExportBits, OfColorHaveItsThreeChannelsInTheirPlaces) {
  std::vector<Frame> frames;
  for (int i = 0; i < 3; ++i) frames.push_back(frame_of(noise(12, 8, CV_8UC3, 30 + i), i));
  record(frames, 8);
  const std::vector<cv::Mat> pages = exported();
  ASSERT_EQ(pages.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    ASSERT_EQ(pages[i].type(), CV_8UC3);
    EXPECT_EQ(cv::norm(pages[i], frames[i].image, cv::NORM_INF), 0) << i;
  }
  EXPECT_NE(tags.find("Samples/Pixel: 3"), std::string::npos) << tags;
  EXPECT_NE(tags.find("RGB color"), std::string::npos) << tags;
}

TEST_F(ExportBits, OfOmeTiffAreThoseOfTheStackForImageJ) {
  Frame deep = frame_of(noise(13, 7, CV_8UC1, 1), 0);
  deep.deep = noise(13, 7, CV_16UC1, 2);
  deep.bits = 10;
  record({deep, deep}, 10);
  const std::vector<cv::Mat> pages = exported(export_ome);
  ASSERT_EQ(pages.size(), 2U);
  EXPECT_EQ(cv::norm(pages[1], deep.deep, cv::NORM_INF), 0);
  EXPECT_NE(tags.find("SignificantBits=\"10\""), std::string::npos) << tags;
  record({frame_of(noise(13, 7, CV_8UC3, 3), 0)}, 8);
  const std::vector<cv::Mat> color = exported(export_ome);
  ASSERT_EQ(color.size(), 1U);
  EXPECT_EQ(cv::norm(color[0], noise(13, 7, CV_8UC3, 3), cv::NORM_INF), 0);
}

TEST_F(ExportBits, OfAFilmComeBackAsTheyWereForEveryKindOfFrame) {
  // export_mkv decodes what it wrote and compares it with the record's CRC-32: it throws.
  record({frame_of(noise(12, 8, CV_8UC3, 3), 0), frame_of(noise(12, 8, CV_8UC3, 4), 1000000)}, 8);
  EXPECT_EQ(files_of(export_mkv).size(), 1U);
  Frame deep = frame_of(noise(12, 8, CV_8UC1, 1), 0);
  deep.deep = noise(12, 8, CV_16UC1, 2);
  deep.bits = 16;
  record({deep}, 16);
  EXPECT_EQ(files_of(export_mkv).size(), 1U);
}

TEST_F(ExportBits, OfMoreThanEightInMcapAreImagesThatTheReferenceReaderTakes) {
  if (!std::filesystem::exists(VITREO_OPEN_FORMATS_TEST "/node_modules/ajv"))
    GTEST_SKIP() << "no npm packages in " VITREO_OPEN_FORMATS_TEST;
  Frame deep = frame_of(noise(13, 7, CV_8UC1, 1), 0);
  deep.deep = noise(13, 7, CV_16UC1, 2);
  deep.bits = 12;
  record({deep}, 12);
  const Files files = files_of(export_mcap);
  const auto read = nlohmann::json::parse(
      said("node " VITREO_OPEN_FORMATS_TEST "/mcap_check.mjs '" + files.at(0).string() + "'"));
  const auto& topic = read["topics"]["/top_camera/image"];
  EXPECT_EQ(topic["schema"], "foxglove.RawImage");
  EXPECT_TRUE(topic["faults"].empty()) << topic["faults"];
  EXPECT_TRUE(topic["invalid"].empty()) << topic["invalid"];
  EXPECT_EQ(topic["first"]["content"]["encoding"], "mono16");
  EXPECT_EQ(topic["first"]["content"]["step"], 14);
}

TEST_F(ExportBits, InHdf5AreNamedBesideSixteenBitImages) {
  Frame frame = frame_of(noise(4, 3, CV_8UC1, 1), 0);
  frame.deep = cv::Mat(4, 3, CV_16UC1, cv::Scalar(0xFFF));
  frame.bits = 12;
  record({frame}, 12);
  const Files files = files_of(export_hdf5);
  ASSERT_EQ(files.size(), 1U);
  const std::string bits =
      said("h5dump -d /frames/top_camera/bits '" + files[0].string() + "' 2>&1");
  EXPECT_NE(bits.find("(0): 12"), std::string::npos) << bits;
  const std::string images =
      said("h5dump -d /frames/top_camera/images '" + files[0].string() + "' 2>&1");
  EXPECT_NE(images.find("H5T_STD_U16LE"), std::string::npos) << images;
  EXPECT_NE(images.find("(0,0,0): 4095, 4095, 4095"), std::string::npos) << images;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
