// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/pose_sensor.h"

#include "devices/error.h"

#include <algorithm>
#include <random>
#include <stdexcept>
#include <utility>

namespace vitreo::sim {
namespace {

/// A number of its own for every reading, whichever are asked for.
Eigen::Vector3d noise_of(std::uint64_t seed, std::uint64_t number) {
  std::seed_seq mixed{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                      static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(number >> 32), 0x705e5eU};
  std::mt19937_64 random(mixed);
  std::normal_distribution<double> normal;
  const double x = normal(random), y = normal(random), z = normal(random);  // a fixed order
  return {x, y, z};
}

class TruthSensor : public PoseSensor {
 public:
  TruthSensor(const PoseSensorSettings& settings, TruePlace truth, Clock& clock, std::uint64_t seed)
      : settings_(settings),
        truth_(std::move(truth)),
        clock_(clock),
        seed_(seed),
        period_(from_seconds(1 / settings.frame_rate)),
        latency_(from_seconds(settings.latency)) {}
  std::string identity() const override { return "simulated pose sensor: the simulator's truth, late and noisy"; }
  double period() const override { return 1 / settings_.frame_rate; }
  PoseReading read(Time timeout) override {
    const Time deadline = timeout == kForever ? kForever : clock_.now() + timeout;
    const std::int64_t arrived = clock_.now() < latency_ ? -1 : (clock_.now() - latency_) / period_;
    const std::int64_t number = std::max(arrived, last_ + 1);
    const Time arrives = number * period_ + latency_;
    if (arrives > deadline) {
      clock_.sleep_until(deadline);
      throw DeviceError(DeviceErrorKind::timeout, "pose_sensor", "no reading in time");
    }
    clock_.sleep_until(arrives);
    last_ = number;
    PoseReading reading{static_cast<std::uint64_t>(number), number * period_, arrives, truth_(number * period_), {}};
    reading.covariance = settings_.noise * settings_.noise * Eigen::Matrix3d::Identity();
    if (reading.position) *reading.position += settings_.noise * noise_of(seed_, reading.number);
    return reading;
  }

 private:
  PoseSensorSettings settings_;
  TruePlace truth_;
  Clock& clock_;
  std::uint64_t seed_;
  Time period_, latency_;
  std::int64_t last_ = -1;
};

}  // namespace

void PoseSensorSettings::check() const {
  if (!(frame_rate > 0 && frame_rate <= 10000)) throw std::invalid_argument("frame_rate must be in (0, 10000] Hz");
  if (!(latency >= 0 && latency < 0.4)) throw std::invalid_argument("latency must be in [0, 0.4) s");
  if (!(noise > 0 && noise <= 1e-3)) throw std::invalid_argument("noise must be in (0, 1 mm]");
}

std::unique_ptr<PoseSensor> make_pose_sensor(const PoseSensorSettings& settings, TruePlace truth, Clock& clock,
                                             std::uint64_t seed) {
  settings.check();
  return std::make_unique<TruthSensor>(settings, std::move(truth), clock, seed);
}

}  // namespace vitreo::sim
