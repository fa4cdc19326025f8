// SPDX-License-Identifier: Apache-2.0
#include "host/rig/rig_settings.h"

#include "control/robots.h"
#include "devices/instruments/rescues.h"
#include "devices/links/serial_link.h"
#include "host/config/rights.h"
#include "host/rig/bench_settings.h"
#include "host/rig/calibrations.h"
#include "host/rig/instrument_file.h"
#include "host/rig/plant_settings.h"
#include "optics/system/prescriptions.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <sstream>
#include <stdexcept>

namespace vitreo {
namespace {

constexpr double kMillimeter = 1e-3;

/// Its table `bench` is read when the cameras and the plant are known: see read_rig_settings().
void read_uncertainty(ConfigReader reader, ViewUncertainty& known) {
  known.size = reader.number("size", known.size, {0, 0.5, ""});
  known.pixel = reader.number("pixel", known.pixel, {0, 0.5, ""});
  known.tilt = reader.number("tilt", known.tilt, {0, 0.5, "rad"});
  known.eye = reader.number("eye", known.eye, {0, 10 * kMillimeter, "m"});
  reader.table("bench");
  reader.finish();
}

// What the loop believes. The bounds keep a slip of a unit out (5 instead of 5 * mm), not a bad
// choice. `field` has one value today; it is read so that a rig file can state it.
void read_model(ConfigReader reader, RigSettings& settings) {
  RigModel& model = settings.model;
  model.eye_name = reader.choice("eye", model.eye_name,
                                 {"model_eye_5_3", "navarro_condensing", "porcine_condensing"});
  model.eye = optics::prescription(model.eye_name).system;
  model.eye_in_world = reader.vector3("eye_in_world", model.eye_in_world, {-20e-3, 20e-3, "m"});
  const auto& robots = control::robot_names();
  model.robot = control::robot_named(
      reader.choice("robot", "coni_2mm", std::vector<std::string>(robots.begin(), robots.end())));
  // Of its surface and, where the localizer estimates how it lies, of its outline.
  if (reader.choice("shape", "own", {"own", "ellipsoid"}) == "ellipsoid")
    model.robot.shape = control::BodyShape::ellipsoid;
  // Of calibrate_robot: against what outline, volume and medium say.
  model.robot.drag_along = reader.number("drag_along", 1, {0.1, 10, ""});
  model.robot.drag_across = reader.number("drag_across", 1, {0.1, 10, ""});
  model.robot.moment_factor = reader.number("moment", 1, {0.1, 10, ""});
  reader.choice("field", "octomag", {"octomag"});
  settings.field_calibration = reader.text("calibration", "");
  settings.chain = reader.text("chain", "");
  model.command_delay = reader.number("coil_delay", model.command_delay, {0, 0.3, "s"});
  model.command_bandwidth =
      reader.number("coil_bandwidth", model.command_bandwidth, {0.1, 10000, "Hz"});
  read_uncertainty(reader.table("uncertainty"), model.uncertainty);
  ConfigReader medium = reader.table("medium");
  model.medium.name = medium.text("name", model.medium.name);
  model.medium.density = medium.number("density", model.medium.density, {500, 3000, "kg/m^3"});
  model.medium.kinematic_viscosity =
      medium.number("kinematic_viscosity", model.medium.kinematic_viscosity, {1e-7, 1, "m^2/s"});
  medium.finish();
  reader.finish();
}

/// The margin of the robot's surface, and how well the view is known. Above 2 mm a margin would
/// leave hardly any place in the eye.
void read_keep_out(ConfigReader reader, KeepOutSettings& keep_out) {
  keep_out.margin = reader.number("margin", keep_out.margin, {0, 2 * kMillimeter, "m"});
  keep_out.scale_uncertainty =
      reader.number("scale_uncertainty", keep_out.scale_uncertainty, {0, 0.2, ""});
  keep_out.eye_uncertain = reader.choice("eye", keep_out.eye_uncertain ? "table_5_1" : "known",
                                         {"known", "table_5_1"}) == "table_5_1";
  reader.finish();
}

// The default exposure is at most half a frame period and twice the latency.
void read_camera(ConfigReader& reader, sim::CameraSettings& camera, double& pixel) {
  camera.size.width = reader.integer("width_px", camera.size.width, 64, 8192);
  camera.size.height = reader.integer("height_px", camera.size.height, 64, 8192);
  camera.frame_rate = reader.number("frame_rate", camera.frame_rate, {0.1, 2000, "Hz"});
  // The simulated camera refuses 0.4 s and more.
  camera.latency = reader.number("latency", camera.latency, {0, 0.39, "s"});
  const double usual = std::min({camera.exposure, 0.5 / camera.frame_rate, 2 * camera.latency});
  camera.exposure = reader.number("exposure", usual, {0, 0.1, "s"});
  camera.jitter = reader.number("jitter", camera.jitter, {0, 0.1, "s"});
  pixel = reader.number("effective_pixel", pixel, {0.5e-6, 200e-6, "m"});
  ConfigReader sensor = reader.table("sensor");
  sim::Sensor& s = camera.sensor;
  s.color = sensor.choice("color", "gray", {"gray", "bayer"}) == "bayer" ? sim::SensorColor::bayer
                                                                         : sim::SensorColor::gray;
  s.full_well = sensor.number("full_well", s.full_well, {100, 1e6, ""});
  s.read_noise = sensor.number("read_noise", s.read_noise, {0, 1000, ""});
  s.brightness = sensor.number("brightness", s.brightness, {1, 1000, ""});
  s.vignette = sensor.number("vignette", s.vignette, {0, 0.95, ""});
  sensor.finish();
}

/// A simulated camera (a null opener), or an opener of a real one; both set the model's pixel size.
Opener<Camera> read_any_camera(ConfigReader& reader, const std::string& role, RigSettings& settings,
                               sim::CameraSettings& camera, double& pixel) {
  std::vector<std::string> names{"simulated"};
  for (const auto& entry : drivers<Camera>()) names.emplace_back(entry.name);
  const std::string driver = reader.choice("driver", "simulated", names);
  if (driver == "simulated") {
    read_camera(reader, camera, pixel);
    settings.links.loads.push_back({role, "an image", {}, true, camera.frame_rate});
    return nullptr;
  }
  // The model's image center and scale are computed before the camera is opened; a default would be
  // that of another camera.
  for (const char* key : {"width_px", "height_px", "effective_pixel"})
    if (!reader.has(key))
      reader.fail(key, "must be given for a real camera: the model of the view is made with it");
  const InstrumentReader instrument{reader, role, read_address(reader), settings.laboratory,
                                    settings.links};
  pixel = reader.number("effective_pixel", pixel, {0.5e-6, 200e-6, "m"});
  camera.size.width = reader.integer("width_px", camera.size.width, 1, 1 << 16);
  camera.size.height = reader.integer("height_px", camera.size.height, 1, 1 << 16);
  for (const auto& entry : drivers<Camera>())
    if (entry.name == driver) return explained(instrument, entry.read(instrument));
  reader.fail("driver", "is not known");
}

// The order matters: the size of the image decides the default center, and `view` decides which
// optics the laboratory builds. `projection_reach` bounds the fit of the single viewpoint, thesis
// (5.2) to (5.11), to where the robot can be.
void read_top_camera(ConfigReader reader, RigSettings& settings) {
  settings.top_camera = true;
  sim::CameraSettings& camera = settings.laboratory.top;
  const std::string view =
      reader.choice("view", "microscope", {"microscope", "bare_sensor", "plain"});
  settings.laboratory.top_view = view == "plain"         ? sim::TopView::plain
                                 : view == "bare_sensor" ? sim::TopView::bare_sensor
                                                         : sim::TopView::microscope;
  settings.laboratory.sensor_aperture =
      reader.number("sensor_aperture", settings.laboratory.sensor_aperture, {0.005, 0.4, ""});
  optics::ImageScale& image = settings.model.top_image;
  settings.top = read_any_camera(reader, "top_camera", settings, camera, image.pixel);
  const Eigen::Vector2d middle((camera.size.width - 1) / 2.0, (camera.size.height - 1) / 2.0);
  image.center_px = reader.vector2("center_px", middle, {-8192, 8192, ""});
  optics::Microscope& microscope = settings.model.microscope;
  ConfigReader m = reader.table("microscope");
  microscope.numerical_aperture =
      m.number("numerical_aperture", microscope.numerical_aperture, {0.002, 0.15, ""});
  microscope.focus =
      m.number("focus", microscope.focus, {-50 * kMillimeter, 100 * kMillimeter, "m"});
  if (m.has("pupil_distance"))
    microscope.pupil_distance =
        m.number("pupil_distance", 150 * kMillimeter, {20 * kMillimeter, 100, "m"});
  microscope.decenter =
      m.vector2("decenter", microscope.decenter, {-3 * kMillimeter, 3 * kMillimeter, "m"});
  microscope.tilt = m.vector2("tilt", microscope.tilt, {-0.1, 0.1, "rad"});
  m.finish();
  settings.exact_projection =
      reader.choice("projection", "single_viewpoint", {"single_viewpoint", "exact"}) == "exact";
  settings.projection_reach = reader.number("projection_reach", settings.projection_reach,
                                            {1 * kMillimeter, 10 * kMillimeter, "m"});
  reader.finish();
}

void read_side_camera(ConfigReader reader, RigSettings& settings) {
  settings.side_camera = true;
  sim::CameraSettings& camera = settings.laboratory.side;
  camera.size = {656, 490};
  settings.side =
      read_any_camera(reader, "side_camera", settings, camera, settings.model.side_pixel);
  const Eigen::Vector2d middle((camera.size.width - 1) / 2.0, (camera.size.height - 1) / 2.0);
  settings.model.side_center_px = reader.vector2("center_px", middle, {-8192, 8192, ""});
  reader.finish();
}

/// What the guardian gets are numbers: of a choice of the line, its place among the choices.
double number_for_guardian(const std::string& key, const nlohmann::json& value) {
  if (!value.is_string()) return value.get<double>();
  const std::vector<std::string>& names = key == "parity" ? parity_names() : flow_names();
  return static_cast<double>(std::find(names.begin(), names.end(), value.get<std::string>()) -
                             names.begin());
}

/// A role's output that the guardian must bring to zero. It gets it as text: nothing in this
/// program's memory outlives it. `guardian = true` on an emulated instrument starts one without a
/// duty; without it an instrument that can do harm is energized unguarded, which the record shows.
void read_guardian(ConfigReader& reader, RigSettings& settings) {
  const std::string address = reader.text("address", "emulated");
  // On by default exactly where something real is energized.
  const bool wanted = reader.flag("guardian", address != "emulated");
  settings.guardian = settings.guardian || wanted;
  if (!wanted || address == "emulated") return;
  guardian::Output output{reader.resolved().at("driver").get<std::string>(), address};
  const Rescue* const rescue = find_rescue(output.driver);
  output.script = rescue_text(reader);
  if (rescue == nullptr && output.script.empty())
    reader.fail("driver", "\"" + output.driver +
                              "\" has no rescue, so the guardian cannot bring it to zero; guardian "
                              "= false leaves it unguarded");
  // Read back from the resolved table: the defaults of the driver's own reader are in it too.
  const std::vector<std::string> wants = rescue == nullptr ? kLineKeys : rescue->settings;
  for (const std::string& key : wants)
    if (const auto found = reader.resolved().find(key); found != reader.resolved().end())
      output.settings[key] = number_for_guardian(key, *found);
  settings.guarded.push_back(output);
}

/// The same of all lines that there can be.
HeartbeatSettings read_heartbeat(ConfigReader& reader) {
  HeartbeatSettings beat;
  beat.rate = reader.number("heartbeat", beat.rate, {10, 100, "Hz"});
  beat.one_shot = reader.number("one_shot", beat.one_shot, {1e-3, 1, "s"});
  beat.pick_up = reader.number("pick_up", beat.pick_up, {0, 1, "s"});
  beat.answer_within = reader.number("answer_within", beat.answer_within, {0.01, 5, "s"});
  try {
    beat.check();
  } catch (const std::invalid_argument& problem) {
    reader.fail("one_shot", problem.what());
  }
  return beat;
}

void read_coils_heartbeat(ConfigReader& reader, RigSettings& settings) {
  settings.heartbeat = read_heartbeat(reader);
  settings.laboratory.world.coils.one_shot = settings.heartbeat->one_shot;
}

void want_line(ConfigReader& reader, const char* which) {
  if (reader.has("enable_line")) return;
  reader.fail("heartbeat", std::string("wants the line that it toggles: ") + which);
}

/// A static `enable_line` holds its level when the host is gone; with `heartbeat` it is toggled.
void read_own_line(ConfigReader& reader, RigSettings& settings) {
  if (!reader.has("heartbeat")) return;
  want_line(reader, "enable_line, or the role enable_line");
  read_coils_heartbeat(reader, settings);
  settings.laboratory.enable_line = reader.integer("enable_line", 0, 0, 7);
}

// The interlock's limit of a channel is interlock_current, else the amplifier's current_limit.
void read_coils(ConfigReader reader, RigSettings& settings) {
  settings.coils =
      read_instrument<CoilAmplifier>(reader, "coils", settings.laboratory, settings.links);
  // Where the file states the amplifier's limit, that is the interlock's default too: one number
  // limits both.
  const double limit = reader.has("current_limit")
                           ? reader.number("current_limit", 0, {0.1, 20, "A"})
                           : settings.limits.current;
  settings.limits.current = reader.number("interlock_current", limit, {0.1, 20, "A"});
  for (const double channel : reader.numbers("dead", {}, {1, control::kMaxCoils, ""})) {
    if (channel != std::floor(channel))
      reader.fail("dead", "wants the numbers of channels, from 1");
    settings.model.dead_coils.push_back(static_cast<int>(channel));
  }
  settings.limits.total_current =
      reader.number("interlock_total_current", settings.limits.total_current, {0.1, 160, "A"});
  settings.limits.slew = reader.number("interlock_slew", settings.limits.slew, {1, 1e6, "A/s"});
  settings.limits.read_back =
      reader.number("interlock_read_back", settings.limits.read_back, {0.01, 5, "A"});
  settings.limits.dead_man = reader.number("dead_man", settings.limits.dead_man, {0.05, 5, "s"});
  CoilHeat& heat = settings.limits.heat;
  heat.resistance = reader.number("resistance", heat.resistance, {0, 100, ""});
  heat.heat_capacity = reader.number("heat_capacity", heat.heat_capacity, {1, 1e6, ""});
  heat.thermal_resistance =
      reader.number("thermal_resistance", heat.thermal_resistance, {1e-3, 1e3, ""});
  heat.limit = reader.number("temperature_limit", heat.limit, {300, 500, "K"});
  read_own_line(reader, settings);
  const std::string pause = reader.choice("pause", "hold", {"hold", "ramp", "zero"});
  settings.coil_pause = pause == "ramp"   ? PausePolicy::ramp
                        : pause == "zero" ? PausePolicy::zero
                                          : PausePolicy::hold;
  read_guardian(reader, settings);
  reader.finish();
}

/// A role that has only its driver's settings; nothing where the rig has no such table.
template <class Role>
void read_role(ConfigReader& rig, const char* role, RigSettings& settings, Opener<Role>& opener) {
  if (!rig.has(role)) return;
  ConfigReader reader = rig.table(role);
  opener = read_instrument<Role>(reader, role, settings.laboratory, settings.links);
  reader.finish();
}

/// enable_line = { driver = "serial_line", ... }: a line of another device than the amplifiers'.
void read_enable_line(ConfigReader reader, RigSettings& settings) {
  settings.enable_line =
      read_instrument<EnableLine>(reader, "enable_line", settings.laboratory, settings.links);
  if (!settings.coils) reader.fail("driver", "is of use only with the role coils");
  if (settings.heartbeat)
    reader.fail("driver", "is a second line: coils.heartbeat toggles one already");
  read_coils_heartbeat(reader, settings);
  reader.finish();
}

/// What it measures is compared with what was set: `tolerance`, `settling`, `period`, `timeout`.
void read_current_sensor(ConfigReader reader, RigSettings& settings) {
  settings.current_sensor =
      read_instrument<CurrentSensor>(reader, "current_sensor", settings.laboratory, settings.links);
  if (!settings.coils) reader.fail("driver", "is of use only with the role coils");
  CurrentWatchSettings& watch = settings.current_watch;
  watch.tolerance = reader.number("tolerance", watch.tolerance, {1e-3, 5, "A"});
  watch.settling = reader.number("settling", watch.settling, {0, 5, "s"});
  watch.period = reader.number("period", watch.period, {1e-3, 1, "s"});
  watch.timeout = reader.number("timeout", watch.timeout, {1e-3, 5, "s"});
  reader.finish();
}

/// dead_man = { 1, 3 }: these pedals, counted from 1, must be held while the coils are energized.
void read_pedal(ConfigReader reader, RigSettings& settings) {
  settings.pedal = read_instrument<OperatorInput>(reader, "pedal", settings.laboratory,
                                                  settings.links, "foot_pedal");
  for (const double pedal : reader.numbers("dead_man", {}, {1, 32, ""})) {
    if (pedal != std::floor(pedal)) reader.fail("dead_man", "wants the numbers of pedals, from 1");
    settings.dead_man_pedals |= 1U << (static_cast<unsigned>(pedal) - 1);
  }
  // Coils are read before the pedal: see read_rig_settings().
  if (settings.dead_man_pedals != 0 && !settings.coils)
    reader.fail("dead_man", "is of use only with the role coils");
  reader.finish();
}

// The one role that gives the truth to a script; check_rig() refuses it beside real instruments.
/// Which axis is focus is the rig's matter, not the driver's: it follows from how it is mounted.
void read_stage(ConfigReader reader, RigSettings& settings) {
  settings.stage = read_instrument<Stage>(reader, "stage", settings.laboratory, settings.links);
  settings.model.focus_axis =
      reader.choice("focus_axis", settings.model.focus_axis, {"x", "y", "z"});
  reader.finish();
}

void read_lamp(ConfigReader reader, RigSettings& settings) {
  settings.lamp = read_instrument<Lamp>(reader, "lamp", settings.laboratory, settings.links);
  settings.lamp_level = reader.number("level", settings.lamp_level, {0, 1, ""});
  if (reader.has("heartbeat")) {
    want_line(reader, "enable_line");
    settings.lamp_heartbeat = read_heartbeat(reader);
  }
  read_guardian(reader, settings);
  reader.finish();
}

/// The kinds, other than instruments of one Lua file, of which a rig can have several.
struct Several {
  const char* kind;
  bool (*has)(const std::string& driver);
};
template <class Role>
bool has_driver(const std::string& driver) {
  const auto& all = drivers<Role>();
  return std::any_of(all.begin(), all.end(),
                     [&](const DriverEntry<Role>& one) { return one.name == driver; });
}
constexpr Several kSeveral[] = {{"stage", has_driver<Stage>},
                                {"rotation_stage", has_driver<RotationStage>},
                                {"field_probe", has_driver<FieldProbe>},
                                {"operator_input", has_driver<OperatorInput>}};

/// The kind of a free role: what its Lua file declares, what its table says, or the only one that
/// has a driver of that name.
std::string kind_of(ConfigReader& reader, std::string& measures) {
  if (const auto file =
          find_instrument_file(reader.rig(), reader.file_of("driver"), reader.peek("driver"))) {
    const scripted::Loaded loaded = load_instrument(*file);
    measures = loaded.declaration.measures;
    return loaded.declaration.kind;
  }
  std::vector<std::string> kinds;
  for (const Several& one : kSeveral)
    if (one.has(reader.peek("driver"))) kinds.emplace_back(one.kind);
  if (kinds.empty()) {
    std::vector<std::string> names = instrument_file_names(reader.rig());
    const std::string near = nearest(reader.peek("driver"), names);
    reader.fail("driver", "\"" + reader.peek("driver") +
                              "\" is neither a driver nor the name of an instrument's Lua file" +
                              (near.empty() ? "" : "; did you mean " + near + "?"));
  }
  return kinds.size() == 1 ? kinds.front() : reader.choice("kind", kinds.front(), kinds);
}

/// heater = { driver = "tc038d", address = "serial:..." }: a role under a name of the file's own.
void read_free_role(ConfigReader reader, const std::string& name, RigSettings& settings) {
  FreeRoleSettings role{.name = name, .kind{}, .measures{}, .opener{}};
  role.kind = kind_of(reader, role.measures);
  const auto read = [&]<class Role>(Opener<Role>*) {
    role.opener = read_instrument<Role>(reader, name, settings.laboratory, settings.links);
  };
  if (role.kind == "stage") {
    read(static_cast<Opener<Stage>*>(nullptr));
  } else if (role.kind == "rotation_stage") {
    read(static_cast<Opener<RotationStage>*>(nullptr));
  } else if (role.kind == "field_probe") {
    read(static_cast<Opener<FieldProbe>*>(nullptr));
  } else if (role.kind == "operator_input") {
    read(static_cast<Opener<OperatorInput>*>(nullptr));
  } else if (scripted::is_free(role.kind)) {
    read(static_cast<Opener<Instrument>*>(nullptr));
    const std::size_t before = settings.guarded.size();
    if (!rescue_text(reader).empty()) read_guardian(reader, settings);
    role.guarded = settings.guarded.size() > before;
  } else {
    reader.fail("driver", "is of the kind " + role.kind +
                              ": a rig has one of these, under the name " + role.kind);
  }
  reader.finish();
  settings.free_roles.push_back(std::move(role));
}

/// Tables of names that are no role's, and have a driver.
void read_free_roles(ConfigReader& reader, RigSettings& settings) {
  const std::vector<std::string>& fixed = role_names();
  for (const std::string& key : reader.keys()) {
    const auto* const table = std::get_if<ConfigTable>(&reader.rig().table.at(key).value);
    if (table == nullptr || std::find(fixed.begin(), fixed.end(), key) != fixed.end()) continue;
    if (text_of(*table, "driver").empty()) continue;
    read_free_role(reader.table(key), key, settings);
  }
}

void read_pose_sensor(ConfigReader reader, RigSettings& settings) {
  reader.choice("driver", "simulated", {"simulated"});
  sim::PoseSensorSettings& sensor = settings.pose_sensor.emplace();
  sensor.frame_rate = reader.number("frame_rate", sensor.frame_rate, {0.1, 2000, "Hz"});
  sensor.latency = reader.number("latency", sensor.latency, {0, 0.39, "s"});
  sensor.noise = reader.number("noise", sensor.noise, {1e-9, 1e-3, "m"});
  sensor.axis_noise = reader.number("axis_noise", sensor.axis_noise, {0, 0.5, "rad"});
  settings.links.loads.push_back({"pose_sensor", "a reading", {}, false, sensor.frame_rate});
  reader.finish();
}

void read_sample(ConfigReader reader, RigSettings& settings) {
  settings.sample = true;
  const bool person = reader.choice("driver", "simulated", {"simulated", "operator"}) == "operator";
  // Of the simulated one: asks all the same, as in a dry run of a laboratory's rig.
  settings.sample_by_hand = person || reader.flag("by_hand", false);
  // Of a person, in the twin and in the emulated laboratory.
  settings.laboratory.world.placement_scatter = reader.number(
      "placement_scatter", settings.laboratory.world.placement_scatter, {0, 2 * kMillimeter, "m"});
  // What is known of it, for the record, where the file says so: check_request() takes it.
  for (const char* const field :
       {"eye", "species", "age", "died", "removed", "pipette", "light", "robot"})
    if (reader.has(field)) reader.text(field, "");
  if (reader.has("eye")) settings.model.eye_id = reader.text("eye", "");
  reader.finish();
}

/// A person has the calibration's target in a drawer: where `truth` does not say what it is like,
/// the twin's and the emulated one is a ball, out of sight until it is placed.
void add_target(RigSettings& settings) {
  std::vector<sim::BodySettings>& bodies = settings.laboratory.world.bodies;
  const bool there = std::any_of(bodies.begin(), bodies.end(),
                                 [](const auto& body) { return body.name == "target"; });
  if (!settings.sample_by_hand || there) return;
  sim::BodySettings ball;
  ball.name = "target";
  ball.shape = sim::Shape::spheroid;
  ball.semi_axis = ball.semi_radius = 0.4 * kMillimeter;
  ball.position = {0.5, 0.5, 0.5};
  ball.axis = {0, 0, 1};
  ball.fixed = true;
  bodies.push_back(ball);
}

/// What the laboratory's plant is drawn about: what is believed. Two copies from here on: `truth`
/// and the draws (read_plant) change the laboratory's alone. The optics are as believed but for
/// what a script or the optical bench changes. The cavity is the retina's sphere, with the lens as
/// its lid.
void center_laboratory(RigSettings& settings) {
  sim::LaboratorySettings& laboratory = settings.laboratory;
  laboratory.eye = settings.model.eye;
  laboratory.microscope = settings.model.microscope;
  laboratory.top_image = settings.model.top_image;
  laboratory.side_pixel = settings.model.side_pixel;
  laboratory.side_center_px = settings.model.side_center_px;
  laboratory.world.field = laboratory.believed_field = settings.model.field;
  laboratory.world.robot = settings.model.robot;
  // What was identified of the robot is belief: its truth stays where it was.
  control::Robot& real = laboratory.world.robot;
  real.drag_along = real.drag_across = real.moment_factor = 1;
  laboratory.world.medium = settings.model.medium;
  laboratory.world.cavity.vertex = settings.model.eye_in_world;
  laboratory.world.cavity.radius = settings.model.eye.surfaces.front().radius;
  laboratory.world.cavity.lens_depth = settings.model.eye.vertex(2);
}

/// What a rig that does not say it knows of its bench follows from its camera and its plant.
BenchFacts bench_facts(const RigSettings& settings) {
  BenchFacts facts;
  facts.pictures = settings.top_camera;
  facts.shows_eye = settings.top_camera && settings.laboratory.top_view != sim::TopView::plain;
  facts.simulated = settings.top == nullptr;
  facts.plant = settings.optics;
  return facts;
}

}  // namespace

// Rights and calibrations are read for their errors and their place in the resolved rig; their
// users read them again. `truth` comes after all that center_laboratory() builds upon, and the
// bench's places after it: whether they are known by default depends on the plant.
RigSettings read_rig_settings(ConfigReader& reader) {
  RigSettings settings;
  settings.title = reader.text("title", "untitled rig");
  Rights::read(reader);
  Calibrations::read(reader);
  read_model(reader.table("model"), settings);
  read_keep_out(reader.table("keep_out"), settings.model.keep_out);
  if (reader.has("top_camera")) read_top_camera(reader.table("top_camera"), settings);
  if (reader.has("side_camera")) read_side_camera(reader.table("side_camera"), settings);
  if (reader.has("coils")) read_coils(reader.table("coils"), settings);
  if (reader.has("enable_line")) read_enable_line(reader.table("enable_line"), settings);
  if (reader.has("current_sensor")) read_current_sensor(reader.table("current_sensor"), settings);
  if (reader.has("pose_sensor")) read_pose_sensor(reader.table("pose_sensor"), settings);
  if (reader.has("sample")) read_sample(reader.table("sample"), settings);
  read_role(reader, "joystick", settings, settings.joystick);
  if (reader.has("pedal")) read_pedal(reader.table("pedal"), settings);
  if (reader.has("lamp")) read_lamp(reader.table("lamp"), settings);
  read_role(reader, "lens_mover", settings, settings.lens_mover);
  if (reader.has("stage")) read_stage(reader.table("stage"), settings);
  read_role(reader, "rotation_stage", settings, settings.rotation_stage);
  read_role(reader, "field_probe", settings, settings.field_probe);
  read_free_roles(reader, settings);
  center_laboratory(settings);
  read_plant(reader.table("truth"), settings.laboratory, settings.optics, settings.calibration);
  settings.model.uncertainty.bench =
      read_bench(reader.table("model").table("uncertainty").table("bench"), bench_facts(settings),
                 settings.warnings);
  add_target(settings);
  reader.finish();
  return settings;
}

namespace {

/// Of a list, one address a channel.
std::vector<std::string> addresses_in(const std::string& text) {
  std::vector<std::string> addresses;
  std::istringstream list(text);
  for (std::string one; std::getline(list, one, ',');)
    addresses.push_back(one.substr(std::min(one.find_first_not_of(' '), one.size())));
  return addresses;
}

/// Two roles cannot share a port, nor two channels of one; a folder or a film can be watched twice.
void check_addresses(const RigDescription& rig) {
  std::map<std::string, std::string> taken;
  for (const auto& [role, value] : rig.table) {
    const auto* const table = std::get_if<ConfigTable>(&value.value);
    if (table == nullptr || !table->contains("address")) continue;
    const auto* const address = std::get_if<std::string>(&table->at("address").value);
    if (address == nullptr || *address == "emulated" || is_recording(*address)) continue;
    const std::vector<std::string> addresses = addresses_in(*address);
    for (std::size_t i = 0; i < addresses.size(); ++i) {
      const std::string channel =
          addresses.size() > 1 ? fmt::format(", channel {}", i + 1) : std::string();
      const auto [first, is_new] = taken.emplace(addresses[i], role + channel);
      if (!is_new)
        throw ConfigError(rig.file + ": " + role + ".address" + channel + " is that of " +
                          first->second + " already: " + addresses[i]);
    }
  }
}

}  // namespace

// Everything that can be wrong without opening an instrument: a request is checked by this before
// anything is touched. limits.check() is the interlock's own, which would otherwise throw when the
// coils are open already.
std::vector<std::string> check_rig(const RigDescription& rig, std::vector<std::string>* kinds) {
  ConfigReader reader(rig);
  const RigSettings settings = read_rig_settings(reader);
  check_addresses(rig);
  if (settings.pose_sensor && has_real_instruments(rig))
    throw ConfigError(
        rig.file +
        ": pose_sensor: it knows the truth, so only a rig that is simulated throughout " +
        "may have one");
  try {
    settings.limits.check();
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(rig.file + ": " + problem.what());
  }
  std::vector<std::string> roles;
  for (const std::string& role : role_names())
    if (reader.has(role)) roles.push_back(role);
  for (const FreeRoleSettings& one : settings.free_roles) {
    roles.push_back(one.name);
    if (kinds == nullptr) continue;
    kinds->push_back(one.kind);
    if (!one.measures.empty()) kinds->push_back(one.kind + ":" + one.measures);
  }
  std::sort(roles.begin(), roles.end());
  return roles;
}

// An error ends the list: what was read before it is known all the same.
std::vector<KnownSetting> known_settings(const RigDescription& rig) {
  std::vector<KnownSetting> known;
  try {
    ConfigReader reader(rig, &known);
    read_rig_settings(reader);
  } catch (const ConfigError&) {
  }
  return known;
}

LinkLoads link_loads(const RigDescription& rig) {
  ConfigReader reader(rig);
  return read_rig_settings(reader).links;
}

}  // namespace vitreo
