// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/pose_sensor.h"

#include "devices/sim/checks.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <limits>
#include <random>
#include <utility>

namespace vitreo::sim {
namespace {

// Standard normal noise of one reading's position and axis, from a generator seeded with its
// number: the same whichever readings are pulled.
std::array<Eigen::Vector3d, 2> noise_of(std::uint64_t seed, std::uint64_t number) {
  std::seed_seq mixed{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                      static_cast<std::uint32_t>(number), static_cast<std::uint32_t>(number >> 32),
                      0x705e5eU};
  std::mt19937_64 random(mixed);
  std::normal_distribution<double> normal;
  // One statement each: the order of evaluation within an expression is unspecified.
  const double x = normal(random);
  const double y = normal(random);
  const double z = normal(random);
  const Eigen::Vector3d position(x, y, z);
  // After the position's, which thereby stays what it was before there was an axis.
  const double u = normal(random);
  const double v = normal(random);
  const double w = normal(random);
  return {position, Eigen::Vector3d(u, v, w)};
}

// Readings are taken at k period and arrive `latency` later. A call returns the newest that has
// arrived, or waits for the next: those between are never made.
class SimulatedPoseSensor : public PoseSensor {
 public:
  SimulatedPoseSensor(const PoseSensorSettings& settings, TruePosition truth, Clock& clock,
                      std::uint64_t seed, const ImagingFaults& faults, TrueAxis axis)
      : settings_(settings),
        truth_(std::move(truth)),
        axis_(std::move(axis)),
        clock_(clock),
        seed_(seed),
        faults_(faults),
        period_(from_seconds(1 / settings.frame_rate)),
        latency_(from_seconds(settings.latency)) {}
  std::string identity() const override {
    return "simulated pose sensor: the simulator's truth, late and noisy";
  }
  double period() const override { return 1 / settings_.frame_rate; }
  // Readings between two calls are skipped, as by a camera: the newest one counts. The true
  // position is fetched at the usual latency even where a fault delays the reading, since the world
  // remembers one second only.
  PoseReading read(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      const Time late = latency_ + faults_.late;
      const std::int64_t arrived = clock_.now() < late ? -1 : (clock_.now() - late) / period_;
      const std::int64_t number = std::max(arrived, last_ + 1);
      const Time arrives = number * period_ + late;
      if (arrives > deadline) {
        wait_until(deadline);
        throw DeviceError(DeviceErrorKind::timeout, "pose_sensor", "no reading in time");
      }
      wait_until(number * period_ + latency_);
      last_ = number;
      // Before the world forgets it. An alternating one has the last two.
      const bool old = faults_.frozen || faults_.stale || (faults_.alternating && before_position_);
      if (!old) {
        before_position_ = last_position_;
        last_position_ = truth_(number * period_);
        if (axis_) last_axis_ = axis_(number * period_);
      }
      if (faults_.late > Time::zero()) wait_until(arrives);
      const auto each = [number](int n) { return n > 0 && number % n == 0; };
      if (faults_.silent || each(faults_.drops) || each(faults_.torn)) continue;
      return reading(number, arrives);
    }
  }

 private:
  void wait_until(Time due) {
    const auto check = [this] {
      if (faults_.unplugged) throw DeviceError(DeviceErrorKind::lost, "pose_sensor", "is gone");
    };
    check();
    clock_.sleep_until(due);
    check();
  }

  // Truth with white noise; the covariance is the noise's own, sigma^2 1.
  PoseReading reading(std::int64_t number, Time arrives) const {
    PoseReading reading{static_cast<std::uint64_t>(number),
                        number * period_ + faults_.stamp_error(number * period_),
                        arrives,
                        faults_.alternating && number % 2 == 0 ? before_position_ : last_position_,
                        {}};
    reading.covariance = settings_.noise * settings_.noise * Eigen::Matrix3d::Identity();
    reading.axis = last_axis_;
    const auto [shift, turn] = noise_of(seed_, reading.number);
    const bool to_the_bit = faults_.frozen || faults_.alternating;
    if (reading.position && !to_the_bit) *reading.position += settings_.noise * shift;
    if (reading.axis && !to_the_bit)
      reading.axis = (*reading.axis + settings_.axis_noise * turn).normalized();
    if (faults_.nan)
      reading.position = Eigen::Vector3d::Constant(std::numeric_limits<double>::quiet_NaN());
    return reading;
  }

  PoseSensorSettings settings_;
  TruePosition truth_;
  TrueAxis axis_;
  Clock& clock_;
  std::uint64_t seed_;
  const ImagingFaults& faults_;
  Time period_;
  Time latency_;
  std::int64_t last_ = -1;
  std::optional<Eigen::Vector3d> last_position_;
  std::optional<Eigen::Vector3d> before_position_;
  std::optional<Eigen::Vector3d> last_axis_;
};

}  // namespace

void PoseSensorSettings::check() const {
  require(frame_rate > 0 && frame_rate <= 10000, "frame_rate must be in (0, 10000] Hz");
  require(latency >= 0 && latency < 0.4, "latency must be in [0, 0.4) s");
  require(noise > 0 && noise <= 1e-3, "noise must be in (0, 1 mm]");
  require(axis_noise >= 0 && axis_noise < 1, "axis_noise must be in [0, 1) rad");
}

std::unique_ptr<PoseSensor> make_pose_sensor(const PoseSensorSettings& settings, TruePosition truth,
                                             Clock& clock, std::uint64_t seed,
                                             const ImagingFaults* faults, TrueAxis axis) {
  static const ImagingFaults none;
  settings.check();
  return std::make_unique<SimulatedPoseSensor>(settings, std::move(truth), clock, seed,
                                               faults != nullptr ? *faults : none, std::move(axis));
}

}  // namespace vitreo::sim
