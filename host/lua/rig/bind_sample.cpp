// Bindings of rig.sample: what is put in, taken out and changed, by a person or in the simulator.
// SPDX-License-Identifier: Apache-2.0
#include "control/measured_gel.h"
#include "devices/time/error.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/people.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/rig/classes.h"

#include <fmt/format.h>

#include <functional>
#include <stdexcept>
#include <string>

namespace vitreo::lua {
namespace {

constexpr double kHandling = 3600;                // s of wall time: a person may be long at it
constexpr Time kCall = std::chrono::minutes(10);  // of a handler that is a program
// For one frame; a camera that takes longer has failed.
constexpr Time kPhotograph = std::chrono::seconds(5);

/// One thing to do: its words for a person, its task for a program in the person's place, and the
/// call of the handler.
struct Handling {
  std::string name;  // of the question: --answer insert_robot=yes
  std::string request;
  nlohmann::json task;
  std::function<void(SampleHandler&)> act;
};

// To 0.01 mm, finer than a hand can place anything; a program gets meters, as numbers.
std::string place_words(const Eigen::Vector3d& p) {
  return fmt::format("x {:.2f}, y {:.2f}, z {:.2f} mm", p.x() * 1e3, p.y() * 1e3, p.z() * 1e3);
}

nlohmann::json numbers_of(const Eigen::Vector3d& p) { return {p.x(), p.y(), p.z()}; }

/// What the top camera sees after a person's hands were there goes into the record, beside the
/// answer; why it saw nothing, where it did not: the answer counts all the same.
int photograph(Call& call, const Handling& done) {
  Session& session = session_of(call.L);
  Camera* const camera = session.rig.top_camera;
  // In a dry run no hand was there, and no camera looks.
  if (camera == nullptr || session.rehearsal != nullptr) return 0;
  // Shared, since the worker may still write to them when a stop has ended the wait.
  auto frame = std::make_shared<Frame>();
  auto missing = std::make_shared<std::string>();
  return call.wait(work(
      call, camera->info().identity,
      [=] {
        try {
          *frame = camera->grab(kPhotograph);
        } catch (const DeviceError& error) {
          *missing = error.what();
        }
      },
      // Longer than grab() waits: its own error says more than that of a worker out of time.
      2 * kPhotograph,
      [frame, missing, name = done.name, request = done.request, &session](Call&) {
        if (missing->empty())
          session.recorder.picture(name, "photograph: " + request, frame->image);
        else
          session.recorder.event(session.clock.now(), "no photograph", name + ": " + *missing);
        return 0;
      }));
}

/// A person is asked and waited for, then the handler is told; a program is told at once.
int handle(Call& call, const Handling& wanted) {
  SampleHandler* const sample = &call.self<SampleHandler>();
  if (!sample->by_hand())
    return call.wait(work(
        call, "sample", [sample, act = wanted.act] { act(*sample); }, kCall,
        [](Call&) { return 0; }));
  Question question;
  question.text = wanted.request + ": is it done?";
  question.answer.name = wanted.name;
  question.answer.kind = ParameterKind::flag;
  // By default no: else the rig would take for done what is not done.
  question.answer.fallback = false;
  question.task = wanted.task;
  question.task["do"] = wanted.name;
  return ask_people(call, question, kHandling, [=](Call& done, const ArgumentValue& answer) {
    if (!std::get<bool>(answer))
      throw std::runtime_error("it was not done, says the operator: " + wanted.request);
    wanted.act(*sample);
    return photograph(done, wanted);
  });
}

int insert_robot(Call& call) {
  const Eigen::Vector3d position = call.vector(0);
  return handle(call, {"insert_robot",
                       "put the robot in near " + place_words(position) + " of the workspace",
                       {{"position", numbers_of(position)}},
                       [position](SampleHandler& sample) { sample.insert_robot(position); }});
}

int remove_robot(Call& call) {
  return handle(call,
                {"remove_robot", "take the robot out, if one is there", nlohmann::json::object(),
                 [](SampleHandler& sample) { sample.remove_robot(); }});
}

int place_target(Call& call) {
  const Eigen::Vector3d position = call.vector(0);
  return handle(call,
                {"place_target",
                 "put the target with its middle at " + place_words(position) + " of the workspace",
                 {{"position", numbers_of(position)}},
                 [position](SampleHandler& sample) { sample.place_target(position); }});
}

int remove_target(Call& call) {
  return handle(call, {"remove_target", "take the target out of sight", nlohmann::json::object(),
                       [](SampleHandler& sample) { sample.remove_target(); }});
}

/// By its name, or by what a rheometer measured; "" is the fluid.
std::string gel_asked_for(Call& call) {
  const auto storage = call.number_option("storage_modulus");
  const auto loss = call.number_option("loss_modulus");
  const auto gel = call.text_option("gel");
  if (!storage && !loss) return gel.value_or("");
  // G' without G'' (or the reverse) leaves the share of loss open, and a name says both already.
  if (gel || !storage || !loss)
    throw std::invalid_argument("gel: either a name, or storage_modulus and loss_modulus together");
  return control::gel_text({*storage, *loss, call.number_option("frequency").value_or(1)});
}

int change_vial(Call& call) {
  const std::string robot = *call.text_option("robot");
  const std::string gel = gel_asked_for(call);
  return handle(call, {"change_vial",
                       fmt::format("put the vial of {} with the robot {} in the workspace's middle",
                                   gel.empty() ? "the fluid" : gel, robot),
                       {{"robot", robot}, {"gel", gel}},
                       [robot, gel](SampleHandler& sample) { sample.change_vial(robot, gel); }});
}

Argument position_argument(const char* help) {
  return {.name = "position", .type = Type::vector, .unit = "m", .help = help};
}

}  // namespace

const Class& sample_class() {
  static const Class kind{
      "sample",
      "the sample: on a laboratory rig each call asks the operator, by a question of the call's "
      "name (--answer insert_robot=yes), waits, and keeps a photograph",
      {{"insert_robot",
        {position_argument("near which it is released, world")},
        "",
        "puts the robot in",
        insert_robot,
        "rig.sample:insert_robot({ 0, 0, 0 })"},
       {"remove_robot", {}, "", "takes the robot out", remove_robot, "rig.sample:remove_robot()"},
       {"place_target",
        {position_argument("of its middle, world")},
        "",
        "puts the calibration's target at a place",
        place_target,
        "rig.sample:place_target({ 0, 0, 0 })"},
       {"remove_target",
        {},
        "",
        "takes the target out of sight",
        remove_target,
        "rig.sample:remove_target()"},
       {"change_vial",
        {{.name = "options",
          .type = Type::options,
          .options = {{.name = "robot", .type = Type::text, .help = "as control.robots names it"},
                      {.name = "gel",
                       .type = Type::text,
                       .optional = true,
                       .help = "gel_1 to gel_11 (the fluid)"},
                      {.name = "storage_modulus",
                       .type = Type::number,
                       .optional = true,
                       .min = 1e-3,
                       .max = 1e5,
                       .help = "Pa: G' of a gel that a rheometer measured"},
                      {.name = "loss_modulus",
                       .type = Type::number,
                       .optional = true,
                       .min = 1e-3,
                       .max = 1e5,
                       .help = "Pa: its G''"},
                      {.name = "frequency",
                       .type = Type::number,
                       .unit = "Hz",
                       .optional = true,
                       .min = 1e-3,
                       .max = 1000,
                       .help = "at which they were measured (1 Hz)"}}}},
        "",
        "puts in another vial, with the robot at rest in the middle; the loop believes in that "
        "robot from now on",
        change_vial,
        "rig.sample:change_vial { robot = \"coni_2mm\", gel = \"gel_1\" }"}}};
  return kind;
}

}  // namespace vitreo::lua
