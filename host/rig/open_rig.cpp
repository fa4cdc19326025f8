// SPDX-License-Identifier: Apache-2.0
#include "host/rig/open_rig.h"

#include "devices/sim/bench_sample.h"
#include "devices/time/error.h"
#include "host/rig/calibrations.h"
#include "host/rig/field_calibration_yaml.h"
#include "host/rig/measured_chain.h"
#include "host/rig/plant_settings.h"
#include "host/rig/rig_settings.h"
#include "host/rig/sample.h"
#include "host/safety/guardian.h"
#include "host/safety/watched_lamp.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <sstream>
#include <utility>

namespace vitreo {
namespace {

/// Longer than the interlock's dead-man time (0.25 s), which acts first.
constexpr Time kStuck = std::chrono::milliseconds(400);
/// Between two looks whether the guardian is still there.
constexpr Time kGuardianLook = std::chrono::milliseconds(20);

/// Commands of a script to the simulated laboratory.
class SimulationCommands final : public Simulation {
 public:
  SimulationCommands(sim::Laboratory& laboratory, const sim::OpticsSample& bench,
                     std::uint64_t seed)
      : laboratory_(laboratory), bench_(bench), seed_(seed) {}
  void sample_machine(std::uint64_t number) override {
    constexpr std::uint64_t kFar =
        0x9E3779B97F4A7C15U;  // so that the machines of neighboring seeds are others
    laboratory_.redraw(seed_ + number * kFar);
  }
  void use_calibration(const control::FieldModel& measured) override {
    laboratory_.use_field(measured);
  }
  void set_eye(const optics::System& eye) override { laboratory_.set_eye(bench_.applied_to(eye)); }
  void move_body(const std::string& name, const Eigen::Vector3d& position) override {
    laboratory_.move_body(name, position);
  }

 private:
  sim::Laboratory& laboratory_;
  const sim::OpticsSample bench_;  // in which another eye stands too
  const std::uint64_t seed_;
};

/// What has no safe state is left as it is.
void make_free_safe(const FreeRole& role) {
  if (auto* const* instrument = std::get_if<Instrument*>(&role.device)) (*instrument)->make_safe();
  if (auto* const* stage = std::get_if<Stage*>(&role.device)) (*stage)->make_safe();
  if (auto* const* stage = std::get_if<RotationStage*>(&role.device)) (*stage)->make_safe();
}

/// Whether the input says that all is well, and said so lately. It is looked for at each time: a
/// reload may have moved it.
bool is_closed(const Instrument& input, Time now) {
  const auto& all = input.info().quantities;
  const auto found = std::find_if(all.begin(), all.end(),
                                  [](const QuantityInfo& one) { return one.name == "closed"; });
  if (found == all.end()) return false;
  const auto quantity = static_cast<std::size_t>(found - all.begin());
  const Instrument::Latest latest = input.latest(quantity);
  constexpr int kMissed = 3;  // questions without an answer
  return latest.sample && std::get<bool>(latest.sample->value) &&
         now - latest.sample->time <=
             kMissed * input.info().quantities[quantity].every + std::chrono::milliseconds(100);
}

/// Whose roles are simulated: decides what there is beside the instruments.
enum class Share { none, some, all };

/// A rig of its parts. Members in the order of their birth: the laboratory first, the interlock
/// last, so that they die the other way round.
class ComposedRig final : public OpenRig {
 public:
  ComposedRig(const RigSettings& settings, nlohmann::json resolved, Clock& clock,
              std::uint64_t seed, Share simulated, LinkTap* tap)
      : resolved_(std::move(resolved)), clock_(clock) {
    rig_.title = settings.title;
    rig_.model = settings.model;
    complete_model(settings);
    const sim::OpticsSample bench = sim::sample_bench(settings.laboratory, settings.optics, seed);
    if (simulated != Share::none)
      world_ = std::make_unique<sim::Laboratory>(sim::with_optics(settings.laboratory, bench),
                                                 clock, seed);
    // Only where all is simulated may a script change the world, and is there a truth: an eye that
    // is drawn beside a real camera judges nothing.
    if (simulated == Share::all) rig_.simulation = &simulation_.emplace(*world_, bench, seed);
    if (world_) open_simulated(settings, seed);
    if (settings.sample)
      rig_.sample = &sample_.emplace(world_ ? &world_->sample() : nullptr, rig_.model,
                                     settings.sample_by_hand);
    RigContext where{clock, world_.get()};
    where.rig = &resolved_;
    where.tap = tap;
    where.reloadable = &reloadable_;
    open_instruments(settings, where);
    rig_.reload = [this](const std::string& role) { return reload(role); };
  }
  // While every member is still alive; what fails here has no caller to hear of it.
  ~ComposedRig() override { make_safe(); }
  Rig& rig() override { return rig_; }
  const nlohmann::json& resolved() const override { return resolved_; }
  void on_unguarded(std::function<void(const std::string&)> listener) override {
    on_unguarded_ = std::move(listener);
  }
  sim::Laboratory* laboratory() override { return simulation_ ? world_.get() : nullptr; }

  // Each device on its own: one that fails does not keep the others from their safe state. A stop
  // that arrives meanwhile waits.
  std::vector<std::string> make_safe() override {
    const StopShield shield(clock_);
    std::vector<std::string> failures;
    const auto attempt = [&failures](auto action) {
      try {
        action();
      } catch (const std::exception& error) {
        failures.emplace_back(error.what());
      }
    };
    // The most dangerous first: currents, light, motion.
    if (rig_.coils != nullptr) attempt([&] { rig_.coils->make_safe(); });
    if (rig_.lamp != nullptr) attempt([&] { rig_.lamp->make_safe(); });
    if (rig_.lens_mover != nullptr) attempt([&] { rig_.lens_mover->make_safe(); });
    if (rig_.stage != nullptr) attempt([&] { rig_.stage->make_safe(); });
    if (rig_.rotation_stage != nullptr) attempt([&] { rig_.rotation_stage->make_safe(); });
    for (const FreeRole& one : rig_.free_roles) attempt([&] { make_free_safe(one); });
    return failures;
  }

 private:
  RigSource reload(const std::string& role) {
    const auto found = reloadable_.find(role);
    if (found == reloadable_.end()) {
      const std::vector<std::string> roles = rig_.roles();
      const bool there = std::find(roles.begin(), roles.end(), role) != roles.end();
      std::string known;
      for (const auto& [name, one] : reloadable_) known += (known.empty() ? "" : ", ") + name;
      throw std::invalid_argument("role: " +
                                  (there ? role + " is no instrument of a Lua file"
                                         : "there is no " + role + " in this rig") +
                                  (known.empty() ? "" : "; such are: " + known));
    }
    const std::string why = held_by(role);
    if (!why.empty()) throw DeviceError(DeviceErrorKind::refused, role, why);
    return found->second->reload();
  }

  /// Why the instrument must stay as it is now; empty: nothing keeps it.
  std::string held_by(const std::string& role) {
    const auto input = std::find_if(
        rig_.free_roles.begin(), rig_.free_roles.end(),
        [&](const FreeRole& one) { return one.name == role && one.kind == "interlock_input"; });
    const bool guards =
        role == "coils" || role == "current_sensor" || input != rig_.free_roles.end();
    if (guards && interlock_ && interlock_->energized())
      return "the coils carry a current: rig.coils:set_currents to zero, or end what holds them";
    const bool free = std::any_of(rig_.free_roles.begin(), rig_.free_roles.end(),
                                  [&](const FreeRole& one) { return one.name == role; });
    if ((guards || !free) && interlock_ && interlock_->has_loop())
      return "a servo loop uses the rig: close it before";
    if (!reloadable_.at(role)->in_use()) return "";
    return role == "lamp"
               ? "it burns: rig.lamp:set_level(0) before"
               : "it may be on, or moves: it was set, or told to, since it was last made "
                 "safe. rig." +
                     role + ":make_safe(), or stop it, before";
  }

  /// What the model has beyond the rig file's numbers: how this view projects.
  void complete_model(const RigSettings& settings) {
    rig_.model.plain_view = settings.laboratory.top_view == sim::TopView::plain;
    if (settings.laboratory.top_view == sim::TopView::bare_sensor)
      rig_.model.microscope = sim::bare_sensor(settings.model.eye, settings.model.microscope.focus,
                                               settings.laboratory.sensor_aperture);
    rig_.model.projection = optics::fit_single_viewpoint(rig_.model.eye, rig_.model.microscope,
                                                         settings.projection_reach);
    if (settings.exact_projection)
      rig_.model.exact.emplace(rig_.model.eye, rig_.model.microscope, settings.projection_reach);
  }

  /// The roles that the simulated laboratory itself plays.
  void open_simulated(const RigSettings& settings, std::uint64_t seed) {
    if (settings.top_camera && !settings.top) rig_.top_camera = &world_->top_camera();
    if (settings.side_camera && !settings.side) rig_.side_camera = &world_->side_camera();
    if (!settings.pose_sensor) return;
    // The pose sensor is given functions and not the laboratory: poses are all that it can learn.
    const auto truth = [this](Time time) -> std::optional<Eigen::Vector3d> {
      const auto known = world_->truth(time);
      return known ? std::optional(known->position) : std::nullopt;
    };
    const auto axis = [this](Time time) -> std::optional<Eigen::Vector3d> {
      const auto known = world_->truth(time);
      return known ? std::optional(known->axis) : std::nullopt;
    };
    sim::PoseSensorSettings sensor = *settings.pose_sensor;
    sensor.latency = world_->latency_of(sensor.latency);
    pose_sensor_ = sim::make_pose_sensor(sensor, truth, clock_, seed,
                                         &world_->faults().looks["pose_sensor"], axis);
    rig_.pose_sensor = pose_sensor_.get();
  }

  // The chain of the coils: amplifier <- guarded (arms the guardian) <- interlock <- all others.
  void open_instruments(const RigSettings& settings, const RigContext& where) {
    // Before anything is opened that can be energized.
    if (settings.guardian)
      guardian_ = std::make_unique<Guardian>(settings.guarded,
                                             [this] { return clock_.stuck_for() < kStuck; });
    if (settings.coils) {
      coils_ = settings.coils(where);
      if (guardian_) guarded_ = guarded(*coils_.device, *guardian_);
      rig_.coil_pause = settings.coil_pause;
      // The amplifier itself goes no further: rig_.coils is the interlock, and nothing else leads
      // to the outputs.
      interlock_ = std::make_unique<Interlock>(guarded_ ? *guarded_ : *coils_.device,
                                               settings.limits, &clock_);
      rig_.coils = interlock_.get();
      open_heartbeat(settings, where);
      open_current_sensor(settings, where);
    }
    if (settings.top) rig_.top_camera = (top_ = settings.top(where)).device.get();
    if (settings.side) rig_.side_camera = (side_ = settings.side(where)).device.get();
    if (settings.joystick) rig_.joystick = (joystick_ = settings.joystick(where)).device.get();
    if (settings.pedal) rig_.pedal = (pedal_ = settings.pedal(where)).device.get();
    // It asks through rig_ at each time: the pedal may be lost and opened again.
    if (settings.dead_man_pedals != 0)
      interlock_->require(
          "the pedal is released, or gone",
          [this, held = settings.dead_man_pedals] { return is_held(rig_.pedal, held); });
    if (settings.lamp) open_lamp(settings, where);
    rig_.lamp_level = settings.lamp_level;
    if (settings.lens_mover)
      rig_.lens_mover = (lens_mover_ = settings.lens_mover(where)).device.get();
    // Stages before the probe: what stands on a stage asks where it is (RigContext::places).
    if (settings.stage) rig_.stage = (stage_ = settings.stage(where)).device.get();
    if (settings.rotation_stage)
      rig_.rotation_stage = (rotation_stage_ = settings.rotation_stage(where)).device.get();
    if (settings.field_probe)
      rig_.field_probe = (field_probe_ = settings.field_probe(where)).device.get();
    for (const FreeRoleSettings& one : settings.free_roles) open_free_role(one, where);
    if (guardian_) guardian_watch_ = clock_.spawn("guardian", [this] { watch_guardian(); });
  }

  void open_free_role(const FreeRoleSettings& settings, const RigContext& where) {
    std::visit(
        [&]<class Role>(const Opener<Role>& open) {
          auto opened = std::make_shared<Opened<Role>>(open(where));
          Role* device = opened->device.get();
          free_.push_back(opened);
          if constexpr (std::is_same_v<Role, Instrument>) {
            if (settings.guarded && guardian_) {
              const std::shared_ptr<Instrument> own = guarded(*device, *guardian_, settings.name);
              free_.push_back(own);
              device = own.get();
            }
            if (settings.kind == "interlock_input") watch_input(settings.name, *device);
          }
          rig_.free_roles.push_back({settings.name, settings.kind, device});
        },
        settings.opener);
  }

  /// A chiller's contact, a door: open, gone or silent, it is a condition that does not hold.
  void watch_input(const std::string& name, const Instrument& input) {
    if (!interlock_) return;
    interlock_->require(name + " is open, or gone",
                        [this, &input] { return is_closed(input, clock_.now()); });
  }

  /// The line that the heartbeat toggles: the amplifiers' own, or that of another device.
  void open_heartbeat(const RigSettings& settings, const RigContext& where) {
    if (!settings.heartbeat) return;
    if (settings.enable_line) enable_line_ = settings.enable_line(where);
    rig_.enable_line =
        enable_line_.device ? enable_line_.device.get() : coils_.device->enable_line();
    interlock_->beat_on(*rig_.enable_line, *settings.heartbeat);
  }

  void open_current_sensor(const RigSettings& settings, const RigContext& where) {
    if (!settings.current_sensor) return;
    current_sensor_ = settings.current_sensor(where);
    rig_.current_sensor = current_sensor_.device.get();
    interlock_->watch_by(*rig_.current_sensor, settings.current_watch);
  }

  void open_lamp(const RigSettings& settings, const RigContext& where) {
    lamp_ = settings.lamp(where);
    if (guardian_) guarded_lamp_ = guarded(*lamp_.device, *guardian_);
    watched_lamp_ = std::make_unique<WatchedLamp>(guarded_lamp_ ? *guarded_lamp_ : *lamp_.device,
                                                  clock_, [this](const std::string& why) {
                                                    if (on_unguarded_) on_unguarded_(why);
                                                  });
    if (settings.lamp_heartbeat) watched_lamp_->beat(*settings.lamp_heartbeat);
    rig_.lamp = watched_lamp_.get();
  }

  // A current or a light that is held must not go on unguarded; no set-point may come for long, so
  // the loss is watched for and not only met.
  void watch_guardian() {
    for (std::string told;; clock_.sleep_for(kGuardianLook)) {
      const std::string why = guardian_->trouble();
      if (std::exchange(told, why) != why && !why.empty()) unguarded(why);
    }
  }

  void unguarded(const std::string& why) {
    // What fails is in the trip's own text, and in what make_safe() reports at the run's end.
    const auto attempt = [](auto action) {
      try {
        action();
      } catch (const DeviceError&) {
      }
    };
    if (interlock_) attempt([&] { interlock_->trip(why); });
    if (rig_.lamp != nullptr) attempt([&] { rig_.lamp->make_safe(); });
    if (on_unguarded_) on_unguarded_(why);
  }

  nlohmann::json resolved_;
  std::map<std::string, Reloadable*> reloadable_;  // by role
  Clock& clock_;
  std::unique_ptr<sim::Laboratory> world_;  // null: nothing is simulated
  std::optional<SimulationCommands> simulation_;
  std::unique_ptr<PoseSensor> pose_sensor_;
  std::optional<RigSample> sample_;
  Opened<Camera> top_, side_;
  Opened<OperatorInput> joystick_, pedal_;  // before the interlock, which asks the pedal
  std::unique_ptr<Guardian> guardian_;
  Opened<Lamp> lamp_;
  std::unique_ptr<Lamp> guarded_lamp_;
  std::unique_ptr<WatchedLamp> watched_lamp_;
  Opened<CoilAmplifier> coils_;
  std::unique_ptr<CoilAmplifier> guarded_;
  Opened<EnableLine> enable_line_;
  Opened<CurrentSensor> current_sensor_;
  std::unique_ptr<Interlock> interlock_;
  Opened<LensMover> lens_mover_;
  Opened<Stage> stage_;
  Opened<RotationStage> rotation_stage_;
  Opened<FieldProbe> field_probe_;
  std::vector<std::shared_ptr<void>> free_;  // opened, and what guards it, in the order of birth
  Rig rig_;
  std::function<void(const std::string&)> on_unguarded_;
  std::unique_ptr<Task> guardian_watch_;  // last: it uses the others
};

/// Files are named from where the rig file that names them stands.
/// source_of(): a key that a base states is relative to the base, so that a rig in another folder
/// can build on it.
std::string beside(const RigDescription& rig, const std::string& key, const std::string& name) {
  return (std::filesystem::path(rig.source_of(key).file).parent_path() / name).string();
}

// What the loop believes of the field. Unlike the truth's (read_calibration()), its coils are taken
// in the order of the file.
control::MultipoleField model_calibration(const std::string& file,
                                          std::vector<std::string>& warnings) {
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  if (!stream) throw ConfigError(file + ": the field's calibration cannot be read");
  try {
    control::FieldCalibration read = parse_field_calibration(text.str());
    for (const std::string& warning : read.warnings) warnings.push_back(file + ": " + warning);
    return std::move(read.field);
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(file + ": " + problem.what());
  }
}

/// A calibration changes what the loop believes; the simulated cameras stay as the rig file has
/// them.
void keep_simulated_cameras(const RigDescription& rig, sim::LaboratorySettings& laboratory) {
  const Calibrations calibrations = Calibrations::of(rig);
  for (const Calibration& one : calibrations.list) {
    // A rig file without a pupil has a telecentric microscope.
    if (one.name == "top_camera.microscope.pupil_distance" &&
        (one.instead_of || (calibrations.installed && one.file == calibrations.installed->file)))
      laboratory.microscope.pupil_distance =
          one.instead_of.value_or(std::numeric_limits<double>::infinity());
    if (!one.instead_of) continue;
    // `instead_of` is what the rig file itself says: in a simulated laboratory that is how the
    // camera was built, and the calibration what was measured of it.
    if (one.name == "top_camera.effective_pixel") laboratory.top_image.pixel = *one.instead_of;
    if (one.name == "side_camera.effective_pixel") laboratory.side_pixel = *one.instead_of;
  }
}

}  // namespace

std::vector<std::string> Rig::fitting(const std::string& need) const {
  const std::vector<std::string> names = roles();
  if (std::find(names.begin(), names.end(), need) != names.end()) return {need};
  std::vector<std::string> fitting;
  const std::size_t colon = need.find(':');
  for (const FreeRole& one : free_roles) {
    if (one.kind != need.substr(0, colon)) continue;
    auto* const* instrument = std::get_if<Instrument*>(&one.device);
    if (colon == std::string::npos ||
        (instrument != nullptr && (*instrument)->info().measures == need.substr(colon + 1)))
      fitting.push_back(one.name);
  }
  return fitting;
}

std::vector<std::string> Rig::roles() const {
  std::vector<std::string> names;
  if (coils != nullptr) names.emplace_back("coils");
  if (field_probe != nullptr) names.emplace_back("field_probe");
  if (joystick != nullptr) names.emplace_back("joystick");
  if (lamp != nullptr) names.emplace_back("lamp");
  if (lens_mover != nullptr) names.emplace_back("lens_mover");
  if (pedal != nullptr) names.emplace_back("pedal");
  if (pose_sensor != nullptr) names.emplace_back("pose_sensor");
  if (rotation_stage != nullptr) names.emplace_back("rotation_stage");
  if (sample != nullptr) names.emplace_back("sample");
  if (side_camera != nullptr) names.emplace_back("side_camera");
  if (stage != nullptr) names.emplace_back("stage");
  if (top_camera != nullptr) names.emplace_back("top_camera");
  for (const FreeRole& one : free_roles) names.push_back(one.name);
  std::sort(names.begin(), names.end());
  return names;
}

// check_rig() first, so that nothing is opened of a rig with any error. Then in this order: files
// of the model, files of the truth, and instruments last. An std::invalid_argument of whatever is
// built is an error of the rig file.
void switch_light_on(Rig& rig) {
  if (rig.lamp != nullptr && rig.lamp_level > 0) rig.lamp->set_level(rig.lamp_level);
}

std::unique_ptr<OpenRig> open_rig(const RigDescription& description, Clock& clock,
                                  std::uint64_t seed, const SimulationShifts& shifts,
                                  LinkTap* tap) {
  check_rig(description);
  ConfigReader reader(description);
  RigSettings settings = read_rig_settings(reader);
  sim::LaboratorySettings& laboratory = settings.laboratory;
  if (!laboratory.fundus.empty())
    laboratory.fundus = beside(description, "truth.fundus", laboratory.fundus);
  std::vector<std::string> warnings = settings.warnings;
  if (!settings.field_calibration.empty())
    settings.model.field = laboratory.believed_field = model_calibration(
        beside(description, "model.calibration", settings.field_calibration), warnings);
  take_chain(description, settings.chain, settings.model, warnings);
  keep_simulated_cameras(description, laboratory);
  settings.laboratory.truth_shift = shifts.truth;
  settings.laboratory.drawn_shift = shifts.drawn;
  try {
    if (!settings.calibration.empty()) {
      try {
        MeasuredField measured = read_calibration(
            beside(description, "truth.calibration", settings.calibration), laboratory.world.field);
        laboratory.world.field = std::move(measured.field);
        warnings.insert(warnings.end(), measured.warnings.begin(), measured.warnings.end());
      } catch (const std::invalid_argument& problem) {
        throw std::invalid_argument(std::string("truth.calibration: ") + problem.what());
      }
    }
    const Share simulated = !has_real_instruments(description) ? Share::all
                            : simulates_something(description) ? Share::some
                                                               : Share::none;
    auto opened =
        std::make_unique<ComposedRig>(settings, reader.resolved(), clock, seed, simulated, tap);
    opened->rig().warnings = std::move(warnings);
    return opened;
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(description.file + ": " + problem.what());
  }
}

}  // namespace vitreo
