// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo.h"

#include "host/servo/loop_settings.h"
#include "host/servo/servo_loop.h"
#include "host/text/units.h"

#include <nlohmann/json.hpp>

#include <stdexcept>
#include <utility>

namespace vitreo {

const char* to_string(ServoState state) {
  switch (state) {
    case ServoState::searching:
      return "searching";
    case ServoState::holding:
      return "holding";
    case ServoState::following:
      return "following";
    case ServoState::released:
      return "released";
    case ServoState::lost:
      return "lost";
    case ServoState::failed:
      return "failed";
    case ServoState::closed:
      return "closed";
  }
  return "?";
}

/// The task is started last, with all in place that it uses.
Servo::Servo(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras cameras,
             const ServoSettings& settings) {
  settings.check();
  check_coils(rig);
  loop_ = std::make_unique<Loop>(clock, rig, recorder, std::move(cameras), settings);
  // A replay of the frames needs these. A look on the retina corrects the centered optics: such a
  // loop does without a measured chain.
  const Eigen::Vector3d& axis = settings.axis;
  const bool by_chain = rig.model.chain && !settings.view.corrects();
  recorder.event(clock.now(), "servo",
                 nlohmann::json{{"axis", {axis.x(), axis.y(), axis.z()}},
                                {"axis_sigma", settings.axis_uncertainty()},
                                {"chain", by_chain},
                                {"field", settings.field}}
                     .dump());
  loop_->task = clock.spawn("servo", [loop = loop_.get()] { loop->run(); });
}

Servo::~Servo() { close(); }

ServoStatus Servo::status() const { return loop_->status; }
Signal& Servo::changed() { return loop_->ticked; }
const ServoSettings& Servo::settings() const { return loop_->settings; }

/// The progress is 0 at once: a script may wait for it before the next frame has come.
void Servo::follow(const control::Trajectory& path, int pictures) {
  loop_->set_goal(Loop::Mode::following, path, pictures);
  loop_->status.progress = 0;
}

std::string Servo::refusal(const control::Trajectory& path) const {
  try {
    loop_->check_goal(path);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return {};
}

void Servo::hold(const Eigen::Vector3d& position, const Eigen::Vector3d& velocity) {
  loop_->set_goal(Loop::Mode::holding, control::Trajectory::glide(position, velocity, kMovingHold),
                  0);
}

void Servo::turn(const control::DirectionPath& path) {
  if (loop_->rotating)
    throw std::invalid_argument("direction: the law \"rotating\" steers by the axis itself");
  loop_->attitude.turn(path);
  loop_->status.turned = false;
}

Eigen::Vector3d Servo::direction() const {
  return loop_->attitude.wanted(to_seconds(loop_->clock.now()));
}

/// Throws std::invalid_argument for another law, which has no estimate of a disturbance.
void Servo::release(bool cancel, bool touch) {
  if (cancel && loop_->settings.law != ControlLaw::estimator)
    throw std::invalid_argument("cancel: only the law \"estimator\" knows what pushes the robot");
  if (loop_->rotating) loop_->rotating->steer();
  loop_->canceling = cancel;
  loop_->allow_touch(touch || loop_->settings.may_touch);
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

void Servo::spin(const Eigen::Vector3d& axis, double frequency) {
  if (!loop_->rotating) throw std::invalid_argument("only the law \"rotating\" turns the field");
  loop_->rotating->spin(axis, frequency);
  loop_->mode = Loop::Mode::released;
  loop_->let_go = false;
  loop_->corrections.clear();
}

std::optional<RotationState> Servo::rotation() const {
  if (!loop_->rotating) return std::nullopt;
  return loop_->rotating->state();
}

/// Corrections from before belong to another trim and would falsify the mean.
void Servo::set_trim(const Eigen::Vector3d& force) {
  loop_->controller.set_trim(force, loop_->goal);
  loop_->corrections.clear();
}

Eigen::Vector3d Servo::trim() const { return loop_->controller.trim(); }

/// An event of the record, since positions differ by it from there on.
void Servo::set_offset(const Eigen::Vector3d& offset) {
  // m: more is no bias but another position. A bench that was set up by hand is 0.8 mm aside (one
  // sigma, docs/simulated_laboratory.md).
  constexpr double kLargest = 3e-3;
  if (!(offset.norm() <= kLargest))
    throw std::invalid_argument("offset: wants at most " + format_quantity(kLargest, "m") +
                                ", got " + format_quantity(offset.norm(), "m"));
  loop_->offset = offset;
  loop_->recorder.event(loop_->clock.now(), "offset",
                        nlohmann::json{offset.x(), offset.y(), offset.z()}.dump());
}

Eigen::Vector3d Servo::offset() const { return loop_->offset; }

Eigen::Vector3d Servo::force_for(const Eigen::Vector3d& velocity) const {
  return loop_->controller.force_of(velocity);
}

/// The robot stands still on average, so the velocity asked for balances what the model lacks:
/// f = R mean(v) (the thesis trims by hand, 6.1).
Eigen::Vector3d Servo::mean_correction(double duration) const {
  const auto& corrections = loop_->corrections;
  // Nine tenths: samples come with the frames, not at the ends of the time asked for.
  if (corrections.empty() || corrections.back().first - corrections.front().first < duration * 0.9)
    throw std::logic_error("mean_correction: the servo has not held this place for that long");
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const auto& [time, correction] : corrections) {
    if (time < corrections.back().first - duration) continue;
    sum += correction;
    ++count;
  }
  return loop_->controller.force_of(sum / count);
}

std::optional<ServoMargins> Servo::margins() const { return loop_->controller.margins(); }

double Servo::margin() const { return loop_->surface.margin(); }
/// Throws std::invalid_argument for a duration out of bounds, std::logic_error for a law that would
/// not know of the fall.
void Servo::let_fall(double duration) {
  constexpr double kLongest = 1;  // s
  if (!(duration > 0 && duration <= kLongest))
    throw std::invalid_argument("duration: wants more than 0 s and at most " +
                                format_quantity(kLongest, "s"));
  if (loop_->settings.law != ControlLaw::estimator)
    throw std::logic_error("let_fall: only the law \"estimator\" reckons with a fall");
  loop_->fall = {duration, 0, 0, false, false};
  loop_->mode = Loop::Mode::falling;
}

std::optional<std::pair<double, double>> Servo::last_fall() const {
  if (!loop_->fall.over || !loop_->fall.begun) return std::nullopt;
  return std::pair{loop_->fall.off, loop_->fall.on};
}

LoopQuality Servo::quality() const { return loop_->reports.worst(); }

/// The next frame with an image takes it; a caption that is still waiting is replaced.
void Servo::snapshot(const std::string& caption) { loop_->wanted_picture = caption; }

/// With the caller's own stop deferred, as the coils must be at zero before it goes on. Also called
/// by the destructor.
void Servo::close() {
  if (!loop_->task) return;
  const StopShield shield(loop_->clock);
  loop_->task->request_stop();
  loop_->task->join();
  loop_->task.reset();
}

}  // namespace vitreo
