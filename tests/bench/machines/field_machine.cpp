// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/machines/field_machine.h"

#include "control/robots.h"
#include "control/stability.h"
#include "host/servo/field_allocator.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <deque>
#include <memory>
#include <random>
#include <vector>

namespace vitreo::machines {
namespace {

constexpr Time kTick = std::chrono::milliseconds(1);
constexpr double kPi = 3.14159265358979323846;

Eigen::Vector3d pitched(double pitch, double azimuth) {
  return {std::cos(pitch) * std::cos(azimuth), std::cos(pitch) * std::sin(azimuth),
          std::sin(pitch)};
}

/// Through the corners and the middles of a box about the center, so that each coordinate is
/// crossed at several values of the others.
control::Trajectory tour() {
  std::vector<Eigen::Vector3d> points;
  for (const double z : {2.5e-3, 0.0, -2e-3})
    for (const auto& [x, y] : std::vector<std::pair<double, double>>{
             {0, 0}, {-3e-3, -2e-3}, {3e-3, -2e-3}, {3e-3, 2e-3}, {-3e-3, 2e-3}, {-3e-3, -2e-3}})
      points.emplace_back(x, y, z);
  return control::Trajectory::waypoints(points, {1e-3, 5e-3});
}

/// One machine's plant and sensor, and one controller after another.
class Bench {
 public:
  explicit Bench(const MachineSetting& setting)
      : setting_(setting),
        model_(believed(setting)),
        world_(plant(setting, model_), sim::seed_for(setting.seed, sim::Purpose::world)),
        random_(sim::seed_for(setting.seed, sim::Purpose::probe)) {}

  control::FieldMotion go(const control::Trajectory& path, const Eigen::Vector3d& axis,
                          double field) {
    constexpr double kSettle = 8;  // s
    MachineSetting one = setting_;
    one.axis = axis;
    one.field = one.field_max = field;
    ServoController controller(model_, settings_of(one, ControlLaw::estimator));
    world_.insert_robot(now_, path.at(0).position);
    const double begin = to_seconds(now_);
    const ReferencePath reference{path, begin + kSettle};
    const Time end = now_ + from_seconds(kSettle + path.duration());
    const Time latency = from_seconds(latency_of(setting_));
    control::FieldMotion motion;
    coming_.clear();
    for (; now_ < end; now_ += kTick) {
      const double now = to_seconds(now_);
      measure();
      if (coming_.empty() || now_ < from_seconds(coming_.front().time) + latency) continue;
      const ControlStep step =
          controller.step(now, coming_.front(), reference, ControlMode::follow);
      if (now > begin + kSettle)
        motion.measured.push_back({coming_.front().time, coming_.front().position});
      if (step.currents.size() > 0) {
        world_.set_coil_commands(now_, step.currents);
        motion.commanded.push_back(
            {now, step.currents, controller.drag_at(coming_.front().position).inverse()});
      }
      coming_.pop_front();
    }
    return motion;
  }
  double now() const { return to_seconds(now_); }
  const RigModel& model() const { return model_; }

 private:
  void measure() {
    if (now_ < next_) return;
    control::PositionMeasurement measured{
        to_seconds(now_), world_.robot(now_)->position,
        std::pow(setting_.noise, 2) * Eigen::Matrix3d::Identity()};
    for (double& coordinate : measured.position) coordinate += setting_.noise * normal_(random_);
    coming_.push_back(measured);
    next_ = now_ + from_seconds(1 / setting_.frame_rate);
  }

  MachineSetting setting_;
  RigModel model_;
  sim::World world_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  std::deque<control::PositionMeasurement> coming_;
  Time now_{}, next_{};
};

}  // namespace

FieldErrors field_errors(const MachineSetting& setting, const RigModel& model, double field) {
  const sim::WorldSettings truth = plant(setting, model);
  control::Robot robot = truth.robot;
  robot.moment_factor *= truth.moment_gain;
  std::vector<Eigen::Vector3d> axes;
  for (const double pitch : {0.0, 30.0, 60.0, 85.0})
    for (const double azimuth : {-45.0, 0.0, 45.0, 90.0})
      axes.push_back(pitched(pitch * kPi / 180, azimuth * kPi / 180));
  FieldErrors errors;
  double drifts = 0, angles = 0, steeps = 0;
  int count = 0, steep_count = 0;
  for (const double x : {-2.5e-3, 0.0, 2.5e-3})
    for (const double y : {-1.5e-3, 1.5e-3})
      for (const double z : {-1.5e-3, 0.5e-3, 2e-3})
        for (const Eigen::Vector3d& axis : axes) {
          const Eigen::Vector3d place(x, y, z);
          FieldAllocator allocator(
              model, {field, field, axis, control::CurrentLimits::Constant(8, 12), 60});
          const FieldAllocation found = allocator.allocate(place, Eigen::Vector3d::Zero());
          if (found.limited) continue;
          const Eigen::Vector3d force =
              control::force_at(truth.field, robot, truth.medium, found.currents, place);
          drifts += (control::resistance(truth.robot, truth.medium, axis).inverse() * force)
                        .squaredNorm();
          const Eigen::Vector3d shown =
              (truth.field.matrix(place) * found.currents + truth.field.background(place))
                  .head<3>()
                  .normalized();
          const double angle = std::atan2(shown.cross(axis).norm(), shown.dot(axis));
          angles += angle * angle;
          errors.largest = std::max(errors.largest, angle);
          ++count;
          if (axis.z() < 0.8) continue;
          steeps += angle * angle;
          errors.steep_largest = std::max(errors.steep_largest, angle);
          ++steep_count;
        }
  errors.drift = std::sqrt(drifts / std::max(1, count));
  errors.direction = std::sqrt(angles / std::max(1, count));
  errors.steep = std::sqrt(steeps / std::max(1, steep_count));
  return errors;
}

FieldMachine calibrate_field(const MachineSetting& setting) {
  FieldMachine result;
  result.belief = setting.belief;
  try {
    Bench bench(setting);
    const control::Trajectory path = tour();
    std::vector<control::FieldMotion> motions;
    for (const Eigen::Vector3d& axis :
         {pitched(0, 0), pitched(0, kPi / 2), pitched(kPi / 4, 0), pitched(kPi / 3, kPi / 2)})
      motions.push_back(bench.go(path, axis, 15e-3));
    const RigModel& model = bench.model();
    const double lag = 1 / (2 * kPi * model.command_bandwidth);
    result.found = control::identify_field(*model.field.dipoles(), model.robot, model.medium,
                                           motions, model.command_delay + lag);
    control::FieldModel field = result.found->field;
    field.set_uniform_background(result.found->background);
    result.belief.field = field;
    // (1 + r) M F - (1 + s) M W with the weight as believed: the drag is smaller by 1 + s, and the
    // moment larger by (1 + r) / (1 + s).
    result.belief.drag_along /= result.found->sink.value;
    result.belief.drag_across /= result.found->sink.value;
    result.belief.moment *= result.found->response.value / result.found->sink.value;
    result.duration = bench.now();
  } catch (const std::exception& problem) {
    result.failure = problem.what();
  }
  return result;
}

}  // namespace vitreo::machines
