// SPDX-License-Identifier: Apache-2.0
#include "host/view/instrument_panel.h"

#include "devices/time/error.h"
#include "host/record/meaning.h"
#include "host/session/session.h"
#include "host/text/columns.h"

#include <fmt/format.h>

#include <array>
#include <chrono>
#include <cmath>
#include <cstdlib>
#include <stdexcept>
#include <utility>

namespace vitreo::view {
namespace {

constexpr Time kLookPeriod = std::chrono::milliseconds(50);  // of looking for what a person wants
constexpr Time kMotionPatience = std::chrono::seconds(60);   // of a motion
constexpr double kMostGain = 24;                             // dB, by hand

/// A camera's feature that is a knob. The standard names are GenICam's (SFNC 2.7): ExposureTime in
/// microseconds, Gain in dB; cameras of before 2012 have ExposureTimeAbs.
struct CameraKnob {
  const char* feature;
  const char* name;
  const char* unit;
  double in_si;  // SI of one of the feature's units
};
constexpr std::array kCameraKnobs = {CameraKnob{"ExposureTime", "exposure", "s", 1e-6},
                                     CameraKnob{"ExposureTimeAbs", "exposure", "s", 1e-6},
                                     CameraKnob{"Gain", "gain", "dB", 1}};

/// The feature's value in SI; nothing where the camera has none of that name.
std::optional<double> feature_of(Camera& camera, const CameraKnob& knob) {
  try {
    const std::string said = camera.feature(knob.feature);
    char* end = nullptr;
    const double value = std::strtod(said.c_str(), &end);
    if (end == said.c_str() || !std::isfinite(value)) return std::nullopt;
    return value * knob.in_si;
  } catch (const DeviceError& error) {
    if (error.kind != DeviceErrorKind::refused) throw;
    return std::nullopt;
  }
}

std::string shown_value(double value, const std::string& unit) {
  return unit == "dB" ? fmt::format("{:.3g} dB", value) : format_quantity(value, unit);
}

nlohmann::json finite_or_null(double value) {
  return std::isfinite(value) ? nlohmann::json(value) : nlohmann::json();
}

}  // namespace

InstrumentPanel::InstrumentPanel(Clock& clock, Rig& rig, Recorder& recorder,
                                 const RunControl& control)
    : clock_(clock), rig_(rig), recorder_(recorder), control_(control) {}
InstrumentPanel::~InstrumentPanel() = default;

void InstrumentPanel::begin() {
  {
    const std::lock_guard lock(mutex_);
    if (rig_.stage != nullptr) add_stage("stage", *rig_.stage);
    if (rig_.rotation_stage != nullptr) add_rotation_stage("rotation_stage", *rig_.rotation_stage);
    for (const FreeRole& role : rig_.free_roles) {
      if (auto* const* stage = std::get_if<Stage*>(&role.device)) add_stage(role.name, **stage);
      if (auto* const* stage = std::get_if<RotationStage*>(&role.device))
        add_rotation_stage(role.name, **stage);
    }
    if (rig_.lens_mover != nullptr) add_lens_mover();
    if (rig_.lamp != nullptr) add_lamp();
    open_ = true;
  }
  task_ = clock_.spawn("instrument panel", [this] { work(); });
}

void InstrumentPanel::add_stage(const std::string& role, Stage& stage) {
  auto device = std::make_unique<Device>();
  device->role = role;
  for (const StageAxis& axis : stage.info().axes)
    device->knobs.push_back(
        {{role + " " + axis.name, "m", axis.travel_min, axis.travel_max, axis.resolution}});
  device->read = [&stage] { return stage.position(); };
  device->set = [this, &stage](std::size_t axis, double value) {
    std::vector<double> target = stage.position();
    target.at(axis) = value;
    move_to(stage, target, stage.info().axes.at(axis).speed, kMotionPatience, clock_);
  };
  devices_.push_back(std::move(device));
}

void InstrumentPanel::add_rotation_stage(const std::string& role, RotationStage& stage) {
  const StageAxis& axis = stage.info().axis;
  auto device = std::make_unique<Device>();
  device->role = role;
  device->knobs.push_back({{role, "rad", axis.travel_min, axis.travel_max, axis.resolution}});
  device->read = [&stage] { return std::vector<double>{stage.position()}; };
  device->set = [this, &stage](std::size_t, double value) {
    move_to(stage, value, stage.info().axis.speed, kMotionPatience, clock_);
  };
  devices_.push_back(std::move(device));
}

void InstrumentPanel::add_lens_mover() {
  constexpr double kStep = 10e-6;  // m
  LensMover& mover = *rig_.lens_mover;
  auto device = std::make_unique<Device>();
  device->role = "lens_mover";
  device->knobs.push_back({{"lens_mover", "m", mover.travel_min(), mover.travel_max(), kStep}});
  device->read = [&mover] { return std::vector<double>{mover.position()}; };
  device->set = [&mover](std::size_t, double value) { mover.move_to(value, kMotionPatience); };
  devices_.push_back(std::move(device));
}

void InstrumentPanel::add_lamp() {
  Lamp& lamp = *rig_.lamp;
  auto device = std::make_unique<Device>();
  device->role = "lamp";
  device->knobs.push_back({{"lamp", "%", 0, 1, 0.01}});
  device->read = [&lamp] { return std::vector<double>{lamp.level()}; };
  device->set = [&lamp](std::size_t, double value) { lamp.set_level(value); };
  devices_.push_back(std::move(device));
}

// By the slot and not by the camera: a recording stands in it while it lasts, and notes the change.
void InstrumentPanel::add_camera(const std::string& role, Camera* Rig::*slot) {
  if (rig_.*slot == nullptr) return;
  auto device = std::make_unique<Device>();
  device->role = role;
  std::vector<CameraKnob> known;
  const double period = (rig_.*slot)->info().frame_period;
  for (const CameraKnob& knob : kCameraKnobs) {
    const bool twice = !known.empty() && std::string(known.back().name) == knob.name;
    if (twice || !feature_of(*(rig_.*slot), knob)) continue;
    known.push_back(knob);
    const bool time = std::string(knob.unit) == "s";
    device->knobs.push_back({{role + " " + knob.name, knob.unit, time ? knob.in_si : 0.0,
                              time ? period : kMostGain, time ? 10 * knob.in_si : 0.1}});
  }
  if (known.empty()) return;
  device->read = [this, slot, known] {
    std::vector<double> values;
    for (const CameraKnob& knob : known)
      values.push_back(feature_of(*(rig_.*slot), knob).value_or(std::nan("")));
    return values;
  };
  device->set = [this, slot, known](std::size_t index, double value) {
    const CameraKnob& knob = known.at(index);
    (rig_.*slot)->set_feature(knob.feature, fmt::format("{:.6g}", value / knob.in_si));
  };
  const std::lock_guard lock(mutex_);
  devices_.push_back(std::move(device));
}

void InstrumentPanel::check_open() const {
  if (!open_) throw std::invalid_argument("instruments cannot be adjusted by hand yet");
  if (ending()) throw std::invalid_argument("the run is ending: nothing is adjusted any more");
}

// Told to end, or at its end: from there on the rig is made safe.
bool InstrumentPanel::ending() const {
  return control_.tier() != StopTier::none || control_.status().phase == RunPhase::ended;
}

std::pair<InstrumentPanel::Device*, std::size_t> InstrumentPanel::find(const std::string& name) {
  std::string names;
  for (const auto& device : devices_)
    for (std::size_t i = 0; i < device->knobs.size(); ++i) {
      const std::string& known = device->knobs[i].info.name;
      if (known == name) return {device.get(), i};
      names += (names.empty() ? "" : ", ") + known;
    }
  throw std::invalid_argument("instrument: '" + name + "' is none of those that can be adjusted" +
                              (names.empty() ? "" : ": " + names));
}

void InstrumentPanel::adjust(const std::string& name, double value, const std::string& by) {
  const std::lock_guard lock(mutex_);
  check_open();
  const auto [device, index] = find(name);
  Knob& knob = device->knobs[index];
  const AdjustableInfo& info = knob.info;
  if (!(value >= info.min && value <= info.max))
    throw std::invalid_argument(
        fmt::format("{}: {} is not within {}", name, shown_value(value, info.unit),
                    info.unit == "dB" ? fmt::format("{} to {} dB", info.min, info.max)
                                      : format_range(info.min, info.max, info.unit)));
  wanted_[name] = {value, by};
  knob.busy = true;
  ++changes_;
}

void InstrumentPanel::read() {
  const std::lock_guard lock(mutex_);
  check_open();
  read_wanted_ = true;
}

nlohmann::json InstrumentPanel::status() const {
  const std::lock_guard lock(mutex_);
  nlohmann::json list = nlohmann::json::array();
  for (const auto& device : devices_)
    for (const Knob& knob : device->knobs)
      list.push_back({{"name", knob.info.name},
                      {"unit", knob.info.unit},
                      {"min", finite_or_null(knob.info.min)},
                      {"max", finite_or_null(knob.info.max)},
                      {"step", knob.info.step},
                      {"value", knob.value ? finite_or_null(*knob.value) : nlohmann::json()},
                      {"busy", knob.busy},
                      {"by", knob.by},
                      {"refused", knob.refused}});
  return list;
}

// On the clock, whose tasks alone may speak to an instrument; requests come from other threads,
// which cannot wake it, so it looks.
void InstrumentPanel::work() {
  for (;; clock_.sleep_for(kLookPeriod)) {
    bool look = false;
    {
      const std::lock_guard lock(mutex_);
      look = std::exchange(read_wanted_, false);
    }
    if (look) read_all();
    std::string name;
    Wanted wanted;
    while (take(name, wanted)) carry_out(name, wanted);
  }
}

bool InstrumentPanel::take(std::string& name, Wanted& wanted) {
  const std::lock_guard lock(mutex_);
  if (wanted_.empty()) return false;
  name = wanted_.begin()->first;
  wanted = wanted_.begin()->second;
  wanted_.erase(wanted_.begin());
  return true;
}

void InstrumentPanel::read_all() {
  // Which features a camera has is asked once, and only where a person looks.
  if (!std::exchange(cameras_asked_, true)) ask_cameras();
  for (const auto& device : devices_) read_device(*device);
}

void InstrumentPanel::ask_cameras() {
  for (const auto& [role, slot] :
       {std::pair{"top_camera", &Rig::top_camera}, std::pair{"side_camera", &Rig::side_camera}})
    try {
      add_camera(role, slot);
    } catch (const DeviceError& error) {
      recorder_.event(clock_.now(), "adjust",
                      std::string(role) + " cannot be asked: " + error.what());
    }
}

void InstrumentPanel::read_device(Device& device) {
  std::vector<double> values;
  std::string refused;
  try {
    values = device.read();
  } catch (const DeviceError& error) {
    refused = error.what();
  }
  {
    const std::lock_guard lock(mutex_);
    for (std::size_t i = 0; i < device.knobs.size(); ++i) {
      Knob& knob = device.knobs[i];
      knob.value =
          i < values.size() && std::isfinite(values[i]) ? std::optional(values[i]) : std::nullopt;
      if (!refused.empty()) knob.refused = refused;
    }
    ++changes_;
  }
  if (values.empty()) return;
  if (device.stream < 0) {
    StreamInfo info{
        "panel_" + device.role, "as it was read for a person who adjusts by hand", {}, kReading};
    for (const Knob& knob : device.knobs) {
      const std::size_t space = knob.info.name.rfind(' ');
      info.channels.push_back(
          {space == std::string::npos ? "value" : knob.info.name.substr(space + 1),
           knob.info.unit == "%" ? "" : knob.info.unit, knob.info.name});
    }
    device.stream = recorder_.add_stream(std::move(info));
  }
  recorder_.sample(device.stream, clock_.now(), values);
}

/// Absence of a device is an answer to the person, not an end of the run: what the run needs of the
/// instrument it will find out by itself.
void InstrumentPanel::carry_out(const std::string& name, const Wanted& wanted) {
  const auto [device, index] = find(name);
  const AdjustableInfo info = device->knobs[index].info;
  std::string refused;
  // First, so that the record has a motion that is broken off, too.
  const std::string event =
      name + " to " + shown_value(wanted.value, info.unit) + ", by " + wanted.by;
  recorder_.event(clock_.now(), "adjust", event);
  // Asked for before the run was told to end, and not begun: dropped.
  if (ending()) {
    refused = "the run is ending";
  } else {
    try {
      device->set(index, wanted.value);
    } catch (const DeviceError& error) {
      refused = error.what();
    } catch (const std::invalid_argument& error) {
      refused = error.what();
    }
  }
  if (!refused.empty()) recorder_.event(clock_.now(), "adjust", event + ": refused: " + refused);
  read_device(*device);
  const std::lock_guard lock(mutex_);
  Knob& knob = device->knobs[index];
  knob.busy = wanted_.contains(name);
  knob.by = wanted.by;
  knob.refused = refused;
  ++changes_;
}

void read_adjustment(const nlohmann::json& request, OperatorCommand& command) {
  const auto instrument = request.find("instrument"), to = request.find("to");
  if (instrument == request.end() && to == request.end()) return;
  if (instrument == request.end() || !instrument->is_string())
    throw std::invalid_argument("instrument: wants a text");
  if (to == request.end() || !to->is_number())
    throw std::invalid_argument("to: wants a number, in SI units");
  command.text = *instrument;
  command.to = to->get<double>();
}

void PanelFace::begin(Session& session) {
  if (!session.real_time) return;
  session_ = &session;
  panel_ = std::make_unique<InstrumentPanel>(session.clock, session.rig, session.recorder,
                                             session.control);
  panel_->begin();
  session.desk.offer(panel_.get());
}

// Taken away first: no face speaks to it when its task is ended.
void PanelFace::end(const std::string&) {
  if (session_ != nullptr) session_->desk.offer(nullptr);
  panel_.reset();
  session_ = nullptr;
}

}  // namespace vitreo::view
