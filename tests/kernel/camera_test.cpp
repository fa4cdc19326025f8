// Camera of the system: our driver on V4L2, before the kernel's own test camera (vivid).
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/opencv_camera/driver.h"
#include "devices/time/error.h"
#include "tests/kernel/guest.h"

#include <gtest/gtest.h>

#include <fcntl.h>
#include <linux/videodev2.h>
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

}  // namespace
}  // namespace vitreo::kernel_guest
