// Swimmers on the simulator's own plant, in one loop without devices: for the tests of the rotating
// controller and for the figures over many machines.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/robots.h"
#include "devices/sim/laboratory.h"
#include "devices/sim/world.h"
#include "host/servo/rotating_controller.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <deque>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::machines {

using std::chrono::milliseconds;
constexpr double kNoise = 0.3 * 14.3e-6;  // m, of one coordinate of one reading

inline RigModel helix_model() {
  RigModel model;
  model.robot = control::robot_named("helix_2mm");
  return model;
}

/// A machine drawn with everything a laboratory does not know, read 15 times a second, 80 ms late;
/// set-points every 11 ms, as a USB-3103 takes them.
class SwimBench {
 public:
  SwimBench(unsigned seed, const RotatingSettings& law, double field,
            const RigModel& model = helix_model(), const Eigen::Vector3d& start = {-4e-3, 0, 0},
            Time set_interval = milliseconds(11))
      : random_(seed),
        world_(plant(seed, model.robot), seed),
        controller_(model, settings(law, field)),
        interval_(set_interval) {
    world_.insert_robot(time_, start);
    path_.path = control::Trajectory::hold_at(start);
  }

  /// Goes on for `span` s; calls `each` at every frame with the true state.
  template <typename Each>
  void go(double span, Each each) {
    const Time end = time_ + milliseconds(std::lround(span * 1e3));
    for (; time_ < end; time_ += milliseconds(1)) {
      const sim::BodyState robot = *world_.robot(time_);
      if (time_ >= next_frame_) {
        Eigen::Vector3d seen = robot.position;
        for (double& part : seen) part += kNoise * normal_(random_);
        coming_.push_back({to_seconds(time_), seen, kNoise * kNoise * Eigen::Matrix3d::Identity()});
        next_frame_ += from_seconds(1 / 15.0);
        each(to_seconds(time_), robot);
      }
      if (!coming_.empty() && to_seconds(time_) >= coming_.front().time + 0.08) turn();
      if (started_ && time_ >= next_set_) set_point();
    }
  }
  void go(double span) {
    go(span, [](double, const sim::BodyState&) {});
  }
  RotatingController& controller() { return controller_; }
  ReferencePath& path() { return path_; }
  double now() const { return to_seconds(time_); }
  const RotatingStep& last() const { return step_; }
  /// Hz: by the drawn moment, size and oil, in a field (T) that is as commanded.
  double true_step_out(double field) const {
    const sim::WorldSettings& plant = world_.settings();
    return plant.moment_gain * control::step_out_frequency(plant.robot, plant.medium, field);
  }
  /// s, of the moments at which a step-out was found, and at which it turned with the field again.
  std::vector<double> found, recovered;

 private:
  static sim::WorldSettings plant(unsigned seed, const control::Robot& robot) {
    sim::LaboratorySettings laboratory;
    laboratory.world.robot = robot;
    laboratory.world.placement_scatter = 0;
    laboratory.sigmas = sim::PlantSigmas::stated();
    sim::add_stated_truth(laboratory.world.coils);
    laboratory.world.coils.delay = 40e-3;
    return sim::sampled_world(laboratory, seed);
  }
  static RotatingControllerSettings settings(const RotatingSettings& law, double field) {
    RotatingControllerSettings settings;
    settings.law = law;
    settings.field = field;
    return settings;
  }
  void turn() {
    step_ =
        controller_.step(now(), coming_.front(), path_, ControlMode::follow, to_seconds(interval_));
    coming_.pop_front();
    path_.begin += step_.behind;
    started_ = true;
    if (step_.stepped_out) found.push_back(now());
    if (step_.recovered) recovered.push_back(now());
  }
  void set_point() {
    const control::Rotation& rotation = controller_.state().rotation;
    const double rate = 2 * std::numbers::pi * rotation.frequency;
    const double hold = to_seconds(interval_);
    phase_ += rate * hold;
    world_.set_coil_commands(
        time_,
        step_.currents * control::commanded_field(rotation, phase_ + rate * (0.05 + hold / 2),
                                                  1 / (2 * std::numbers::pi * 15), hold) +
            step_.constant);
    next_set_ = time_ + interval_;
  }

  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  sim::World world_;
  RotatingController controller_;
  Time interval_;
  ReferencePath path_;
  RotatingStep step_;
  std::deque<control::PositionMeasurement> coming_;
  Time time_{}, next_frame_{}, next_set_{};
  double phase_ = 0;
  bool started_ = false;
};

inline control::Trajectory centimeter() {
  return control::Trajectory::spline(
      {{-4e-3, 0, 0}, {-1.5e-3, 1e-3, 0.7e-3}, {1.5e-3, -1e-3, -0.5e-3}, {4.5e-3, 0.5e-3, 0.5e-3}},
      {1e-3, 0.5e-3});
}

/// rms of the way's distance from its point, m.
inline double path_error(unsigned seed, double* worst = nullptr, int* told = nullptr) {
  SwimBench bench(seed, {}, 2e-3);
  bench.go(6);
  bench.path() = {centimeter(), bench.now()};
  double sum = 0;
  int count = 0;
  const double end = bench.now() + bench.path().path.duration() + 2;
  bench.go(end - bench.now(), [&](double now, const sim::BodyState& robot) {
    if (now - bench.path().begin > bench.path().path.duration()) return;
    const double off = (robot.position - bench.path().at(now).position).norm();
    sum += off * off;
    ++count;
    if (worst != nullptr) *worst = std::max(*worst, off);
  });
  if (told != nullptr) *told = static_cast<int>(bench.found.size());
  return std::sqrt(sum / count);
}

}  // namespace vitreo::machines
