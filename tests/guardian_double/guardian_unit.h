// Bench of the tests of the guardian's host side: the double of the guardian's process, its record,
// and an amplifier that looks at that.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/error.h"
#include "host/safety/guardian.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <signal.h>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {

using namespace std::chrono_literals;
using Steady = std::chrono::steady_clock;
using Currents = std::vector<double>;

struct Heard {
  double time = 0;  // s
  std::string text;
};

struct GuardianUnit : testing::Test {
  void SetUp() override {
    std::string name = (std::filesystem::temp_directory_path() / "guardian_XXXXXX").string();
    folder = mkdtemp(name.data());
    setenv("VITREO_GUARDIAN_HEARD", (folder / "heard").c_str(), 1);
    mode("ready");
  }
  void TearDown() override { std::filesystem::remove_all(folder); }
  static void mode(const char* word) { setenv("VITREO_GUARDIAN_MODE", word, 1); }
  std::unique_ptr<Guardian> make() {
    return std::make_unique<Guardian>(outputs, [this] { return healthy.load(); });
  }
  std::vector<Heard> heard() const {
    std::vector<Heard> all;
    std::ifstream file(folder / "heard");
    Heard one;
    while (file >> one.time && file.get() && std::getline(file, one.text)) all.push_back(one);
    return all;
  }
  std::size_t count(const std::string& text) const {
    const auto all = heard();
    return static_cast<std::size_t>(
        std::count_if(all.begin(), all.end(), [&](const Heard& one) { return one.text == text; }));
  }
  /// The messages in their order, without heartbeats.
  std::string order() const {
    std::string text;
    for (const Heard& one : heard())
      if (one.text.size() == 1 && one.text != "b") text += one.text;
    return text;
  }
  bool hears(const std::string& text, std::size_t times = 1, std::chrono::seconds most = 5s) const {
    for (const auto until = Steady::now() + most; Steady::now() < until;) {
      if (count(text) >= times) return true;
      std::this_thread::sleep_for(1ms);
    }
    return false;
  }
  static bool is_there(pid_t process) { return ::kill(process, 0) == 0; }

  std::filesystem::path folder;
  std::atomic<bool> healthy{true};
  std::vector<guardian::Output> outputs{
      {.driver = "usb3103", .address = "hid:09db:009c", .settings = {{"enable_line", 3}}},
      {.driver = "kepco_bop", .address = "serial:/dev/a, serial:/dev/b"}};
};

/// Looks, at each set-point, at what the guardian has heard by then.
class AskingCoils : public CoilAmplifier {
 public:
  explicit AskingCoils(GuardianUnit& test) : test_(test) {}
  std::string identity() const override { return "asking"; }
  int channels() const override { return 3; }
  double current_limit() const override { return 7; }
  void set_currents(std::span<const double> currents) override {
    now.assign(currents.begin(), currents.end());
    look();
    if (gone) throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
  }
  Currents currents() const override { return now; }
  std::optional<Currents> measured_currents() override { return Currents{1, 2, 3}; }
  LinkState link_state() const override {
    LinkState state;
    state.owed = 5ms;
    return state;
  }
  void make_safe() override {
    look();
    if (gone) throw DeviceError(DeviceErrorKind::lost, "coils", "is gone");
    ++made_safe;
  }
  Currents now;
  bool gone = false;
  int made_safe = 0;
  std::string by_then;

 private:
  // What has been sent is heard within this.
  void look() {
    std::this_thread::sleep_for(100ms);
    by_then = test_.order();
  }
  GuardianUnit& test_;
};

}  // namespace vitreo
