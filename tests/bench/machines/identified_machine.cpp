// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/identified_machine.h"

#include "control/robots.h"
#include "devices/sim/hardware_sample.h"
#include "devices/time/clock.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <random>

namespace vitreo::machines {
namespace {

constexpr Time kTick = std::chrono::milliseconds(1);
constexpr int kFalls = 5;

/// A plant and one controller after another, with what was measured and commanded.
class Bench {
 public:
  explicit Bench(const MachineSetting& setting)
      : setting_(setting),
        model_(believed(setting)),
        world_(plant(setting, model_), sim::seed_for(setting.seed, sim::Purpose::world)),
        random_(sim::seed_for(setting.seed, sim::Purpose::probe)) {}

  void insert(const Eigen::Vector3d& at) { world_.insert_robot(now_, at); }
  void control(const Eigen::Vector3d& axis) {
    MachineSetting setting = setting_;
    setting.axis = axis;
    setting.field_max = setting.field;  // the same moment throughout
    controller_ =
        std::make_unique<ServoController>(model_, settings_of(setting, ControlLaw::estimator));
  }
  /// Goes on for `span` s along a path that begins now; the measured and commanded rows of it.
  control::DrivenMotion go(const control::Trajectory& path, double span,
                           ControlMode mode = ControlMode::follow) {
    control::DrivenMotion motion;
    motion.lag = 1 / (2 * M_PI * model_.command_bandwidth);
    const ReferencePath reference{path, now()};
    const Time end = now_ + from_seconds(span);
    const Time latency = from_seconds(latency_of(setting_));
    for (; now_ < end; now_ += kTick) {
      measure();
      if (coming_.empty() || now_ < from_seconds(coming_.front().time) + latency) continue;
      const ControlStep step = controller_->step(now(), coming_.front(), reference, mode);
      note_quality(watched, quality_, step.quality, now());
      motion.measured.push_back({coming_.front().time, coming_.front().position});
      motion.commanded.push_back({now(), step.commanded});
      coming_.pop_front();
      if (step.currents.size() > 0) world_.set_coil_commands(now_, step.currents);
    }
    return motion;
  }
  double now() const { return to_seconds(now_); }
  const RigModel& model() const { return model_; }
  const sim::WorldSettings& truth() const { return world_.settings(); }
  Eigen::Matrix3d drag_at(const Eigen::Vector3d& p) const { return controller_->drag_at(p); }
  MachineResult watched;

 private:
  void measure() {
    if (now_ < next_) return;
    control::PositionMeasurement measured{
        now(), world_.robot(now_)->position,
        std::pow(setting_.noise, 2) * Eigen::Matrix3d::Identity()};
    for (double& coordinate : measured.position) coordinate += setting_.noise * normal_(random_);
    coming_.push_back(measured);
    next_ += from_seconds(1 / setting_.frame_rate);
  }

  MachineSetting setting_;
  RigModel model_;
  sim::World world_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::unique_ptr<ServoController> controller_;
  LoopQuality quality_;
  std::deque<control::PositionMeasurement> coming_;
  Time now_{}, next_{};
};

control::DrivenMotion steps(Bench& bench, const Eigen::Vector3d& center,
                            const Eigen::Vector3d& direction) {
  constexpr double kReach = 0.4e-3;
  std::vector<Eigen::Vector3d> points{center};
  for (int k = 0; k < 12; ++k) points.push_back(center + (k % 2 ? -kReach : kReach) * direction);
  points.push_back(center);
  const auto path = control::Trajectory::waypoints(points, {0.8e-3, 20e-3});
  return bench.go(path, path.duration() + 0.3);
}

struct Falls {
  std::vector<control::Fall> falls;
  double believed = 0;  // m/s, mean of the rows of all falls
};

/// Five falls of half a second, or of 0.8 mm as believed; each from where the robot was held again.
Falls fall(Bench& bench, const Eigen::Vector3d& place) {
  const double weight = bench.model().robot.net_weight(bench.model().medium);
  const auto speed_at = [&](const Eigen::Vector3d& p) { return weight / bench.drag_at(p)(2, 2); };
  const double span = std::min(0.5, 0.8e-3 / speed_at(place));
  const auto hold = control::Trajectory::hold_at(place);
  Falls found;
  int rows = 0;
  for (int k = 0; k < kFalls; ++k) {
    const auto held = bench.go(hold, 4);
    const auto off = bench.go(hold, span, ControlMode::off);
    const auto caught = bench.go(hold, 0.5);
    control::Fall one;
    one.off = off.commanded.front().time;
    one.on = caught.commanded.front().time;
    one.measured.assign(held.measured.end() - 7, held.measured.end());
    for (const auto* part : {&off, &caught})
      one.measured.insert(one.measured.end(), part->measured.begin(), part->measured.end());
    for (const control::TimedVector& row : one.measured) {
      if (row.time < one.off || row.time > one.on) continue;
      found.believed += speed_at(row.value);
      ++rows;
    }
    found.falls.push_back(std::move(one));
  }
  found.believed /= std::max(1, rows);
  return found;
}

/// The free sinking speed of the plant over the believed one, along `axis` upright or lying.
double true_sink(const Bench& bench, const Eigen::Vector3d& axis) {
  const auto speed = [&axis](const control::Robot& robot, const control::Medium& medium) {
    return robot.net_weight(medium) / control::resistance(robot, medium, axis)(2, 2);
  };
  return speed(bench.truth().robot, bench.truth().medium) /
         speed(bench.model().robot, bench.model().medium);
}

control::Identified over(const control::Identified& found, double by) {
  return {found.value / by, found.sigma / by};
}

}  // namespace

IdentifiedMachine identify_machine(const MachineSetting& setting) {
  const Eigen::Vector3d place(0, 0, 1e-3), lying(1, 0, 0), upright(0, 0, 1);
  IdentifiedMachine result;
  try {
    Bench bench(setting);
    // A soft magnet's force goes with the current's square where it is far from saturation.
    const double lag = 1 / (2 * M_PI * bench.model().command_bandwidth);
    const double force_lag = bench.model().robot.hard ? lag : lag / 2;
    bench.insert(place);
    bench.control(lying);
    bench.go(control::Trajectory::hold_at(place), 8);
    result.x = control::identify_response(steps(bench, place, lying), lying);
    result.z = control::identify_response(steps(bench, place, upright), upright);
    const Falls across = fall(bench, place);
    bench.control(upright);
    bench.go(control::Trajectory::hold_at(place), 8);
    const Falls along = fall(bench, place);
    result.across = control::identify_fall(across.falls, -upright, force_lag);
    result.along = control::identify_fall(along.falls, -upright, force_lag);
    result.sink_across = over(result.across.speed, across.believed);
    result.sink_along = over(result.along.speed, along.believed);
    result.delay = bench.truth().coils.delay;
    result.true_across = true_sink(bench, lying);
    result.true_along = true_sink(bench, upright);
    // Weight as believed: only its ratio to the drag shows in a motion.
    Belief& belief = result.belief = setting.belief;
    belief.drag_across /= result.sink_across.value;
    belief.drag_along /= result.sink_along.value;
    // Two places of the same field's errors: their mean.
    belief.moment *= (result.x.gain.value / result.sink_along.value +
                      result.z.gain.value / result.sink_across.value) /
                     2;
    belief.delay = (result.x.delay.value + result.across.delay.value) / 2;
    result.duration = bench.now();
    result.watched = bench.watched;
  } catch (const std::exception& problem) {
    result.failure = problem.what();
  }
  return result;
}

}  // namespace vitreo::machines
