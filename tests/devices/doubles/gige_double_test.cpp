// The GenICam driver against a GigE Vision camera by another hand: real packets, a clock of the
// camera's own, an exposure that is known.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"
#include "devices/instruments/genicam/driver.h"
#include "devices/time/error.h"
#include "tests/devices/doubles/double_process.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fcntl.h>
#include <functional>
#include <map>
#include <sys/file.h>
#include <unistd.h>

namespace vitreo::genicam {
namespace {

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

}  // namespace
}  // namespace vitreo::genicam
