// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/world.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::sim {
namespace {

constexpr Time kStep = std::chrono::milliseconds(1);
constexpr double kStepSeconds = 1e-3;
constexpr std::size_t kHistory = 500;   // steps
constexpr double kWeakestField = 1e-6;  // T; below, nothing turns the robot

/// How far a spheroid reaches from its centre along a unit vector.
double support(const BodyState& body, const Eigen::Vector3d& direction) {
  const double along = body.axis.dot(direction);
  const double a = body.semi_axis * along, b = body.semi_radius;
  return std::sqrt(a * a + b * b * (1 - along * along));
}

}  // namespace

void WorldSettings::check() const {
  const auto positive = [](double value, const char* name) {
    if (!(value > 0) || !std::isfinite(value)) throw std::invalid_argument(std::string(name) + " must be above zero");
  };
  const auto not_negative = [](double value, const char* name) {
    if (!(value >= 0) || !std::isfinite(value))
      throw std::invalid_argument(std::string(name) + " must not be negative");
  };
  robot.check();
  medium.check();
  positive(coil_bandwidth, "coil_bandwidth");
  not_negative(coil_delay, "coil_delay");
  not_negative(current_noise, "current_noise");
  positive(moment_gain, "moment_gain");
  positive(retina_radius, "retina_radius");
  positive(lens_depth, "lens_depth");
  not_negative(friction, "friction");
  not_negative(placement_scatter, "placement_scatter");
}

World::World(const WorldSettings& settings, std::uint64_t seed) : settings_(settings), random_(seed) {
  settings_.check();
  target_ = control::Currents::Zero(settings_.field.coils());
  currents_ = target_;
  body_ = {settings_.eye_in_world, Eigen::Vector3d::UnitX(), settings_.robot.semi_axis, settings_.robot.semi_radius};
  history_.push_back({present_, body_});
}

void World::set_coil_commands(Time time, const control::Currents& commands) {
  if (commands.size() != target_.size()) throw std::invalid_argument("commands: one for each coil is wanted");
  const Time acts_from = time + from_seconds(settings_.coil_delay);
  if (!commands_.empty() && acts_from < commands_.back().acts_from) throw std::invalid_argument("time runs backwards");
  commands_.push_back({acts_from, commands});
}

void World::insert_robot(Time time, const Eigen::Vector3d& near) {
  advance_to(time);
  const double scatter = settings_.placement_scatter;
  const double x = normal_(random_), y = normal_(random_), z = normal_(random_);  // one statement each: a fixed order
  body_.position = near + scatter * Eigen::Vector3d(x, y, z);
  Eigen::Vector3d none = Eigen::Vector3d::Zero();
  keep_inside(none);
  present_ = true;
  history_.back() = {present_, body_};
}

void World::remove_robot(Time time) {
  advance_to(time);
  present_ = false;
  history_.back() = {present_, body_};
}

const BodyState* World::robot(Time time) {
  advance_to(time);
  const std::int64_t wanted = time / kStep;
  const std::int64_t back = steps_ - wanted;
  if (back >= static_cast<std::int64_t>(history_.size()))
    throw std::out_of_range("the simulated world keeps only the last 0.5 s");
  const auto& before = history_[history_.size() - 1 - static_cast<std::size_t>(std::max<std::int64_t>(back, 0))];
  if (!before.present) return nullptr;
  answer_ = before.body;
  if (back >= 1) {  // between two steps: straight on
    const auto& after = history_[history_.size() - static_cast<std::size_t>(back)];
    const double part = static_cast<double>((time % kStep).count()) / static_cast<double>(kStep.count());
    if (after.present) answer_.position += part * (after.body.position - before.body.position);
  }
  return &answer_;
}

const control::Currents& World::currents(Time time) {
  advance_to(time);
  return currents_;
}

void World::advance_to(Time time) {
  // One step beyond, so that robot() can interpolate; it must not pass the present, where a command may still come: a
  // command acts no earlier than the step that starts at or after it.
  while (Time(kStep * (steps_ + 1)) <= time) step();
}

void World::step() {
  const Time start = kStep * steps_;
  while (!commands_.empty() && commands_.front().acts_from <= start) {
    target_ = commands_.front().currents;
    commands_.pop_front();
  }
  const double keep = std::exp(-2 * M_PI * settings_.coil_bandwidth * kStepSeconds);
  currents_ = target_ + keep * (currents_ - target_);
  if (present_) move_robot();
  ++steps_;
  history_.push_back({present_, body_});
  if (history_.size() > kHistory) history_.pop_front();
}

void World::move_robot() {
  control::Currents flowing = currents_;
  for (double& current : flowing) current += settings_.current_noise * normal_(random_);
  const control::FieldGradient field = settings_.field.matrix(body_.position) * flowing;
  const Eigen::Vector3d b = field.head<3>();
  const double strength = b.norm();
  Eigen::Vector3d force(0, 0, -settings_.robot.net_weight(settings_.medium));
  if (strength > kWeakestField) {
    // It turns within milliseconds (facts/magnetics 3.1): the axis is the field's, at whichever end is nearer.
    const Eigen::Vector3d along = b / strength;
    body_.axis = along.dot(body_.axis) < 0 ? Eigen::Vector3d(-along) : along;
    const Eigen::Vector3d moment = settings_.moment_gain * settings_.robot.moment(strength) * along;
    force += control::force_from_field(moment) * field;
  }
  const Eigen::Matrix3d drag = control::resistance(settings_.robot, settings_.medium, body_.axis);
  Eigen::Vector3d moved = drag.inverse() * force * kStepSeconds;
  const Eigen::Vector3d before = body_.position;
  body_.position += moved;
  moved = body_.position - before;
  keep_inside(moved);
}

/// Pushes the robot back inside the retina, the walls and below the lens; where it touches, friction eats the sliding.
void World::keep_inside(Eigen::Vector3d& moved) {
  const Eigen::Vector3d centre = settings_.eye_in_world + Eigen::Vector3d(0, 0, settings_.retina_radius);
  const auto contact = [&](const Eigen::Vector3d& outward, double depth) {
    if (depth <= 0) return;
    body_.position -= depth * outward;
    const Eigen::Vector3d sliding = moved - moved.dot(outward) * outward;
    const double slid = sliding.norm(), held = settings_.friction * depth;
    if (slid > 0) body_.position -= sliding * std::min(1.0, held / slid);
  };
  Eigen::Vector3d from_centre = body_.position - centre;
  if (from_centre.z() > 0) from_centre.z() = 0;  // above the retina's equator the wall is a cylinder
  const double distance = from_centre.norm();
  if (distance > 0) {
    const Eigen::Vector3d outward = from_centre / distance;
    contact(outward, distance + support(body_, outward) - settings_.retina_radius);
  }
  const double lens = settings_.eye_in_world.z() + settings_.lens_depth;
  contact(Eigen::Vector3d::UnitZ(), body_.position.z() + support(body_, Eigen::Vector3d::UnitZ()) - lens);
}

}  // namespace vitreo::sim
