// Bindings of the rig and its instruments.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/rig/bind_rig.h"

#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/classes.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "host/text/units.h"
#include "vision/background.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

int camera_info(Call& call) {
  const CameraInfo& info = call.self<Camera>().info();
  ResultTable(call)
      .text("identity", info.identity)
      .integer("width_px", info.width_px)
      .integer("height_px", info.height_px)
      .number("frame_period", info.frame_period, "s")
      .number("effective_pixel", info.effective_pixel, "m")
      .integer("offset_x_px", info.offset_x_px)
      .integer("offset_y_px", info.offset_y_px);
  return 1;
}

// GenICam has its features as text; a number is read as one.
int push_feature(const Call& call, const std::string& value) {
  if (value == "true" || value == "false") {
    lua_pushboolean(call.L, value == "true" ? 1 : 0);
  } else if (lua_stringtonumber(call.L, value.c_str()) == 0) {
    lua_pushlstring(call.L, value.data(), value.size());
  }
  return 1;
}

// GigE Vision answers within a second, or with its own error.
constexpr Time kFeature = std::chrono::seconds(10);

int camera_feature(Call& call) {
  Camera* const camera = &call.self<Camera>();
  const std::string name = call.text(0);
  const auto value = std::make_shared<std::string>();
  return call.wait(work(
      call, camera->info().identity, [=] { *value = camera->feature(name); }, kFeature,
      [value](Call& done) { return push_feature(done, *value); }));
}

/// As the camera takes it; nil and "" execute a command.
std::string feature_text(const Call& call, std::size_t argument) {
  const int at = call.index(argument);
  if (lua_isnoneornil(call.L, at)) return "";
  if (lua_isboolean(call.L, at)) return lua_toboolean(call.L, at) != 0 ? "true" : "false";
  if (lua_type(call.L, at) != LUA_TSTRING && lua_type(call.L, at) != LUA_TNUMBER)
    throw std::invalid_argument("value: must be a number, a text, true or false");
  lua_pushvalue(call.L, at);  // lua_tostring would change the argument itself
  std::string text = lua_tostring(call.L, -1);
  lua_pop(call.L, 1);
  return text;
}

int camera_set_feature(Call& call) {
  Camera* const camera = &call.self<Camera>();
  const std::string name = call.text(0);
  const std::string value = feature_text(call, 1);
  return call.wait(work(
      call, camera->info().identity, [=] { camera->set_feature(name, value); }, kFeature,
      [](Call&) { return 0; }));
}

// A frame's time is the middle of its exposure, `received` its arrival at the host, both of the
// run's clock.
int push_frame(const Call& call, const Frame& frame) {
  ResultTable table(call);
  push_image(call.L, frame.image.clone());  // the camera may use its buffer again
  table.top("image")
      .integer("number", static_cast<lua_Integer>(frame.number))
      .number("time", to_seconds(frame.exposed), "s")
      .number("received", to_seconds(frame.received), "s")
      .integer("width_px", frame.image.cols)
      .integer("height_px", frame.image.rows);
  return 1;
}

// The number of the last frame goes into the error of a camera that falls silent, so that one that
// never sent anything is told from one that stopped.
int camera_grab(Call& call) {
  auto frame = std::make_shared<Frame>();
  Camera* const camera = &call.self<Camera>();
  const std::uint64_t last = call.context().last_frames[camera];
  const Time timeout = from_seconds(call.number_option("timeout").value_or(5));
  Clock* const clock = &session_of(call.L).clock;
  std::optional<Time> after;
  // An exposure, whose middle is known, lasts a frame's period at most.
  if (call.flag_option("fresh"))
    after = clock->now() + from_seconds(camera->info().frame_period / 2);
  if (const auto since = call.number_option("after"))
    after = std::max(after.value_or(Time(0)), from_seconds(*since));
  const auto grab = [=] {
    const Time began = clock->now();
    for (;;) {
      *frame = camera->grab(timeout);
      if (!after || frame->exposed >= *after) return;
      if (clock->now() - began < timeout) continue;
      throw DeviceError(DeviceErrorKind::timeout, camera->info().identity,
                        fmt::format("no frame was exposed after {:g} s within {:g} s",
                                    to_seconds(*after), to_seconds(timeout)));
    }
  };
  // The camera keeps the time itself and says more; ours is only there should it hang.
  return call.wait(
      work(call, camera->info().identity, grab, 2 * timeout,
           [frame, camera](Call& done) {
             done.context().last_frames[camera] = frame->number;
             return push_frame(done, *frame);
           },
           {last == 0 ? "a frame" : "a frame after number " + std::to_string(last),
            [last] { return last == 0 ? "no frame yet" : "frame " + std::to_string(last); }}));
}

int lens_position(Call& call) { return call.result(call.self<LensMover>().position(), "m"); }

/// For the error of a motion that took too long; the place is asked for only then.
WaitInfo about_lens(const LensMover* mover, const std::string& target) {
  return {target, [mover] { return format_quantity(mover->position(), "m"); }};
}

// The mover keeps the deadline itself, and stands when it throws; twice of it is for one that
// hangs.
int lens_move(Call& call) {
  LensMover* const mover = &call.self<LensMover>();
  const Time timeout = from_seconds(call.number_option("timeout").value_or(30));
  return call.wait(work(
      call, "lens_mover", [=, position = call.number(0)] { mover->move_to(position, timeout); },
      2 * timeout, [](Call&) { return 0; },
      about_lens(mover, format_quantity(call.number(0), "m"))));
}

// Whether it is homed is asked of the motor each time: it forgets its steps with its power.
int lens_info(Call& call) {
  const LensMover& mover = call.self<LensMover>();
  ResultTable(call)
      .text("identity", mover.identity())
      .number("travel_min", mover.travel_min(), "m")
      .number("travel_max", mover.travel_max(), "m")
      .flag("homed", mover.homed());
  return 1;
}

int lens_home(Call& call) {
  LensMover* const mover = &call.self<LensMover>();
  const Time timeout = from_seconds(call.number_option("timeout").value_or(60));
  return call.wait(work(
      call, "lens_mover", [=] { mover->home(timeout); }, 2 * timeout, [](Call&) { return 0; },
      about_lens(mover, "its switch")));
}

// The frames are grabbed on the job's task; the model becomes the script's only when all are in, so
// that one that is broken off half-way leaves no half-learnt background.
int learn(Call& call) {
  Session* const session = &session_of(call.L);
  const int frames = static_cast<int>(call.number_option("frames").value_or(15));
  auto background = std::make_shared<vision::Background>();
  return call.wait(work(
      call, "background", [=] { *background = session->learn_background(frames); },
      from_seconds(call.number_option("timeout").value_or(60)),
      [background](Call& done) {
        push_handle(done.L, background_class(), background);
        return 1;
      },
      {std::to_string(frames) + " frames", {}}));
}

int background_info(Call& call) {
  ResultTable(call).integer("count", call.self<vision::Background>().count());
  return 1;
}

/// The option `timeout` of a call that waits for hands or a device; `fallback` is what the page
/// says stands for it.
Argument timeout(const std::string& fallback) {
  return {.name = "timeout",
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = 600,
          .help = "how long it may take (" + fallback + ")"};
}

/// Those of the loop; a law's gains are in the law itself (module control).
std::vector<Argument> servo_options() {
  const auto number = number_option;
  const auto text = [](const char* name, const char* help, std::vector<std::string> choices) {
    return Argument{.name = name,
                    .type = Type::text,
                    .optional = true,
                    .help = help,
                    .choices = std::move(choices)};
  };
  return {
      {.name = "background",
       .type = Type::handle,
       .optional = true,
       .help = "of the empty scene; needed by every feedback that looks, but color",
       .handle = "background"},
      {.name = "model",
       .type = Type::handle,
       .optional = true,
       .help = "what the robot looks like; of the feedbacks by color",
       .handle = "color_model"},
      {.name = "models",
       .type = Type::list,
       .optional = true,
       .help = "instead, with other bodies: color_models, the robot's first"},
      {.name = "view",
       .type = Type::handle,
       .optional = true,
       .help = "as rig:view() or a calibration of it: what the loop localizes by",
       .handle = "localizer"},
      text("feedback", "what the loop sees the robot by (one_camera)",
           {"none", "one_camera", "two_cameras", "pose_sensor", "color", "color_and_background"}),
      {.name = "law",
       .type = Type::handle,
       .optional = true,
       .help = "what turns the error into a command; a name: with the gains by default (pd)",
       .handle = "control_law",
       .choices = {"pd", "estimator", "velocity"}},
      number("field", "T", 1e-3, 40e-3, "magnitude of the field (10 mT)"),
      number("field_max", "T", 1e-3, 40e-3,
             "how far the law estimator may raise it where that asks less of the coils (three "
             "times the field)"),
      {.name = "axis",
       .type = Type::direction,
       .optional = true,
       .help = "where the robot's axis points ({1, 0, 0})"},
      {.name = "dead_coils",
       .type = Type::numbers,
       .optional = true,
       .help = "coils that stay without current"},
      number("axis_uncertainty", "rad", 0, 1,
             "how surely the robot lies along the field asked for; 0: surely (0; of estimator "
             "4 degrees)"),
      {.name = "touch",
       .type = Type::flag,
       .optional = true,
       .help = "the robot may touch retina and lens: no keep-out margin (false)"},
      {.name = "wall_drag",
       .type = Type::flag,
       .optional = true,
       .help = "reckon with the drag that retina and lens add (true)"},
      number("coil_tone", "A", 0, 2,
             "amplitude of the currents, without field or force, by which the law estimator "
             "tells a weak coil (0.6 A)"),
      number("lost_timeout", "s", 0, 10,
             "how long the robot may be unseen before the coils go to zero (1 s)")};
}

/// The rig's rows are in three files: those of the fixed roles here, the others beside.
Class with_rows(Class made) {
  for (Binding& row : rig_model_rows()) made.methods.push_back(std::move(row));
  for (Binding& row : rig_field_rows()) made.methods.push_back(std::move(row));
  for (Binding& row : rig_instrument_rows()) made.methods.push_back(std::move(row));
  return made;
}

/// Gives the rig's handle on top of the stack the field `name`; none where the rig has no such
/// role, so a script asks `if rig.lamp`. The rig outlives the state: the handle does not own the
/// device.
template <class T>
void add_role(lua_State* L, const Class& kind, T* device, const char* name) {
  if (!device) return;
  push_handle(L, kind, std::shared_ptr<void>(device, [](void*) {}));
  lua_insert(L, -2);
  set_field_below(L, name);
}

/// A role under the name of a function of the rig would never be reached.
void check_free_name(const std::string& name) {
  for (const Binding& method : rig_class().methods)
    if (method.name == name)
      throw std::invalid_argument("the rig file's role '" + name +
                                  "' needs another name: rig:" + name + " is a function");
}

}  // namespace

void set_identity(ResultTable& table, const Identity& identity) {
  table.text("identity", to_string(identity))
      .text("name", identity.name)
      .text("serial", identity.serial)
      .text("firmware", identity.firmware);
}

std::vector<ResultField> identity_fields(std::vector<ResultField> more) {
  std::vector<ResultField> fields = {{"identity", "", "all of it"},
                                     {"name", "", "maker and model"},
                                     {"serial", "", "empty where it reports none"},
                                     {"firmware", "", "empty where it reports none"}};
  for (ResultField& one : more) fields.push_back(std::move(one));
  return fields;
}

const Class& rig_class() {
  static const Class kind = with_rows(Class{
      "rig",
      "the instruments: rig.top_camera, rig.side_camera, rig.coils, rig.lens_mover, "
      "rig.sample, rig.stage, "
      "rig.rotation_stage, rig.field_probe, rig.joystick, rig.pedal, rig.lamp, rig.simulation",
      {{"learn_background",
        {options_of({{.name = "frames",
                      .type = Type::integer,
                      .optional = true,
                      .min = 2,
                      .max = 1000,
                      .help = "how many (15)"},
                     timeout("60 s")})},
        "background",
        "learns what the empty scene looks like to the top camera",
        learn,
        "rig:learn_background { frames = 4 }"},
       {"servo",
        {options_of(servo_options())},
        "servo",
        "starts the servo loop; end it with <close> or servo:close(), the coils are at zero "
        "then",
        open_servo,
        "rig:servo { background = background, law = control.pd { proportional = 1.2 } }"}},
      {"top_camera", "side_camera", "coils", "lens_mover", "sample", "stage", "rotation_stage",
       "field_probe", "joystick", "pedal", "lamp", "simulation"}});
  return kind;
}

const Class& camera_class() {
  static const Class kind{
      "camera",
      "a camera",
      {{"info",
        {},
        {"table",
         {{"identity", "", ""},
          {"width_px", "", ""},
          {"height_px", "", ""},
          {"frame_period", "s", ""},
          {"effective_pixel", "m", "of the scene; of the aerial image where there is an eye"},
          {"offset_x_px", "", "of the image's first pixel on the sensor"},
          {"offset_y_px", "", ""}}},
        "what camera it is",
        camera_info,
        "rig.top_camera:info()"},
       {"grab",
        {options_of({{.name = "after",
                      .type = Type::number,
                      .unit = "s",
                      .optional = true,
                      .min = 0,
                      .max = 1e9,
                      .help = "of the run: only a frame whose exposure is of then or later; "
                              "run:now() after something has moved (none)"},
                     {.name = "fresh",
                      .type = Type::flag,
                      .optional = true,
                      .help = "only a frame that was exposed as a whole after the call: after "
                              "something has moved (false)"},
                     timeout("5 s")})},
        {"table",
         {{"image", "", "image"},
          {"number", "", "of the frame"},
          {"time", "s", "of its exposure"},
          {"received", "s", ""},
          {"width_px", "", ""},
          {"height_px", "", ""}}},
        "waits for the next frame that arrives: its exposure may lie before the call, by the "
        "camera's delay",
        camera_grab,
        "rig.top_camera:grab { after = run:now() }"},
       {"feature",
        {{.name = "name", .type = Type::text, .help = "GenICam's: \"Gain\""}},
        "any",
        "a setting by the name that the camera gives it: a number, a text or true or false, in its "
        "own unit",
        camera_feature,
        "rig.top_camera:feature(\"Gain\")"},
       {"set_feature",
        {{.name = "name", .type = Type::text},
         {.name = "value",
          .type = Type::any,
          .optional = true,
          .help = "in the camera's own unit; none of a command"}},
        "",
        "sets it, or executes a command; what decides the image's size belongs to the rig file",
        camera_set_feature,
        "rig.top_camera:set_feature(\"Gain\", 3)"}}};
  return kind;
}

const Class& lens_mover_class() {
  static const Class kind{
      "lens_mover",
      "the motor that moves the condensing lens",
      {{"move_to",
        {{.name = "position", .type = Type::number, .unit = "m", .min = -1, .max = 1},
         options_of({timeout("30 s")})},
        "",
        "moves, and waits until it is there",
        lens_move,
        "rig.lens_mover:move_to(1 * mm)"},
       {"position",
        {},
        {"number", "m"},
        "from the lens' nominal place, away from the eye",
        lens_position,
        "rig.lens_mover:position()"},
       {"info",
        {},
        {"table",
         {{"identity", "", ""},
          {"travel_min", "m", "as position counts"},
          {"travel_max", "m", ""},
          {"homed", "", "whether its position can be believed"}}},
        "what motor it is, and how it stands",
        lens_info,
        "rig.lens_mover:info()"},
       {"home",
        {options_of({timeout("60 s")})},
        "",
        "finds its place by its switch, and waits for it",
        lens_home,
        "rig.lens_mover:home()"}}};
  return kind;
}

// A handle for rig:servo; the images themselves stay inside, for nothing in a script works on them.
const Class& background_class() {
  static const Class kind{"background",
                          "what the empty scene looks like",
                          {{"info",
                            {},
                            {"table", {{"count", "", "of images it was learnt from"}}},
                            "what it was made of",
                            background_info,
                            "background:info()"}}};
  return kind;
}

// One handle a state and role; the fields are of that handle, so another rig has its own.
void push_rig(lua_State* L, Rig& rig) {
  push_handle(L, rig_class(), std::shared_ptr<void>(&rig, [](void*) {}));
  add_role(L, camera_class(), rig.top_camera, "top_camera");
  add_role(L, camera_class(), rig.side_camera, "side_camera");
  add_role(L, coils_class(), rig.coils, "coils");
  add_role(L, lens_mover_class(), rig.lens_mover, "lens_mover");
  add_role(L, sample_class(), rig.sample, "sample");
  add_role(L, stage_class(), rig.stage, "stage");
  add_role(L, rotation_stage_class(), rig.rotation_stage, "rotation_stage");
  add_role(L, field_probe_class(), rig.field_probe, "field_probe");
  add_role(L, operator_input_class(), rig.joystick, "joystick");
  add_role(L, operator_input_class(), rig.pedal, "pedal");
  add_role(L, lamp_class(), rig.lamp, "lamp");
  add_role(L, simulation_class(), rig.simulation, "simulation");
  for (const FreeRole& role : rig.free_roles) {
    check_free_name(role.name);
    push_free_role(L, role);
    lua_insert(L, -2);
    set_field_below(L, role.name.c_str());
  }
}

}  // namespace vitreo::lua
