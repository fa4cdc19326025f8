// SPDX-License-Identifier: Apache-2.0
#include "control/servo_law.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Of the two-degree-of-freedom loop, dimensionless: gain and observer bandwidth times the dead
// time. With both at these values the gain margin is 6.6 dB and the delay margin 158 ms at 15
// frames/s (loop_margins).
constexpr double kProportional = 0.5;
constexpr double kObserver = 1.0;
// 1/sqrt(s): disturbance walk over the reference's speed, for the model's errors along a path.
constexpr double kPathWalk = 0.06;
// Change of the disturbance over a change of the command: what one gain for all directions leaves.
constexpr double kDirectional = 0.05;
// m/s: bounds of the feedback's speed.
constexpr double kLeastFeedback = 0.5e-3;
constexpr double kMostFeedback = 5e-3;
// Of the loop as believed before anything was measured: moment 30 %, drag a factor of two, delay
// 60 ms, each as two standard deviations or less.
constexpr double kGainSigma = 0.35;
constexpr double kDelaySigma = 30e-3;  // s

}  // namespace

void ServoGains::check() const {
  require(not_negative(proportional), "proportional: must be at least 0 1/s");
  require(positive(max_speed), "max_speed: must be above 0 m/s");
}

// The shortened feedback keeps its direction: a limit must not bend the path.
// Dividing by (1 + g) (1 + s^2 / (1 + g)^2), s the gain's standard deviation, is the cautious form
// (Astrom & Wittenmark 1995, 7): the command with the least expected square of the next error.
Eigen::Vector3d servo_velocity(const ServoGains& gains, const Reference& reference,
                               const PositionEstimate& estimate) {
  gains.check();
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  Eigen::Vector3d feedback = gains.proportional * (reference.position - estimate.position);
  const double speed = feedback.norm();
  if (speed > gains.max_speed) feedback *= gains.max_speed / speed;
  const double gain = 1 + estimate.gain;
  const double cautious = gain + estimate.gain_sigma * estimate.gain_sigma / gain;
  return (reference.velocity + feedback - estimate.disturbance) / cautious;
}

void LoopIdentity::check() const {
  require(not_negative(measurement_latency), "measurement_latency: must be at least 0 s");
  require(not_negative(command_delay), "command_delay: must be at least 0 s");
  require(not_negative(command_lag), "command_lag: must be at least 0 s");
  require(positive(period), "period: must be above 0 s");
  require(positive(noise), "noise: must be above 0 m");
  require(positive(drag), "drag: must be above 0 N s/m");
  require(std::isfinite(weight), "weight: not finite");
  require(not_negative(instability), "instability: must be at least 0 1/s");
}

// Gains from the dead time T of the loop: latency of the measurement, delay and lag of the coils,
// and half a period, the mean age of a held command. The plant is an integrator, p' = u.
// All from the identified parameters, so that a faster camera or a thicker medium needs no tuning
// by hand.
ServoTuning tune(const LoopIdentity& loop) {
  loop.check();
  ServoTuning tuning;
  tuning.loop = loop;
  const double dead = loop.dead_time();
  // The coils make the weight's force beyond levitation wherever they levitate at all with some
  // room: the speed at which the robot sinks is the scale of everything.
  const double sinking = std::abs(loop.weight) / loop.drag;
  // Without prediction: L(s) = Kp e^(-sT) / s crosses at w = Kp with the phase margin
  // 90 deg - Kp T, that is 61 deg at Kp T = 0.5. At 0.35 (70 deg) there is room for a drag that is
  // not as believed.
  tuning.pd.proportional = 0.35 / dead;
  tuning.pd.derivative = 0.05;
  tuning.pd.derivative_time = std::max(dead, loop.period);
  tuning.gains.max_speed = tuning.pd.max_speed = std::clamp(sinking, kLeastFeedback, kMostFeedback);
  // With prediction the dead time is out of the loop but for its error; noise limits the gain.
  tuning.gains.proportional = kProportional / dead;
  EstimatorSettings& estimator = tuning.estimator;
  estimator.command_delay = loop.command_delay;
  estimator.command_lag = loop.command_lag;
  estimator.position_walk = 0.1 * loop.noise / std::sqrt(dead);
  estimator.initial_disturbance = std::max(3e-4, 0.65 * sinking);
  // In half the drag, 50 % too heavy and its moment 30 % too small, the robot sinks at 1.6 times
  // that speed; what is beyond four times is no free robot.
  estimator.max_disturbance = std::max(2e-3, 4 * sinking);
  estimator.gain_sigma = kGainSigma;
  estimator.delay_sigma = kDelaySigma;
  estimator.max_age = std::max(1.0, 4 * dead);
  estimator.disturbance_walk = schedule(tuning, {}, {}).disturbance_walk;
  // What is commanded now acts after delay and lag: reference and estimate are taken there.
  tuning.horizon = loop.command_delay + loop.command_lag;
  return tuning;
}

// With s_g, s_tau the standard deviations of gain and delay,
//   eta = 1 / [(1 + 2 s_g / (1 + g)) (1 + 2 s_tau / T)],  Kp = 0.5 eta / T,
//   wo = min(eta^2 / T, sqrt(q / (r sqrt(Ts)))):
// stable, with room, at two standard deviations of both (facts/control_limits 3). The stationary
// filter of p' = d, d' = q, measured each Ts with r, has the natural frequency
// sqrt(q / (r sqrt(Ts))), so q is what makes wo. What has to be followed: a displacement of the
// noise's size grows at the rate of Earnshaw's instability; along a path the model's error changes
// with the place; and what one gain for all directions leaves changes with the command. The last
// two could feed an oscillation, but for the first bound of wo.
ServoSchedule schedule(const ServoTuning& tuning, const PositionEstimate& estimate,
                       const ServoChanges& changes) {
  const LoopIdentity& loop = tuning.loop;
  const double dead = loop.dead_time() + estimate.delay;
  const double eta = 1 / ((1 + 2 * estimate.gain_sigma / (1 + estimate.gain)) *
                          (1 + 2 * estimate.delay_sigma / dead));
  const double held = std::max(loop.instability, 0.02) * loop.noise / std::sqrt(loop.dead_time());
  const double needed = std::hypot(held, kPathWalk * changes.reference_speed,
                                   kDirectional * changes.command / std::sqrt(loop.period));
  const double scale = loop.noise * std::sqrt(loop.period);
  ServoSchedule now;
  now.proportional = eta * kProportional / dead;
  now.bandwidth = std::min(kObserver * eta * eta / dead, std::sqrt(needed / scale));
  now.disturbance_walk = now.bandwidth * now.bandwidth * scale;
  return now;
}

}  // namespace vitreo::control
