// Bindings of the servo: its options, the calls that steer the loop and those that listen to it.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/control/bind_control.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/optics/localizer_calls.h"
#include "host/lua/rig/bind_rig.h"
#include "host/lua/rig/classes.h"
#include "host/lua/rig/servo_calls.h"
#include "host/lua/vision/bind_vision.h"
#include "host/servo/servo.h"
#include "host/servo/servo_cameras.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <variant>

namespace vitreo::lua {
namespace {

using namespace servo_calls;

/// Of go_to and follow: the robot's axis as a part of the reference.
void add_direction_options(std::vector<Argument>& keys) {
  keys.push_back({.name = "direction",
                  .type = Type::direction,
                  .optional = true,
                  .help = "of the robot's axis at the end (as it is)"});
  keys.push_back({.name = "turn_speed",
                  .type = Type::number,
                  .unit = "rad/s",
                  .optional = true,
                  .min = 1e-3,
                  .max = 3,
                  .help = "fastest of the axis' turn (0.35 rad/s)"});
}

/// Speed and acceleration are limits, not what is reached on a short way.
std::vector<Argument> limits_options() {
  return {number_option("speed", "m/s", 1e-6, 10e-3, "along the way (0.5 mm/s)"),
          number_option("acceleration", "m/s^2", 1e-5, 1, "along and across the way (2 mm/s^2)")};
}

/// Of go_to.
std::vector<Argument> travel_options() {
  const auto number = number_option;
  std::vector<Argument> keys = limits_options();
  for (Argument& key : std::vector<Argument>{
           number("within", "m", 1e-6, 10e-3, "how near is there (100 µm)"),
           number("settle", "s", 0, 600, "how long it must stay there (0.5 s)"),
           number("timeout", "s", 0, 3600, "how long it may take (twice the way's time and 20 s)"),
           number("within_angle", "rad", 1e-3, 1,
                  "how near the axis is to its direction, where it is measured (3 degrees)")})
    keys.push_back(std::move(key));
  add_direction_options(keys);
  return keys;
}

/// Of follow: a path ends when its time is over, so there is nothing to settle.
std::vector<Argument> follow_options() {
  std::vector<Argument> keys = travel_options();
  std::erase_if(keys, [](const Argument& key) {
    return key.name == "within" || key.name == "settle" || key.name == "within_angle";
  });
  keys.push_back({.name = "directions",
                  .type = Type::any,
                  .optional = true,
                  .help = "of the robot's axis at each position of the list"});
  keys.push_back({.name = "progress_to",
                  .type = Type::number,
                  .optional = true,
                  .min = 0,
                  .max = 1,
                  .help = "how far the run is at the path's end (1)"});
  keys.push_back({.name = "pictures",
                  .type = Type::integer,
                  .optional = true,
                  .min = 0,
                  .max = 50,
                  .help = "frames to keep for the report, evenly along the way (0)"});
  keys.push_back({.name = "label",
                  .type = Type::text,
                  .optional = true,
                  .help = "what the progress line says"});
  return keys;
}

/// A coil's channel, from 1. That the rig has as many is checked by the loop.
int channel_of(double number) {
  if (!(number >= 1 && number <= control::kMaxCoils && number == std::floor(number)))
    throw std::invalid_argument(fmt::format("dead_coils: wants numbers of coils, 1 to {}, got {}",
                                            control::kMaxCoils, format_number(number)));
  return static_cast<int>(number);
}

/// Puts a law and its gains into the settings. Of the estimator's gains those that were left out
/// stay empty: the loop tunes them by latency, drag and instability.
struct TakeLaw {
  ServoSettings& settings;
  void operator()(const control::PdGains& gains) const {
    settings.law = ControlLaw::pd;
    settings.gains = gains;
  }
  void operator()(const EstimatorGains& gains) const {
    settings.law = ControlLaw::estimator;
    settings.proportional = gains.proportional;
    settings.max_speed = gains.max_speed;
  }
  void operator()(const control::VelocityGains& gains) const {
    settings.law = ControlLaw::velocity;
    settings.velocity = gains;
  }
  void operator()(const RotatingSettings& gains) const {
    settings.law = ControlLaw::rotating;
    settings.rotating = gains;
  }
};

/// The option `law`: a control_law, or the name of one for its gains by default. Left out: pd.
void take_law(const Call& call, ServoSettings& settings) {
  const bool given = call.push_option("law");
  const bool by_name = lua_type(call.L, -1) == LUA_TSTRING;
  lua_pop(call.L, 1);
  if (by_name)
    settings.law = control_law_named(*call.text_option("law"));
  else if (given)
    std::visit(TakeLaw{settings}, call.handle_option<LawGains>("law"));
  // Turning takes less field than pulling.
  // Before the option `field` is read, which replaces it.
  if (settings.law == ControlLaw::rotating) settings.field = 2e-3;
}

/// The rig file has no settings of the loop: what the script leaves out is ServoSettings' own.
ServoSettings settings_of(const Call& call) {
  ServoSettings settings;
  take_law(call, settings);
  if (const auto feedback = call.text_option("feedback"))
    settings.feedback = feedback_named(*feedback);
  settings.field = call.number_option("field").value_or(settings.field);
  settings.field_max = call.number_option("field_max");
  settings.lost_timeout = call.number_option("lost_timeout").value_or(settings.lost_timeout);
  settings.axis_sigma = call.number_option("axis_uncertainty");
  settings.wall_drag = call.flag_option("wall_drag", settings.wall_drag);
  settings.may_touch = call.flag_option("touch", settings.may_touch);
  settings.coil_tone = call.number_option("coil_tone").value_or(settings.coil_tone);
  for (const double channel : call.numbers_option("dead_coils").value_or(std::vector<double>{}))
    settings.dead_coils.push_back(channel_of(channel));
  if (const auto axis = call.vector_option("axis")) settings.axis = axis->normalized();
  return settings;
}

/// Optional fields are nil where there is nothing to say: a table with zeros would be a position.
Returned status_fields() {
  return {"table",
          {{"state", "", "searching, holding, following, released, lost, failed or closed"},
           {"time", "s", "exposure of the frame behind it"},
           {.name = "position", .unit = "m", .help = "nil while unseen", .optional = true},
           {"direction", "", "where the robot's axis should point then, unit"},
           {.name = "axis", .help = "where it does, unit, where it is measured", .optional = true},
           {.name = "disturbance",
            .unit = "m/s",
            .help = "what pushes the robot beyond the model; of the law estimator",
            .optional = true},
           {"target", "m", "where it should be then"},
           {"trim", "N", "constant force added to the weight compensation"},
           {"offset", "m", "added to each place that the top camera finds"},
           {"progress", "", "of the path, 0 to 1"},
           {"field", "T", "magnitude of the field that is commanded"},
           {"headroom", "", "1 - largest current over its limit"},
           {"limited", "", "whether a current's limit cost something of field or force"},
           {.name = "failure", .help = "why, in the state failed", .optional = true}}};
}

/// nil for a law without an estimate: margins of what is not modelled would be guesses.
Returned margins_fields() {
  return Returned{
      "table",
      {{"stable", "", "whether the loop is, as believed"},
       {"gain_up", "", "factor of the robot's response at which it oscillates; 2 is 6 dB"},
       {"gain_down", "", "the same below 1; 0: none"},
       {"delay_more", "s", "that the loop may be later than believed; searched to six dead times"},
       {"delay_less", "s", "that it may be sooner"},
       {"proportional", "1/s", "gain in use"},
       {"bandwidth", "1/s", "of the observer of the disturbance (rad/s)"},
       {"gain", "", "estimated: the robot's response over the believed one"},
       {"gain_sigma", "", "its standard deviation"},
       {"delay", "s", "estimated: of the loop beyond the believed one"},
       {"delay_sigma", "s", "its standard deviation"},
       {"innovation", "",
        "normalized, of the last 10 s: 1 where the filter is as sure as it is right"},
       {"correlation", "",
        "of each innovation with the one before: 0 where none is left to learn"}}}
      .or_nil("of another law, and before anything was measured");
}

Returned rotation_fields() {
  return Returned{
      "table",
      {{"frequency", "Hz", "commanded; negative: against the axis"},
       {"axis", "", "of the field's rotation, unit; where it oscillates, the way forwards"},
       {"field", "T", "magnitude"},
       {"limit", "Hz", "the fastest now: of the law, of the coils, below a step-out"},
       {"set_points", "Hz", "that the amplifiers take"},
       {.name = "swing",
        .unit = "rad",
        .help = "of a field that oscillates, to either side; else nil",
        .optional = true},
       {.name = "believed_step_out",
        .unit = "Hz",
        .help = "by the model; nil where the field oscillates",
        .optional = true},
       {"response", "", "way per turn over the believed one, of the last 0.6 s"},
       {"response_before", "", "the same while it turned with the field"},
       {"response_sigma", "", "standard deviation of response"},
       {"stepped_out", "", "whether it no longer turns with the field"},
       {.name = "step_out",
        .unit = "Hz",
        .help = "that explains what the last step-out left of the way",
        .optional = true},
       {"unresponsive", "", "whether it moves less than it is driven at any frequency"}}}
      .or_nil("of another law");
}

/// nil where there is nothing to be near to, or nothing that is near.
Returned clearance_fields() {
  return Returned{"table",
                  {{"bound", "m", "lower end of its 99 % interval: distance less uncertainty"},
                   {"distance", "m", "of the robot's surface from the nearest wall"},
                   {"uncertainty", "m", "half width of the 99 % interval"},
                   {"wall", "", "the nearest: retina or lens"},
                   {"retina", "m", "of the surface from the retina"},
                   {"lens", "m", "of the surface from the lens"},
                   {"away", "", "direction away from the nearest wall"},
                   {"margin", "m", "that is kept (keep_out.margin of the rig file)"},
                   {"kept_out", "", "whether the margin changes the command"}}}
      .or_nil("while the robot is not seen, and in an eye without a lens");
}

Returned quality_fields() {
  return {
      "table",
      {{"good", "", "whether nothing of the below was so"},
       {"oscillating", "", "the robot went to and fro about its target"},
       {"standing", "", "it was told to move and stood"},
       {"off_target", "", "it was farther than 2 mm from its target for 3 s and came no nearer"},
       {"rests_off", "m",
        "how far it stayed, at most, for 3 s from a target that rested; 0: 0.2 mm or less"},
       {"kept_out", "", "the keep-out margin changed the command for more than 3 s"},
       {"capped", "", "the feedback asked for its largest speed for more than 3 s"},
       {"clamped", "", "what pushed it was at its bound for more than 3 s"},
       {.name = "weak_coil",
        .help = "the coil that carried less than it was given; nil: none",
        .optional = true},
       {"verdict", "", "good, or the names of what was wrong"}}};
}

/// What the loop is asked, and what it is waited for. 30 s of corrections are what it keeps, which
/// bounds the duration of their mean.
std::vector<Binding> listening_rows() {
  const Argument duration{
      .name = "duration", .type = Type::number, .unit = "s", .min = 0.01, .max = 30};
  return {{"position",
           {},
           {"position", "m"},
           "where the robot is, as the loop sees it; an error when it is not seen",
           position,
           "servo:position()"},
          {"status",
           {},
           status_fields(),
           "what the loop does and sees, of one moment, and what it was set to",
           status,
           "servo:status()"},
          {"margins",
           {},
           margins_fields(),
           "how far the loop is from oscillating, with the gains in use (law estimator; else nil)",
           margins,
           "servo:margins()"},
          {"rotation",
           {},
           rotation_fields(),
           "what the rotating field does and how the robot answers (law rotating; else nil)",
           rotation,
           "servo:rotation()"},
          {"clearance",
           {},
           clearance_fields(),
           "how near the robot's surface is to retina and lens, by shape, attitude and what is not "
           "known of its place",
           clearance,
           "servo:clearance()"},
          {"quality",
           {},
           quality_fields(),
           "what was wrong with the control since the last goal was given",
           quality,
           "servo:quality()"},
          {"wait_until_tracked",
           {options_of({{.name = "timeout",
                         .type = Type::number,
                         .unit = "s",
                         .optional = true,
                         .min = 0,
                         .max = 3600,
                         .help = "how long it may take (10 s)"}})},
           {"position", "m"},
           "waits until the robot is seen",
           wait_until_tracked,
           "servo:wait_until_tracked { timeout = 10 * s }"},
          {"mean_correction",
           {duration},
           {"force", "N"},
           "waits, and returns the mean force by which the loop corrected meanwhile",
           mean_correction,
           "servo:mean_correction(0.5 * s)"},
          {"force_for",
           {{.name = "velocity", .type = Type::vector, .unit = "m/s"}},
           {"force", "N"},
           "the force that moves the robot through the medium at a velocity, by its drag",
           force_for,
           "servo:force_for({ 0.5 * mm / s, 0, 0 })"},
          {"snapshot",
           {{.name = "caption", .type = Type::text}},
           "",
           "puts the next frame, as it is tracked, into the record",
           snapshot,
           "servo:snapshot(\"before the path\")"}};
}

/// What the loop is told. A position out of reach is refused, and the loop goes on as before.
std::vector<Binding> steering_rows() {
  const Argument path{.name = "path",
                      .help = "a trajectory, or a list of positions {x, y, z} in m"};
  const Argument place{.name = "position", .type = Type::vector, .unit = "m"};
  const Argument force{.name = "force", .type = Type::vector, .unit = "N"};
  return {
      {"go_to",
       {place, options_of(travel_options())},
       "",
       "goes straight to a place and waits until it stays there",
       go_to,
       "servo:go_to({ 0.5 * mm, 0, 0 }, { within = 0.5 * mm, settle = 0 })"},
      {"follow",
       {path, options_of(follow_options())},
       {"number", "s"},
       "goes along a trajectory, or straight lines with rest at each point; waits for the end, "
       "returns the time it took",
       follow,
       "servo:follow({ { 0, 0, 0 }, { 0.5 * mm, 0, 0 } }, { speed = 1 * mm / s })"},
      {"refusal",
       {path, options_of(limits_options())},
       Returned("text").or_nil("it would be taken"),
       "why follow would refuse a way now, before anything moves",
       refusal,
       "servo:refusal({ { 0, 0, 0 }, { 0.5 * mm, 0, 0 } }, { speed = 1 * mm / s })"},
      {"hold",
       {place, options_of({{.name = "velocity",
                            .type = Type::vector,
                            .unit = "m/s",
                            .optional = true,
                            .help = "of a place that moves: it goes on for 0.25 s, and rests "
                                    "there unless it is said anew (0)"}})},
       "",
       "holds a place from now on; does not wait",
       hold,
       "servo:hold({ 0, 0, 0 })"},
      {"let_fall",
       {{.name = "duration", .type = Type::number, .unit = "s", .min = 0.05, .max = 1}},
       {"table",
        {{"off", "s", "when the coils were switched off"},
         {"on", "s", "when they were given currents again"}}},
       "switches the coils off for a moment and holds the robot again where it was to be; waits "
       "for the moment's end (law estimator)",
       let_fall,
       "servo:let_fall(0.3 * s)"},
      {"release",
       {options_of({{.name = "cancel",
                     .type = Type::flag,
                     .optional = true,
                     .help = "go on canceling what pushes the robot (law estimator)"},
                    {.name = "touch",
                     .type = Type::flag,
                     .optional = true,
                     .help = "the robot may lie on the retina: the keep-out margin is off until "
                             "the next goal"}})},
       "",
       "keeps field and weight compensation, leaves the place alone",
       release,
       "servo:release()"},
      {"spin",
       {options_of({{.name = "axis", .type = Type::direction, .help = "world"},
                    {.name = "frequency",
                     .type = Type::number,
                     .unit = "Hz",
                     .min = -200,
                     .max = 200,
                     .help = "negative: the other way round"}})},
       "",
       "turns the field about an axis until the next goal, wherever the robot goes (law "
       "rotating)",
       spin,
       "servo:spin { axis = { 1, 0, 0 }, frequency = 5 * Hz }"},
      {"set_trim",
       {force},
       "",
       "sets the constant force added to the weight compensation (status().trim)",
       set_trim,
       "servo:set_trim(servo:status().trim + servo:force_for { 0, 0, 10 * um / s })"},
      {"set_offset",
       {{.name = "offset", .type = Type::vector, .unit = "m", .help = "at most 3 mm long"}},
       "",
       "sets what is added to each place that the top camera finds (status().offset): its bias "
       "at a known place",
       set_offset,
       "servo:set_offset({ 0, 0, 50 * um })"},
      {.name = "close",
       .doc = "ends the loop; the coils are at zero",
       .function = close,
       .example = "servo:close()",
       .when_closed = true}};
}

std::vector<Binding> servo_rows() {
  std::vector<Binding> rows = listening_rows();
  for (Binding& row : steering_rows()) rows.push_back(std::move(row));
  return rows;
}

/// In a dry run poses stand in for images; a rig that has no sample handler gets its robot now.
/// What the run itself would refuse is refused here too: that is what the dry run is for.
void rehearse(Rehearsal& rehearsal, ServoSettings& settings, const ServoCameras& eyes) {
  if (settings.feedback == Feedback::pose_sensor && !rehearsal.pose_sensor)
    throw std::invalid_argument("feedback: pose_sensor needs that role, and this rig has none");
  const auto need = [&settings](bool there, const char* what) {  // as the run itself would say it
    if (!there)
      throw std::invalid_argument(std::string("feedback \"") + to_string(settings.feedback) +
                                  "\" needs " + what);
  };
  need(!needs_background(settings.feedback) || eyes.top,
       "a background of the empty scene, as rig:learn_background() gives it");
  need(!needs_colors(settings.feedback) || !eyes.colors.empty(), "a color model of the robot");
  // By the feedback of the run itself, which is replaced below.
  settings.by_pose = settings.feedback != Feedback::pose_sensor;
  settings.stays_in_sight = looks(settings.feedback);
  if (settings.feedback != Feedback::none)
    settings.feedback = Feedback::pose_sensor;  // else it is let go as it was
  if (rehearsal.bring_robot) rehearsal.bring_robot();
}

/// The models of an eye by color; none for a feedback without one.
std::vector<vision::TrackedObject> color_objects(const Call& call) {
  std::vector<vision::TrackedObject> objects;
  if (option_given(call, "model"))
    objects.push_back({call.handle_option<TrainedModel>("model").model, {}});
  if (!option_given(call, "models")) return objects;
  if (!objects.empty()) throw std::invalid_argument("options: wants either model or models");
  for (const TrainedModel* trained : models_option(call)) objects.push_back({trained->model, {}});
  return objects;
}

/// The roles by whose measurements the loop would turn in the run itself.
std::set<std::string> sources_of(Feedback feedback) {
  if (feedback == Feedback::pose_sensor) return {"pose_sensor"};
  if (feedback == Feedback::two_cameras) return {"top_camera", "side_camera"};
  return {"top_camera"};
}

}  // namespace

// Cameras, settings, view: each may throw, and only then the loop is started. A calibrated view is
// handed on as what it changes of the rig's own: the scale of its image and its offset, or its eye.
int open_servo(Call& call) {
  Session& session = session_of(call.L);
  ServoCameras eyes{{}, session.side_observations(), {}};
  if (call.push_option("background"))
    eyes.top = call.handle_option<vision::Background>("background");
  lua_pop(call.L, 1);
  ServoSettings settings = settings_of(call);
  eyes.colors = color_objects(call);
  if (call.push_option("view")) {
    const auto& view = call.handle_option<localizer_calls::Localizer>("view");
    settings.view = {view.settings.image.pixel / session.rig.model.top_image.pixel, view.offset};
    settings.view.looked_at = view.looked_at;
    if (view.eye_calibrated)
      settings.view.eye = std::make_shared<CorrectedEye>(
          CorrectedEye{view.eye.system, view.settings.projection, view.settings.exact,
                       view.robot_length, view.robot_width});
  }
  lua_pop(call.L, 1);
  const std::set<std::string> sources = sources_of(settings.feedback);
  if (session.rehearsal != nullptr && session.rig.pose_sensor != nullptr)
    rehearse(*session.rehearsal, settings, eyes);
  // Shared with the closer below: the script's handle may be collected before the session ends.
  auto servo = std::make_shared<Servo>(session.clock, session.rig, session.recorder,
                                       std::move(eyes), settings);
  if (session.rehearsal != nullptr)
    session.rehearsal->loop_sources.insert(sources.begin(), sources.end());
  // The session's end closes what the script left open.
  call.context().closers.push_back([servo] { servo->close(); });
  push_handle(call.L, servo_class(), servo);
  return 1;
}

const Class& servo_class() {
  static const Class kind{"servo", "the servo loop; make one with rig:servo", servo_rows()};
  return kind;
}

}  // namespace vitreo::lua
