// rig and its instruments.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/rig/bind_rig.h"

#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/rig/classes.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "host/text/units.h"
#include "vision/background.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kLongestHandling = 600;  // s

void set_size(lua_State* L, int width, int height) {
  lua_pushinteger(L, width);
  lua_setfield(L, -2, "width_px");
  lua_pushinteger(L, height);
  lua_setfield(L, -2, "height_px");
}

int camera_info(Call& call) {
  const CameraInfo& info = call.self<Camera>().info();
  lua_createtable(call.L, 0, 5);
  lua_pushstring(call.L, info.identity.c_str());
  lua_setfield(call.L, -2, "identity");
  set_size(call.L, info.width_px, info.height_px);
  set_number(call.L, "frame_period", info.frame_period);
  set_number(call.L, "effective_pixel", info.effective_pixel);
  return 1;
}

int push_frame(lua_State* L, const Frame& frame) {
  lua_createtable(L, 0, 6);
  push_image(L, frame.image.clone());  // the camera may use its buffer again
  lua_setfield(L, -2, "image");
  lua_pushinteger(L, static_cast<lua_Integer>(frame.number));
  lua_setfield(L, -2, "number");
  set_number(L, "time", to_seconds(frame.exposed));
  set_number(L, "received", to_seconds(frame.received));
  set_size(L, frame.image.cols, frame.image.rows);
  return 1;
}

int camera_grab(Call& call) {
  auto frame = std::make_shared<Frame>();
  Camera* const camera = &call.self<Camera>();
  const std::uint64_t last = call.context().last_frames[camera];
  const Time timeout = from_seconds(call.number_option("timeout").value_or(5));
  // The camera keeps the time itself and says more; ours is only there should it hang.
  return call.wait(work(
      call, camera->info().identity, [=] { *frame = camera->grab(timeout); }, 2 * timeout,
      [frame, camera](Call& done) {
        done.context().last_frames[camera] = frame->number;
        return push_frame(done.L, *frame);
      },
      {last == 0 ? "a frame" : "a frame after number " + std::to_string(last),
       [last] { return last == 0 ? "no frame yet" : "frame " + std::to_string(last); }}));
}

std::string currents_text(const std::vector<double>& currents) {
  std::string text;
  for (const double current : currents)
    text += (text.empty() ? "" : ", ") + format_number(current, 3);
  return text + " A";
}

int coils_set(Call& call) {
  CoilAmplifier* const coils = &call.self<CoilAmplifier>();
  return call.wait(work(
      call, "coils", [coils, currents = call.numbers(0)] { coils->set_currents(currents); },
      from_seconds(5), [](Call&) { return 0; },
      {currents_text(call.numbers(0)), [coils] { return currents_text(coils->currents()); }}));
}

int coils_currents(Call& call) {
  const std::vector<double> currents = call.self<CoilAmplifier>().currents();
  lua_createtable(call.L, static_cast<int>(currents.size()), 0);
  for (std::size_t i = 0; i < currents.size(); ++i) {
    lua_pushnumber(call.L, currents[i]);
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i) + 1);
  }
  return 1;
}

int coils_limit(Call& call) { return call.result(call.self<CoilAmplifier>().current_limit()); }
int lens_position(Call& call) { return call.result(call.self<LensMover>().position()); }

WaitInfo about_lens(const LensMover* mover, const std::string& target) {
  return {target, [mover] { return format_quantity(mover->position(), "m"); }};
}

int lens_move(Call& call) {
  LensMover* const mover = &call.self<LensMover>();
  const Time timeout = from_seconds(call.number_option("timeout").value_or(30));
  return call.wait(work(
      call, "lens_mover", [=, position = call.number(0)] { mover->move_to(position, timeout); },
      2 * timeout, [](Call&) { return 0; },
      about_lens(mover, format_quantity(call.number(0), "m"))));
}

int lens_homed(Call& call) {
  lua_pushboolean(call.L, call.self<LensMover>().homed() ? 1 : 0);
  return 1;
}

int lens_home(Call& call) {
  LensMover* const mover = &call.self<LensMover>();
  const Time timeout = from_seconds(call.number_option("timeout").value_or(60));
  return call.wait(work(
      call, "lens_mover", [=] { mover->home(timeout); }, 2 * timeout, [](Call&) { return 0; },
      about_lens(mover, "its switch")));
}

int insert_robot(Call& call) {
  SampleHandler* const sample = &call.self<SampleHandler>();
  return call.wait(work(
      call, "sample", [sample, position = call.vector(0)] { sample->insert_robot(position); },
      from_seconds(kLongestHandling), [](Call&) { return 0; }));
}

int remove_robot(Call& call) {
  SampleHandler* const sample = &call.self<SampleHandler>();
  return call.wait(work(
      call, "sample", [sample] { sample->remove_robot(); }, from_seconds(kLongestHandling),
      [](Call&) { return 0; }));
}

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

int background_count(Call& call) { return call.result(call.self<vision::Background>().count()); }

Argument timeout(const std::string& fallback) {
  return {.name = "timeout",
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = kLongestHandling,
          .help = "how long it may take (" + fallback + ")"};
}

std::vector<Argument> servo_options() {
  const auto number = [](const char* name, const char* unit, double min, double max,
                         const char* help) {
    return Argument{.name = name,
                    .type = Type::number,
                    .unit = unit,
                    .optional = true,
                    .min = min,
                    .max = max,
                    .help = help};
  };
  const auto text = [](const char* name, const char* help, std::vector<std::string> choices) {
    return Argument{.name = name,
                    .type = Type::text,
                    .optional = true,
                    .help = help,
                    .choices = std::move(choices)};
  };
  return {{.name = "background",
           .type = Type::handle,
           .optional = true,
           .help = "of the empty scene; needed by every feedback that looks",
           .handle = "background"},
          {.name = "view",
           .type = Type::handle,
           .optional = true,
           .help = "as rig:view() or a calibration of it: what the loop localizes by",
           .handle = "localizer"},
          text("feedback", "what the loop sees the robot by (one_camera)",
               {"none", "one_camera", "two_cameras", "pose_sensor"}),
          text("law", "what turns the error into a velocity (pd)", {"pd", "estimator", "velocity"}),
          number("field", "T", 1e-3, 40e-3, "magnitude of the field (10 mT)"),
          {.name = "axis",
           .type = Type::vector,
           .optional = true,
           .help = "where the robot's axis points ({1, 0, 0})"},
          number("proportional", "Hz", 0, 100, "gain: speed asked per distance"),
          number("derivative", "", 0, 10, "gain of pd: speed asked per speed error"),
          number("derivative_time", "s", 0, 10, "of pd: low-pass of the measured speed"),
          number("max_speed", "m/s", 0, 0.1, "largest speed asked"),
          number("integral", "N/m", 0, 100,
                 "gain of velocity: force per distance stayed behind; of pd, 1/s^2: speed per "
                 "distance and time (0)"),
          number("velocity_time", "s", 0, 10, "of velocity: low-pass of the measured speed"),
          number("max_force", "N", 0, 1, "of velocity: largest force asked"),
          {.name = "dead_coils",
           .type = Type::numbers,
           .optional = true,
           .help = "coils that stay without current"},
          number("axis_uncertainty", "rad", 0, 1,
                 "how surely the robot lies along the field asked for; 0: surely (0; of estimator "
                 "4 degrees)"),
          {.name = "wall_drag",
           .type = Type::flag,
           .optional = true,
           .help = "reckon with the drag that retina and lens add (false)"},
          number("lost_timeout", "s", 0, 10,
                 "how long the robot may be unseen before the coils go to zero (1 s)")};
}

Class with_rows(Class made, std::vector<Binding> rows) {
  for (Binding& row : rows) made.methods.push_back(std::move(row));
  return made;
}

template <class T>
void add_role(lua_State* L, const Class& kind, T* device, const char* name) {
  if (!device) return;
  push_handle(L, kind, std::shared_ptr<void>(device, [](void*) {}));  // the rig owns it
  lua_insert(L, -2);
  set_field_below(L, name);
}

}  // namespace

const Class& rig_class() {
  static const Class kind = with_rows(
      Class{
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
            learn},
           {"servo",
            {options_of(servo_options())},
            "servo",
            "starts the servo loop; end it with <close> or servo:close(), the coils are at zero "
            "then",
            open_servo}},
          {"top_camera", "side_camera", "coils", "lens_mover", "sample", "stage", "rotation_stage",
           "field_probe", "joystick", "pedal", "lamp", "simulation"}},
      rig_model_rows());
  return kind;
}

const Class& camera_class() {
  static const Class kind{
      "camera",
      "a camera",
      {{"info",
        {},
        "table",
        "identity, width_px, height_px, frame_period in s, effective_pixel in m",
        camera_info},
       {"grab",
        {options_of({timeout("5 s")})},
        "table",
        "waits for the next frame: number, time in s, received in s, width_px, height_px, image",
        camera_grab}}};
  return kind;
}

const Class& coils_class() {
  static const Class kind{
      "coils",
      "the coil amplifiers",
      {{"set_currents",
        {{.name = "currents", .type = Type::numbers, .unit = "A"}},
        "",
        "sets all channels together",
        coils_set},
       {"currents", {}, "list of numbers in A", "as last set", coils_currents},
       {"limit", {}, "number in A", "largest current of a channel, either sign", coils_limit}}};
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
        lens_move},
       {"position",
        {},
        "number in m",
        "from the lens' nominal place, away from the eye",
        lens_position},
       {"homed", {}, "boolean", "whether its position can be believed", lens_homed},
       {"home",
        {options_of({timeout("60 s")})},
        "",
        "finds its place by its switch, and waits for it",
        lens_home}}};
  return kind;
}

const Class& sample_class() {
  static const Class kind{"sample",
                          "whoever brings the robot into the eye",
                          {{"insert_robot",
                            {{.name = "position", .type = Type::vector, .unit = "m"}},
                            "",
                            "releases the robot near a place",
                            insert_robot},
                           {"remove_robot", {}, "", "takes the robot out", remove_robot}}};
  return kind;
}

const Class& background_class() {
  static const Class kind{
      "background",
      "what the empty scene looks like",
      {{"count", {}, "number", "of images it was learnt from", background_count}}};
  return kind;
}

void push_rig(lua_State* L, Rig& rig) {
  push_handle(L, rig_class(), std::shared_ptr<void>(&rig, [](void*) {}));
  add_role(L, camera_class(), rig.top_camera, "top_camera");
  add_role(L, camera_class(), rig.side_camera, "side_camera");
  add_role<CoilAmplifier>(L, coils_class(), rig.coils, "coils");
  add_role(L, lens_mover_class(), rig.lens_mover, "lens_mover");
  add_role(L, sample_class(), rig.sample, "sample");
  add_role(L, stage_class(), rig.stage, "stage");
  add_role(L, rotation_stage_class(), rig.rotation_stage, "rotation_stage");
  add_role(L, field_probe_class(), rig.field_probe, "field_probe");
  add_role(L, operator_input_class(), rig.joystick, "joystick");
  add_role(L, operator_input_class(), rig.pedal, "pedal");
  add_role(L, lamp_class(), rig.lamp, "lamp");
  add_role(L, simulation_class(), rig.simulation, "simulation");
}

}  // namespace vitreo::lua
