// Field allocator: currents for a field along the robot's axis, its levitation and a force besides,
// within the limits of each coil and of their sum (the inner loop of thesis 6.1, figure 6.1); and
// the choice of the field's magnitude.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/box_allocation.h"
#include "host/rig/rig.h"

#include <Eigen/Core>

#include <optional>

namespace vitreo {

struct AllocatorSettings {
  double field = 10e-3;           // T, the magnitude wanted, at least
  double field_max = 10e-3;       // T: choose() may raise it so far
  Eigen::Vector3d axis{1, 0, 0};  // unit, world: the field's direction, taken as the robot's
  control::CurrentLimits limits = control::CurrentLimits::Constant(8, 12);  // A; 0 for a dead coil
  double total_limit = 60;                                                  // A, sum of magnitudes
  double tone = 0;  // A: amplitude of tone() before it is taken into the null space
};

struct FieldAllocation {
  control::Currents currents;      // A
  Eigen::Vector3d force{0, 0, 0};  // N: what the limits left of the force besides levitation
  double headroom = 1;             // 1 - the largest |I| / limit over the living coils
  bool limited = false;            // a limit cost something of field or force
  bool outside = false;            // of the field model's region: its nearest position was used
};

/// The model is borrowed.
class FieldAllocator {
 public:
  /// Throws std::invalid_argument naming the setting; with every coil dead there would be nothing
  /// to allocate.
  FieldAllocator(const RigModel& model, const AllocatorSettings& settings);
  /// [B; F] = A(m, p) I at `position` (m, world), `force` (N, world) on top of levitation. Throws
  /// std::domain_error where levitation is out of reach, with the field to which raising it helps.
  FieldAllocation allocate(const Eigen::Vector3d& position, const Eigen::Vector3d& force) const;
  /// Moves the field's magnitude towards the one in [field, field_max] that asks least of the coils
  /// there, and at once where a limit is met. `span`: s since the last call. A soft robot's moment
  /// grows with its field, so that a stronger one may need less current for the same force.
  void choose(const Eigen::Vector3d& position, const Eigen::Vector3d& force, double span);
  /// T: the weakest field above the present one, up to 40 mT, with which no limit cuts anything
  /// there; nothing where none helps.
  std::optional<double> stronger(const Eigen::Vector3d& position,
                                 const Eigen::Vector3d& force) const;
  /// Another direction of the field, unit, world.
  void set_axis(const Eigen::Vector3d& axis) { settings_.axis = axis; }
  double field() const { return field_; }  // T, for which currents are allocated
  /// Currents to add to `currents` (A) that change neither field nor force at `position`, as
  /// believed: each coil's share of a tone of kToneRate, in a phase of its own, projected into the
  /// null space of the allocation. A coil that does not carry its share makes the robot sing
  /// (control::CoilWatch). Zero where a limit is in the way.
  control::Currents tone(const control::Currents& currents, const Eigen::Vector3d& position,
                         double time) const;
  static constexpr double kToneRate = 1.6;  // Hz
  /// The field without any force, at the workspace's center.
  control::Currents orienting() const;

 private:
  FieldAllocation allocate(const Eigen::Vector3d& position, const Eigen::Vector3d& force,
                           double field) const;
  double cost(const Eigen::Vector3d& position, const Eigen::Vector3d& force, double field) const;
  control::BoxAllocation within(const control::FieldMatrix& matrix,
                                const control::FieldGradient& background,
                                const Eigen::Vector3d& force, double wanted) const;

  const RigModel& model_;
  AllocatorSettings settings_;
  double field_;  // T
};

}  // namespace vitreo
