// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulate.h"

#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/genicam/camera_server.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/links/peer_end.h"
#include "devices/links/serial_line.h"
#include "devices/links/usb_frames.h"
#include "devices/testbed/usb_testbed.h"
#include "devices/time/error.h"
#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/rig/rig_settings.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include <atomic>
#include <cerrno>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <filesystem>
#include <iostream>
#include <mutex>
#include <signal.h>
#include <spawn.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace {

// Period at which idle wires are looked at: below the time of one character at 19 200 baud (521
// us).
constexpr Time kPump = std::chrono::microseconds(500);
// A byte that is due at once is not waited for without a pause.
constexpr Time kLeastPause = std::chrono::microseconds(50);
constexpr const char* kLocal = "tcp:127.0.0.1:";

bool begins(const std::string& text, const std::string& with) { return text.rfind(with, 0) == 0; }

/// A mutex that is given to those who wait for it in the order in which they came.
class Turns {
 public:
  void lock() {
    std::unique_lock lock(mutex_);
    const std::uint64_t mine = next_++;
    changed_.wait(lock, [&] { return serving_ == mine; });
  }
  void unlock() {
    const std::lock_guard lock(mutex_);
    ++serving_;
    changed_.notify_all();
  }

 private:
  std::mutex mutex_;
  std::condition_variable changed_;
  std::uint64_t next_ = 0;
  std::uint64_t serving_ = 0;
};

/// The address of a camera on the loopback, "" for any other.
std::string loopback_camera(const std::string& address) {
  return begins(address, "genicam:127.") ? address.substr(std::strlen("genicam:")) : "";
}

}  // namespace

/// The rig's instruments: its simulated world and, on real wires, what stands at their far ends.
class Emulation::State {
 public:
  State(const RigDescription& description, const EmulationSettings& given)
      : in_place_(given.in_place),
        reader_(description),
        settings_(read_rig_settings(reader_)),
        laboratory_(settings_.laboratory, *clock_, given.seed) {
    for (const auto& [role, value] : description.table)
      if (const auto* const table = std::get_if<ConfigTable>(&value.value))
        offer(role, text_of(*table, "driver"), text_of(*table, "address"));
    transfers_ = quiet_thread([this] { transfer(); });
    exchanges_ = quiet_thread([this] { exchange(); });
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    ended_ = true;
    transfers_.join();
    exchanges_.join();
    cameras_.clear();
  }

  void handle(const nlohmann::json& task) {
    const std::string what = task.value("do", "");
    const auto position = [&task] {
      const auto numbers = task.at("position").get<std::vector<double>>();
      if (numbers.size() != 3) throw std::invalid_argument("position: wants three numbers");
      return Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    };
    with_world([&] {
      SampleHandler& sample = laboratory_.sample();
      if (what == "insert_robot")
        sample.insert_robot(position());
      else if (what == "remove_robot")
        sample.remove_robot();
      else if (what == "place_target")
        sample.place_target(position());
      else if (what == "remove_target")
        sample.remove_target();
      else if (what == "change_vial")
        sample.change_vial(task.at("robot").get<std::string>(), task.at("gel").get<std::string>());
      else
        throw std::invalid_argument("task: '" + what + "' is not known");
    });
  }

  std::optional<sim::Truth> truth() {
    std::optional<sim::Truth> found;
    with_world([&] { found = laboratory_.truth(clock_->now()); });
    return found;
  }

 private:
  // For a command the addresses must be those of the rig file, and what cannot be at that address
  // is said. Without one every instrument that talks bytes gets a new address, an emulated one too.
  void offer(const std::string& role, const std::string& driver, const std::string& address) {
    const bool hid = begins(address, "hid:");
    if (hid || begins(address, "usb:")) {
      if (!in_place_) return say(role, address + " is there only for a command: -- COMMAND");
      plug(role, driver, parse_usb_address(hid ? "hid" : "usb", address));
      return say(role, address);
    }
    if (role == "top_camera" || role == "side_camera") {
      const std::string interface = camera_interface(role, address);
      if (!interface.empty()) return offer_camera(role, interface);
    }
    const bool talks = begins(address, "serial:") || begins(address, "tcp:");
    if (!talks && (in_place_ || !(address.empty() || address == "emulated"))) {
      if (!address.empty() && address != "emulated") say(role, address + " is not emulated here");
      return;
    }
    offer_bytes(role, driver);
  }

  /// In place every address of the rig must be there; else a camera that finds no interface of its
  /// own is left out.
  void offer_camera(const std::string& role, const std::string& interface) {
    try {
      serve(role, interface);
      say(role, "genicam:" + interface);
    } catch (const DeviceError& error) {
      if (in_place_) throw;
      say(role, std::string("not offered: ") + error.what());
    }
  }

  /// Where a camera is served; "" where it is not: recorded images, or another camera's address.
  std::string camera_interface(const std::string& role, const std::string& address) const {
    const std::string given = loopback_camera(address);
    if (!given.empty() || in_place_ || begins(address, "video:") || begins(address, "images:"))
      return given;
    return role == "top_camera" ? "127.0.0.1" : "127.0.0.2";
  }

  /// The far ends that the role's driver asks for, if it is one that talks bytes.
  /// The driver's own opener is asked, with `where.offer` set: it knows its emulator and opens no
  /// instrument. The lambda borrows `role`; it is called before this returns.
  void offer_bytes(const std::string& role, const std::string& driver) {
    RigContext where{*clock_, &laboratory_, places_};
    where.offer = [this, &role](const std::string& address, int baud_rate,
                                std::shared_ptr<BytePeer> peer) {
      const bool tcp = begins(address, "tcp:");
      if (tcp && in_place_ && !begins(address, kLocal))
        return say(role, address + " is not emulated here: only 127.0.0.1 is");
      const int port =
          tcp && begins(address, kLocal) ? std::stoi(address.substr(std::strlen(kLocal))) : 0;
      // A pseudo-terminal knows no baud rate: the line's time is kept at its far end.
      const Time per_byte = baud_rate > 0 ? character_time(baud_rate) : Time::zero();
      End end{tcp ? open_tcp_end(port) : open_pty_end(per_byte), std::move(peer)};
      std::string shown = end.wire->address();
      if (!tcp && in_place_) {
        // The pseudo-terminal appears under the name of the rig file's port.
        testbed().add_node(address.substr(address.find(':') + 1),
                           shown.substr(shown.find(':') + 1));
        shown = address + " (" + shown + ")";
      }
      if (baud_rate > 0) shown += fmt::format(", {} baud", baud_rate);
      say(role, shown);
      ends_.push_back(std::move(end));
    };
    if (role == "stage") settings_.stage(where);
    if (role == "rotation_stage") settings_.rotation_stage(where);
    if (role == "field_probe" && driver != "simulated") settings_.field_probe(where);
    if (role == "coils" && driver == "kepco_bop") settings_.coils(where);
  }

  /// To the standard output, where a program may read the addresses; beside a command to the error
  /// output.
  void say(const std::string& role, const std::string& what) const {
    std::ostream& out = in_place_ ? std::cerr : std::cout;
    out << role << ": " << what << std::endl;
  }

  // Only when something is plugged in: a rig without USB needs no umockdev.
  UsbTestbed& testbed() {
    if (!testbed_) testbed_ = make_usb_testbed();
    return *testbed_;
  }

  // 0x01, 0x08 of the SpaceMouse: the HID usage "multi-axis controller" on the page of generic
  // desktop controls. An address without a serial number takes any; the emulated device has "1"
  // then.
  // Each transfer takes its frame, as the rig file has it.
  void plug(const std::string& role, const std::string& driver, const UsbAddress& address) {
    const double interval =
        reader_.resolved().at(role).value("transfer_interval", to_seconds(kUsbFrame));
    const Time frame = from_seconds(interval);
    UsbIdentity identity{
        address.vendor, address.product,      0x0100, address.serial.empty() ? "1" : address.serial,
        "Vitreo",       "emulated " + driver, ""};
    if (driver == "usb3103")
      testbed().plug(laboratory_.coil_outputs(), identity, kVendorUsage, 1, frame);
    else if (driver == "led")
      plug_lamp(identity, frame);
    else if (driver == "pololu_tic")
      testbed().plug(laboratory_.lens_motor(), frame);
    else if (driver == "spacemouse")
      testbed().plug(mouse_, identity, 0x01, 0x08);
    else if (driver == "foot_pedal")
      testbed().plug(pedal_, identity);
    else
      throw ConfigError(role + ": there is no emulator for the driver '" + driver + "' on USB");
  }

  /// The light in the simulated eye is what the output puts out, as in host/rig/drivers/led_lamp.
  void plug_lamp(const UsbIdentity& identity, Time frame) {
    const nlohmann::json& lamp = reader_.resolved().at("lamp");
    const auto output = lamp.at("output").get<std::size_t>();
    const double level_per_volt =
        lamp.at("amperes_per_volt").get<double>() / lamp.at("full_current").get<double>();
    lamp_ = usb3103::make_emulator({}, [this, output, level_per_volt](const auto& volts) {
      laboratory_.set_light(volts[output] * level_per_volt);
    });
    laboratory_.set_light(0);
    testbed().plug(*lamp_, identity, kVendorUsage, 1, frame);
  }

  /// A GigE Vision camera that streams what the role sees of the simulated world. The server calls
  /// `draw` in a thread of its own: nothing may be drawn there without with_world().
  void serve(const std::string& role, const std::string& interface) {
    const bool top = role == "top_camera";
    const sim::CameraSettings& camera = top ? settings_.laboratory.top : settings_.laboratory.side;
    genicam::ServerSettings settings;
    settings.interface = interface;
    settings.serial = top ? "VITREO01" : "VITREO02";
    settings.width_px = camera.size.width;
    settings.height_px = camera.size.height;
    const auto view = [this, top](std::uint64_t number) {
      const Time now = clock_->now();
      return top ? laboratory_.top_image(now, number) : laboratory_.side_image(now, number);
    };
    const auto draw = [this, view](const genicam::Exposure& exposure, cv::Mat& image) {
      cv::Mat seen;
      with_world([&] { seen = view(exposure.number); });
      cv::resize(seen, image, image.size());  // where the client asked for another size
    };
    // The first image takes long: a client would take that for silence.
    view(0);
    cameras_.push_back(genicam::serve_camera(settings, draw));
  }

  /// One thread at a time, in the order in which they come: the cameras', the testbed's, the
  /// wires'. An unfair lock lets two cameras pass it to each other, and the wires fall silent. The
  /// laboratory and the emulators know nothing of threads. This lock is taken before the testbed's,
  /// and the testbed's own thread holds that one alone: no two wait for each other.
  void with_world(const std::function<void()>& work) {
    const std::lock_guard lock(turns_);
    if (testbed_)
      testbed_->with_emulators(work);
    else
      work();
  }

  // The wires' own thread. It never waits for the world, so that bytes keep their times while an
  // image is drawn. Polled, because a pseudo-terminal and the emulators' own delays have no common
  // event to wait for; while bytes are on their way the next of them is waited for.
  void transfer() {
    while (!ended_) {
      Time due = later(clock_->now(), kPump);
      for (End& end : ends_) {
        end.wire->transfer(clock_->now());
        due = std::min(due, end.wire->next());
      }
      std::this_thread::sleep_for(std::max(due - clock_->now(), kLeastPause));
    }
  }

  /// The emulators' turns at the world.
  void exchange() {
    while (!ended_) {
      if (!ends_.empty())
        with_world([this] {
          for (End& end : ends_) end.wire->exchange(*end.peer, clock_->now());
        });
      std::this_thread::sleep_for(kPump);
    }
  }

  struct End {
    std::unique_ptr<PeerEnd> wire;
    std::shared_ptr<BytePeer> peer;
  };

  // Members go from the last to the first: the testbed before the emulators that it borrows. Thread
  // and camera have ended by then (see the destructor).
  const bool in_place_;
  std::unique_ptr<Clock> clock_ = wall_clock();
  ConfigReader reader_;
  RigSettings settings_;
  sim::Laboratory laboratory_;
  std::shared_ptr<SimulatedPlaces> places_ = std::make_shared<SimulatedPlaces>();
  spacemouse::Emulator mouse_;
  foot_pedal::Emulator pedal_;
  std::unique_ptr<usb3103::Emulator> lamp_;
  std::vector<End> ends_;
  Turns turns_;
  std::unique_ptr<UsbTestbed> testbed_;
  std::vector<std::unique_ptr<genicam::CameraServer>> cameras_;
  std::atomic<bool> ended_{false};
  std::thread transfers_;
  std::thread exchanges_;
};

Emulation::Emulation(const RigDescription& description, const EmulationSettings& settings)
    : state_(std::make_unique<State>(description, settings)) {}
Emulation::~Emulation() = default;
void Emulation::handle(const nlohmann::json& task) { state_->handle(task); }
std::optional<sim::Truth> Emulation::truth() { return state_->truth(); }

// The exit code as a shell gives it.
int run_among(const std::vector<std::string>& command) {
  std::vector<char*> words;
  for (const std::string& word : command) words.push_back(const_cast<char*>(word.c_str()));
  words.push_back(nullptr);
  pid_t child = 0;
  if (const int error = posix_spawnp(&child, words[0], nullptr, nullptr, words.data(), environ);
      error != 0)
    throw ConfigError("the command " + command.front() + " cannot be run: " + std::strerror(error));
  // The terminal's Ctrl-C reaches the command too: it decides, and the instruments outlive it.
  struct sigaction ignore {
  }, before{};
  // Only after the start: an ignored signal stays ignored in a program that is started.
  ignore.sa_handler = SIG_IGN;
  sigaction(SIGINT, &ignore, &before);
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  sigaction(SIGINT, &before, nullptr);
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

struct EndingSignals::Sets {
  sigset_t ending{}, before{};
};

// Made before any thread, which inherits the mask: the signal then waits for sigwait() and
// interrupts no system call of the emulators.
EndingSignals::EndingSignals() : sets_(std::make_unique<Sets>()) {
  sigemptyset(&sets_->ending);
  for (const int one : {SIGINT, SIGTERM, SIGHUP}) sigaddset(&sets_->ending, one);
  pthread_sigmask(SIG_BLOCK, &sets_->ending, &sets_->before);
}
EndingSignals::~EndingSignals() { pthread_sigmask(SIG_SETMASK, &sets_->before, nullptr); }
void EndingSignals::wait() const {
  int one = 0;
  sigwait(&sets_->ending, &one);
}

namespace {

/// The preloaded library of the testbed: beside the program in a build folder, or as installed; ""
/// where it is not.
std::string loopback_library(const std::filesystem::path& program) {
  const std::filesystem::path name = "libvitreo_loopback.so";
  for (const auto& folder : {program.parent_path(), program.parent_path() / "../lib/vitreo"})
    if (std::filesystem::exists(folder / name)) return (folder / name).lexically_normal().string();
  return "";
}

}  // namespace

void restart_in_testbed(char** words) {
  // A second start in the testbed would not help where the first did not.
  if (std::getenv("VITREO_IN_TESTBED") != nullptr) return;
  setenv("VITREO_IN_TESTBED", "1", 1);
  std::error_code gone;
  const std::string self = std::filesystem::read_symlink("/proc/self/exe", gone).string();
  if (gone) return;
  const char* const before = std::getenv("LD_PRELOAD");
  const std::string library = loopback_library(self);
  if (!library.empty())
    setenv("LD_PRELOAD", (library + (before == nullptr ? "" : ":" + std::string(before))).c_str(),
           1);
  std::vector<char*> all{const_cast<char*>("umockdev-wrapper"), const_cast<char*>(self.c_str())};
  for (char** word = words + 1; *word != nullptr; ++word) all.push_back(*word);
  all.push_back(nullptr);
  // It returns only where umockdev-wrapper is not installed: then the caller goes on, and says what
  // is missing when it is needed.
  execvp(all[0], all.data());
}

}  // namespace vitreo
