// SPDX-License-Identifier: Apache-2.0
#include "host/emulate.h"

#include "devices/error.h"
#include "devices/foot_pedal/emulator.h"
#include "devices/genicam/camera_server.h"
#include "devices/spacemouse/emulator.h"
#include "devices/testbed/usb_testbed.h"
#include "host/rig_settings.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <cerrno>
#include <cstring>
#include <iostream>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {
namespace {

std::string text_at(const ConfigTable& table, const std::string& key) {
  const auto found = table.find(key);
  const auto* const text = found == table.end() ? nullptr : std::get_if<std::string>(&found->second.value);
  return text == nullptr ? "" : *text;
}

/// Everything that is emulated, in the order of birth.
class Emulation {
 public:
  explicit Emulation(const RigDescription& description)
      : reader_(description), settings_(read_rig_settings(reader_)), laboratory_(settings_.laboratory, *clock_, 1) {
    for (const auto& [role, value] : description.table)
      if (const auto* const table = std::get_if<ConfigTable>(&value.value))
        offer(role, text_at(*table, "driver"), text_at(*table, "address"));
  }

 private:
  void offer(const std::string& role, const std::string& driver, const std::string& address) {
    if (address.empty() || address == "emulated") return;
    const bool hid = address.rfind("hid:", 0) == 0;
    if (hid || address.rfind("usb:", 0) == 0)
      plug(role, driver, parse_usb_address(hid ? "hid" : "usb", address));
    else if (address == "genicam:127.0.0.1")
      serve(role);
    else
      return say(role, address + " is not emulated here");
    say(role, address + " is emulated");
  }
  static void say(const std::string& role, const std::string& what) { std::cerr << role << ": " << what << "\n"; }

  void plug(const std::string& role, const std::string& driver, const UsbAddress& address) {
    if (!testbed_) testbed_ = make_usb_testbed();
    UsbIdentity identity{address.vendor, address.product,      0x0100, address.serial.empty() ? "1" : address.serial,
                         "Vitreo",       "emulated " + driver, ""};
    if (driver == "usb3103")
      testbed_->plug(laboratory_.coil_outputs(), identity);
    else if (driver == "pololu_tic")
      testbed_->plug(laboratory_.lens_motor());
    else if (driver == "spacemouse")
      testbed_->plug(mouse_, identity, 0x01, 0x08);
    else if (driver == "foot_pedal")
      testbed_->plug(pedal_, identity);
    else
      throw ConfigError(role + ": there is no emulator for the driver '" + driver + "' on USB");
  }

  void serve(const std::string&) {
    genicam::ServerSettings settings;
    settings.width_px = settings_.laboratory.top.size.width;
    settings.height_px = settings_.laboratory.top.size.height;
    const auto draw = [this](const genicam::Exposure& exposure, cv::Mat& image) {
      cv::Mat eye;
      const auto look = [&] { eye = laboratory_.top_image(clock_->now(), exposure.number); };
      if (testbed_)
        testbed_->with_emulators(look);
      else
        look();
      cv::resize(eye, image, image.size());  // where the client asked for another size
    };
    camera_ = genicam::serve_camera(settings, draw);
  }

  std::unique_ptr<Clock> clock_ = wall_clock();
  ConfigReader reader_;
  RigSettings settings_;
  sim::Laboratory laboratory_;
  spacemouse::Emulator mouse_;
  foot_pedal::Emulator pedal_;
  std::unique_ptr<UsbTestbed> testbed_;
  std::unique_ptr<genicam::CameraServer> camera_;
};

int run(const std::vector<std::string>& command) {
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  pid_t child = 0;
  if (const int error = posix_spawnp(&child, words[0], nullptr, nullptr, words.data(), environ); error != 0)
    throw std::runtime_error(command.front() + ": " + std::strerror(error));
  // The terminal's Ctrl-C reaches the command too: it decides, and the instruments outlive it.
  struct sigaction ignore {
  }, before{};
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGINT, &ignore, &before);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  sigaction(SIGINT, &before, nullptr);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

}  // namespace

int emulate(const RigDescription& description, const std::vector<std::string>& command) {
  const Emulation emulation(description);
  if (!command.empty()) return run(command);
  std::cerr << "press Ctrl-D to end\n";
  for (std::string line; std::getline(std::cin, line);) {
  }
  return 0;
}

void restart_in_testbed(char** words) {
  if (why_no_usb_testbed().empty()) return;
  if (std::getenv("VITREO_IN_TESTBED") != nullptr) return;  // it did not help
  setenv("VITREO_IN_TESTBED", "1", 1);
  char self[4096];
  const ssize_t length = readlink("/proc/self/exe", self, sizeof self - 1);
  if (length <= 0) return;
  self[length] = '\0';
  std::vector<char*> all{const_cast<char*>("umockdev-wrapper"), self};
  for (char** word = words + 1; *word != nullptr; ++word) all.push_back(*word);
  all.push_back(nullptr);
  execvp(all[0], all.data());
}

}  // namespace vitreo
