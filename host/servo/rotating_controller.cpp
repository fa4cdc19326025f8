// SPDX-License-Identifier: Apache-2.0
#include "host/servo/rotating_controller.h"

#include "control/robots.h"
#include "host/servo/rotating_margin.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr double kMeasurementFloor = 0.2e-6;  // m, as ServoController's
/// Part of the step-out found at which it goes on.
constexpr double kBelowStepOut = 0.8;
/// Part of the believed step-out up to which it goes where nothing else is said.
constexpr double kBelowBelieved = 0.7;
constexpr double kGrace = 1.5;  // s after the first measurement: the robot turns into the field

void need(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// m/rad: what the robot goes by where it neither slips nor is hindered.
double advance_of(const RigModel& model, control::RotatingMode mode) {
  const control::Robot& robot = model.robot;
  if (mode == control::RotatingMode::oscillating) return 0;  // the measured curve takes its place
  if (mode == control::RotatingMode::helix)
    return control::helix_resistance(*robot.helix, model.medium.dynamic_viscosity()).advance();
  const double a = robot.semi_axis, b = robot.semi_radius;
  // A turn of a body that tumbles on a wall without slip is the circumference of its ellipse, by
  // the mean square of the axes; of a sphere that is its radius.
  return std::sqrt((a * a + b * b) / 2);
}

/// s: the axis follows the field's as e^(-t / lag), lag = 2 z / (m B), z the drag of turning: the
/// mean of the torque across the axis over a turn is half of that of a field that stands (helix).
/// oscillating: z / (m B cos swing), by the part of the field that stands. A robot whose moment
/// lies in the plane of rotation turns with it at once.
double axis_lag(const RigModel& model, const RotatingSettings& law, double field) {
  const double turn = control::rotational_resistance(model.robot, model.medium) /
                      (model.robot.moment(field) * field);
  if (law.mode == control::RotatingMode::oscillating) return turn / std::cos(law.swing);
  return law.mode == control::RotatingMode::helix ? 2 * turn : 0;
}

/// What robot each mode is for.
bool fits(const control::Robot& robot, control::RotatingMode mode) {
  if (mode == control::RotatingMode::helix) return robot.helix.has_value();
  if (mode == control::RotatingMode::oscillating) return robot.tail.has_value();
  return !robot.helix && !robot.tail;
}

/// In the fluid, free of the walls.
bool swims(control::RotatingMode mode) {
  return mode == control::RotatingMode::helix || mode == control::RotatingMode::oscillating;
}

control::StepOutSettings watch_settings(control::RotatingMode mode) {
  control::StepOutSettings settings;
  // A helix' advance is its geometry, a tail's speed was measured; how much a wall lets slip is not
  // known beforehand.
  settings.known = swims(mode);
  if (mode == control::RotatingMode::oscillating) {
    // Slow: in the 0.6 s of a helix it goes 40 to 100 um, and a drop by a quarter shows beyond the
    // noise after 120. Of the beat, which goes aside, some is along the way where the axis turns.
    settings.window = 3;
    settings.memory = 12;
  }
  return settings;
}

}  // namespace

void RotatingSettings::check() const {
  need(!frequency || (*frequency > 0 && *frequency <= 200), "frequency: must be in (0, 200] Hz");
  need(!proportional || *proportional >= 0, "proportional: must be at least 0 1/s");
  need(!max_speed || *max_speed > 0, "max_speed: must be above 0 m/s");
  need(swing > 0 && swing < 1.5, "swing: must be in (0, 1.5) rad");
}

RotatingController::RotatingController(const RigModel& model,
                                       const RotatingControllerSettings& settings)
    : model_(model),
      settings_(settings),
      advance_((need(fits(model.robot, settings.law.mode),
                     "mode: \"helix\" is for a helical robot, \"oscillating\" for one with a "
                     "flexible tail, \"roller\" and \"tumbler\" for the others"),
                advance_of(model, settings.law.mode))),
      lag_(axis_lag(model, settings.law, settings.field)),
      step_out_limit_(std::numeric_limits<double>::infinity()),
      watch_(watch_settings(settings.law.mode)),
      commands_(model.command_delay, std::max(lag_, 1e-3)) {
  settings_.law.check();
  need(settings.period > 0, "period: must be above 0 s");
  need(swims(settings.law.mode) || model.eye.size() > 2,
       "mode: roller and tumbler need an eye in the rig's model, whose retina they go on");
  state_.rotation.axis = settings.axis;
  state_.rotation.first = settings.axis.unitOrthogonal();
  state_.rotation.field = settings.field;
  // A tail does not step out: the higher the frequency, the less its head turns.
  if (oscillates())
    state_.rotation.swing = 0;
  else
    state_.believed_step_out =
        control::step_out_frequency(model.robot, model.medium, settings.field);
}

RotatingStep RotatingController::step(double now,
                                      const std::optional<control::PositionMeasurement>& measured,
                                      const ReferencePath& path, ControlMode mode, double update) {
  RotatingStep step;
  // The order matters: the law sets position_ to where the robot will be when the command acts, the
  // currents are computed there, and they say how fast the field may turn.
  step.passed_over = measured && !take(now, *measured, step);
  settings_.limits.update = update;
  const Eigen::Vector3d velocity = wanted(step, now, path, mode);
  allocate(step, position_, update);
  const double law = settings_.law.frequency.value_or(usual_limit());
  // The law's own limit is kept below the step-out of the field that is wanted, not of what is left
  // of it where the coils cut it. A spin is slowed by a step-out only where the law recovers.
  state_.limit = std::min(law, coils_limit_);
  if (!spin_ || settings_.law.recover) state_.limit = std::min(state_.limit, step_out_limit_);
  state_.set_points = 1 / update;
  command(step, now, velocity, mode);
  control::Rotation& rotation = state_.rotation;
  rotation.field = settings_.field;
  const double part = control::reachable_part(step.currents, rotation, settings_.limits);
  step.limited = part < 1 - 1e-6;
  rotation.field *= part;
  return step;
}

/// Hz, where nothing else is said.
double RotatingController::usual_limit() const {
  if (!oscillates()) return kBelowBelieved * state_.believed_step_out;
  return settings_.law.speeds ? settings_.law.speeds->fastest()
                              : std::numeric_limits<double>::infinity();
}

/// As ServoController::take. Each measurement that was used also feeds the watch.
bool RotatingController::take(double now, const control::PositionMeasurement& measured,
                              RotatingStep& step) {
  if (!measured.position.allFinite() || !std::isfinite(measured.time) || measured.time > now)
    return false;
  if (last_ && measured.time <= last_->time) return false;
  control::PositionMeasurement sound = measured;
  sound.covariance += kMeasurementFloor * kMeasurementFloor * Eigen::Matrix3d::Identity();
  // A Cholesky factor exists exactly for a positive definite matrix.
  if (Eigen::LLT<Eigen::Matrix3d>(sound.covariance).info() != Eigen::Success) return false;
  if (!estimator_) tune(now, sound);
  // A tail's beat is taken off: seen slower than it is, the law would answer it.
  const auto beating = beating_at(sound.time);
  if (beating) sound.position -= beat_.displacement(*beating);
  // What the filter does not believe says nothing of the response either.
  if (!estimator_->measure(sound)) return false;
  if (const auto& innovation = estimator_->innovation(); beating && innovation)
    beat_.learn(*beating, innovation->value, innovation->covariance);
  // The watch knows the beat as a part of its noise.
  sound.position = measured.position;
  watch(sound, step);
  last_ = sound;
  position_ = sound.position;
  return true;
}

/// The delay is the coils'; what lags behind it is the robot's axis, the coils' own lag being made
/// good by what is commanded.
void RotatingController::tune(double now, const control::PositionMeasurement& first) {
  control::LoopIdentity loop;
  loop.measurement_latency = now - first.time;
  loop.command_delay = model_.command_delay;
  loop.command_lag = std::max(lag_, 1e-3);
  loop.period = settings_.period;
  loop.noise = std::sqrt(first.covariance.trace() / 3);
  loop.drag =
      control::resistance(model_.robot, model_.medium, settings_.axis).diagonal().minCoeff();
  loop.weight = model_.robot.net_weight(model_.medium);
  loop.instability = 0;  // a field without gradient pulls nowhere
  tuning_ = control::tune(loop);
  tuning_->gains.proportional = settings_.law.proportional.value_or(tuning_->gains.proportional);
  tuning_->gains.max_speed = settings_.law.max_speed.value_or(tuning_->gains.max_speed);
  tuning_->gains.check();
  estimator_.emplace(tuning_->estimator);
  // Until the first command acts the robot sinks.
  estimator_->set_before(sinking());
  began_ = first.time;
}

/// The way along the commanded one, without the sinking, against it. Where the axis is being turned
/// by much, the robot's own is not known well enough.
void RotatingController::watch(const control::PositionMeasurement& measured, RotatingStep& step) {
  if (!last_ || measured.time < began_ + kGrace) return;
  const double span = measured.time - last_->time;
  const Eigen::Vector3d from = commands_.velocity_at(last_->time);
  const control::CommandHistory::Motion motion =
      commands_.advance(from, last_->time, measured.time);
  commands_.forget_before(last_->time - commands_.memory());
  // One that is spun may be spun beyond its step-out on purpose, and stand.
  if (spin_)
    still_.reset();
  else
    still_.add(measured.time, measured.position, std::sqrt(measured.covariance.trace() / 3),
               motion.moved + span * sinking());
  state_.standing = still_.stands();
  if (turning_ > 0) {
    turning_ -= span;
    interrupt();
    return;
  }
  const double commanded = motion.moved.norm();
  if (!(commanded > 0)) return;
  const Eigen::Vector3d along = motion.moved / commanded;
  const double turning =
      along.dot(last_commanded_.norm() > 0 ? last_commanded_.normalized() : along);
  constexpr double kStraight = 0.9;  // cosine
  // What was commanded while the robot moved and what is commanded now point elsewhere: the axis is
  // being turned, and a robot that lags behind it is no step-out.
  if (std::abs(turning) < kStraight) return interrupt();
  // Of the mean over the interval, as delayed as the motion that it is compared with.
  const double frequency = oscillates() ? settings_.law.speeds->frequency(commanded / span)
                                        : commanded / span / std::abs(advance_) / (2 * M_PI);
  if (too_slow(commanded / span, frequency)) return interrupt();
  const double went = (measured.position - last_->position - span * sinking()).dot(along);
  const bool found = watch_.add(went, commanded, span, frequency);
  if (found) step.stepped_out = frequency;
  judge(found, step);
  state_.response = watch_.response();
  state_.response.stepped_out = step_outs_ > 0;
}

/// The beat takes a tail aside by ten times the sensor's noise: of a way in pieces each has that at
/// both of its ends.
void RotatingController::interrupt() {
  if (oscillates()) watch_.interrupt();
}

/// Turned slowly, a helix turns its axis more slowly than by the lag (docs/rotating_fields.md). Of
/// a slow tail's way the weight is too large a part, which is a difference of two that nearly
/// cancel, and by less swing than was measured the speed is known by the law of its square alone.
/// One that does not follow lags, and is commanded faster.
bool RotatingController::too_slow(double speed, double frequency) const {
  constexpr double kTooSlow = 1. / 8;  // of the believed step-out
  constexpr double kFullSpeed = 0.8;   // of the fastest
  if (!oscillates()) return frequency < kTooSlow * state_.believed_step_out;
  const control::SpeedCurve& curve = *settings_.law.speeds;
  return speed < kFullSpeed * curve.speed(curve.fastest());
}

/// A step-out: below it, the robot turns with the field again, which is then watched for. A robot
/// that does not at three lower frequencies is held, aground, or not what is believed.
void RotatingController::judge(bool found, RotatingStep& step) {
  constexpr int kTries = 3;
  if (found) {
    ++step_outs_;
    state_.unresponsive = state_.unresponsive || step_outs_ > kTries;
    if ((spin_ && !settings_.law.recover) || state_.unresponsive) return;
    // A tail that does not follow is held, or its field is not what is believed: a lower frequency
    // is no remedy.
    if (!oscillates()) step_out_limit_ = kBelowStepOut * watch_.response().step_out;
    watch_.recovered();
    constexpr double kCatches = 0.2;  // s, until it turns with the slower field
    settle_in(kCatches);
  } else if (step_outs_ > 0 && watch_.settled() && !watch_.response().stepped_out) {
    step_outs_ = 0;
    state_.unresponsive = false;
    step.recovered = true;
  }
}

/// The velocity to command, m/s through the fluid; zero: the field stands.
Eigen::Vector3d RotatingController::wanted(RotatingStep& step, double now,
                                           const ReferencePath& path, ControlMode mode) {
  ahead_.reset();
  if (!estimator_) return Eigen::Vector3d::Zero();
  step.estimate = estimator_->at(now);
  if (!step.estimate) return Eigen::Vector3d::Zero();
  // All is taken at the time at which the command will act (docs/control.md, Estimate and law).
  const double then = now + std::max(0.0, tuning_->horizon + step.estimate->delay);
  const auto ahead = estimator_->at(then);
  ahead_ = ahead;
  if (!ahead || (mode != ControlMode::follow && mode != ControlMode::cancel))
    return Eigen::Vector3d::Zero();
  position_ = ahead->position;
  const control::Reference reference = control::held_reference(path, then, settings_.period);
  // As ServoController::plan.
  constexpr double kRemembered = 0.92;  // s
  changes_.reference_speed =
      std::max(reference.velocity.norm(),
               changes_.reference_speed * std::exp(-settings_.period / kRemembered));
  changes_.command = (ahead->commanded - last_ahead_).norm();
  last_ahead_ = ahead->commanded;
  const control::ServoSchedule planned = control::schedule(*tuning_, *ahead, changes_);
  estimator_->set_disturbance_walk(planned.disturbance_walk);
  control::ServoGains gains = tuning_->gains;
  gains.proportional = settings_.law.proportional.value_or(planned.proportional);
  if (mode == ControlMode::cancel) return -ahead->disturbance / (1 + ahead->gain) - sinking();
  // A reference that runs away, because the frequency is limited, waits; of its velocity only what
  // it still goes is fed forward.
  constexpr double kPatience = 0.3e-3;  // m
  const double speed = reference.velocity.norm();
  const Eigen::Vector3d off = reference.position - ahead->position;
  const double late = speed > 0 ? off.dot(reference.velocity) / speed : 0;
  const double wait = std::clamp(late / kPatience - 1, 0.0, 1.0);
  step.behind = settings_.period * wait;
  control::Reference held = reference;
  held.velocity *= 1 - wait;
  const Eigen::Vector3d velocity = control::servo_velocity(gains, held, *ahead);
  step.correction = velocity - held.velocity;
  return velocity - sinking();
}

/// m/s, of a robot that turns with the field of the spin.
Eigen::Vector3d RotatingController::spun() const {
  const double frequency = std::clamp(spin_->frequency, -most(), most());
  if (oscillates()) {
    if (!settings_.law.speeds) return Eigen::Vector3d::Zero();
    return settings_.law.speeds->speed(std::abs(frequency)) * spin_->axis;
  }
  const bool helix = settings_.law.mode == control::RotatingMode::helix;
  return advance_ * 2 * M_PI * frequency *
         (helix ? spin_->axis : spin_->axis.cross(wall_normal(position_)));
}

/// Hz. Steering stays below a step-out that was found, whether or not a spin is to be slowed.
double RotatingController::most() const {
  const double limit = std::max(state_.limit, 1e-3);
  const double found = watch_.response().step_out;
  return spin_ || oscillates() || !(found > 0) ? limit : std::min(limit, kBelowStepOut * found);
}

/// Sets axis and frequency for a velocity through the fluid; what they make of it, m/s.
Eigen::Vector3d RotatingController::steered(const Eigen::Vector3d& velocity) {
  control::Rotation& rotation = state_.rotation;
  control::SwimSettings swim;
  swim.mode = settings_.law.mode;
  swim.advance = advance_;
  // The robot's axis is at most half a radian behind.
  swim.turn_rate = std::min(6.0, 0.5 / std::max(lag_, 1e-3));
  swim.frequency = most();
  swim.swing = settings_.law.swing;
  if (settings_.law.speeds) swim.speeds = &*settings_.law.speeds;
  const control::SwimCommand given =
      control::swim(swim, velocity, wall_normal(position_), rotation.axis, settings_.period);
  // A quick turn of the axis costs speed as a step-out does.
  constexpr double kQuick = 0.15;  // rad in one lag
  constexpr double kLags = 3;
  const double angle = std::acos(std::clamp(given.axis.dot(rotation.axis), -1.0, 1.0));
  if (angle / settings_.period * lag_ > kQuick) settle_in(kLags * lag_);
  rotation.turn_to(given.axis);
  rotation.frequency = given.frequency;
  if (oscillates()) rotation.swing = given.swing;
  return given.velocity;
}

/// A spin goes on as it was told unless that would take the robot into a wall's margin: then the
/// margin steers. Rollers and tumblers are on the wall.
void RotatingController::command(RotatingStep& step, double now, const Eigen::Vector3d& velocity,
                                 ControlMode mode) {
  Eigen::Vector3d given = spin_ ? spun() : velocity;
  const bool keeps = clearance_ != nullptr && ahead_ && mode != ControlMode::constant &&
                     mode != ControlMode::off && swims(settings_.law.mode);
  if (keeps) {
    const auto kept =
        margin_kept(*clearance_, {*ahead_, sinking(), tuning_->loop.dead_time()}, given);
    step.kept_out = kept.has_value();
    given = kept.value_or(given);
  }
  if (spin_ && !step.kept_out) {
    state_.rotation.turn_to(spin_->axis);
    state_.rotation.frequency = std::clamp(spin_->frequency, -most(), most());
    if (oscillates()) state_.rotation.swing = settings_.law.swing;
  } else {
    given = steered(given);
  }
  turn_phase(now);
  // Two histories: the watch compares with the swimming alone, the filter with all that moves the
  // robot, the sinking included.
  commands_.add(now, given);
  last_commanded_ = given;
  if (estimator_) estimator_->command(now, given + sinking());
}

void RotatingController::allocate(RotatingStep& step, const Eigen::Vector3d& position,
                                  double update) {
  const Eigen::Vector3d known = model_.field.nearest_valid(position);
  step.outside = known != position;
  step.currents =
      control::uniform_field_currents(model_.field.matrix(known), settings_.limits.currents);
  step.constant = -step.currents * model_.field.background(known).head<3>();
  // The frequency is asked for the whole field, not for the part that the last turn could reach.
  control::Rotation whole = state_.rotation;
  whole.field = settings_.field;
  if (oscillates()) whole.swing = settings_.law.swing;
  settings_.limits.update = update;
  coils_limit_ = control::fastest(step.currents, whole, settings_.limits);
}

/// The phase as the rotor turns it, but for where it began and for what its set-points are apart:
/// both are in what is learnt.
void RotatingController::turn_phase(double now) {
  constexpr double kKept = 1;  // s, beyond what delay and latency are
  if (!oscillates()) return;
  const control::Rotation& rotation = state_.rotation;
  double phase = 0;
  if (!turned_.empty()) {
    const Turned& last = turned_.back();
    phase = std::remainder(last.moment.phase + last.rate * (now - last.time), 2 * M_PI);
  }
  turned_.push_back(
      {now, 2 * M_PI * rotation.frequency, {phase, rotation.swing.value_or(0), rotation.first}});
  while (turned_.size() > 2 && turned_[1].time < now - kKept) turned_.pop_front();
}

/// Of the command that acted then. Nothing of a field that turns, and before there was any.
std::optional<control::Beat::Moment> RotatingController::beating_at(double time) const {
  const double given = time - model_.command_delay;
  for (auto turned = turned_.rbegin(); turned != turned_.rend(); ++turned) {
    if (turned->time > given) continue;
    control::Beat::Moment moment = turned->moment;
    moment.phase += turned->rate * (given - turned->time);
    return moment;
  }
  return std::nullopt;
}

/// m/s, world; zero on a wall, which carries the robot.
Eigen::Vector3d RotatingController::sinking() const {
  if (!swims(settings_.law.mode)) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d weight(0, 0, -model_.robot.net_weight(model_.medium));
  return control::resistance(model_.robot, model_.medium, state_.rotation.axis).inverse() * weight;
}

/// Of the retina, towards the robot: its sphere below the equator, a cylinder above.
Eigen::Vector3d RotatingController::wall_normal(const Eigen::Vector3d& position) const {
  if (swims(settings_.law.mode)) return Eigen::Vector3d::UnitZ();
  const double radius = model_.eye.surfaces.front().radius;
  Eigen::Vector3d inwards = model_.eye_in_world + Eigen::Vector3d(0, 0, radius) - position;
  inwards.z() = std::max(inwards.z(), 0.0);
  return inwards.norm() > 1e-6 ? Eigen::Vector3d(inwards.normalized()) : Eigen::Vector3d::UnitZ();
}

void RotatingController::spin(const Eigen::Vector3d& axis, double frequency) {
  need(axis.allFinite() && std::abs(axis.norm() - 1) < 1e-6, "axis: must be a direction");
  need(std::isfinite(frequency), "frequency: must be a number");
  constexpr double kLeap =
      0.95;  // cosine: an axis that leaps takes some lags until the robot is there
  constexpr double kLags = 4;
  settle_in(std::abs(axis.dot(state_.rotation.axis)) < kLeap ? kLags * lag_ : 0);
  spin_ = Spin{axis, frequency};
  watch_.recovered();
  step_outs_ = 0;
  state_.unresponsive = false;
}

/// What the filter learnt of a robot that was spun, stepped out perhaps, is no use for steering.
void RotatingController::steer() {
  if (spin_) estimator_.reset();
  spin_.reset();
}

/// What was on its way when the frequency or the axis leapt is not judged.
void RotatingController::settle_in(double more) {
  if (tuning_) turning_ = tuning_->loop.measurement_latency + model_.command_delay + more;
}

void RotatingController::reset() {
  estimator_.reset();
  tuning_.reset();
  watch_.reset();
  still_.reset();
  step_outs_ = 0;
  state_.unresponsive = state_.standing = false;
  commands_.clear();
  turned_.clear();
  beat_.reset();
  last_.reset();
  changes_ = {};
  last_commanded_.setZero();
  last_ahead_.setZero();
}

}  // namespace vitreo
