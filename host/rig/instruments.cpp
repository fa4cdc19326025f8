// SPDX-License-Identifier: Apache-2.0
#include "host/rig/instruments.h"

#include "devices/contract/camera.h"
#include "devices/contract/coil_amplifier.h"
#include "devices/contract/current_sensor.h"
#include "devices/contract/field_probe.h"
#include "devices/contract/instrument.h"
#include "devices/contract/lamp.h"
#include "devices/contract/lens_mover.h"
#include "devices/contract/operator_input.h"
#include "devices/contract/stage.h"
#include "devices/time/error.h"
#include "host/rig/rig_settings.h"
#include "host/rig/sample.h"

#include <fmt/format.h>

#include <cmath>

namespace vitreo {
namespace {

using Json = nlohmann::json;

void describe(Json& row, Camera& camera) {
  const CameraInfo& info = camera.info();
  row["identity"] = info.identity;
  row["state"] = "streaming";
  row["limits"] = {{"width_px", info.width_px},
                   {"height_px", info.height_px},
                   {"frame_rate", 1 / info.frame_period}};
  for (const auto& [name, value] : info.settings) row["settings"][name] = value;
}
void describe(Json& row, CoilAmplifier& coils) {
  row["identity"] = coils.identity();
  // Not asked: open() has returned, and leaves an amplifier at zero by its contract.
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
void describe(Json& row, EnableLine& line) {
  row["identity"] = line.identity();
  row["state"] = line.high() ? "high" : "low";
  row["limits"] = Json::object();
}
void describe(Json& row, CurrentSensor& sensor) {
  row["identity"] = to_string(sensor.info().identity);
  row["firmware"] = sensor.info().identity.firmware;
  row["state"] = "waiting";
  row["limits"] = {{"coils", sensor.info().coils.size()}};
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
/// An infinite travel is left out: JSON has no such number.
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
  row["position"] = stage.position();
  row["limits"] = limits_of(stage.info().axis);
}
void describe(Json& row, FieldProbe& probe) {
  row["identity"] = to_string(probe.info().identity);
  row["firmware"] = probe.info().identity.firmware;
  row["state"] = "waiting";
  row["limits"] = {{"axes", probe.info().axes}, {"range", probe.info().range}};
}

void describe(Json& row, Instrument& instrument) {
  const InstrumentInfo& info = instrument.info();
  row["identity"] = to_string(info.identity);
  row["firmware"] = info.identity.firmware;
  row["state"] = info.kind + (info.measures.empty() ? "" : " of " + info.measures);
  row["limits"] = Json::object();
  for (const QuantityInfo& one : info.quantities) row["quantities"].push_back(one.name);
  for (const CommandInfo& one : info.commands) row["commands"].push_back(one.name);
}

/// The rig's roles, each opened by a call of its own.
class Opening {
 public:
  // Seed 1 for all: an examination has no run, and its simulated instruments need not differ.
  explicit Opening(const RigDescription& description)
      : clock_(has_real_instruments(description) ? wall_clock() : virtual_clock()),
        reader_(description),
        settings_(read_rig_settings(reader_)) {
    if (simulates_something(description))
      laboratory_ = std::make_unique<sim::Laboratory>(settings_.laboratory, *clock_, 1);
  }
  Clock& clock() { return *clock_; }
  /// The rig as read, with the drivers and addresses that it does not name.
  const Json& resolved() const { return reader_.resolved(); }

  /// Calls `visit(device)` with the opened role; throws DeviceError, ConfigError for a role that is
  /// not in the rig.
  template <class Visit>
  void with(const std::string& role, Visit visit) {
    // Simulated roles are the laboratory's own and need no opening; they are taken where the rig
    // names no driver of another.
    RigContext where{*clock_, laboratory_.get()};
    where.rig = &reader_.resolved();
    if (role == "top_camera" && settings_.top_camera && !settings_.top)
      return visit(laboratory_->top_camera());
    if (role == "sample" && settings_.sample) {
      RigSample sample(laboratory_ ? &laboratory_->sample() : nullptr, settings_.model,
                       settings_.sample_by_hand);
      return visit(static_cast<SampleHandler&>(sample));
    }
    if (role == "pose_sensor" && settings_.pose_sensor) {
      const auto truth = [this](Time time) -> std::optional<Eigen::Vector3d> {
        const auto known = laboratory_->truth(time);
        return known ? std::optional(known->position) : std::nullopt;
      };
      return visit(*sim::make_pose_sensor(*settings_.pose_sensor, truth, *clock_, 1));
    }
    if (role == "side_camera" && settings_.side_camera && !settings_.side)
      return visit(laboratory_->side_camera());
    const bool found = open(role, "top_camera", settings_.top, where, visit) ||
                       open(role, "side_camera", settings_.side, where, visit) ||
                       open(role, "coils", settings_.coils, where, visit) ||
                       open(role, "enable_line", settings_.enable_line, where, visit) ||
                       open(role, "current_sensor", settings_.current_sensor, where, visit) ||
                       open(role, "lens_mover", settings_.lens_mover, where, visit) ||
                       open(role, "lamp", settings_.lamp, where, visit) ||
                       open(role, "joystick", settings_.joystick, where, visit) ||
                       open(role, "pedal", settings_.pedal, where, visit) ||
                       open(role, "stage", settings_.stage, where, visit) ||
                       open(role, "rotation_stage", settings_.rotation_stage, where, visit) ||
                       open(role, "field_probe", settings_.field_probe, where, visit);
    if (found || open_free(role, where, visit)) return;
    throw ConfigError("the rig has no instrument for the role '" + role + "'");
  }

 private:
  template <class Visit>
  bool open_free(const std::string& wanted, const RigContext& where, Visit& visit) {
    for (const FreeRoleSettings& one : settings_.free_roles) {
      if (one.name != wanted) continue;
      std::visit([&](const auto& opener) { open(wanted, one.name.c_str(), opener, where, visit); },
                 one.opener);
      return true;
    }
    return false;
  }

  // The instrument is closed when the visit ends, before the next one is opened: no two are open at
  // the same time.
  template <class Role, class Visit>
  static bool open(const std::string& wanted, const char* role, const Opener<Role>& opener,
                   const RigContext& where, Visit& visit) {
    if (wanted != role || !opener) return false;
    const Opened<Role> opened = opener(where);
    visit(*opened.device);
    return true;
  }

  std::unique_ptr<Clock> clock_;
  ConfigReader reader_;
  RigSettings settings_;
  std::unique_ptr<sim::Laboratory> laboratory_;  // null: nothing is simulated
};

constexpr Time kSmallMotion = std::chrono::seconds(5);

/// Where it has no reference before it is homed, a motion to where it stands is refused, or is
/// beyond its travel.
bool wants_reference(const DeviceError& error) {
  return error.kind == DeviceErrorKind::refused || error.kind == DeviceErrorKind::out_of_range;
}
bool wants_home(Stage& stage) {
  try {
    stage.start(stage.position(), stage.info().axes.front().speed);
    stage.wait(kSmallMotion);
  } catch (const DeviceError& error) {
    return wants_reference(error);
  }
  return false;
}

// One suite a role, by overload; the template takes those that have none. Findings go out by
// reference, since a visit returns nothing.
struct Tester {
  Clock& clock;
  std::vector<std::string>& findings;
  void operator()(Camera& camera) const { findings = contract::check(camera, clock); }
  void operator()(CoilAmplifier& coils) const { findings = contract::check(coils); }
  void operator()(LensMover& lens) const { findings = contract::check(lens); }
  void operator()(Stage& stage) const {
    findings = contract::check(stage, clock, {.home = wants_home(stage)});
  }
  void operator()(RotationStage& stage) const {
    contract::StageCheck how;
    try {  // as wants_home()
      stage.start(stage.position(), stage.info().axis.speed);
      stage.wait(kSmallMotion);
    } catch (const DeviceError& error) {
      how.home = wants_reference(error);
    }
    findings = contract::check(stage, clock, how);
  }
  void operator()(FieldProbe& probe) const { findings = contract::check(probe, clock); }
  void operator()(CurrentSensor& sensor) const { findings = contract::check(sensor); }
  void operator()(Lamp& lamp) const { findings = contract::check(lamp); }
  void operator()(OperatorInput& input) const { findings = contract::check(input, clock); }
  void operator()(Instrument& instrument) const { findings = contract::check(instrument); }
  template <class Role>
  void operator()(Role&) const {
    throw ConfigError("there is no contract suite for this role yet");
  }
};

}  // namespace

// The roles are what has a driver. One instrument that is missing does not hide the others.
Json examine_rig(const RigDescription& description) {
  Opening opening(description);
  Json rows = Json::array();
  for (const auto& [role, settings] : opening.resolved().items()) {
    if (!settings.is_object() || !settings.contains("driver")) continue;
    Json row = {{"role", role},
                {"driver", settings["driver"]},
                {"link", settings.value("address", "emulated")},
                {"present", false}};
    try {
      opening.with(role, [&row](auto& device) { describe(row, device); });
      row["present"] = true;
    } catch (const DeviceError& error) {
      row["state"] = to_string(error.kind);
      // The row has the role already.
      row["why"] = renamed(error, role).text + " (" + to_string(error.kind) + ")";
    }
    rows.push_back(row);
  }
  return rows;
}

std::vector<std::string> test_instrument(const RigDescription& description,
                                         const std::string& name) {
  Opening opening(description);
  std::vector<std::string> findings;
  opening.with(name, Tester{opening.clock(), findings});
  return findings;
}

}  // namespace vitreo
