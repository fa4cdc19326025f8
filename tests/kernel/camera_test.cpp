// Camera of the system: our driver on V4L2, before the kernel's own test camera (vivid), and on
// the kernel's uvcvideo, before a camera of the USB video class by another hand.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/opencv_camera/driver.h"
#include "devices/time/error.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <cmath>
#include <fcntl.h>
#include <filesystem>
#include <linux/videodev2.h>
#include <set>
#include <sys/ioctl.h>
#include <unistd.h>

namespace vitreo::kernel_guest {
namespace {

constexpr const char* kNode = "/dev/video0";

/// Sets vivid's control of that name, as `v4l2-ctl --set-ctrl` does.
void control(const std::string& name, int value) {
  const int node = ::open(kNode, O_RDWR | O_CLOEXEC);
  v4l2_queryctrl asked{};
  asked.id = V4L2_CTRL_FLAG_NEXT_CTRL;
  for (; ::ioctl(node, VIDIOC_QUERYCTRL, &asked) == 0; asked.id |= V4L2_CTRL_FLAG_NEXT_CTRL) {
    if (name != reinterpret_cast<const char*>(asked.name)) continue;
    v4l2_control set{asked.id, value};
    EXPECT_EQ(::ioctl(node, VIDIOC_S_CTRL, &set), 0) << name;
    ::close(node);
    return;
  }
  ::close(node);
  FAIL() << "vivid has no control " << name;
}

class CameraGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    load({"vivid n_devs=1 input_types=0x0 node_types=0x1"});
    wait_for_node(kNode);
  }
  std::unique_ptr<Camera> open() {
    opencv_camera::Settings settings;
    settings.source = kNode;
    settings.width_px = 320;
    settings.height_px = 180;
    return opencv_camera::open(settings, *clock);
  }
  const std::unique_ptr<Clock> clock = wall_clock();
};

TEST_F(CameraGuest, DeliversFramesInOrderAndIsLostWhenItIsUnplugged) {
  auto camera = open();
  std::uint64_t last = 0;
  Time begin{};
  for (int i = 0; i < 20; ++i) {
    const Frame frame = camera->grab(from_seconds(2));
    ASSERT_EQ(frame.image.cols, 320);
    ASSERT_EQ(frame.image.rows, 180);
    if (i == 0) begin = frame.received;
    EXPECT_TRUE(i == 0 || frame.number > last);
    last = frame.number;
  }
  const double seconds = to_seconds(clock->now() - begin);
  row("%s: 20 frames in %.2f s, %.1f asked for; %llu lost", camera->info().identity.c_str(),
      seconds, 1 / camera->info().frame_period,
      static_cast<unsigned long long>(camera->statistics().lost));
  control("Disconnect", 1);
  const auto began = Steady::now();
  std::string said;
  while (said.empty() && Steady::now() - began < 5s) try {
      camera->grab(from_seconds(2));
    } catch (const DeviceError& error) {
      said = error.what();
      EXPECT_EQ(error.kind, DeviceErrorKind::lost) << said;
    }
  row("unplugged: \"%s\" after %.0f ms", said.c_str(), Milliseconds(Steady::now() - began).count());
  EXPECT_LT(Steady::now() - began, 1s);
  EXPECT_NE(said.find(kNode), std::string::npos) << said;
  camera.reset();
  camera = open();
  EXPECT_EQ(camera->grab(from_seconds(2)).image.cols, 320);
}

TEST_F(CameraGuest, CountsTheFramesThatTheCameraDrops) {
  const auto camera = open();
  for (int i = 0; i < 5; ++i) camera->grab(from_seconds(2));
  control("Percentage of Dropped Buffers", 50);
  for (int i = 0; i < 20; ++i) camera->grab(from_seconds(2));
  control("Percentage of Dropped Buffers", 0);
  row("half of the frames dropped: %llu counted as lost beside %llu",
      static_cast<unsigned long long>(camera->statistics().lost),
      static_cast<unsigned long long>(camera->statistics().delivered));
  EXPECT_GT(camera->statistics().lost, 3U);
}

/// Its pictures' gray grows with the exposure that it really has.
class UvcGuest : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { load({"vhci-hcd", "uvcvideo"}); }
  void SetUp() override {
    std::set<std::string> before = nodes();
    camera_ = std::make_unique<Gadget>(std::vector<std::string>{"usbip", "uvc_camera"});
    time_until(20s, [&] {
      for (const std::string& node : nodes())
        if (!before.contains(node) && captures(node)) node_ = node;
      return !node_.empty();
    });
    ASSERT_FALSE(node_.empty()) << "no camera within 20 s";
  }
  static std::set<std::string> nodes() {
    std::set<std::string> found;
    for (const auto& entry : std::filesystem::directory_iterator("/dev"))
      if (entry.path().filename().string().starts_with("video")) found.insert(entry.path());
    return found;
  }
  /// uvcvideo makes a second node for what accompanies the images.
  static bool captures(const std::string& node) {
    const int open = ::open(node.c_str(), O_RDWR | O_CLOEXEC);
    v4l2_capability can{};
    const bool told = ::ioctl(open, VIDIOC_QUERYCAP, &can) == 0;
    ::close(open);
    return told && (can.device_caps & V4L2_CAP_VIDEO_CAPTURE) != 0;
  }
  opencv_camera::Settings settings() const {
    opencv_camera::Settings wanted;
    wanted.source = node_;
    return wanted;
  }
  int has(const std::string& name) { return camera_->state(name).get<int>(); }
  double gray(Camera& camera) {
    Frame frame;
    for (int i = 0; i < 6; ++i) frame = camera.grab(from_seconds(2));  // those on their way first
    return cv::mean(frame.image)[0];
  }
  std::string refusal(const opencv_camera::Settings& wanted) {
    try {
      opencv_camera::open(wanted, *clock);
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused) << error.what();
      return error.what();
    }
    return "taken";
  }
  const std::unique_ptr<Clock> clock = wall_clock();
  std::unique_ptr<Gadget> camera_;
  std::string node_;
};

TEST_F(UvcGuest, ExposesForAsLongAsItIsToldAndHasNoAutomaticsThen) {
  EXPECT_EQ(has("ae_mode"), 8) << "as it comes: aperture priority";
  std::vector<double> grays;
  for (const double exposure : {5e-3, 10e-3, 20e-3}) {
    opencv_camera::Settings wanted = settings();
    wanted.exposure = exposure;
    wanted.gain = 20;
    const auto camera = opencv_camera::open(wanted, *clock);
    EXPECT_EQ(has("exposure"), static_cast<int>(exposure * 1e4 + 0.5));
    EXPECT_EQ(has("ae_mode"), 1);
    EXPECT_EQ(has("ae_priority"), 0) << "the rate would give way to the exposure";
    EXPECT_EQ(has("gain"), 20);
    EXPECT_EQ(has("white_balance_auto"), 0);
    EXPECT_EQ(has("focus_auto"), 0);
    grays.push_back(gray(*camera));
    bool recorded = false;
    for (const auto& [name, value] : camera->info().settings)
      recorded = recorded || (name == "exposure" && std::abs(std::stod(value) - exposure) < 1e-6);
    EXPECT_TRUE(recorded) << "the record says what was read back";
  }
  row("UVC: exposures of 5, 10, 20 ms at gain 20 give grays of %.0f, %.0f, %.0f", grays[0],
      grays[1], grays[2]);
  EXPECT_NEAR((grays[2] - grays[1]) / (grays[1] - grays[0]), 2, 0.2) << "in proportion";
}

TEST_F(UvcGuest, WithoutSettingsIsLeftAsItWas) {
  const auto camera = opencv_camera::open(settings(), *clock);
  gray(*camera);
  EXPECT_EQ(has("ae_mode"), 8);
  EXPECT_EQ(has("white_balance_auto"), 1);
}

TEST_F(UvcGuest, WhatItCannotDoIsRefusedByName) {
  opencv_camera::Settings wanted = settings();
  wanted.exposure = 0.5;  // its longest is 0.2047 s
  std::string said = refusal(wanted);
  row("%s", said.c_str());
  EXPECT_NE(said.find("exposure: "), std::string::npos) << said;
  wanted.exposure = 0;
  wanted.gain = 500;
  said = refusal(wanted);
  row("%s", said.c_str());
  EXPECT_NE(said.find("gain: "), std::string::npos) << said;
}

TEST_F(UvcGuest, IsLostWithItsCable) {
  const auto camera = opencv_camera::open(settings(), *clock);
  gray(*camera);
  camera_->unplug();
  const auto began = Steady::now();
  std::string said;
  while (said.empty() && Steady::now() - began < 5s) try {
      camera->grab(from_seconds(2));
    } catch (const DeviceError& error) {
      said = error.what();
      EXPECT_EQ(error.kind, DeviceErrorKind::lost) << said;
    }
  row("cable out: \"%s\" after %.0f ms", said.c_str(), Milliseconds(Steady::now() - began).count());
  EXPECT_LT(Steady::now() - began, 1s);
}

}  // namespace
}  // namespace vitreo::kernel_guest
