// SPDX-License-Identifier: Apache-2.0
#include "host/rig/emulate.h"

#include "devices/instruments/foot_pedal/emulator.h"
#include "devices/instruments/spacemouse/emulator.h"
#include "devices/links/peer_end.h"
#include "devices/links/serial_line.h"
#include "devices/links/usb_frames.h"
#include "devices/time/error.h"
#include "devices/time/quiet_thread.h"
#include "host/config/config.h"
#include "host/rig/emulated_faults.h"
#include "host/rig/emulated_world.h"
#include "host/rig/identities.h"
#include "host/rig/rig_settings.h"

#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstring>
#include <iostream>
#include <thread>

namespace vitreo {
namespace {

// Period at which idle wires are looked at: below the time of one character at 19 200 baud (521
// us).
constexpr Time kPump = std::chrono::microseconds(500);
// A byte that is due at once is not waited for without a pause.
constexpr Time kLeastPause = std::chrono::microseconds(50);
constexpr const char* kLocal = "tcp:127.0.0.1:";

bool begins(const std::string& text, const std::string& with) { return text.rfind(with, 0) == 0; }

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
        breaks_(!given.faults.empty()),
        reader_(description),
        settings_(read_rig_settings(reader_)),
        world_(settings_.laboratory, given.seed) {
    for (const auto& [role, value] : description.table)
      if (const auto* const table = std::get_if<ConfigTable>(&value.value))
        offer(role, text_of(*table, "driver"), text_of(*table, "address"));
    add_what_moves();
    if (breaks_) {
      if (!in_place_) throw ConfigError("a fault is for a command: -- COMMAND");
      faults_.emplace(given.faults, parts_);
    }
    transfers_ = quiet_thread([this] { transfer(); });
    exchanges_ = quiet_thread([this] { exchange(); });
  }
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    faults_.reset();
    ended_ = true;
    transfers_.join();
    exchanges_.join();
  }

  void handle(const nlohmann::json& task) {
    const std::string what = task.value("do", "");
    const auto position = [&task] {
      const auto numbers = task.at("position").get<std::vector<double>>();
      if (numbers.size() != 3) throw std::invalid_argument("position: wants three numbers");
      return Eigen::Vector3d(numbers[0], numbers[1], numbers[2]);
    };
    world_.with([&] {
      SampleHandler& sample = world_.laboratory().sample();
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

  EmulatedTruth truth(Time monotonic) {
    EmulatedTruth found;
    const Time time = monotonic - clock_begin_;
    sim::Laboratory& laboratory = world_.laboratory();
    world_.with([&] { found = {laboratory.truth(time), laboratory.coils(time)}; });
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
    if (role == "enable_line" && begins(address, "serial:"))
      return say(role, address + " is not emulated: a pseudo-terminal has no lines RTS and DTR");
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
    RigContext where{world_.clock(), &world_.laboratory(), places_};
    const std::size_t before = parts_.size();
    where.offer = [this, &role](const std::string& address, int baud_rate,
                                std::shared_ptr<BytePeer> peer) {
      offer_line(role, address, baud_rate, std::move(peer));
    };
    if (role == "stage") settings_.stage(where);
    if (role == "rotation_stage") settings_.rotation_stage(where);
    if (role == "field_probe" && driver != "simulated") settings_.field_probe(where);
    const bool file = !driver.empty() && !is_built_in(driver);
    if (role == "coils" && (driver == "kepco_bop" || file)) settings_.coils(where);
    if (role == "lamp" && file) settings_.lamp(where);
    if (role == "lens_mover" && file) settings_.lens_mover(where);
    for (const FreeRoleSettings& one : settings_.free_roles)
      if (one.name == role) std::visit([&where](const auto& opener) { opener(where); }, one.opener);
    if (role == "current_sensor" && driver != "simulated") settings_.current_sensor(where);
    if (parts_.size() - before < 2) return;
    for (std::size_t i = before; i < parts_.size(); ++i)
      parts_[i].channel = static_cast<int>(i - before) + 1;
  }

  void offer_line(const std::string& role, const std::string& address, int baud_rate,
                  std::shared_ptr<BytePeer> peer) {
    const bool tcp = begins(address, "tcp:");
    if (tcp && in_place_ && !begins(address, kLocal))
      return say(role, address + " is not emulated here: only 127.0.0.1 is");
    // A pseudo-terminal knows no baud rate: the line's time is kept at its far end.
    const Time per_byte = baud_rate > 0 ? character_time(baud_rate) : Time::zero();
    const Plug plug = tcp ? connection(address) : port(address, per_byte);
    std::unique_ptr<PeerEnd> wire = plug.open();
    std::string shown = wire->address();
    if (!tcp && in_place_) shown = address + " (" + shown + ")";
    if (baud_rate > 0) shown += fmt::format(", {} baud", baud_rate);
    say(role, shown);
    add(role, make_line(world_, std::move(wire), plug, std::move(peer)));
  }

  static Plug connection(const std::string& address) {
    const int number = begins(address, kLocal) ? std::stoi(address.substr(std::strlen(kLocal))) : 0;
    return {[number] { return open_tcp_end(number); }, [] {}};
  }
  /// In place the pseudo-terminal appears under the name of the rig file's port.
  Plug port(const std::string& address, Time per_byte) {
    if (!in_place_) return {[per_byte] { return open_pty_end(per_byte); }, [] {}};
    const std::string node = address.substr(address.find(':') + 1);
    return {[this, node, per_byte] {
              auto wire = open_pty_end(per_byte);
              const std::string& target = wire->address();
              world_.testbed().add_node(node, target.substr(target.find(':') + 1));
              return wire;
            },
            [this, node] { world_.testbed().remove_node(node); }};
  }

  void add(const std::string& role, std::unique_ptr<EmulatedPart> part) {
    parts_.push_back({role, 0, std::move(part)});
  }

  /// Motors and amplifiers, which no driver speaks to.
  void add_what_moves() {
    for (const char* const role : {"stage", "rotation_stage"})
      if (world_.laboratory().faults().sticks.contains(role)) add(role, make_motor(world_, role));
    const auto stands = [this](const char* role) {
      return std::any_of(parts_.begin(), parts_.end(),
                         [role](const RolePart& one) { return one.role == role; });
    };
    if (stands("lens_mover")) add("lens_mover", make_motor(world_, "lens_mover"));
    if (stands("coils")) add("coils", make_amplifiers(world_));
  }

  /// To the standard output, where a program may read the addresses; beside a command to the error
  /// output.
  void say(const std::string& role, const std::string& what) const {
    std::ostream& out = in_place_ ? std::cerr : std::cout;
    out << role << ": " << what << std::endl;
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
      add(role, make_hid(world_, world_.laboratory().coil_outputs(), identity, {}, frame));
    else if (driver == "led")
      add(role, make_hid(world_, lamp(), identity, {}, frame));
    else if (driver == "pololu_tic")
      add(role, make_usb(world_, world_.laboratory().lens_motor(), frame));
    else if (driver == "spacemouse")
      add(role, make_hid(world_, mouse_, identity, {0x01, 0x08}, frame));
    else if (driver == "foot_pedal")
      add(role, make_hid(world_, pedal_, identity, {}, frame));
    else
      throw ConfigError(role + ": there is no emulator for the driver '" + driver + "' on USB");
  }

  /// The light in the simulated eye is what the output puts out, as in host/rig/drivers/led_lamp.
  usb3103::Emulator& lamp() {
    const nlohmann::json& lamp = reader_.resolved().at("lamp");
    const auto output = lamp.at("output").get<std::size_t>();
    const double level_per_volt =
        lamp.at("amperes_per_volt").get<double>() / lamp.at("full_current").get<double>();
    lamp_ = usb3103::make_emulator({}, [this, output, level_per_volt](const auto& volts) {
      world_.laboratory().set_light(volts[output] * level_per_volt);
    });
    world_.laboratory().set_light(0);
    return *lamp_;
  }

  /// A GigE Vision camera that streams what the role sees of the simulated world.
  void serve(const std::string& role, const std::string& interface) {
    const bool top = role == "top_camera";
    const sim::CameraSettings& camera = top ? settings_.laboratory.top : settings_.laboratory.side;
    genicam::ServerSettings settings;
    settings.interface = interface;
    settings.serial = top ? "VITREO01" : "VITREO02";
    settings.width_px = camera.size.width;
    settings.height_px = camera.size.height;
    const auto view = [this, top](Time exposed, std::uint64_t number) {
      sim::Laboratory& laboratory = world_.laboratory();
      return top ? laboratory.expose_top(exposed, number) : laboratory.expose_side(exposed, number);
    };
    // The first image takes long: a client would take that for silence.
    world_.with([&] { view(world_.clock().now(), 0)(); });
    add(role, make_camera(world_, settings, view));
  }

  // The wires' own thread. It never waits for the world, so that bytes keep their times while an
  // image is drawn. Polled, because a pseudo-terminal and the emulators' own delays have no common
  // event to wait for; while bytes are on their way the next of them is waited for.
  void transfer() {
    while (!ended_) {
      const Clock& clock = world_.clock();
      Time due = later(clock.now(), kPump);
      for (RolePart& one : parts_) due = std::min(due, one.part->transfer(clock.now()));
      std::this_thread::sleep_for(std::max(due - clock.now(), kLeastPause));
    }
  }

  /// The emulators' turns at the world.
  void exchange() {
    while (!ended_) {
      world_.with([this] {
        for (RolePart& one : parts_) one.part->serve(world_.clock().now());
      });
      std::this_thread::sleep_for(kPump);
    }
  }

  // Members go from the last to the first: parts before the emulators that they borrow, and before
  // the world. Threads have ended by then (see the destructor).
  const bool in_place_;
  const bool breaks_;  // something
  ConfigReader reader_;
  RigSettings settings_;
  EmulatedWorld world_;
  // The clock's zero on the machine's monotonic clock.
  const Time clock_begin_ =
      std::chrono::steady_clock::now().time_since_epoch() - world_.clock().now();
  std::shared_ptr<SimulatedPlaces> places_ = std::make_shared<SimulatedPlaces>();
  spacemouse::Emulator mouse_;
  foot_pedal::Emulator pedal_;
  std::unique_ptr<usb3103::Emulator> lamp_;
  RoleParts parts_;
  std::optional<EmulatedFaults> faults_;
  std::atomic<bool> ended_{false};
  std::thread transfers_;
  std::thread exchanges_;
};

Emulation::Emulation(const RigDescription& description, const EmulationSettings& settings)
    : state_(std::make_unique<State>(description, settings)) {}
Emulation::~Emulation() = default;
void Emulation::handle(const nlohmann::json& task) { state_->handle(task); }
EmulatedTruth Emulation::truth(Time monotonic) { return state_->truth(monotonic); }

}  // namespace vitreo
