// A small laboratory in one loop, without devices: perturbed coils with delay and lag, an
// overdamped robot, a late and noisy position sensor. For the tests of the whole of control/.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/allocation.h"
#include "control/robot.h"
#include "control/servo_law.h"
#include "control/trajectory.h"

#include <Eigen/LU>

#include <cmath>
#include <deque>
#include <numbers>
#include <optional>
#include <random>
#include <utility>

namespace vitreo::control {

struct LoopSetting {
  double frame_rate = 15;    // 1/s
  double latency = 0.08;     // s, exposure to measurement: 0.13 with the coils
  double coil_delay = 0.05;  // s
  double coil_lag = 1 / (2 * std::numbers::pi * 15);  // s
  double noise = 0.3 * 14.3e-6;                       // m, each axis
  double field = 10e-3;                               // T, along x: the hardest case
  double missing = 0;                                 // part of the measurements that never come
  unsigned long long seed = 1;
};

struct LoopError {
  double rms = 0, largest = 0;  // m, true place against reference, in 3-D
};

class SimulatedLoop {
 public:
  explicit SimulatedLoop(const LoopSetting& setting)
      : setting_(setting), random_(setting.seed), truth_(controller_.perturbed({}, random_)) {
    moment_error_ = 1 + 0.05 * normal_(random_);
    identity_.measurement_latency = setting.latency;
    identity_.command_delay = setting.coil_delay;
    identity_.command_lag = setting.coil_lag;
    identity_.period = 1 / setting.frame_rate;
    identity_.noise = setting.noise;
    identity_.drag = drag_(0, 0);
    identity_.weight = robot_.net_weight(medium_);
  }

  /// The error after `settle` seconds.
  LoopError run(const Trajectory& path, bool estimate, double settle, double end) {
    const ServoTuning tuning = tune(identity_);
    PositionEstimator estimator(tuning.estimator);
    changes_ = {};
    PdController pd(tuning.pd);
    position_ = path.at(0).position;
    double next_frame = 0, sum = 0;
    std::deque<PositionMeasurement> coming;
    LoopError error;
    int count = 0;
    for (double t = 0; t < end; t += kStep) {
      if (t >= next_frame) {
        coming.push_back(measured(t));
        next_frame += 1 / setting_.frame_rate;
      }
      if (!coming.empty() && t >= coming.front().time + setting_.latency) {
        const bool lost = std::uniform_real_distribution<double>(0, 1)(random_) < setting_.missing;
        const PositionMeasurement measurement = std::exchange(coming.front(), {});
        coming.pop_front();
        if (estimate) {
          if (!lost) estimator.measure(measurement);
          servo(t, path, tuning, estimator);
        } else if (!lost) {
          const Eigen::Vector3d u = pd.update(measurement.time, measurement.position, path.at(t));
          command(t, measurement.position, u);
        }
      }
      advance(t);
      const double off = (position_ - path.at(t).position).norm();
      if (t < settle) continue;
      sum += off * off;
      error.largest = std::max(error.largest, off);
      ++count;
    }
    error.rms = std::sqrt(sum / count);
    return error;
  }

  LoopIdentity& identity() { return identity_; }

 private:
  static constexpr double kStep = 1e-3;

  PositionMeasurement measured(double t) {
    PositionMeasurement m{t, position_,
                          setting_.noise * setting_.noise * Eigen::Matrix3d::Identity()};
    for (int axis = 0; axis < 3; ++axis) m.position[axis] += setting_.noise * normal_(random_);
    return m;
  }

  void servo(double t, const Trajectory& path, const ServoTuning& tuning,
             PositionEstimator& estimator) {
    const auto now = estimator.at(t);
    if (!now) return;
    const double then = t + std::max(0.0, tuning.horizon + now->delay);
    const auto ahead = estimator.at(then);
    if (!ahead) return;
    const Reference reference = held_reference(path, then, 1 / setting_.frame_rate);
    // As ServoController plans.
    changes_.reference_speed =
        std::max(reference.velocity.norm(),
                 changes_.reference_speed * std::exp(-1 / setting_.frame_rate / 0.92));
    changes_.command = (ahead->commanded - commanded_).norm();
    commanded_ = ahead->commanded;
    const ServoSchedule planned = schedule(tuning, *ahead, changes_);
    estimator.set_disturbance_walk(planned.disturbance_walk);
    const ServoGains gains{planned.proportional, tuning.gains.max_speed};
    estimator.command(t, command(t, now->position, servo_velocity(gains, reference, *ahead)));
  }

  // The velocity that the currents' limit left.
  Eigen::Vector3d command(double t, const Eigen::Vector3d& where, const Eigen::Vector3d& velocity) {
    const Eigen::Vector3d field(setting_.field, 0, 0), moment(robot_.moment(setting_.field), 0, 0);
    const Allocation got =
        allocate(controller_.matrix(where), moment,
                 {field, {0, 0, robot_.net_weight(medium_)}, drag_ * velocity}, 12);
    pending_.emplace_back(t + setting_.coil_delay, got.currents);
    return got.force_scale * velocity;
  }

  void advance(double t) {
    while (!pending_.empty() && t >= pending_.front().first) {
      wanted_ = pending_.front().second;
      pending_.pop_front();
      if (currents_.size() == 0)
        currents_ = wanted_;  // the robot is released when the coils first are on
    }
    if (currents_.size() == 0) return;
    currents_ += (1 - std::exp(-kStep / setting_.coil_lag)) * (wanted_ - currents_);
    const FieldGradient f = truth_.matrix(position_) * currents_;
    const Eigen::Vector3d b = f.head<3>();
    const Eigen::Vector3d moment = moment_error_ * robot_.moment(b.norm()) * b.normalized();
    const Eigen::Vector3d force =
        force_from_field(moment) * f - Eigen::Vector3d(0, 0, robot_.net_weight(medium_));
    position_ += kStep * resistance(robot_, medium_, b).inverse() * force;
  }

  LoopSetting setting_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
  Robot robot_ = coni_2mm();
  Medium medium_;
  CoilField controller_ = CoilField::octomag(), truth_;
  double moment_error_ = 1;
  Eigen::Matrix3d drag_ = resistance(robot_, medium_, Eigen::Vector3d::UnitX());
  LoopIdentity identity_;
  ServoChanges changes_;
  Eigen::Vector3d commanded_{0, 0, 0};
  Eigen::Vector3d position_{0, 0, 0};
  std::deque<std::pair<double, Currents>> pending_;
  Currents wanted_, currents_;
};

}  // namespace vitreo::control
