// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_controller.h"

#include "control/robots.h"
#include "control/stability.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo {
namespace {

// Allocations tried for one set of currents: each finds a smaller field or force, and they converge
// fast.
constexpr int kMostAttempts = 8;
// m/s asked for at most by the estimator's law, as ServoGains has it.
constexpr double kMaxSpeed = 2e-3;
// m, standard deviation added to every measurement: none is better, whatever its covariance says,
// and R stays positive definite where a sensor states a singular one.
constexpr double kFloor = 0.2e-6;

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

/// What the interlock's total limit is about, A.
/// Magnitudes, as opposite currents do not cancel.
double total(const control::Currents& currents) { return currents.cwiseAbs().sum(); }

}  // namespace

const char* to_string(ControlLaw law) {
  constexpr const char* kNames[] = {"pd", "estimator", "velocity"};
  return kNames[static_cast<std::size_t>(law)];
}

ControlLaw control_law_named(const std::string& name) {
  for (const ControlLaw law : {ControlLaw::pd, ControlLaw::estimator, ControlLaw::velocity})
    if (name == to_string(law)) return law;
  throw std::invalid_argument("law: wants \"pd\", \"estimator\" or \"velocity\", got \"" + name +
                              "\"");
}

/// Throws std::invalid_argument naming the setting. With every coil dead there would be nothing to
/// allocate.
ServoController::ServoController(const RigModel& model, const ControllerSettings& settings)
    : model_(model),
      settings_(settings),
      drag_(control::resistance(model.robot, model.medium, settings.axis)),
      mobility_(drag_.inverse()),
      pd_(settings.gains),
      velocity_(settings.velocity) {
  require(settings.limits.size() == model.field.coils(), "limits: one a coil is wanted");
  require(settings.limits.allFinite() && settings.limits.minCoeff() >= 0,
          "limits: must be at least 0 A");
  require(settings.limits.maxCoeff() > 0, "limits: every coil is dead");
  require(settings.total_limit > 0, "total_limit: must be above 0 A");
  require(settings.period > 0, "period: must be above 0 s");
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
    steer(step, *measured, path, mode);
  if (mode == ControlMode::constant) allocate(step, trim_position_, trim_);
  return step;
}

/// The validity of a measurement, and with the estimator its update. False for one that is not
/// used: a gap is bridged by prediction, a wild measurement becomes a wild current.
bool ServoController::take(double now, const control::PositionMeasurement& measured) {
  if (!measured.position.allFinite() || !std::isfinite(measured.time) || measured.time > now)
    return false;
  if (measured.time <= last_measured_) return false;  // the filters' time does not run backwards
  last_measured_ = measured.time;
  if (settings_.law != ControlLaw::estimator) return true;
  control::PositionMeasurement sound = measured;
  sound.covariance += kFloor * kFloor * Eigen::Matrix3d::Identity();
  // A Cholesky factor exists exactly for a positive definite matrix.
  if (Eigen::LLT<Eigen::Matrix3d>(sound.covariance).info() != Eigen::Success) return false;
  if (!estimator_) tune(now, sound);
  return estimator_->measure(sound);
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
  loop.force_limit = kMaxSpeed * loop.drag;
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
  gains.check();
  estimator_.emplace(tuning_->estimator);
}

/// The estimator's law, u = v_ref + Kp (p_ref - p^) - d (facts/magnetics 2). Reference and
/// estimate are those of `now + horizon`, the moment at which the currents set now take effect: the
/// dead time is predicted away instead of limiting the gain.
void ServoController::predict(ControlStep& step, double now, const ReferencePath& path,
                              ControlMode mode) {
  if (!estimator_) return;
  step.estimate = estimator_->at(now);
  const double then = now + tuning_->horizon;
  const auto ahead = estimator_->at(then);
  if (!step.estimate || !ahead) return;
  const Eigen::Matrix3d drag = drag_at(ahead->position);
  const Eigen::Matrix3d mobility = settings_.wall_drag ? drag.inverse() : mobility_;
  // Force and velocity are one thing in Stokes flow: f = R v, v = R^-1 f. The trim is a force.
  const Eigen::Vector3d trimmed = mobility * trim_;
  Eigen::Vector3d velocity = trimmed;
  if (mode == ControlMode::follow) {
    const control::Reference reference = control::held_reference(path, then, settings_.period);
    velocity = control::servo_velocity(tuning_->gains, reference, *ahead);
    step.correction = velocity - reference.velocity - trimmed;
  } else if (mode == ControlMode::cancel) {
    velocity = -ahead->disturbance;  // the law above without its reference: the robot stays put
  }
  // Anti-windup: the filter's input u is the velocity that the limits left, not the one asked for.
  estimator_->command(now, mobility * allocate(step, ahead->position, drag * velocity));
}

/// The laws without prediction (the thesis' PD, 6.2, and velocity control, 7.3): error of the last
/// measured position against the reference of that moment, so that latency is no tracking error.
void ServoController::steer(ControlStep& step, const control::PositionMeasurement& measured,
                            const ReferencePath& path, ControlMode mode) {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  const control::Reference reference = path.at(measured.time);
  if (mode != ControlMode::follow) {  // released: only levitation and trim
    pd_.reset();
    velocity_.reset();
  } else if (settings_.law == ControlLaw::pd) {
    const Eigen::Vector3d velocity = pd_.update(measured.time, measured.position, reference);
    step.correction = velocity - reference.velocity;
    force = drag_at(measured.position) * velocity;
  } else {
    force = velocity_.update(measured.time, measured.position, reference);
    step.correction = mobility_ * force - reference.velocity;
  }
  const Eigen::Vector3d made = allocate(step, measured.position, trim_ + force);
  // Anti-windup: the integral goes on from the force that the limits left.
  if (mode == ControlMode::follow && settings_.law == ControlLaw::velocity)
    velocity_.limited_to(made - trim_);
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
      out > kNearest ? Eigen::Vector3d(-from_center / out) : Eigen::Vector3d::UnitZ();
  const Eigen::Matrix3d beside =
      control::resistance_near_wall(drag_, model_.robot, normal, std::max(radius - out, kNearest));
  return control::resistance_near_wall(
      beside, model_.robot, Eigen::Vector3d::UnitZ(),
      std::max(model_.eye_in_world.z() + lens - position.z(), kNearest));
}

/// Currents for field, weight and `force` besides at a position: [B; F] = A(m, p) I, the inner loop
/// of thesis 6.1 (figure 6.1). Returns what of `force` the limits left.
/// Outside of the field model's region the nearest position's field is used, and step.outside says
/// so.
Eigen::Vector3d ServoController::allocate(ControlStep& step, const Eigen::Vector3d& position,
                                          const Eigen::Vector3d& force) const {
  const Eigen::Vector3d known = model_.field.nearest_valid(position);
  step.outside = known != position;
  const control::FieldMatrix matrix = model_.field.matrix(known);
  const control::FieldGradient background = model_.field.background(known);
  const control::BoxAllocation found = within(matrix, background, force);
  step.currents = found.currents;
  step.headroom = found.headroom;
  step.limited = found.limited || found.vertical_cut;
  return found.force - Eigen::Vector3d(0, 0, model_.robot.net_weight(model_.medium));
}

/// The quadratic programme of control::allocate_within, repeated until moment and field agree and
/// the sum of currents is within its limit. It is nonlinear only in the moment m(|B|), which is
/// found by fixed-point iteration. Field and force of the result are those that the robot feels,
/// the background's share included. Throws std::domain_error where levitation is out of reach.
/// From the sixth attempt on, a force that is too much is given up altogether.
control::BoxAllocation ServoController::within(const control::FieldMatrix& matrix,
                                               const control::FieldGradient& background,
                                               const Eigen::Vector3d& force) const {
  const Eigen::Vector3d levitation(0, 0, model_.robot.net_weight(model_.medium));
  control::BoxAllocation found;
  double field = settings_.field;  // T along the axis, for which the moment is taken
  Eigen::Vector3d asked = force;
  bool cut = false;
  const auto ask_for_less = [&asked, &cut](int attempt) {
    cut = true;
    asked = attempt + 3 < kMostAttempts ? Eigen::Vector3d(asked / 2) : Eigen::Vector3d::Zero();
  };
  // A soft robot's moment falls with its field: where a limit cuts the field, ask again with what
  // is left of the moment. Where the sum of currents is too much, ask for less force, in the end
  // for none but the levitation.
  for (int attempt = 0; attempt < kMostAttempts; ++attempt) {
    const Eigen::Vector3d moment = model_.robot.moment(field) * settings_.axis;
    // F = S(m) g: the force in the gradients that are there without any current of ours.
    const Eigen::Vector3d pulled = control::force_from_field(moment) * background;
    try {
      found = control::allocate_within(
          matrix, moment,
          {settings_.field * settings_.axis - background.head<3>(), levitation - pulled, asked},
          settings_.limits);
    } catch (const std::domain_error&) {
      // What the limit left of the field holds the robot no longer: rather less of the force beyond
      // its weight. At full field and without such a force nothing is left to give up.
      if (field == settings_.field && asked.isZero(0)) throw;
      field = settings_.field;
      ask_for_less(attempt);
      continue;
    }
    found.field += background.head<3>();
    found.force += pulled;
    if (total(found.currents) > settings_.total_limit) {
      ask_for_less(attempt);
      continue;
    }
    // Converged when the field made is the one for which the moment was taken, to a thousandth.
    const double made = found.field.dot(settings_.axis);
    if (!found.limited || made > (1 - 1e-3) * field || !(made > 0)) break;
    field = made;
  }
  if (total(found.currents) > settings_.total_limit)
    throw std::domain_error(
        "holding the robot against its weight is beyond the limit of the sum of currents here");
  found.limited = found.limited || cut;
  return found;
}

/// The estimator is built and tuned anew by the next measurement.
void ServoController::reset() {
  pd_.reset();
  velocity_.reset();
  estimator_.reset();
  last_measured_ = -1e9;
}

/// Levitation and force are zero: as long as the position is not known, a gradient made for one
/// position would push a robot at another.
control::Currents ServoController::orienting_currents() const {
  const Eigen::Vector3d center = model_.field.nearest_valid(Eigen::Vector3d::Zero());
  const Eigen::Vector3d moment = model_.robot.moment(settings_.field) * settings_.axis;
  const Eigen::Vector3d none = Eigen::Vector3d::Zero();
  const Eigen::Vector3d field =
      settings_.field * settings_.axis - model_.field.background(center).head<3>();
  return control::allocate_within(model_.field.matrix(center), moment, {field, none, none},
                                  settings_.limits)
      .currents;
}

/// `position` is where the trim was found: constant currents are computed there.
void ServoController::set_trim(const Eigen::Vector3d& force, const Eigen::Vector3d& position) {
  require(force.allFinite(), "trim: a force that is a number is wanted");
  trim_ = force;
  trim_position_ = position;
}

}  // namespace vitreo
