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

constexpr int kCuts = 8;            // each finds a smaller field; they converge fast
constexpr double kMaxSpeed = 2e-3;  // m/s that the estimator's law asks for at most
constexpr double kFloor = 0.2e-6;   // m: no measurement is better, whatever its covariance says

void require(bool good, const char* what) {
  if (!good) throw std::invalid_argument(what);
}

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

ControlStep ServoController::step(double now,
                                  const std::optional<control::PositionMeasurement>& measured,
                                  const ReferencePath& course, Aim aim) {
  require(aim != Aim::cancel || settings_.law == ControlLaw::estimator,
          "canceling needs the law \"estimator\"");
  ControlStep step;
  const bool taken = measured && take(now, *measured);
  step.passed_over = measured && !taken;
  if (settings_.law == ControlLaw::estimator)
    predict(step, now, course, aim);
  else if (taken)
    steer(step, *measured, course, aim);
  if (aim == Aim::constant) allocate(step, trim_place_, trim_);
  return step;
}

/// False for one that says nothing: better a gap than a wild current.
bool ServoController::take(double now, const control::PositionMeasurement& measured) {
  if (!measured.position.allFinite() || !std::isfinite(measured.time) || measured.time > now)
    return false;
  if (measured.time <= last_measured_) return false;
  last_measured_ = measured.time;
  if (settings_.law != ControlLaw::estimator) return true;
  control::PositionMeasurement sound = measured;
  sound.covariance += kFloor * kFloor * Eigen::Matrix3d::Identity();
  if (Eigen::LLT<Eigen::Matrix3d>(sound.covariance).info() != Eigen::Success) return false;
  if (!estimator_) tune(now, sound);
  return estimator_->measure(sound);
}

void ServoController::tune(double now, const control::PositionMeasurement& first) {
  control::LoopIdentity loop;
  loop.measurement_latency = now - first.time;
  loop.command_delay = model_.command_delay;
  loop.command_lag = 1 / (2 * M_PI * model_.command_bandwidth);
  loop.period = settings_.period;
  loop.noise = std::sqrt(first.covariance.trace() / 3);
  loop.drag = drag_.diagonal().minCoeff();
  loop.force_limit = kMaxSpeed * loop.drag;
  // How the robot runs away at the center, as the model has it, in the currents that hold it there.
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

/// The estimator's law. All is taken where and when the currents will flow.
void ServoController::predict(ControlStep& step, double now, const ReferencePath& course, Aim aim) {
  if (!estimator_) return;
  step.estimate = estimator_->at(now);
  const double then = now + tuning_->horizon;
  const auto ahead = estimator_->at(then);
  if (!step.estimate || !ahead) return;
  const Eigen::Matrix3d drag = drag_at(ahead->position),
                        mobility = settings_.wall_drag ? drag.inverse() : mobility_;
  const Eigen::Vector3d trimmed = mobility * trim_;
  Eigen::Vector3d velocity = trimmed;
  if (aim == Aim::follow) {
    const control::Reference reference = control::held_reference(course, then, settings_.period);
    velocity = control::servo_velocity(tuning_->gains, reference, *ahead);
    step.correction = velocity - reference.velocity - trimmed;
  } else if (aim == Aim::cancel) {
    velocity = -ahead->disturbance;
  }
  // What the limits left is what the robot was told: nothing winds up.
  estimator_->command(now, mobility * allocate(step, ahead->position, drag * velocity));
}

/// The laws without prediction: on the last place measured, against the reference of that moment.
void ServoController::steer(ControlStep& step, const control::PositionMeasurement& measured,
                            const ReferencePath& course, Aim aim) {
  Eigen::Vector3d force = Eigen::Vector3d::Zero();
  const control::Reference reference = course.at(measured.time);
  if (aim != Aim::follow) {
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
  if (aim == Aim::follow && settings_.law == ControlLaw::velocity)
    velocity_.limited_to(made - trim_);
}

Eigen::Matrix3d ServoController::drag_at(const Eigen::Vector3d& place) const {
  if (!settings_.wall_drag) return drag_;
  constexpr double kNearest = 1e-6;  // m: a place measured beyond a wall is at the wall
  const double radius = model_.eye.surfaces.front().radius, lens = model_.eye.vertex(2);
  // The retina's sphere, a cylinder above its equator, and the lens as a lid, as check_reach has
  // them.
  Eigen::Vector3d from_center = place - model_.eye_in_world - Eigen::Vector3d(0, 0, radius);
  from_center.z() = std::min(from_center.z(), 0.0);
  const double out = from_center.norm();
  const Eigen::Vector3d normal =
      out > kNearest ? Eigen::Vector3d(-from_center / out) : Eigen::Vector3d::UnitZ();
  const Eigen::Matrix3d beside =
      control::resistance_near_wall(drag_, model_.robot, normal, std::max(radius - out, kNearest));
  return control::resistance_near_wall(
      beside, model_.robot, Eigen::Vector3d::UnitZ(),
      std::max(model_.eye_in_world.z() + lens - place.z(), kNearest));
}

/// Currents for the weight and `force` besides; returns what of `force` the limits left.
Eigen::Vector3d ServoController::allocate(ControlStep& step, const Eigen::Vector3d& place,
                                          const Eigen::Vector3d& force) const {
  const Eigen::Vector3d known = model_.field.nearest_valid(place);
  step.outside = known != place;
  const control::FieldMatrix matrix = model_.field.matrix(known);
  const control::FieldGradient background = model_.field.background(known);
  const control::BoxAllocation found = within(matrix, background, force);
  step.currents = found.currents;
  step.headroom = found.headroom;
  step.limited = found.limited || found.vertical_cut;
  return found.force - Eigen::Vector3d(0, 0, model_.robot.net_weight(model_.medium));
}

/// field and force of the result are those that the robot feels, the background's share included.
control::BoxAllocation ServoController::within(const control::FieldMatrix& matrix,
                                               const control::FieldGradient& background,
                                               const Eigen::Vector3d& force) const {
  const Eigen::Vector3d levitation(0, 0, model_.robot.net_weight(model_.medium));
  control::BoxAllocation found;
  double field = settings_.field;
  Eigen::Vector3d asked = force;
  bool cut = false;
  // A soft robot's moment falls with its field: where a limit cuts the field, ask again with what
  // is left of the moment. Where the sum of currents is too much, ask for less force, in the end
  // for none but the levitation.
  for (int attempt = 0; attempt < kCuts; ++attempt) {
    const Eigen::Vector3d moment = model_.robot.moment(field) * settings_.axis;
    const Eigen::Vector3d pulled = control::force_from_field(moment) * background;
    try {
      found = control::allocate_within(
          matrix, moment,
          {settings_.field * settings_.axis - background.head<3>(), levitation - pulled, asked},
          settings_.limits);
    } catch (const std::domain_error&) {
      // What the limit left of the field holds the robot no longer: rather less of the force beyond
      // its weight.
      if (field == settings_.field && asked.isZero(0)) throw;
      cut = true;
      field = settings_.field;
      asked = attempt + 3 < kCuts ? Eigen::Vector3d(asked / 2) : Eigen::Vector3d::Zero();
      continue;
    }
    found.field += background.head<3>();
    found.force += pulled;
    if (total(found.currents) > settings_.total_limit) {
      cut = true;
      asked = attempt + 3 < kCuts ? Eigen::Vector3d(asked / 2) : Eigen::Vector3d::Zero();
      continue;
    }
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

void ServoController::reset() {
  pd_.reset();
  velocity_.reset();
  estimator_.reset();
  last_measured_ = -1e9;
}

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

void ServoController::set_trim(const Eigen::Vector3d& force, const Eigen::Vector3d& place) {
  require(force.allFinite(), "trim: a force that is a number is wanted");
  trim_ = force;
  trim_place_ = place;
}

}  // namespace vitreo
