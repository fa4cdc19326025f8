// The servo law and where its gains come from.
// SPDX-License-Identifier: Apache-2.0
#include "control/servo_law.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace {

void require(bool good, const std::string& what) {
  if (!good) throw std::invalid_argument(what);
}

}  // namespace

void ServoGains::check() const {
  require(std::isfinite(proportional) && proportional >= 0, "proportional: must be at least 0 1/s");
  require(std::isfinite(max_speed) && max_speed > 0, "max_speed: must be above 0 m/s");
}

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
  const auto at_least_0 = [](double value) { return std::isfinite(value) && value >= 0; };
  const auto above_0 = [](double value) { return std::isfinite(value) && value > 0; };
  require(at_least_0(measurement_latency), "measurement_latency: must be at least 0 s");
  require(at_least_0(command_delay), "command_delay: must be at least 0 s");
  require(at_least_0(command_lag), "command_lag: must be at least 0 s");
  require(above_0(period), "period: must be above 0 s");
  require(above_0(noise), "noise: must be above 0 m");
  require(above_0(drag), "drag: must be above 0 N s/m");
  require(above_0(force_limit), "force_limit: must be above 0 N");
  require(at_least_0(instability), "instability: must be at least 0 1/s");
}

ServoTuning tune(const LoopIdentity& loop) {
  loop.check();
  ServoTuning tuning;
  const double dead =
      loop.measurement_latency + loop.command_delay + loop.command_lag + loop.period / 2;
  // Without prediction: an integrator behind a dead time T keeps 60 degrees of phase at Kp T = 0.5;
  // a third leaves room for the drag being another than thought.
  tuning.pd.proportional = 0.35 / dead;
  tuning.pd.derivative = 0.05;
  tuning.pd.derivative_time = std::max(dead, loop.period);
  tuning.gains.max_speed = tuning.pd.max_speed = loop.force_limit / loop.drag;
  // With prediction the dead time is out of the loop but for its error; what speaks against more
  // gain is noise.
  tuning.gains.proportional = 0.5 / dead;
  EstimatorSettings& estimator = tuning.estimator;
  estimator.command_delay = loop.command_delay;
  estimator.command_lag = loop.command_lag;
  // Displaced by its own noise over one dead time, the robot is pushed by the instability times
  // that.
  estimator.disturbance_walk = std::max(loop.instability, 0.02) * 10 * loop.noise / std::sqrt(dead);
  estimator.position_walk = 0.1 * loop.noise / std::sqrt(dead);
  estimator.max_disturbance = tuning.gains.max_speed;
  estimator.max_age = std::max(1.0, 4 * dead);
  tuning.horizon = loop.command_delay + loop.command_lag;
  return tuning;
}

}  // namespace vitreo::control
