// The GenICam driver against a GigE Vision camera on 127.0.0.1: real packets, real time, so these
// tests wait for real.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/instruments/genicam/camera_server.h"
#include "devices/instruments/genicam/driver.h"
#include "devices/roles/reopening.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <atomic>
#include <fcntl.h>
#include <fstream>
#include <functional>
#include <stdexcept>
#include <sys/file.h>
#include <sys/socket.h>
#include <unistd.h>

namespace vitreo::genicam {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;

/// The number of the exposure in the first four pixels, and in every row's last pixel its low byte:
/// a torn image shows.
void draw(const Exposure& exposure, cv::Mat& image) {
  const auto number = static_cast<std::uint32_t>(exposure.number);
  image.setTo(number % 200);
  image.col(image.cols - 1).setTo(number & 0xFFU);
  for (int i = 0; i < 4; ++i)
    image.at<unsigned char>(0, i) = static_cast<unsigned char>(number >> 8 * i);
}
std::string wrong_with(const cv::Mat& image) {
  std::uint32_t number = 0;
  for (int i = 0; i < 4; ++i) number |= std::uint32_t{image.at<unsigned char>(0, i)} << 8 * i;
  for (int v = 1; v < image.rows; ++v)
    if (image.at<unsigned char>(v, image.cols - 1) != (number & 0xFFU) ||
        image.at<unsigned char>(v, 0) != number % 200)
      return "rows of different exposures";
  return "";
}

struct GigeCamera : ::testing::Test {
  // The port is fixed and tests run side by side: one at a time.
  GigeCamera() : lock(::open("/tmp/vitreo_gige_test.lock", O_CREAT | O_RDWR | O_CLOEXEC, 0666)) {
    flock(lock, LOCK_EX);
  }
  ~GigeCamera() override { ::close(lock); }
  Settings camera_settings() const {
    Settings settings;
    settings.camera = "127.0.0.1";
    settings.width_px = 320;
    settings.height_px = 240;
    settings.frame_rate = 50;
    return settings;
  }
  DeviceErrorKind kind_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "camera");
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::protocol;
  }
  int lock;
  std::unique_ptr<Clock> clock = wall_clock();
};

TEST_F(GigeCamera, KeepsTheContractOfACamera) {
  const auto server = serve_camera({}, draw);
  const auto camera = open(camera_settings(), *clock);
  EXPECT_NE(camera->info().identity.find("VITREO01"), std::string::npos) << camera->info().identity;
  contract::CameraCheck how;
  how.content = [](const Frame& frame) { return wrong_with(frame.image); };
  // On a machine that is busy with other tests the server itself may be silent for half a second:
  // asked again where it exposed less often than it should have, by its own count.
  Findings found;
  for (int again = 0; again < 4; ++again) {
    const Time began = clock->now();
    const std::uint64_t before = server->exposures();
    found = contract::check(*camera, *clock, how);
    const auto exposed = static_cast<double>(server->exposures() - before);
    const double due = to_seconds(clock->now() - began) * camera_settings().frame_rate;
    if (found.empty() || exposed > due - 15) break;
  }
  EXPECT_EQ(found, Findings{});
  EXPECT_GT(server->exposures(), 12U);
}

TEST_F(GigeCamera, CountsFramesThatLostAPacketAndDeliversNoneOfThem) {
  ServerSettings lossy;
  lossy.lost_packets = 0.01;  // an image has 56 packets: about four in ten are torn
  const auto server = serve_camera(lossy, draw);
  const auto camera = open(camera_settings(), *clock);
  for (int i = 0; i < 15; ++i) EXPECT_EQ(wrong_with(camera->grab(5s).image), "");
  const CameraStatistics statistics = camera->statistics();
  EXPECT_GE(statistics.delivered, 15U);
  EXPECT_GT(statistics.torn + statistics.lost, 0U);
}

TEST_F(GigeCamera, IsLostWhenItIsKilledAndOpensAgainWhenItIsBack) {
  auto server = serve_camera({}, draw);
  const auto camera =
      reopening([this] { return open(camera_settings(), *clock); }, {.name = "camera"}, *clock);
  const std::uint64_t before = camera->grab(5s).number;
  server.reset();
  const Time start = clock->now();
  EXPECT_EQ(kind_of([&] {
              for (;;) camera->grab(5s);
            }),
            DeviceErrorKind::lost);
  EXPECT_LT(clock->now() - start,
            4s);  // of the five that a grab may take; the figure of 0.5 s is the bench's
  server = serve_camera({}, draw);
  const Frame back = camera->grab(5s);
  EXPECT_EQ(wrong_with(back.image), "");
  EXPECT_GT(back.number, before);
}

/// Numbers of the exposures in `count` frames.
std::vector<std::uint32_t> numbers_of(Camera& camera, int count) {
  std::vector<std::uint32_t> numbers;
  for (int i = 0; i < count; ++i) {
    const Frame frame = camera.grab(5s);
    EXPECT_EQ(wrong_with(frame.image), "");
    std::uint32_t number = 0;
    for (int k = 0; k < 4; ++k)
      number |= std::uint32_t{frame.image.at<unsigned char>(0, k)} << 8 * k;
    numbers.push_back(number);
  }
  return numbers;
}

TEST_F(GigeCamera, OfAServerThatDropsImagesMissesJustThese) {
  const auto server = serve_camera({}, draw);
  server->set_faults({.drops = 3});
  const auto camera = open(camera_settings(), *clock);
  for (const std::uint32_t number : numbers_of(*camera, 10)) EXPECT_NE(number % 3, 0U);
}

TEST_F(GigeCamera, OfAServerThatIsFrozenSeesTheSameImageAgain) {
  const auto server = serve_camera({}, draw);
  const auto camera = open(camera_settings(), *clock);
  camera->grab(5s);
  server->set_faults({.frozen = true});
  numbers_of(*camera, 2);  // what was under way
  const auto numbers = numbers_of(*camera, 3);
  EXPECT_EQ(numbers.front(), numbers.back());
  server->set_faults({});
  numbers_of(*camera, 2);
  EXPECT_GT(numbers_of(*camera, 1).front(), numbers.back());
}

TEST_F(GigeCamera, OfAServerThatIsLateIsDrawnAsItWasThenAndTheCamerasClockSaysSo) {
  std::atomic<double> age{0};
  const auto server = serve_camera({}, [&age](const Exposure& exposure, cv::Mat& image) {
    age = exposure.age;
    draw(exposure, image);
  });
  const auto camera = open(camera_settings(), *clock);
  const auto delay = [&] {  // of the arrival on the host's clock after the exposure on the camera's
    double least = 1e9;
    for (int i = 0; i < 10; ++i) {
      const Frame frame = camera->grab(5s);
      least = std::min(least, to_seconds(frame.received - *frame.device));
    }
    return least;
  };
  const double before = delay();
  server->set_faults({.late = 0.3});
  camera->grab(5s);
  // of ten frames the least is free of the scheduler's delays, to a few ms
  EXPECT_NEAR(delay() - before, 0.3, 0.02);
  EXPECT_EQ(age, 0.3);
}

TEST_F(GigeCamera, OfAServerThatHangsIsLost) {
  const auto server = serve_camera({}, draw);
  const auto camera = open(camera_settings(), *clock);
  camera->grab(5s);
  server->set_faults({.silent = true});
  EXPECT_EQ(kind_of([&] {
              for (;;) camera->grab(5s);
            }),
            DeviceErrorKind::lost);
}

/// The receive buffers of this process' datagram sockets, in bytes; -1 for a packet socket, whose
/// ring needs none.
std::vector<int> receive_buffers() {
  std::vector<int> found;
  for (int handle = 0; handle < 256; ++handle) {
    int domain = 0, type = 0, bytes = 0;
    socklen_t size = sizeof(int);
    if (getsockopt(handle, SOL_SOCKET, SO_DOMAIN, &domain, &size) != 0) continue;
    getsockopt(handle, SOL_SOCKET, SO_TYPE, &type, &size);
    getsockopt(handle, SOL_SOCKET, SO_RCVBUF, &bytes, &size);
    if (domain == AF_PACKET) found.push_back(-1);
    if (domain == AF_INET && type == SOCK_DGRAM) found.push_back(bytes);
  }
  return found;
}

TEST_F(GigeCamera, DoesNotRelyOnTheKernelsOwnSocketBuffer) {
  const auto server = serve_camera({}, draw);
  const auto camera = open(camera_settings(), *clock);
  camera->grab(5s);
  int allowed = 0;
  std::ifstream("/proc/sys/net/core/rmem_max") >> allowed;
  const std::vector<int> buffers = receive_buffers();
  const int wanted = std::min(camera_settings().socket_buffer, allowed);
  EXPECT_TRUE(std::any_of(buffers.begin(), buffers.end(),
                          [&](int bytes) { return bytes == -1 || bytes >= wanted; }));
}

TEST_F(GigeCamera, StoppingACameraThatIsGoneHoldsNobodyElseUp) {
  auto server = serve_camera({}, draw);
  auto camera = open(camera_settings(), *clock);
  camera->grab(5s);
  server.reset();
  bool ended = false;
  Time longest{}, last = clock->now();
  int ticks = 0;
  const auto loop = clock->spawn("loop", [&] {
    while (!ended) {
      clock->sleep_for(5ms);
      longest = std::max(longest, clock->now() - last);
      last = clock->now();
      ++ticks;
    }
  });
  const Time start = clock->now();
  camera.reset();
  const Time took = clock->now() - start;
  ended = true;
  loop->join();
  if (took < 1s) GTEST_SKIP() << "the camera was stopped at once";
  EXPECT_GT(ticks, 20);
  EXPECT_LT(longest, took / 2);
}

TEST_F(GigeCamera, IsNotThereWithoutAServer) {
  Settings nobody = camera_settings();
  EXPECT_EQ(kind_of([&] { open(nobody, *clock); }), DeviceErrorKind::not_found);
}

TEST_F(GigeCamera, RefusesASizeThatTheCameraHasNot) {
  const auto server = serve_camera({}, draw);
  Settings large = camera_settings();
  large.width_px = 5000;
  EXPECT_EQ(kind_of([&] { open(large, *clock); }), DeviceErrorKind::refused);
}

TEST(GenicamSettings, AreCheckedByName) {
  const auto complaint = [](Settings settings) -> std::string {
    try {
      settings.check();
    } catch (const std::invalid_argument& error) {
      return std::string(error.what()).substr(0, std::string(error.what()).find(':'));
    }
    return "";
  };
  EXPECT_EQ(complaint({}), "");
  EXPECT_EQ(complaint({.width_px = 0}), "width_px");
  EXPECT_EQ(complaint({.frame_rate = 0}), "frame_rate");
  EXPECT_EQ(complaint({.exposure = -1}), "exposure");
  EXPECT_EQ(complaint({.packet_size = 100}), "packet_size");
  EXPECT_EQ(complaint({.socket_buffer = 0}), "socket_buffer");
  EXPECT_THROW(ServerSettings{.lost_packets = 2}.check(), std::invalid_argument);
  EXPECT_THROW(ServerFaults{.late = 2}.check(), std::invalid_argument);
  EXPECT_THROW(ServerFaults{.drops = -1}.check(), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::genicam
