// Simulated field probe: a three-axis teslameter, a direct device without a wire.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/field_probe.h"

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <random>

namespace vitreo::sim {

struct ProbeSettings {
  double noise = 10e-6;        // T, standard deviation of a component
  double range = 0.3;          // T
  double integration = 20e-3;  // s, of one reading
  void check() const;          // throws std::invalid_argument naming the parameter
};

/// Three axes, along the world's. It measures what `field` (T, at a time and a place) has at the
/// position (m, world) that `position` returns.
class SimulatedProbe : public FieldProbe {
 public:
  using Field = std::function<Eigen::Vector3d(Time time, const Eigen::Vector3d& position)>;
  SimulatedProbe(const ProbeSettings& settings, Field field,
                 std::function<Eigen::Vector3d()> position, Clock& clock, std::uint64_t seed);
  const FieldProbeInfo& info() const override { return info_; }
  FieldReading measure(Time timeout) override;

 private:
  FieldProbeInfo info_;
  ProbeSettings settings_;
  Field field_;
  std::function<Eigen::Vector3d()> position_;
  Clock& clock_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace vitreo::sim
