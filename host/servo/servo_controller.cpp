// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_controller.h"

#include "control/keep_out.h"
#include "control/robots.h"
#include "control/stability.h"
#include "host/servo/robot_clearance.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

// m, standard deviation added to every measurement: none is better, whatever its covariance says,
// and R stays positive definite where a sensor states a singular one.
constexpr double kFloor = 0.2e-6;
// Normalized innovation, mean of ten seconds: a filter whose standard deviations are half of the
// true.
constexpr double kInconsistent = 4;

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// Throws std::invalid_argument naming the setting.
const ControllerSettings& checked(const ControllerSettings& settings) {
  require(settings.field > 0 && std::isfinite(settings.field), "field: must be above 0 T");
  require(settings.field_max == 0 ||
              (settings.field_max >= settings.field && std::isfinite(settings.field_max)),
          "field_max: must be at least the field, or 0");
  require(settings.tone >= 0 && std::isfinite(settings.tone), "tone: must be at least 0 A");
  const auto positive = [](const std::optional<double>& own) {
    return !own || (*own > 0 && std::isfinite(*own));
  };
  require(positive(settings.proportional), "proportional: must be above 0 1/s");
  require(positive(settings.max_speed), "max_speed: must be above 0 m/s");
  require(settings.total_limit > 0 && std::isfinite(settings.total_limit),
          "total_limit: must be above 0 A");
  require(settings.period > 0 && std::isfinite(settings.period), "period: must be above 0 s");
  return settings;
}

/// The velocity commanded that keeps the margin (control::keep_out): judged is the robot's own,
/// with what drives it beside the command, where it will be when this command acts. The rate, a
/// quarter of the dead time's inverse, is half of the loop's bandwidth: the margin is met without
/// overshoot.
Eigen::Vector3d kept_out(const RobotClearance* clearance, const control::LoopIdentity& loop,
                         ControlStep& step, const control::PositionEstimate& ahead,
                         const Eigen::Vector3d& velocity) {
  if (clearance == nullptr) return velocity;
  const auto near = clearance->at(ahead.position, ahead.covariance.topLeftCorner<3, 3>());
  if (!near) return velocity;
  control::KeepOut settings;
  settings.margin = clearance->margin();
  settings.rate = 0.25 / loop.dead_time();
  const double response = 1 + ahead.gain;
  const control::KeptOut kept =
      control::keep_out(settings, *near, ahead.disturbance + response * velocity);
  step.kept_out = kept.limited;
  if (!kept.limited) return velocity;
  return (kept.velocity - ahead.disturbance) / response;
}

/// m/s, of a law without prediction, however near a wall is.
constexpr double kAlwaysSafe = 2e-3;

/// m/s: as fast as a law without prediction may go whose robot is seen at `measured`. What it does
/// not know of yet takes a dead time T; a loop that has become a relay goes to and fro by speed x T
/// about its target, and shall do so within half of what is free about it. Never below what a robot
/// needs to come away from a wall.
double safe_speed(const RobotClearance* clearance,
                  const std::optional<control::ServoTuning>& tuning,
                  const control::PositionMeasurement& measured) {
  if (clearance == nullptr || !tuning) return std::numeric_limits<double>::infinity();
  const auto near = clearance->at(measured.position, measured.covariance);
  if (!near) return std::numeric_limits<double>::infinity();
  const double left = near->nearest().bound() - clearance->margin();
  return std::max(kAlwaysSafe, 0.5 * left / tuning->loop.dead_time());
}

}  // namespace

const char* to_string(ControlLaw law) {
  constexpr const char* kNames[] = {"pd", "estimator", "velocity", "rotating"};
  return kNames[static_cast<std::size_t>(law)];
}

ControlLaw control_law_named(const std::string& name) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator, ControlLaw::velocity})
    if (name == to_string(law)) return law;
  throw std::invalid_argument("law: wants \"pd\", \"estimator\" or \"velocity\", got \"" + name +
                              "\"");
}

/// Throws std::invalid_argument naming the setting.
ServoController::ServoController(const RigModel& model, const ControllerSettings& settings)
    : model_(model),
      settings_(checked(settings)),
      drag_(control::resistance(model.robot, model.medium, settings.axis)),
      mobility_(drag_.inverse()),
      allocator_(model_, {settings.field, std::max(settings.field, settings.field_max),
                          settings.axis, settings.limits, settings.total_limit, settings.tone}),
      pd_(settings.gains),
      velocity_(settings.velocity),
      watch_(model_) {
  require(!settings.wall_drag || model.eye.size() > 2,
          "wall_drag: needs an eye with a lens in the rig's model");
}

/// A constant current replaces what the law has allocated; the law still runs, so that its estimate
/// is known.
ControlStep ServoController::step(double now,
                                  const std::optional<control::PositionMeasurement>& measured,
                                  const ReferencePath& path, ControlMode mode) {
  require(mode != ControlMode::cancel || settings_.law == ControlLaw::estimator,
          "canceling needs the law \"estimator\"");
  ControlStep step;
  const bool taken = measured && take(now, *measured);
  step.passed_over = measured && !taken;
  if (settings_.law == ControlLaw::estimator)
    predict(step, now, path, mode);
  else if (taken)
    steer(step, now, *measured, path, mode);
  if (mode == ControlMode::constant) allocate(step, trim_position_, trim_);
  if (mode == ControlMode::off) {
    step.currents.setZero(model_.field.coils());
    step.field = 0;
    step.headroom = 1;
    step.limited = false;
  }
  if (taken) watch(*measured, path, mode);
  watch_.kept_out(now, step.kept_out);
  step.quality = watch_.quality();
  return step;
}

/// The validity of a measurement, and with the estimator its update. False for one that is not
/// used: a gap is bridged by prediction, a wild measurement becomes a wild current.
bool ServoController::take(double now, const control::PositionMeasurement& measured) {
  if (!measured.position.allFinite() || !std::isfinite(measured.time) || measured.time > now)
    return false;
  if (measured.time <= last_measured_) return false;  // the filters' time does not run backwards
  last_measured_ = measured.time;
  const bool by_law = settings_.law == ControlLaw::estimator;
  // Of the other laws a filter only serves the keep-out margin.
  if (!by_law && clearance_ == nullptr && !estimator_) return true;
  control::PositionMeasurement sound = measured;
  sound.covariance += kFloor * kFloor * Eigen::Matrix3d::Identity();
  // A Cholesky factor exists exactly for a positive definite matrix.
  if (Eigen::LLT<Eigen::Matrix3d>(sound.covariance).info() != Eigen::Success) return !by_law;
  if (!estimator_) tune(now, sound);
  if (!estimator_->measure(sound)) return !by_law;
  if (estimator_->innovation())
    innovations_.add(*estimator_->innovation(), sound.time - estimated_);
  estimated_ = sound.time;
  if (by_law)
    watch_.measured(sound.time, *estimator_, ahead_.delay, !estimator_->innovation().has_value());
  return true;
}

/// Gains and filter noise from the loop as it is at its first measurement (control::tune).
void ServoController::tune(double now, const control::PositionMeasurement& first) {
  control::LoopIdentity loop;
  loop.measurement_latency = now - first.time;
  loop.command_delay = model_.command_delay;
  // The bandwidth f is a first-order lag's -3 dB frequency: its time constant is 1 / (2 pi f).
  loop.command_lag = 1 / (2 * M_PI * model_.command_bandwidth);
  loop.period = settings_.period;
  // Root mean square over the three coordinates: sqrt(trace R / 3).
  loop.noise = std::sqrt(first.covariance.trace() / 3);
  // Of the direction in which the robot moves most easily: there the gain is highest.
  loop.drag = drag_.diagonal().minCoeff();
  loop.weight = model_.robot.net_weight(model_.medium);
  // Earnshaw's instability (thesis 6.1; facts/magnetics 2.1) by the model: the growth rate of a
  // displacement from the center in the currents that levitate the robot there.
  ControlStep held;
  allocate(held, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  const Eigen::Vector3d center = model_.field.nearest_valid(Eigen::Vector3d::Zero());
  loop.instability = std::max(
      0.0, control::instability(model_.field, model_.robot, model_.medium, held.currents, center));
  tuning_ = control::tune(loop);
  control::ServoGains& gains = tuning_->gains;
  gains.proportional = settings_.proportional.value_or(gains.proportional);
  gains.max_speed = settings_.max_speed.value_or(gains.max_speed);
  estimator_.emplace(tuning_->estimator);
  // Until the first command acts, nothing carries the robot.
  estimator_->set_before(drag_at(first.position).inverse() * Eigen::Vector3d(0, 0, -loop.weight));
}

/// The estimator's law (control::servo_velocity). Reference and estimate are those of the moment at
/// which the currents set now take effect, as far as the delay is known: the dead time is predicted
/// away instead of limiting the gain.
void ServoController::predict(ControlStep& step, double now, const ReferencePath& path,
                              ControlMode mode) {
  if (!estimator_) return;
  step.estimate = estimator_->at(now);
  if (!step.estimate) return;
  const double then = now + std::max(0.0, tuning_->horizon + step.estimate->delay);
  const auto ahead = estimator_->at(then);
  if (!ahead) return;
  const control::Reference reference = control::held_reference(path, then, settings_.period);
  plan(*ahead, mode == ControlMode::follow ? reference.velocity.norm() : 0);
  if (mode == ControlMode::off) return let_go(step, now, ahead->position);
  const Eigen::Matrix3d drag = drag_at(ahead->position);
  const Eigen::Matrix3d mobility = settings_.wall_drag ? drag.inverse() : mobility_;
  // Force and velocity are one thing in Stokes flow: f = R v, v = R^-1 f. The trim is a force.
  const Eigen::Vector3d trimmed = mobility * trim_;
  Eigen::Vector3d velocity = trimmed;
  bool capped = false;
  if (mode == ControlMode::follow) {
    control::ServoGains gains = tuning_->gains;
    gains.proportional = schedule_.proportional;
    capped = gains.proportional * (reference.position - ahead->position).norm() > gains.max_speed;
    velocity = control::servo_velocity(gains, reference, *ahead);
    step.correction = velocity - reference.velocity - trimmed;
  } else if (mode == ControlMode::cancel) {
    // The law above without its reference: the robot stays put.
    velocity = -ahead->disturbance / (1 + ahead->gain);
  }
  velocity = kept_out(clearance_, tuning_->loop, step, *ahead, velocity);
  step.at_bound = estimator_->at_bound();
  step.inconsistent = innovations_.normalized() > kInconsistent;
  allocator_.choose(ahead->position, drag * velocity, settings_.period);
  // Anti-windup: the filter's input u is the velocity that the limits left, not the one asked for.
  step.commanded = mobility * allocate(step, ahead->position, drag * velocity);
  estimator_->command(now, step.commanded);
  if (!step.limited) step.currents += allocator_.tone(step.currents, ahead->position, now);
  watch_command(step, now, mobility, capped);
}

/// Without current the robot sinks: that is the filter's input, as before the first command.
void ServoController::let_go(ControlStep& step, double now, const Eigen::Vector3d& position) {
  const double weight = model_.robot.net_weight(model_.medium);
  step.currents.setZero(model_.field.coils());
  step.commanded = drag_at(position).inverse() * Eigen::Vector3d(0, 0, -weight);
  estimator_->command(now, step.commanded);
  watch_command(step, now, mobility_, false);
}

void ServoController::watch_command(const ControlStep& step, double now,
                                    const Eigen::Matrix3d& mobility, bool capped) {
  constexpr double kAtClamp = 0.99;
  const bool clamped = ahead_.disturbance.norm() > kAtClamp * tuning_->estimator.max_disturbance;
  watch_.commanded({now, step.currents, ahead_.position, mobility, capped, clamped});
}

/// Position against target, whatever the law. Of velocity control, whose robot stands for long
/// until the medium yields, standing is no fault; nor is it of one that is left alone.
void ServoController::watch(const control::PositionMeasurement& measured, const ReferencePath& path,
                            ControlMode mode) {
  if (mode != ControlMode::follow) {
    watch_.let_alone(measured.time, mode == ControlMode::off);
    watched_.reset();
    return;
  }
  const control::Reference target = path.at(measured.time);
  control::WatchedMotion motion;
  motion.time = measured.time;
  motion.position = measured.position;
  motion.error = measured.position - target.position;
  motion.sigma = std::sqrt(measured.covariance.trace() / 3);
  motion.reference = target.velocity;
  motion.free = settings_.law != ControlLaw::velocity;
  // A target that turns round at once is a step on purpose, as those by which a robot is
  // identified: a response that is off by a third moves it as a coil would that lacks as much.
  constexpr double kStep = 1.2e-3;      // m/s, the least change that is one
  constexpr double kStepWithin = 0.15;  // s
  if ((target.velocity - path.at(measured.time - kStepWithin).velocity).norm() > kStep)
    watch_.let_alone(measured.time, true);
  if (watched_)
    motion.turning = std::acos(std::clamp(watched_->second.dot(settings_.axis), -1.0, 1.0)) /
                     (measured.time - watched_->first);
  watched_.emplace(measured.time, settings_.axis);
  if (settings_.law == ControlLaw::estimator) {  // tuned: it has taken the measurement
    const Eigen::Vector3d pull = -schedule_.proportional * motion.error;
    const double speed = pull.norm();
    motion.wanted =
        target.velocity + pull * std::min(1.0, tuning_->gains.max_speed / std::max(speed, 1e-12));
  }
  watch_.moved(motion);
}

/// The schedule of this step (control::schedule). A reference that has stopped counts for some
/// time: what it passed through is still being found out.
void ServoController::plan(const control::PositionEstimate& ahead, double reference_speed) {
  constexpr double kRemembered = 0.92;  // s
  changes_.reference_speed = std::max(
      reference_speed, changes_.reference_speed * std::exp(-settings_.period / kRemembered));
  changes_.command = (ahead.commanded - last_commanded_).norm();
  last_commanded_ = ahead.commanded;
  ahead_ = ahead;
  schedule_ = control::schedule(*tuning_, ahead, changes_);
  schedule_.proportional = settings_.proportional.value_or(schedule_.proportional);
  estimator_->set_disturbance_walk(schedule_.disturbance_walk);
}

const control::PositionEstimator* ServoController::estimator() const {
  return estimator_ && settings_.law == ControlLaw::estimator ? &*estimator_ : nullptr;
}

/// The loop of the direction in which the filter corrects most: there the margins are least.
std::optional<ServoMargins> ServoController::margins() const {
  if (!estimator() || !estimator_->innovation()) return std::nullopt;
  const control::LoopIdentity& known = tuning_->loop;
  control::SampledLoop loop;
  loop.period = known.period;
  loop.latency = known.measurement_latency;
  loop.command_delay = std::max(0.0, known.command_delay + ahead_.delay);
  loop.command_lag = known.command_lag;
  loop.horizon = loop.command_delay + known.command_lag;
  loop.proportional = schedule_.proportional;
  // Both gains of one direction: what is doubtful of response and delay makes both larger along the
  // motion. The largest of one with the mean of the other is a loop that there is not.
  const Eigen::JacobiSVD<Eigen::Matrix3d> corrections(estimator_->velocity_gain(),
                                                      Eigen::ComputeFullU | Eigen::ComputeFullV);
  loop.velocity_gain = corrections.singularValues()[0];
  loop.position_gain =
      corrections.matrixU().col(0).dot(estimator_->position_gain() * corrections.matrixV().col(0));
  return ServoMargins{control::loop_margins(loop), schedule_, ahead_, innovations_.normalized(),
                      innovations_.correlation()};
}

/// The laws without prediction (the thesis' PD, 6.2, and velocity control, 7.3): error of the last
/// measured position against the reference of that moment, so that latency is no tracking error.
void ServoController::steer(ControlStep& step, double now,
                            const control::PositionMeasurement& measured, const ReferencePath& path,
                            ControlMode mode) {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  const control::Reference reference = path.at(measured.time);
  if (mode != ControlMode::follow) {  // released: only levitation and trim
    pd_.reset();
    velocity_.reset();
    still_.reset();
    pushed_.setZero();
  } else if (settings_.law == ControlLaw::pd) {
    const Eigen::Vector3d velocity = pd_.update(measured.time, measured.position, reference,
                                                safe_speed(clearance_, tuning_, measured));
    step.correction = velocity - reference.velocity;
    force = drag_at(measured.position) * velocity;
  } else {
    force = velocity_.update(measured.time, measured.position, reference);
    step.correction = mobility_ * force - reference.velocity;
  }
  if (estimator_ && mode != ControlMode::constant) {
    const double late = estimator_->at(now).value_or(control::PositionEstimate{}).delay;
    const auto ahead = estimator_->at(now + std::max(0.0, tuning_->horizon + late));
    const Eigen::Matrix3d drag = drag_at(measured.position);
    const Eigen::Vector3d velocity = drag.inverse() * (trim_ + force);
    if (ahead) {
      // What the filter believes of an unstable loop is wild: no command becomes faster by it than
      // what is asked for, or than the way back takes.
      Eigen::Vector3d kept = kept_out(clearance_, tuning_->loop, step, *ahead, velocity);
      const double fastest = std::max(velocity.norm(), kAlwaysSafe);
      if (step.kept_out && kept.norm() > fastest) kept *= fastest / kept.norm();
      force = drag * kept - trim_;
    }
  }
  const Eigen::Vector3d made = allocate(step, measured.position, trim_ + force);
  if (estimator_) estimator_->command(now, mobility_ * made);
  // Anti-windup: the integral goes on from the force that the limits left.
  if (mode != ControlMode::follow || settings_.law != ControlLaw::velocity) return;
  velocity_.limited_to(made - trim_);
  step.standing = stands(measured, made - trim_);
}

/// A force f displaces a robot by f / (6 pi G' r) in a gel before it yields, so what it does not
/// move as it changes is held, or is not what is seen. The vitreous of a living eye is the stiffest
/// gel that is meant; one of twice its modulus still moves the robot by more than the noise.
bool ServoController::stands(const control::PositionMeasurement& measured,
                             const Eigen::Vector3d& force) {
  constexpr double kModulus = 14;  // Pa
  const double stiffness = 6 * M_PI * kModulus * model_.robot.semi_radius;
  still_.add(measured.time, measured.position, std::sqrt(measured.covariance.trace() / 3),
             (force - pushed_) / stiffness);
  pushed_ = force;
  return still_.stands();
}

/// The free drag multiplied by Faxen's wall factors (facts/magnetics 3.1), each wall as a plane
/// of its own: for the retina the tangent plane at the nearest point, for the lens the plane
/// through its vertex.
/// N s/m, at a position in the world frame; the lens and the retina multiply their factors.
Eigen::Matrix3d ServoController::drag_at(const Eigen::Vector3d& position) const {
  if (!settings_.wall_drag) return drag_;
  constexpr double kNearest = 1e-6;  // m: a position measured beyond a wall is at the wall
  // Surfaces count from 1 at the retina, as in the thesis' tables: the second is the lens' rear.
  const double radius = model_.eye.surfaces.front().radius;
  const double lens = model_.eye.vertex(2);
  // The retina's sphere, a cylinder above its equator, and the lens as a lid, as check_reach has
  // them: above the equator the vector from the center is taken as horizontal.
  Eigen::Vector3d from_center = position - model_.eye_in_world - Eigen::Vector3d(0, 0, radius);
  from_center.z() = std::min(from_center.z(), 0.0);
  const double out = from_center.norm();
  // From the wall to the robot; at the sphere's center every direction is as near.
  const Eigen::Vector3d normal =
      out > kNearest ? Eigen::Vector3d(-from_center) : Eigen::Vector3d::UnitZ();
  const Eigen::Matrix3d beside =
      control::resistance_near_wall(drag_, model_.robot, normal, std::max(radius - out, kNearest));
  return control::resistance_near_wall(
      beside, model_.robot, Eigen::Vector3d::UnitZ(),
      std::max(model_.eye_in_world.z() + lens - position.z(), kNearest));
}

/// With what the limits did of it in the step. Returns what of `force` they left.
Eigen::Vector3d ServoController::allocate(ControlStep& step, const Eigen::Vector3d& position,
                                          const Eigen::Vector3d& force) {
  asked_ = {position, force};
  const FieldAllocation found = allocator_.allocate(position, force);
  step.currents = found.currents;
  step.field = allocator_.field();
  step.headroom = found.headroom;
  step.limited = found.limited;
  step.outside = found.outside;
  return found.force;
}

void ServoController::set_axis(const Eigen::Vector3d& axis) {
  settings_.axis = axis;
  drag_ = control::resistance(model_.robot, model_.medium, axis);
  mobility_ = drag_.inverse();
  allocator_.set_axis(axis);
}

void ServoController::view_moved(const Eigen::Vector3d& by) {
  if (estimator_) estimator_->shift(by);
  watch_.view_moved();
}

/// The estimator is built and tuned anew by the next measurement.
void ServoController::reset() {
  pd_.reset();
  velocity_.reset();
  still_.reset();
  pushed_.setZero();
  estimator_.reset();
  innovations_.reset();
  watch_.reset();
  watched_.reset();
  changes_ = {};
  last_commanded_.setZero();
  last_measured_ = -1e9;
}

/// `position` is where the trim was found: constant currents are computed there.
void ServoController::set_trim(const Eigen::Vector3d& force, const Eigen::Vector3d& position) {
  require(force.allFinite(), "trim: a force that is a number is wanted");
  trim_ = force;
  trim_position_ = position;
}

}  // namespace vitreo
