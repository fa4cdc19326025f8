// Cameras keep the contract of their role: image sequences and video files; and the contract
// notices one that does not.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/instruments/iidc/driver.h"
#include "devices/instruments/image_sequence/driver.h"
#include "devices/instruments/opencv_camera/driver.h"
#include "devices/roles/gray.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/videoio.hpp>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
namespace fs = std::filesystem;
using Findings = std::vector<std::string>;

/// A folder that is gone after the test.
struct Folder {
  Folder() {
    char name[] = "/tmp/vitreo_camera_XXXXXX";
    path = mkdtemp(name);
  }
  ~Folder() { fs::remove_all(path); }
  std::string file(const std::string& name) const { return (path / name).string(); }
  fs::path path;
};

cv::Mat shade(int value) { return cv::Mat(48, 64, CV_8U, cv::Scalar(value)); }

struct Sequence : ::testing::Test {
  Sequence() {
    settings.folder = folder.path.string();
    settings.frame_rate = 10;
  }
  void write(int count) {
    for (int i = 0; i < count; ++i)
      cv::imwrite(folder.file("frame" + std::to_string(i) + ".png"), shade(10 * i));
  }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "camera");
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }
  Folder folder;
  image_sequence::Settings settings;
  std::unique_ptr<Clock> clock = virtual_clock();
};

int first_pixel(const Frame& frame) { return frame.image.at<unsigned char>(0, 0); }

TEST_F(Sequence, KeepsTheContractOfACamera) {
  write(20);
  contract::CameraCheck how;
  how.content = [](const Frame& frame) -> std::string {
    return first_pixel(frame) == 10 * static_cast<int>(frame.number) ? "" : "another image";
  };
  EXPECT_EQ(contract::check(*image_sequence::open(settings, *clock), *clock, how), Findings{});
}

TEST_F(Sequence, PlaysInNaturalOrder) {
  write(12);
  settings.every_frame = true;
  const auto camera = image_sequence::open(settings, *clock);
  for (int i = 0; i < 12; ++i) EXPECT_EQ(first_pixel(camera->grab(1s)), 10 * i);
}

TEST_F(Sequence, DropsWhatNobodySawAndCountsIt) {
  write(20);
  const auto camera = image_sequence::open(settings, *clock);
  EXPECT_EQ(camera->grab(1s).number, 0U);
  clock->sleep_for(450ms);
  const Frame frame = camera->grab(1s);
  EXPECT_EQ(frame.number, 4U);
  EXPECT_EQ(frame.exposed, 400ms);
  EXPECT_EQ(camera->statistics().lost, 3U);
}

TEST_F(Sequence, WaitsForWhoeverGrabsEveryFrame) {
  write(20);
  settings.every_frame = true;
  const auto camera = image_sequence::open(settings, *clock);
  camera->grab(1s);
  clock->sleep_for(10s);
  EXPECT_EQ(camera->grab(1s).number, 1U);
}

TEST_F(Sequence, EndsOrBeginsAgain) {
  write(2);
  settings.every_frame = true;
  auto camera = image_sequence::open(settings, *clock);
  camera->grab(1s);
  camera->grab(1s);
  EXPECT_EQ(kind_of([&] { camera->grab(1s); }), DeviceErrorKind::lost);
  settings.repeat = true;
  camera = image_sequence::open(settings, *clock);
  for (int i = 0; i < 5; ++i) {
    const Frame frame = camera->grab(1s);
    EXPECT_EQ(frame.number, static_cast<unsigned>(i));
    EXPECT_EQ(first_pixel(frame), 10 * (i % 2));
  }
}

TEST_F(Sequence, NamesWhatIsWrongWithItsFiles) {
  EXPECT_EQ(kind_of([&] { image_sequence::open(settings, *clock); }),
            DeviceErrorKind::not_found);  // empty
  write(1);
  std::ofstream(folder.file("frame1.png")) << "this is no image";
  cv::imwrite(folder.file("frame2.png"), cv::Mat(10, 10, CV_8U, cv::Scalar(0)));
  settings.every_frame = true;
  const auto camera = image_sequence::open(settings, *clock);
  camera->grab(1s);
  EXPECT_EQ(kind_of([&] { camera->grab(1s); }), DeviceErrorKind::protocol);
  EXPECT_EQ(kind_of([&] { camera->grab(1s); }), DeviceErrorKind::protocol);
  settings.folder = "/no/such/folder";
  EXPECT_EQ(kind_of([&] { image_sequence::open(settings, *clock); }), DeviceErrorKind::not_found);
}

TEST(ImageSequence, SortsNamesNaturally) {
  using image_sequence::naturally_before;
  EXPECT_TRUE(naturally_before("f2", "f10"));
  EXPECT_FALSE(naturally_before("f10", "f2"));
  EXPECT_TRUE(naturally_before("f", "f0"));
  EXPECT_TRUE(naturally_before("f9a", "f10"));
  EXPECT_TRUE(naturally_before("a10", "b2"));
  EXPECT_TRUE(
      naturally_before("f18446744073709551617", "f18446744073709551618"));  // beyond 64 bits
  EXPECT_NE(naturally_before("f01", "f1"), naturally_before("f1", "f01"));  // a strict order
  EXPECT_FALSE(naturally_before("f1", "f1"));
}

TEST(Gray, ComesFromEveryKindOfImage) {
  EXPECT_EQ(in_gray(cv::Mat(1, 1, CV_16U, cv::Scalar(65535))).at<unsigned char>(0, 0), 255);
  EXPECT_EQ(in_gray(cv::Mat(1, 1, CV_8UC3, cv::Scalar(255, 255, 255))).at<unsigned char>(0, 0),
            255);
  EXPECT_EQ(in_gray(cv::Mat(1, 1, CV_8UC3, cv::Scalar(0, 255, 0))).at<unsigned char>(0, 0), 150);
  EXPECT_EQ(in_gray(cv::Mat(1, 1, CV_8UC4, cv::Scalar(0, 0, 255, 7))).at<unsigned char>(0, 0), 76);
  EXPECT_THROW(in_gray(cv::Mat(1, 1, CV_32F)), std::invalid_argument);
}

TEST_F(Sequence, PlaysAVideoFileToItsEnd) {
  const std::string file = folder.file("video.avi");
  {
    cv::VideoWriter writer(file, cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 20, {64, 48}, false);
    ASSERT_TRUE(writer.isOpened());
    for (int i = 0; i < 20; ++i) writer.write(shade(10 * i));
  }
  opencv_camera::Settings video;
  video.source = file;
  const auto camera = opencv_camera::open(video, *clock);
  EXPECT_NEAR(camera->info().frame_period, 0.05, 1e-6);
  contract::CameraCheck how;
  how.frames = 15;
  how.may_drop = false;
  how.content = [](const Frame& frame) -> std::string {  // JPEG keeps an even gray to a few counts
    return std::abs(first_pixel(frame) - 10 * static_cast<int>(frame.number)) <= 4
               ? ""
               : "another image";
  };
  EXPECT_EQ(contract::check(*camera, *clock, how), Findings{});
  EXPECT_EQ(kind_of([&] {
              for (int i = 0; i < 20; ++i) camera->grab(1s);
            }),
            DeviceErrorKind::lost);
  video.source = "/no/such/video.avi";
  EXPECT_EQ(kind_of([&] { opencv_camera::open(video, *clock); }), DeviceErrorKind::not_found);
  std::ofstream(folder.file("text.avi")) << "no video";
  video.source = folder.file("text.avi");
  EXPECT_EQ(kind_of([&] { opencv_camera::open(video, *clock); }), DeviceErrorKind::not_found);
}

/// Keeps the contract but for one fault.
struct FaultyCamera final : Camera {
  enum Fault {
    none,
    colored,  // this and the one before are no faults
    nameless,
    deep,
    turns_colored,
    stands_still,
    counts_back,
    from_the_future,
    same_memory,
    never_late,
    frozen
  };
  FaultyCamera(Clock& its_clock, Fault its_fault) : clock(its_clock), fault(its_fault) {
    camera_info = {fault == nameless ? "" : "faulty", 64, 48, 0.1, 1e-6};
  }
  const CameraInfo& info() const override { return camera_info; }
  Frame grab(Time timeout) override {
    if (fault != never_late && timeout < 100ms) {
      clock.sleep_for(timeout);
      throw DeviceError(DeviceErrorKind::timeout, "faulty", "late");
    }
    clock.sleep_for(100ms);
    ++number;
    cv::Mat image = shade(fault == frozen ? 1 : static_cast<int>(number % 200));
    if (fault == colored || (fault == turns_colored && number > 3))
      cv::merge(std::vector<cv::Mat>(3, image), image);
    if (fault == deep) image.convertTo(image, CV_16U);
    if (fault == same_memory) {
      image.copyTo(memory);
      image = memory;
    }
    return {image, fault == counts_back ? 1000 - number : number,
            fault == stands_still ? Time(1) : clock.now() - 1ms,
            fault == from_the_future ? clock.now() + 1h : clock.now()};
  }
  Clock& clock;
  Fault fault;
  CameraInfo camera_info;
  cv::Mat memory;
  std::uint64_t number = 0;
};

TEST(CameraContract, NoticesACameraThatBreaksIt) {
  for (int fault = FaultyCamera::none; fault <= FaultyCamera::frozen; ++fault) {
    const auto clock = virtual_clock();
    FaultyCamera camera(*clock, static_cast<FaultyCamera::Fault>(fault));
    EXPECT_EQ(contract::check(camera, *clock).empty(), fault <= FaultyCamera::colored) << fault;
  }
}

/// tests/devices/firewire has the rest.
TEST(Iidc, ChecksItsSettingsAndFindsNoCameraWithoutABus) {
  const auto clock = wall_clock();
  const auto bad = [&](iidc::Settings wrong) {
    EXPECT_THROW(iidc::open(wrong, *clock), std::invalid_argument);
  };
  bad({.name = ""});
  bad({.guid = "123"});
  bad({.guid = "000000000000000g"});
  bad({.width_px = 0});
  bad({.frame_rate = 0});
  bad({.exposure = -1});
  bad({.shutter_unit = -1});
  try {
    iidc::open({.guid = "00b09d0100a8f3d1"}, *clock);
    ADD_FAILURE() << "there is a camera";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found) << error.what();
    EXPECT_EQ(error.device, "camera");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
