// SPDX-License-Identifier: Apache-2.0
#include "host/rig/twin.h"

#include "devices/roles/forwarding_stage.h"
#include "host/rig/registry.h"

#include <algorithm>
#include <array>
#include <functional>
#include <string_view>

namespace vitreo {
namespace {

/// The settings of a real camera that a simulated one has too.
/// Others, such as a packet size, would be unknown keys of the simulated camera, and so errors.
constexpr std::array kCameraKeys{
    "width_px",        "height_px",  "frame_rate", "effective_pixel",  "view",  "center_px",
    "sensor_aperture", "microscope", "projection", "projection_reach", "sensor"};

ConfigTable* table_in(ConfigTable& table, const std::string& key) {
  const auto found = table.find(key);
  return found == table.end() ? nullptr : std::get_if<ConfigTable>(&found->second.value);
}

/// Whether the address leads to an instrument. Images and videos in files do nothing, and a twin
/// reads them too.
/// By the address alone: an emulated instrument has the same driver as a real one.
bool is_real(const ConfigTable& role) {
  const std::string address = text_of(role, "address");
  return !address.empty() && address != "emulated" && !is_recording(address);
}

/// A real camera may be outside of what a simulated one can be.
/// A twin that is a bit off still rehearses the protocol; a refusal would forbid the real rig what
/// only the simulator cannot do.
void clamp_number(ConfigTable& table, const char* key, double min, double max) {
  const auto found = table.find(key);
  if (found == table.end()) return;
  if (double* const number = std::get_if<double>(&found->second.value))
    *number = std::clamp(*number, min, max);
}

void emulate_camera(ConfigTable& camera) {
  std::erase_if(camera, [](const auto& entry) {
    return std::find(kCameraKeys.begin(), kCameraKeys.end(), entry.first) == kCameraKeys.end();
  });
  for (const char* side : {"width_px", "height_px"}) clamp_number(camera, side, 64, 8192);
  clamp_number(camera, "frame_rate", 0.1, 2000);
}

ConfigTable& made_in(ConfigTable& table, const std::string& key) {
  ConfigValue& value = table[key];
  if (!std::holds_alternative<ConfigTable>(value.value)) value.value = ConfigTable{};
  return std::get<ConfigTable>(value.value);
}

/// What the loop reckons with is the rig's own: a real bench that says nothing was set up by hand,
/// where the twin's simulated picture would count as known.
void keep_places(RigDescription& twin) {
  ConfigTable& bench = made_in(made_in(made_in(twin.table, "model"), "uncertainty"), "bench");
  bench.try_emplace("places", ConfigValue{std::string("by_hand")});
}

// 15 Hz: a real camera's file need not say.
double frame_rate_of(const ConfigTable& camera) {
  const auto found = camera.find("frame_rate");
  const double* const rate =
      found == camera.end() ? nullptr : std::get_if<double>(&found->second.value);
  return rate != nullptr && *rate > 0 ? *rate : 15;
}

/// Notes where the axes of a role are sent.
/// Only motions that were accepted count: what the twin refuses is an error of the rehearsal.
class Note {
 public:
  Note(std::vector<AxisUse>& uses, std::string role, std::string unit)
      : uses_(uses), role_(std::move(role)), unit_(std::move(unit)) {}
  void sent(const std::string& axis, double target) {
    auto use = std::find_if(uses_.begin(), uses_.end(), [&](const AxisUse& one) {
      return one.role == role_ && one.axis == axis;
    });
    if (use == uses_.end())
      use = uses_.insert(uses_.end(), {role_, axis, unit_, 0, target, target});
    ++use->moves;
    use->min = std::min(use->min, target);
    use->max = std::max(use->max, target);
  }

 private:
  std::vector<AxisUse>& uses_;
  const std::string role_;
  const std::string unit_;
};

/// Each forwards everything, and notes the targets that the instrument accepted.
class WatchedStage final : public ForwardingStage {
 public:
  WatchedStage(Stage& stage, std::vector<AxisUse>& uses)
      : ForwardingStage(stage), note_(uses, "stage", "m") {}
  // First the motion: a target beyond its travel throws, and is not noted.
  void start(std::span<const double> target, double speed) override {
    ForwardingStage::start(target, speed);
    for (std::size_t i = 0; i < target.size(); ++i) note_.sent(info().axes[i].name, target[i]);
  }

 private:
  Note note_;
};

class WatchedRotation final : public ForwardingRotationStage {
 public:
  WatchedRotation(RotationStage& stage, std::vector<AxisUse>& uses)
      : ForwardingRotationStage(stage), note_(uses, "rotation_stage", "rad") {}
  void start(double target, double speed) override {
    ForwardingRotationStage::start(target, speed);
    note_.sent(info().axis.name, target);
  }

 private:
  Note note_;
};

class WatchedLens final : public LensMover {
 public:
  WatchedLens(LensMover& lens, std::vector<AxisUse>& uses)
      : lens_(lens), note_(uses, "lens_mover", "m") {}
  std::string identity() const override { return lens_.identity(); }
  double position() const override { return lens_.position(); }
  void move_to(double position, Time timeout) override {
    lens_.move_to(position, timeout);
    note_.sent("", position);
  }
  double travel_min() const override { return lens_.travel_min(); }
  double travel_max() const override { return lens_.travel_max(); }
  bool homed() const override { return lens_.homed(); }
  void home(Time timeout) override { lens_.home(timeout); }
  void make_safe() override { lens_.make_safe(); }

 private:
  LensMover& lens_;
  Note note_;
};

}  // namespace

bool is_laboratory(const RigDescription& rig) {
  return std::any_of(rig.table.begin(), rig.table.end(), [](const auto& entry) {
    const auto* const role = std::get_if<ConfigTable>(&entry.second.value);
    return role != nullptr && is_real(*role);
  });
}

// Cameras first: after the second loop no address says any more which of them are real.
// A copy of the description and not of the settings: the twin goes through the same reader, bounds
// and limits as the rig.
RigDescription twin_of(const RigDescription& rig) {
  RigDescription twin = rig;
  for (const char* name : {"top_camera", "side_camera"}) {
    ConfigTable* const camera = table_in(twin.table, name);
    if (camera == nullptr || !is_real(*camera)) continue;
    emulate_camera(*camera);
    if (name == std::string_view("top_camera") && text_of(*camera, "view") != "plain")
      keep_places(twin);
  }
  for (auto& [name, value] : twin.table) {
    auto* const role = std::get_if<ConfigTable>(&value.value);
    if (role == nullptr || !is_real(*role)) continue;
    const std::string address = text_of(*role, "address");
    (*role)["address"].value = std::string("emulated");
    // Else the emulated link would be a serial line, at whatever baud rate is usual.
    if (address.starts_with("tcp:") && address.find("serial:") == std::string::npos)
      (*role)["baud_rate"].value = 0.0;
  }
  // The questions stay, and what they ask for happens in the twin's world.
  if (ConfigTable* const sample = table_in(twin.table, "sample");
      sample && text_of(*sample, "driver") == "operator") {
    (*sample)["driver"].value = std::string("simulated");
    (*sample)["by_hand"].value = true;
  }
  // An emulated pedal is never pressed.
  if (ConfigTable* const pedal = table_in(twin.table, "pedal")) pedal->erase("dead_man");
  // So that protocols which need the sensor can be rehearsed; only where everything is simulated
  // may the truth be told.
  if (ConfigTable* const camera = table_in(twin.table, "top_camera");
      camera && !twin.table.contains("pose_sensor") && !has_real_instruments(twin)) {
    ConfigTable sensor;
    sensor["frame_rate"].value = frame_rate_of(*camera);
    twin.table["pose_sensor"].value = std::move(sensor);
  }
  return twin;
}

struct Twin::State {
  State(const RigDescription& rig, Clock& the_clock, std::uint64_t seed)
      : clock(the_clock),
        real(has_real_instruments(rig)),
        open(vitreo::open_rig(twin_of(rig), the_clock, seed)) {
    Rig& roles = open->rig();
    // A rig with real instruments has nothing that a script could redraw.
    if (real) roles.simulation = nullptr;
    // From here on the rig's own roles are the decorators: make_safe() goes through them as well,
    // and so they outlive `open`.
    if (roles.stage != nullptr) roles.stage = &stage.emplace(*roles.stage, uses);
    if (roles.rotation_stage != nullptr)
      roles.rotation_stage = &rotation.emplace(*roles.rotation_stage, uses);
    if (roles.lens_mover != nullptr) roles.lens_mover = &lens.emplace(*roles.lens_mover, uses);
  }

  Clock& clock;
  const bool real;
  std::vector<AxisUse> uses;
  std::optional<WatchedStage> stage;
  std::optional<WatchedRotation> rotation;
  std::optional<WatchedLens> lens;
  // Destroyed first: it makes safe the instruments that the decorators borrow.
  std::unique_ptr<OpenRig> open;
};

Twin::Twin(const RigDescription& rig, Clock& clock, std::uint64_t seed)
    : state_(std::make_unique<State>(rig, clock, seed)) {}
Twin::~Twin() = default;

OpenRig& Twin::open_rig() { return *state_->open; }
std::vector<AxisUse> Twin::moves() const { return state_->uses; }

CoilUse Twin::coils() const {
  const Interlock* const coils = state_->open->rig().coils;
  return coils == nullptr ? CoilUse{} : coils->use();
}

// In a rehearsal there is no hand to bring one.
void Twin::bring_robot() {
  sim::Laboratory& laboratory = *state_->open->laboratory();
  if (!laboratory.truth(state_->clock.now())) laboratory.sample().insert_robot({0, 0, 0});
}

}  // namespace vitreo
