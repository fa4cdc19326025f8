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

inline RigModel tail_model() {
  RigModel model;
  model.robot = control::robot_named("tail_3mm");
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
        seen_ = seen;
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
  /// From now on each coil makes this part of its field.
  void weaken(double part) {
    for (int coil = 1; coil <= 8; ++coil) world_.set_coil_response(time_, coil, part);
  }
  RotatingController& controller() { return controller_; }
  ReferencePath& path() { return path_; }
  double now() const { return to_seconds(time_); }
  const RotatingStep& last() const { return step_; }
  const Eigen::Vector3d& seen() const { return seen_; }  // m, of the newest frame
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
  Eigen::Vector3d seen_{0, 0, 0};
  std::deque<control::PositionMeasurement> coming_;
  Time time_{}, next_frame_{}, next_set_{};
  double phase_ = 0;
  bool started_ = false;
};

inline control::Trajectory centimeter(double speed = 1e-3, double acceleration = 0.5e-3) {
  return control::Trajectory::spline(
      {{-4e-3, 0, 0}, {-1.5e-3, 1e-3, 0.7e-3}, {1.5e-3, -1e-3, -0.5e-3}, {4.5e-3, 0.5e-3, 0.5e-3}},
      {speed, acceleration});
}

constexpr double kTailField = 10e-3;           // T
constexpr double kTailSpeed = 0.06e-3;         // m/s, along a path
constexpr double kTailAcceleration = 0.01e-3;  // m/s^2

/// m/s: by least squares of what was seen along x for `span` s.
inline double seen_speed(SwimBench& bench, double span) {
  double n = 0, st = 0, sx = 0, stt = 0, stx = 0;
  bench.go(span, [&](double time, const sim::BodyState&) {
    const double x = bench.seen().x();
    n += 1;
    st += time;
    sx += x;
    stt += time * time;
    stx += time * x;
  });
  return (n * stx - st * sx) / (n * stt - st * st);
}

/// m/s at a frequency (Hz), measured as scripts/session/swimming.lua does: both ways, of which the
/// mean is taken, so that what pulls the robot aside does not count.
inline double beaten_speed(SwimBench& bench, double frequency) {
  double speed = 0;
  for (const double sense : {1.0, -1.0}) {
    bench.controller().spin(sense * Eigen::Vector3d::UnitX(), frequency);
    bench.go(1.5);
    speed += sense * seen_speed(bench, 2) / 2;
  }
  return speed;
}

/// A bench whose tail is spun, not steered.
inline SwimBench beating(unsigned seed) {
  RotatingSettings law;
  law.mode = control::RotatingMode::oscillating;
  return {seed, law, kTailField, tail_model(), {0, 0, 0}};
}

/// The machine's own.
inline control::SpeedCurve beaten_curve(unsigned seed, const std::vector<double>& frequencies) {
  SwimBench bench = beating(seed);
  bench.go(0.5);
  std::vector<control::SpeedCurve::Point> points;
  for (const double frequency : frequencies)
    points.push_back({frequency, beaten_speed(bench, frequency)});
  return control::SpeedCurve(points);
}

/// Hz, in use: the first is near the best of all machines, and slower than it the law lowers the
/// swing.
inline const std::vector<double> kTailFrequencies{9, 12};

inline RotatingSettings tail_law(unsigned seed) {
  RotatingSettings law;
  law.mode = control::RotatingMode::oscillating;
  law.speeds = beaten_curve(seed, kTailFrequencies);
  return law;
}

/// m: rms of the way's distance from its point, and of that of its mean over a second, which is
/// several beats of a tail; the largest, and what was told of step-outs.
struct PathError {
  double rms = 0, mean_way = 0, worst = 0;
  int told = 0;
};

inline PathError path_error_of(unsigned seed, bool tail) {
  SwimBench bench =
      tail ? SwimBench(seed, tail_law(seed), kTailField, tail_model()) : SwimBench(seed, {}, 2e-3);
  bench.go(tail ? 15 : 6);
  bench.path() = {tail ? centimeter(kTailSpeed, kTailAcceleration) : centimeter(), bench.now()};
  PathError found;
  std::deque<Eigen::Vector3d> last;
  Eigen::Vector3d sum(0, 0, 0);
  int count = 0, means = 0;
  const double end = bench.now() + bench.path().path.duration() + 2;
  bench.go(end - bench.now(), [&](double now, const sim::BodyState& robot) {
    if (now - bench.path().begin > bench.path().path.duration()) return;
    const Eigen::Vector3d off = robot.position - bench.path().at(now).position;
    found.rms += off.squaredNorm();
    found.worst = std::max(found.worst, off.norm());
    ++count;
    last.push_back(off);
    sum += off;
    if (last.size() < 15) return;  // a second of frames
    found.mean_way += (sum / 15).squaredNorm();
    ++means;
    sum -= last.front();
    last.pop_front();
  });
  found.rms = std::sqrt(found.rms / count);
  found.mean_way = std::sqrt(found.mean_way / means);
  found.told = static_cast<int>(bench.found.size());
  return found;
}

/// The same of a helix, m rms.
inline double path_error(unsigned seed, double* worst = nullptr, int* told = nullptr) {
  const PathError found = path_error_of(seed, false);
  if (worst != nullptr) *worst = found.worst;
  if (told != nullptr) *told = found.told;
  return found.rms;
}

}  // namespace vitreo::machines
