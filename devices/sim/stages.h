// Stages, a rotation stage and a field probe of the simulated laboratory: direct devices without a wire.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/field_probe.h"
#include "devices/rotation_stage.h"
#include "devices/sim/world.h"
#include "devices/stage.h"

#include <functional>
#include <random>
#include <string>
#include <vector>

namespace vitreo::sim {

/// Axes that set off together and arrive together, at a steady speed, on a multiple of their resolution.
class AxisMotion {
 public:
  /// `unit`: "m" or "rad", for errors under the name `device`. All axes begin at 0, or at the end of a travel without
  /// 0.
  AxisMotion(std::vector<StageAxis> axes, std::string device, const char* unit, Clock& clock);
  const std::vector<StageAxis>& axes() const { return axes_; }
  /// Where it is, was since the last start, or will be if nothing intervenes.
  std::vector<double> at(Time time) const;
  void start(std::span<const double> target, double speed);  // as Stage::start
  bool moving() const { return clock_.now() < arrives_; }
  void wait(Time timeout);  // as Stage::wait
  void stop();
  [[noreturn]] void home() const;  // there is no reference to find: DeviceError{refused}

 private:
  std::vector<StageAxis> axes_;
  std::string device_;
  const char* unit_;
  Clock& clock_;
  Signal changed_;
  std::vector<double> from_, target_;
  Time started_{}, arrives_{};
  bool stopped_ = false;  // the last motion did not reach its target
};

class SimulatedStage : public Stage {
 public:
  SimulatedStage(std::string name, const std::vector<StageAxis>& axes, Clock& clock);
  const StageInfo& info() const override { return info_; }
  std::vector<double> position() override { return motion_.at(clock_.now()); }
  void start(std::span<const double> target, double speed) override { motion_.start(target, speed); }
  bool moving() override { return motion_.moving(); }
  void wait(Time timeout) override { motion_.wait(timeout); }
  void home(Time) override { motion_.home(); }
  void stop() override { motion_.stop(); }
  void make_safe() override { motion_.stop(); }
  std::vector<double> at(Time time) const { return motion_.at(time); }

 private:
  StageInfo info_;
  Clock& clock_;
  AxisMotion motion_;
};

class SimulatedRotationStage : public RotationStage {
 public:
  SimulatedRotationStage(std::string name, const StageAxis& axis, Clock& clock);
  const RotationStageInfo& info() const override { return info_; }
  double angle() override { return motion_.at(clock_.now())[0]; }
  void start(double angle, double speed) override { motion_.start(std::span(&angle, 1), speed); }
  bool moving() override { return motion_.moving(); }
  void wait(Time timeout) override { motion_.wait(timeout); }
  void home(Time) override { motion_.home(); }
  void stop() override { motion_.stop(); }
  void make_safe() override { motion_.stop(); }
  double at(Time time) const { return motion_.at(time)[0]; }

 private:
  RotationStageInfo info_;
  Clock& clock_;
  AxisMotion motion_;
};

struct ProbeSettings {
  double noise = 10e-6;        // T, standard deviation of a component
  double range = 0.3;          // T
  double integration = 20e-3;  // s, of one reading
  void check() const;          // throws std::invalid_argument naming the parameter
};

/// Three axes, along the world's. It reads the field where `place` says it is.
class SimulatedProbe : public FieldProbe {
 public:
  SimulatedProbe(const ProbeSettings& settings, World& world, std::function<Eigen::Vector3d()> place, Clock& clock,
                 std::uint64_t seed);
  const FieldProbeInfo& info() const override { return info_; }
  FieldReading measure(Time timeout) override;

 private:
  FieldProbeInfo info_;
  ProbeSettings settings_;
  World& world_;
  std::function<Eigen::Vector3d()> place_;
  Clock& clock_;
  std::mt19937_64 random_;
  std::normal_distribution<double> normal_;
};

}  // namespace vitreo::sim
