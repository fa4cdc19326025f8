// SPDX-License-Identifier: Apache-2.0
#include "host/servo/plant_gate.h"

#include <Eigen/Cholesky>

#include <algorithm>

namespace vitreo {
namespace {

constexpr double kGateSigmas = 5;
// Of the motion that the model gives, as a standard deviation: gain and drag.
constexpr double kGateGain = 0.3;
// m: what no eye's noise contains, as pixels and pose change from one view of the robot to another.
constexpr double kGateFloor = 15e-6;

}  // namespace

void PlantGate::driven(double acts, const Eigen::Vector3d& velocity) {
  while (!drives_.empty() && drives_.back().acts >= acts) drives_.pop_back();
  drives_.push_back({acts, velocity});
}

// One drive older than the position stays: it acts at that moment.
void PlantGate::believed(double time, const Eigen::Vector3d& position,
                         const Eigen::Matrix3d& noise) {
  time_ = time;
  position_ = position;
  noise_ = noise;
  while (drives_.size() > 1 && drives_[1].acts <= time) drives_.pop_front();
}

Eigen::Vector3d PlantGate::moved(double from, double until) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (std::size_t k = 0; k < drives_.size(); ++k) {
    const double begin = std::max(drives_[k].acts, from);
    const double end = k + 1 < drives_.size() ? std::min(drives_[k + 1].acts, until) : until;
    if (end > begin) sum += (end - begin) * drives_[k].velocity;
  }
  return sum;
}

// S = R_then + R_now + ((unexplained dt)^2 + floor^2) I + gain^2 m m', m the motion by the model.
std::optional<double> PlantGate::distance(double time, const Eigen::Vector3d& position,
                                          const Eigen::Matrix3d& noise) const {
  if (!time_ || time - *time_ > kMemory) return std::nullopt;
  const double apart = std::max(0.0, time - *time_);
  const Eigen::Vector3d motion = moved(*time_, time);
  const double walk = unexplained_ * apart;
  const Eigen::Matrix3d S = noise_ + noise +
                            (walk * walk + kGateFloor * kGateFloor) * Eigen::Matrix3d::Identity() +
                            kGateGain * kGateGain * motion * motion.transpose();
  const Eigen::Vector3d off = position - position_ - motion;
  return off.dot(S.ldlt().solve(off));
}

bool PlantGate::admits(double time, const Eigen::Vector3d& position,
                       const Eigen::Matrix3d& noise) const {
  const auto squared = distance(time, position, noise);
  return !squared || *squared <= kGateSigmas * kGateSigmas;
}

}  // namespace vitreo
