// Figures of the instruments' links: the cost of an update of eight coils through driver and kernel
// interface, and the rate of the GigE Vision path. Start it under umockdev-wrapper; the first
// argument is seconds a stream (60).
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/camera_server.h"
#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/usb3103/driver.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/links/usb_link.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

namespace vitreo {
namespace {

void print_latency(const char* path, CoilAmplifier& coils, const Clock& clock) {
  constexpr int kUpdates = 1000;
  std::vector<double> times;
  for (int i = 0; i < kUpdates; ++i) {
    const Time start = clock.now();
    coils.set_currents(std::vector<double>(8, i % 2 == 0 ? 1. : -1.));
    times.push_back(to_seconds(clock.now() - start) * 1e3);
  }
  coils.make_safe();
  std::sort(times.begin(), times.end());
  std::printf("update of 8 coils, %-24s median %.2f ms, 99th percentile %.2f ms, most %.2f ms\n",
              path, times[kUpdates / 2], times[kUpdates * 99 / 100], times.back());
}

void measure_coils() {
  const auto clock = wall_clock();
  const auto emulator = usb3103::make_emulator({}, nullptr);
  print_latency("link in memory:",
                *usb3103::open(memory_hid_link(*emulator, *clock, Time(0)), {}, *clock), *clock);
  if (const std::string why = why_no_usb_testbed(); !why.empty()) {
    std::printf("update of 8 coils, hidapi and umockdev: not measured, %s\n", why.c_str());
    return;
  }
  const auto testbed = make_usb_testbed();
  const int plug = testbed->plug(*emulator, {0x09DB, 0x009C, 0x0100, "1", "MCC", "USB-3103", ""});
  print_latency("hidapi and umockdev:",
                *usb3103::open(open_hid_link({0x09DB, 0x009C, ""}, *clock), {}, *clock), *clock);
  testbed->unplug(plug);
}

/// How long it takes until the link says so, when the device is pulled out while a caller waits for
/// it.
void print_unplug(const char* path, const Clock& clock, const std::function<void()>& pull,
                  const std::function<void()>& use) {
  const Time start = clock.now();
  std::thread hand(pull);
  try {
    while (clock.now() - start < std::chrono::seconds(10)) use();
  } catch (const DeviceError& error) {
    std::printf("unplugged %-35s \"%s\" after %.1f ms\n", path, to_string(error.kind),
                to_seconds(clock.now() - start) * 1e3);
  }
  hand.join();
}

void measure_unplugs() {
  if (!why_no_usb_testbed().empty()) return;
  const auto clock = wall_clock();
  const auto outputs = usb3103::make_emulator({}, nullptr);
  const auto motor = pololu_tic::make_emulator({}, *clock);
  const auto testbed = make_usb_testbed();
  const int hid = testbed->plug(*outputs, {0x09DB, 0x009C, 0x0100, "1", "MCC", "USB-3103", ""});
  const int usb = testbed->plug(*motor);
  const auto reports = open_hid_link({0x09DB, 0x009C, ""}, *clock);
  print_unplug(
      "inside a HID read:", *clock, [&] { testbed->unplug(hid); },
      [&] { reports->read(std::chrono::seconds(10)); });
  const auto transfers = open_usb_link({0x1FFB, 0x00B3, ""}, *clock);
  testbed->set_fault(usb, UsbFault::silent);
  print_unplug(
      "inside a USB transfer:", *clock, [&] { testbed->unplug(usb); },
      [&] {
        transfers->read({0xC0, 0xA1, 0, 0}, 4, std::chrono::seconds(10));
      });
}

/// Rows that carry the exposure's number: an image of two exposures shows.
void draw(const genicam::Exposure& exposure, cv::Mat& image) {
  image.setTo(static_cast<double>(exposure.number % 200));
  image.col(0).setTo(static_cast<double>(exposure.number & 0xFFU));
  image.at<unsigned char>(0, 1) = static_cast<unsigned char>(exposure.number % 200);
}
bool corrupt(const cv::Mat& image) {
  const cv::Mat body = image.colRange(1, image.cols);
  double least = 0, most = 0;
  cv::minMaxLoc(body, &least, &most);
  double first = 0, last = 0;
  cv::minMaxLoc(image.col(0), &first, &last);
  return least != most || first != last;
}

void measure_stream(int width, int height, double rate, double seconds) {
  const auto clock = wall_clock();
  genicam::ServerSettings served;
  served.width_px = width;
  served.height_px = height;
  auto server = genicam::serve_camera(served, draw);
  genicam::Settings settings;
  settings.camera = "127.0.0.1";
  settings.width_px = width;
  settings.height_px = height;
  settings.frame_rate = rate;
  settings.packet_size = 8000;
  const auto camera = genicam::open(settings, *clock);
  const std::clock_t cpu = std::clock();
  const Time start = clock->now(), end = start + from_seconds(seconds);
  int grabbed = 0, bad = 0;
  double latency = 0;
  while (clock->now() < end) {
    const Frame frame = camera->grab(std::chrono::seconds(2));
    ++grabbed;
    bad += corrupt(frame.image);
    latency += to_seconds(frame.received - frame.exposed) - settings.exposure / 2;
  }
  const CameraStatistics s = camera->statistics();
  const double host_cpu = 100. * static_cast<double>(std::clock() - cpu) / CLOCKS_PER_SEC / seconds;
  std::printf(
      "GigE %4d x %4d asked %2.0f Hz for %.0f s: grabbed %.1f Hz, corrupt %d, delivered %llu, lost "
      "%llu, torn %llu, "
      "from the first packet to the host %.1f ms, CPU of camera and host %.0f %%\n",
      width, height, rate, seconds, grabbed / seconds, bad,
      static_cast<unsigned long long>(s.delivered), static_cast<unsigned long long>(s.lost),
      static_cast<unsigned long long>(s.torn), 1e3 * latency / grabbed, host_cpu);
  server.reset();
  print_unplug(
      "from the network (GigE camera):", *clock, [] {},
      [&] { camera->grab(std::chrono::seconds(10)); });
}

}  // namespace
}  // namespace vitreo

int main(int count, char** words) {
  const double seconds = count > 1 ? std::atof(words[1]) : 60;
  try {
    vitreo::measure_coils();
    vitreo::measure_unplugs();
    vitreo::measure_stream(640, 480, 60, seconds);
    vitreo::measure_stream(1280, 1024, 30, seconds);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
  return 0;
}
