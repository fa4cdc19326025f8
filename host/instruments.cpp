// SPDX-License-Identifier: Apache-2.0
#include "host/instruments.h"

#include "devices/contract/camera.h"
#include "devices/contract/coil_amplifier.h"
#include "devices/contract/field_probe.h"
#include "devices/contract/lamp.h"
#include "devices/contract/lens_mover.h"
#include "devices/contract/operator_input.h"
#include "devices/contract/stage.h"
#include "devices/error.h"
#include "devices/genicam/driver.h"
#include "devices/pololu_tic/wire.h"
#include "host/rig_settings.h"
#include "host/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>

namespace vitreo {
namespace {

using Json = nlohmann::json;

/// Adds what `find` finds, or why it cannot look.
void look(Json& rows, const std::string& bus, const std::function<void()>& find) {
  try {
    find();
  } catch (const std::exception& problem) {
    rows.push_back({{"bus", bus}, {"problem", problem.what()}});
  }
}

Json row_of(const std::string& bus, const UsbIdentity& found) {
  return {{"bus", bus},
          {"address", to_string(bus, {found.vendor, found.product, found.serial})},
          {"name", found.manufacturer + (found.manufacturer.empty() ? "" : " ") + found.name},
          {"place", found.place},
          {"driver", driver_for(found.vendor, found.product)}};
}

/// Ports that the system knows to be serial: those with a device behind them.
void find_ports(Json& rows) {
  std::error_code none;
  for (std::filesystem::directory_iterator port("/sys/class/tty", none), end; !none && port != end;
       port.increment(none)) {
    if (!std::filesystem::exists(port->path() / "device/driver", none)) continue;
    const std::string node = "/dev/" + port->path().filename().string();
    rows.push_back({{"bus", "serial"}, {"address", "serial:" + node}, {"name", ""}, {"place", node}, {"driver", ""}});
  }
}

Json text_of(const ConfigValue& table, const char* key, const char* fallback) {
  const auto& keys = std::get<ConfigTable>(table.value);
  const auto found = keys.find(key);
  const auto* const text = found == keys.end() ? nullptr : std::get_if<std::string>(&found->second.value);
  return text == nullptr ? fallback : *text;
}

void describe(Json& row, Camera& camera) {
  const CameraInfo& info = camera.info();
  row["identity"] = info.identity;
  row["state"] = "streaming";
  row["limits"] = {{"width_px", info.width_px}, {"height_px", info.height_px}, {"frame_rate", 1 / info.frame_period}};
}
void describe(Json& row, CoilAmplifier& coils) {
  row["identity"] = coils.identity();
  row["state"] = "at zero";
  row["limits"] = {{"channels", coils.channels()}, {"current", coils.current_limit()}};
}
void describe(Json& row, LensMover& lens) {
  row["identity"] = lens.identity();
  row["state"] = lens.homed() ? "homed" : "not homed";
  row["position"] = lens.position();
  row["limits"] = {{"travel_min", lens.travel_min()}, {"travel_max", lens.travel_max()}};
}
void describe(Json& row, OperatorInput& input) {
  row["identity"] = input.identity();
  row["state"] = fmt::format("pressed: {:#x}", input.state().pressed);
  row["limits"] = {{"deflection", 1}, {"buttons", 32}};
}
void describe(Json& row, Lamp& lamp) {
  row["identity"] = lamp.identity();
  row["state"] = lamp.level() > 0 ? "burning" : "dark";
  row["limits"] = {{"level", 1}};
}
void describe(Json& row, PoseSensor& sensor) {
  row["identity"] = sensor.identity();
  row["state"] = "streaming";
  row["limits"] = {{"rate", 1 / sensor.period()}};
}
void describe(Json& row, SampleHandler& hands) {
  row["identity"] = hands.identity();
  row["state"] = "waiting";
  row["limits"] = Json::object();
}
/// An infinite travel is no JSON number.
Json limits_of(const StageAxis& axis) {
  Json limits = {{"name", axis.name}, {"max_speed", axis.max_speed}};
  if (std::isfinite(axis.travel_min)) limits["travel_min"] = axis.travel_min;
  if (std::isfinite(axis.travel_max)) limits["travel_max"] = axis.travel_max;
  return limits;
}
void describe(Json& row, Stage& stage) {
  row["identity"] = to_string(stage.info().identity);
  row["firmware"] = stage.info().identity.firmware;
  row["state"] = stage.moving() ? "moving" : "standing";
  row["position"] = stage.position();
  for (const StageAxis& axis : stage.info().axes) row["limits"].push_back(limits_of(axis));
}
void describe(Json& row, RotationStage& stage) {
  row["identity"] = to_string(stage.info().identity);
  row["firmware"] = stage.info().identity.firmware;
  row["state"] = stage.moving() ? "moving" : "standing";
  row["position"] = stage.angle();
  row["limits"] = limits_of(stage.info().axis);
}
void describe(Json& row, FieldProbe& probe) {
  row["identity"] = to_string(probe.info().identity);
  row["firmware"] = probe.info().identity.firmware;
  row["state"] = "waiting";
  row["limits"] = {{"axes", probe.info().axes}, {"range", probe.info().range}};
}

/// The rig's roles, each opened by a call of its own.
class Opening {
 public:
  explicit Opening(const RigDescription& description)
      : clock_(has_real_instruments(description) ? wall_clock() : virtual_clock()),
        reader_(description),
        settings_(read_rig_settings(reader_)),
        laboratory_(settings_.laboratory, *clock_, 1) {}
  Clock& clock() { return *clock_; }

  /// Calls `visit(device)` with the opened role; throws DeviceError, ConfigError for a role that is not in the rig.
  template <class Visit>
  void with(const std::string& role, Visit visit) {
    const Surroundings where{*clock_, &laboratory_};
    if (role == "top_camera" && settings_.top_camera && !settings_.top) return visit(laboratory_.top_camera());
    if (role == "sample" && settings_.sample) return visit(laboratory_.sample());
    if (role == "pose_sensor" && settings_.pose_sensor) {
      const auto truth = [this](Time time) -> std::optional<Eigen::Vector3d> {
        const auto known = laboratory_.truth(time);
        return known ? std::optional(known->position) : std::nullopt;
      };
      return visit(*sim::make_pose_sensor(*settings_.pose_sensor, truth, *clock_, 1));
    }
    if (role == "side_camera" && settings_.side_camera && !settings_.side) return visit(laboratory_.side_camera());
    const bool found =
        open(role, "top_camera", settings_.top, where, visit) ||
        open(role, "side_camera", settings_.side, where, visit) || open(role, "coils", settings_.coils, where, visit) ||
        open(role, "lens_mover", settings_.lens_mover, where, visit) ||
        open(role, "lamp", settings_.lamp, where, visit) || open(role, "joystick", settings_.joystick, where, visit) ||
        open(role, "pedal", settings_.pedal, where, visit) || open(role, "stage", settings_.stage, where, visit) ||
        open(role, "rotation_stage", settings_.rotation_stage, where, visit) ||
        open(role, "field_probe", settings_.field_probe, where, visit);
    if (!found) throw ConfigError("the rig has no instrument for the role '" + role + "'");
  }

 private:
  template <class Role, class Visit>
  static bool open(const std::string& wanted, const char* role, const Opener<Role>& opener, const Surroundings& where,
                   Visit& visit) {
    if (wanted != role || !opener) return false;
    const Opened<Role> opened = opener(where);
    visit(*opened.device);
    return true;
  }

  std::unique_ptr<Clock> clock_;
  ConfigReader reader_;
  RigSettings settings_;
  sim::Laboratory laboratory_;
};

struct Tester {
  Clock& clock;
  std::vector<std::string>& findings;
  void operator()(Camera& camera) const { findings = contract::check(camera, clock); }
  void operator()(CoilAmplifier& coils) const { findings = contract::check(coils); }
  void operator()(LensMover& lens) const { findings = contract::check(lens); }
  void operator()(Stage& stage) const { findings = contract::check(stage, clock); }
  void operator()(RotationStage& stage) const { findings = contract::check(stage, clock); }
  void operator()(FieldProbe& probe) const { findings = contract::check(probe, clock); }
  void operator()(Lamp& lamp) const { findings = contract::check(lamp); }
  void operator()(OperatorInput& input) const { findings = contract::check(input, clock); }
  template <class Role>
  void operator()(Role&) const {
    throw ConfigError("there is no contract suite for this role yet");
  }
};

}  // namespace

std::string driver_for(int vendor, int product) {
  const auto is = [product](std::initializer_list<int> ids) {
    return std::find(ids.begin(), ids.end(), product) != ids.end();
  };
  if (vendor == 0x09DB && product == 0x009C) return "usb3103";
  const auto& tics = pololu_tic::kProducts;
  if (vendor == pololu_tic::kVendor && std::find(tics.begin(), tics.end(), product) != tics.end()) return "pololu_tic";
  if (vendor == 0x046D && is({0xC603, 0xC605, 0xC606, 0xC621, 0xC623, 0xC625, 0xC626, 0xC627, 0xC628, 0xC629, 0xC62B}))
    return "spacemouse";
  if (vendor == 0x256F && is({0xC62E, 0xC62F, 0xC631, 0xC632, 0xC633, 0xC635, 0xC636, 0xC638, 0xC63A, 0xC652}))
    return "spacemouse";
  if (vendor == 0x05F3 && is({0x0268, 0x00FF})) return "foot_pedal";
  return "";
}

Json find_instruments() {
  Json rows = Json::array();
  look(rows, "serial", [&] { find_ports(rows); });
  look(rows, "usb", [&] {
    for (const UsbIdentity& found : list_usb_devices()) rows.push_back(row_of("usb", found));
  });
  look(rows, "hid", [&] {
    for (const UsbIdentity& found : list_hid_devices()) rows.push_back(row_of("hid", found));
  });
  look(rows, "genicam", [&] {
    for (const genicam::Found& found : genicam::list_cameras())
      rows.push_back({{"bus", "genicam"},
                      {"address", "genicam:" + found.identity},
                      {"name", found.vendor + " " + found.model},
                      {"place", found.protocol + " " + found.address},
                      {"driver", "genicam"}});
  });
  // The same device as a USB and as a HID one: the driver takes it by one of them.
  for (Json& row : rows)
    if (row.value("bus", "") == "usb" && row["driver"] != "pololu_tic") row["driver"] = "";
  return rows;
}

Json examine_rig(const RigDescription& description) {
  Opening opening(description);
  Json rows = Json::array();
  static const std::map<std::string, const char*> kRoles{{"top_camera", "simulated"},
                                                         {"side_camera", "simulated"},
                                                         {"coils", "usb3103"},
                                                         {"lens_mover", "pololu_tic"},
                                                         {"joystick", "spacemouse"},
                                                         {"pedal", "foot_pedal"},
                                                         {"stage", "zaber"},
                                                         {"rotation_stage", "zaber"},
                                                         {"field_probe", "scpi_probe"},
                                                         {"lamp", "led"},
                                                         {"pose_sensor", "simulated"},
                                                         {"sample", "simulated"}};
  for (const auto& [role, value] : description.table) {
    const auto known = kRoles.find(role);
    if (known == kRoles.end()) continue;
    Json row = {{"role", role},
                {"driver", text_of(value, "driver", known->second)},
                {"link", text_of(value, "address", "emulated")},
                {"present", false}};
    try {
      opening.with(role, [&row](auto& device) { describe(row, device); });
      row["present"] = true;
    } catch (const DeviceError& error) {
      row["state"] = to_string(error.kind);
      row["why"] = error.what();
    }
    rows.push_back(row);
  }
  return rows;
}

std::vector<std::string> test_instrument(const RigDescription& description, const std::string& name) {
  Opening opening(description);
  std::vector<std::string> findings;
  opening.with(name, Tester{opening.clock(), findings});
  return findings;
}

namespace {

/// "; at 1 mm, 0 m; x: -5 mm to 5 mm, 3 mm/s": what a role's row says about place and limits, in people's units.
std::string place_and_limits(const Json& row) {
  const std::string length = row["role"] == "rotation_stage" ? "rad" : "m", speed = length + "/s";
  std::string text;
  const auto add = [&text](const std::string& more) { text += (text.empty() ? "" : ", ") + more; };
  if (row.contains("position"))
    for (const Json& axis : row["position"].is_array() ? row["position"] : Json::array({row["position"]}))
      add((text.empty() ? "at " : "") + format_quantity(axis.get<double>(), length));
  if (!row.contains("limits")) return text;
  for (const Json& limits : row["limits"].is_array() ? row["limits"] : Json::array({row["limits"]})) {
    text += text.empty() ? "" : "; ";
    std::string of = limits.value("name", "");
    const auto say = [&](const std::string& more) { of += (of.empty() ? "" : " ") + more; };
    if (limits.contains("travel_min") && limits.contains("travel_max"))
      say(format_quantity(limits["travel_min"], length) + " to " + format_quantity(limits["travel_max"], length));
    if (limits.contains("max_speed")) say("up to " + format_quantity(limits["max_speed"], speed));
    if (limits.contains("channels")) say(fmt::format("{} channels", limits["channels"].get<int>()));
    if (limits.contains("current")) say("up to " + format_quantity(limits["current"], "A"));
    if (limits.contains("range")) say("up to " + format_quantity(limits["range"], "T"));
    if (limits.contains("width_px"))
      say(fmt::format("{} x {} px, {}", limits["width_px"].get<int>(), limits["height_px"].get<int>(),
                      format_quantity(limits["frame_rate"], "Hz")));
    text += of;
  }
  return text;
}

std::string with(const std::string& separator, const std::string& text) { return text.empty() ? "" : separator + text; }

}  // namespace

std::string to_text(const Json& rows) {
  std::string text;
  for (const Json& row : rows) {
    const auto of = [&row](const char* key) { return row.contains(key) ? row[key].get<std::string>() : std::string(); };
    if (row.contains("problem"))
      text += fmt::format("{:<8} cannot be looked at: {}\n", of("bus"), of("problem"));
    else if (row.contains("role"))
      text += fmt::format("{:<14} {:<16} {:<28} {}\n", of("role"), of("driver"), of("link"),
                          row["present"].get<bool>()
                              ? of("identity") + with("; ", of("state")) + with("; ", place_and_limits(row))
                              : "missing: " + of("why"));
    else
      text += fmt::format("{:<36} {:<36} {:<24} {}\n", of("address"), of("name"), of("place"),
                          of("driver").empty() ? "no driver" : "driver " + of("driver"));
  }
  return text.empty() ? "nothing is plugged in\n" : text;
}

}  // namespace vitreo
