// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/world.h"

#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::sim {
namespace {

constexpr Time kStep = std::chrono::milliseconds(1);
constexpr double kStepSeconds = 1e-3;
constexpr std::int64_t kHistory = 1000;  // steps: longer than any latency of an instrument

// A unit vector across a unit axis: y or z projected, whichever is not nearly along it.
Eigen::Vector3d any_across(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d other =
      std::abs(axis.y()) < 0.9 ? Eigen::Vector3d::UnitY() : Eigen::Vector3d::UnitZ();
  return (other - other.dot(axis) * axis).normalized();
}

// Linear in position; in direction too, normalized, which within a step of 1 ms is as good as a
// rotation.
BodyState between(const BodyState& before, const BodyState& after, double part) {
  BodyState state = before;
  state.position += part * (after.position - before.position);
  state.axis = (before.axis + part * (after.axis - before.axis)).normalized();
  const Eigen::Vector3d side = before.side + part * (after.side - before.side);
  state.side = (side - side.dot(state.axis) * state.axis).normalized();
  return state;
}

}  // namespace

void WorldSettings::check() const {
  robot.check();
  medium.check();
  if (gel) gel->check();
  coils.check(field.coils());
  cavity.check();
  require_positive(moment_gain, "moment_gain");
  require_not_negative(friction, "friction");
  require_not_negative(placement_scatter, "placement_scatter");
  require(std::isfinite(roll), "roll is not finite");
  require(flow.allFinite(), "flow is not finite");
  require(extra_force.allFinite(), "extra_force is not finite");
  for (const BodySettings& body : bodies) {
    body.check();
    if (gel && !body.fixed)
      throw std::invalid_argument("body '" + body.name +
                                  "': in a gel only fixed bodies are simulated");
  }
}

World::World(const WorldSettings& settings, std::uint64_t seed)
    : settings_(settings),
      random_(seed),
      coils_(settings.coils, settings.field.coils()),
      motion_(settings.robot, settings.medium, settings.gel, settings.moment_gain) {
  settings_.check();
  now_.robot = {settings_.cavity.vertex, Eigen::Vector3d::UnitX(), settings_.robot.semi_axis,
                settings_.robot.semi_radius};
  for (const BodySettings& body : settings_.bodies) {
    const Eigen::Vector3d axis = body.axis.normalized();
    now_.others.push_back(
        {body.position, axis, body.semi_axis, body.semi_radius, any_across(axis)});
    const SpheroidDrag drag =
        spheroid_drag(settings_.medium.dynamic_viscosity(), body.semi_axis, body.semi_radius);
    const double weight =
        volume_of(body) * (body.density - settings_.medium.density) * control::kGravity;
    // Other bodies do not turn in the fluid: one mobility for all directions, the inverse of the
    // mean drag (f_par + 2 f_perp) / 3.
    mobility_.push_back(body.fixed ? 0 : 3 / (drag.along + 2 * drag.across));
    sinking_.push_back(weight * mobility_.back());
  }
  now_.present = false;
  before_ = now_;
  asked_bodies_ = now_.others;
  history_.assign(kHistory, now_);
}

// Not advanced here: the coils keep the command until their delay is over.
void World::set_coil_commands(Time time, const control::Currents& commands) {
  coils_.command(time, commands);
}

// The hand puts the robot somewhere about `near`, N(0, scatter) on each axis, in an unstressed gel.
void World::insert_robot(Time time, const Eigen::Vector3d& near) {
  advance_to(time);
  const double scatter = settings_.placement_scatter;
  // one statement each: a fixed order
  const double x = normal_(random_);
  const double y = normal_(random_);
  const double z = normal_(random_);
  now_.robot.position = near + scatter * Eigen::Vector3d(x, y, z);
  now_.robot.side =
      Eigen::AngleAxisd(settings_.roll, now_.robot.axis) * any_across(now_.robot.axis);
  before_ = now_;
  motion_.relax();
  keep_inside(settings_.cavity, Shape::spheroid, 0, now_.robot.position, Eigen::Vector3d::Zero(),
              now_.robot);
  now_.present = true;
  remember();
}

void World::set_coil_response(Time time, int coil, double part) {
  advance_to(time);
  coils_.set_response(coil, part);
}

void World::remove_robot(Time time) {
  advance_to(time);
  now_.present = false;
  remember();
}

void World::place_body(Time time, std::size_t index, const Eigen::Vector3d& position) {
  advance_to(time);
  now_.others.at(index).position = position;
  remember();
}

// A ring of the last second: instruments ask for the past, at their exposures.
void World::remember() { history_[static_cast<std::size_t>(steps_ % kHistory)] = now_; }

// The steps' ends before and after `time`; the second is null at the newest step.
std::pair<const World::Moment*, const World::Moment*> World::moments_about(Time time) {
  advance_to(time);
  const std::int64_t step = std::min(std::max<std::int64_t>(time / kStep, 0), steps_);
  if (steps_ - step >= kHistory)
    throw std::out_of_range("the simulated world keeps only the last second");
  const Moment* at = &history_[static_cast<std::size_t>(step % kHistory)];
  return {at, step < steps_ ? &history_[static_cast<std::size_t>((step + 1) % kHistory)] : nullptr};
}

// Between the steps before and after, so that a camera's exposure need not fall on a step.
const BodyState* World::robot(Time time) {
  const auto [at, next] = moments_about(time);
  if (!at->present) return nullptr;
  const double part =
      static_cast<double>((time % kStep).count()) / static_cast<double>(kStep.count());
  asked_robot_ = next != nullptr && next->present && part > 0
                     ? between(at->robot, next->robot, part)
                     : at->robot;
  return &asked_robot_;
}

const std::vector<BodyState>& World::bodies(Time time) {
  asked_bodies_ = moments_about(time).first->others;
  return asked_bodies_;
}

const control::Currents& World::currents(Time time) {
  advance_to(time);
  return coils_.currents();
}

const control::Currents& World::coil_temperatures(Time time) {
  advance_to(time);
  return coils_.temperatures();
}

// At the currents of the newest step, without their noise: what flows, not what one instant shows.
control::FieldGradient World::field(Time time, const Eigen::Vector3d& position) {
  advance_to(time);
  return field_at(position, coils_.effective());
}

// B(p) = B(p0) + G(p0) (p - p0) outside the calibration's region, p0 the nearest position inside: a
// multipole model diverges there, and a plant must have a field everywhere.
control::FieldGradient World::field_at(const Eigen::Vector3d& position,
                                       const control::Currents& currents) {
  const control::FieldModel& model = settings_.field;
  beyond_calibration_ = !model.valid_at(position);
  if (!beyond_calibration_) return model.matrix(position) * currents + model.background(position);
  const control::Region& region = model.multipoles()->region();
  const Eigen::Vector3d nearest = position.cwiseMax(region.low).cwiseMin(region.high);
  control::FieldGradient field = model.matrix(nearest) * currents + model.background(nearest);
  field.head<3>() += control::gradient_matrix(field) * (position - nearest);
  return field;
}

void World::advance_to(Time time) {
  // A step ends no later than `time`, because a command may still come at that time: it acts no
  // earlier than the step that starts at or after it.
  while (Time(kStep * (steps_ + 1)) <= time) step();
}

// Operator splitting: coils, then the robot, the other bodies, their contacts, and the walls last,
// so that no body ends a step outside.
void World::step() {
  coils_.step(kStep * steps_);
  before_ = now_;
  turned_.setZero();
  if (now_.present) move_robot();
  if (!now_.others.empty()) {
    move_others();
    push_apart();
  }
  keep_all_inside();
  ++steps_;
  remember();
}

// A gel does not flow.
void World::move_robot() {
  const control::FieldGradient field = field_at(now_.robot.position, coils_.noisy(random_));
  const Cavity* walls = settings_.wall_drag ? &settings_.cavity : nullptr;
  turned_ = motion_.step(now_.robot, field, settings_.extra_force, walls, kStepSeconds).turned;
  if (!settings_.gel) now_.robot.position += kStepSeconds * settings_.flow;
}

void World::move_others() {
  for (std::size_t k = 0; k < now_.others.size(); ++k) {
    if (settings_.bodies[k].fixed) continue;
    now_.others[k].position += kStepSeconds * (settings_.flow - Eigen::Vector3d(0, 0, sinking_[k]));
  }
}

// Contact of bodies as a projection: overlapping ones are moved apart along the contact's normal,
// each by its share of the mobility (overdamped: equal and opposite forces). Coulomb's friction
// takes from their sliding across it at most friction * depth, as in keep_inside.
void World::push_apart() {
  const double robots_mobility =
      1 / spheroid_drag(settings_.medium.dynamic_viscosity(), settings_.robot.semi_axis,
                        settings_.robot.semi_radius)
              .across;
  const auto separate = [this](Shape shape_a, BodyState& a, const BodyState& a_before,
                               double mobility_a, Shape shape_b, BodyState& b,
                               const BodyState& b_before, double mobility_b) {
    if (!(mobility_a + mobility_b > 0)) return;
    const Overlap contact = overlap(shape_a, a, shape_b, b);
    if (!(contact.depth > 0)) return;
    const double part = mobility_a / (mobility_a + mobility_b);
    a.position -= part * contact.depth * contact.normal;
    b.position += (1 - part) * contact.depth * contact.normal;
    Eigen::Vector3d sliding = (a.position - a_before.position) - (b.position - b_before.position);
    sliding -= sliding.dot(contact.normal) * contact.normal;
    const double slid = sliding.norm();
    if (!(slid > 0)) return;
    const Eigen::Vector3d taken =
        sliding * std::min(1.0, settings_.friction * contact.depth / slid);
    a.position -= part * taken;
    b.position += (1 - part) * taken;
  };
  for (std::size_t k = 0; k < now_.others.size(); ++k) {
    const Shape shape = settings_.bodies[k].shape;
    if (now_.present)
      separate(Shape::spheroid, now_.robot, before_.robot, robots_mobility, shape, now_.others[k],
               before_.others[k], mobility_[k]);
    for (std::size_t j = k + 1; j < now_.others.size(); ++j)
      separate(shape, now_.others[k], before_.others[k], mobility_[k], settings_.bodies[j].shape,
               now_.others[j], before_.others[j], mobility_[j]);
  }
}

void World::keep_all_inside() {
  const Cavity& cavity = settings_.cavity;
  if (now_.present)
    keep_inside(cavity, Shape::spheroid, settings_.friction, before_.robot.position, turned_,
                now_.robot);
  for (std::size_t k = 0; k < now_.others.size(); ++k) {
    const BodySettings& body = settings_.bodies[k];
    if (body.fixed) continue;
    BodyState& state = now_.others[k];
    const bool touches = keep_inside(cavity, body.shape, settings_.friction,
                                     before_.others[k].position, Eigen::Vector3d::Zero(), state);
    if (!touches || body.shape != Shape::disc) continue;
    // A disc on the retina settles flat: each step by a hundredth of the sine of its tilt, 0.1 s in
    // all.
    const Eigen::Vector3d up = cavity.retina(state.position).normal;
    const Eigen::Vector3d flat = state.axis.dot(up) < 0 ? Eigen::Vector3d(-up) : up;
    turn_body(state, 0.01 * state.axis.cross(flat));
  }
}

}  // namespace vitreo::sim
