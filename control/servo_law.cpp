// SPDX-License-Identifier: Apache-2.0
#include "control/servo_law.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {

void ServoGains::check() const {
  require(not_negative(proportional), "proportional: must be at least 0 1/s");
  require(positive(max_speed), "max_speed: must be above 0 m/s");
}

// u = v_ref + Kp (p_ref - p^) - d^, shortened to max_speed (facts/magnetics 2): with p' = u + d the
// error decays as e' = -Kp e.
// The shortened velocity keeps its direction: a limit must not bend the path.
Eigen::Vector3d servo_velocity(const ServoGains& gains, const Reference& reference,
                               const PositionEstimate& estimate) {
  gains.check();
  require(reference.position.allFinite() && reference.velocity.allFinite(),
          "reference: not finite");
  const Eigen::Vector3d asked = reference.velocity +
                                gains.proportional * (reference.position - estimate.position) -
                                estimate.disturbance;
  const double speed = asked.norm();
  return speed > gains.max_speed ? Eigen::Vector3d(asked * (gains.max_speed / speed)) : asked;
}

void LoopIdentity::check() const {
  require(not_negative(measurement_latency), "measurement_latency: must be at least 0 s");
  require(not_negative(command_delay), "command_delay: must be at least 0 s");
  require(not_negative(command_lag), "command_lag: must be at least 0 s");
  require(positive(period), "period: must be above 0 s");
  require(positive(noise), "noise: must be above 0 m");
  require(positive(drag), "drag: must be above 0 N s/m");
  require(positive(force_limit), "force_limit: must be above 0 N");
  require(not_negative(instability), "instability: must be at least 0 1/s");
}

// Gains from the dead time T of the loop: latency of the measurement, delay and lag of the coils,
// and half a period, the mean age of a held command. The plant is an integrator, p' = u.
// All from the identified parameters, so that a faster camera or a thicker medium needs no tuning
// by hand.
ServoTuning tune(const LoopIdentity& loop) {
  loop.check();
  ServoTuning tuning;
  const double dead =
      loop.measurement_latency + loop.command_delay + loop.command_lag + loop.period / 2;
  // Without prediction: L(s) = Kp e^(-sT) / s crosses at w = Kp with the phase margin
  // 90 deg - Kp T, that is 61 deg at Kp T = 0.5. At 0.35 (70 deg) there is room for a drag that is
  // not as believed.
  tuning.pd.proportional = 0.35 / dead;
  tuning.pd.derivative = 0.05;
  tuning.pd.derivative_time = std::max(dead, loop.period);
  tuning.gains.max_speed = tuning.pd.max_speed = loop.force_limit / loop.drag;
  // With prediction the dead time is out of the loop but for its error; noise limits the gain.
  tuning.gains.proportional = 0.5 / dead;
  EstimatorSettings& estimator = tuning.estimator;
  estimator.command_delay = loop.command_delay;
  estimator.command_lag = loop.command_lag;
  // Process noise q: a displacement of the noise's size grows at the rate of Earnshaw's instability
  // (1/s), which is a disturbance of instability * noise (m/s) after each dead time, here with a
  // margin of ten.
  estimator.disturbance_walk = std::max(loop.instability, 0.02) * 10 * loop.noise / std::sqrt(dead);
  estimator.position_walk = 0.1 * loop.noise / std::sqrt(dead);
  // A disturbance above the speed limit could not be cancelled.
  estimator.max_disturbance = tuning.gains.max_speed;
  estimator.max_age = std::max(1.0, 4 * dead);
  // What is commanded now acts after delay and lag: reference and estimate are taken there.
  tuning.horizon = loop.command_delay + loop.command_lag;
  return tuning;
}

}  // namespace vitreo::control
