// SPDX-License-Identifier: Apache-2.0
#include "control/rotating_field.h"

#include "control/constants.h"
#include "control/preconditions.h"
#include "control/wrench_rows.h"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

// Normalized: the frequency response of a hold of T s is sinc(f T) (and a delay of T / 2, which the
// caller of commanded_field() has in the phase).
double sinc(double x) { return std::abs(x) < 1e-6 ? 1 : std::sin(kPi * x) / (kPi * x); }

}  // namespace

const char* to_string(RotatingMode mode) {
  constexpr const char* kNames[] = {"helix", "roller", "tumbler", "oscillating"};
  return kNames[static_cast<std::size_t>(mode)];
}

void Rotation::turn_to(const Eigen::Vector3d& other) {
  first = Eigen::Quaterniond::FromTwoVectors(axis, other) * first;
  axis = other;
  // Rounding adds up over hours of turning: e1 is made to lie across the axis again.
  first = (first - first.dot(axis) * axis).normalized();
}

// b = B (e1 cos phi + e2 sin phi) turns as phi' = w, so b + lag b' =
// B [(cos phi - w lag sin phi) e1 + (sin phi + w lag cos phi) e2].
Eigen::Vector3d commanded_field(const Rotation& rotation, double phase, double lag, double hold) {
  const double lead = 2 * kPi * rotation.frequency * lag;
  const double cosine = std::cos(phase), sine = std::sin(phase);
  // Of the oscillating one only the part along e1 changes: sin(phi) + w lag cos(phi).
  if (rotation.swing)
    return rotation.field * std::cos(*rotation.swing) * rotation.axis +
           rotation.field * std::sin(*rotation.swing) / sinc(rotation.frequency * hold) *
               (sine + lead * cosine) * rotation.first;
  const Eigen::Vector3d second = rotation.axis.cross(rotation.first);
  return rotation.field / sinc(rotation.frequency * hold) *
         ((cosine - lead * sine) * rotation.first + (sine + lead * cosine) * second);
}

// |b + lag b'| = B sqrt(1 + (w lag)^2), as b' is w B across b.
double emphasis(double frequency, double lag, double hold) {
  return std::hypot(1.0, 2 * kPi * frequency * lag) / std::abs(sinc(frequency * hold));
}

// The normal equations of the weighted least squares, with a little of |I|^2 for a rank that dead
// coils leave short: (A' W A + eps 1) I = A' W [b; 0].
FieldCurrents uniform_field_currents(const FieldMatrix& matrix, const CurrentLimits& limits) {
  // Rows of the matrix: field (T/A), then the five gradients (T/m/A); times 20 mm both are in T.
  require(matrix.cols() == limits.size(), "limits: one a coil is wanted");
  constexpr double kFieldFirst = 10;  // weight of the field against the gradient times 20 mm
  FieldMatrix weighted = matrix;
  for (int coil = 0; coil < limits.size(); ++coil)
    if (!(limits[coil] > 0)) weighted.col(coil).setZero();
  weighted.topRows<3>() *= kFieldFirst;
  weighted.bottomRows<5>() *= kGradientLength;
  using Square =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::ColMajor, kMaxCoils, kMaxCoils>;
  Square normal = weighted.transpose() * weighted;
  normal.diagonal().array() += 1e-9 * normal.trace();
  FieldCurrents right = kFieldFirst * weighted.topRows<3>().transpose();
  return normal.ldlt().solve(right);
}

namespace {

/// A per coil: what stands, and the amplitudes along cos(phi) and sin(phi).
struct CoilCourse {
  Currents standing, one, two;
};
CoilCourse course_of(const FieldCurrents& currents, const Rotation& rotation,
                     const RotationLimits& limits) {
  const double peak = rotation.field * emphasis(rotation.frequency, limits.lag, limits.update);
  const Currents first = currents * rotation.first;
  if (rotation.swing)
    return {rotation.field * std::cos(*rotation.swing) * (currents * rotation.axis),
            Currents::Zero(first.size()), peak * std::sin(*rotation.swing) * first};
  return {Currents::Zero(first.size()), peak * first,
          peak * (currents * rotation.axis.cross(rotation.first))};
}

}  // namespace

// A coil's current over a turn has the amplitude hypot(one, two) about what stands; the sum of
// magnitudes is largest somewhere on the turn: sampled.
double reachable_part(const FieldCurrents& currents, const Rotation& rotation,
                      const RotationLimits& limits) {
  const CoilCourse course = course_of(currents, rotation, limits);
  const double rate = 2 * kPi * std::abs(rotation.frequency);
  double part = 1;
  for (int coil = 0; coil < course.one.size(); ++coil) {
    const double amplitude = std::hypot(course.one[coil], course.two[coil]);
    const double most = std::abs(course.standing[coil]) + amplitude;
    if (!(limits.currents[coil] > 0) || !(most > 0)) continue;
    // A sine of this amplitude changes fastest by w times it.
    part = std::min({part, limits.currents[coil] / most,
                     rate * amplitude > 0 ? limits.slew / (rate * amplitude) : 1.0});
  }
  constexpr int kAround = 24;
  for (int k = 0; k < kAround; ++k) {
    const double phase = 2 * kPi * k / kAround;
    const double total =
        (course.standing + std::cos(phase) * course.one + std::sin(phase) * course.two)
            .cwiseAbs()
            .sum();
    if (total > limits.total) part = std::min(part, limits.total / total);
  }
  return part;
}

// Bisection: the part that can be reached falls with the frequency.
double fastest(const FieldCurrents& currents, const Rotation& rotation,
               const RotationLimits& limits) {
  Rotation tried = rotation;
  const auto reached = [&](double frequency) {
    tried.frequency = frequency;
    return reachable_part(currents, tried, limits) >= 1;
  };
  double low = 0, high = 1 / (kSetPointsPerTurn * limits.update);
  if (!reached(low)) return 0;
  if (reached(high)) return high;
  for (int pass = 0; pass < 30; ++pass) {
    const double middle = (low + high) / 2;
    (reached(middle) ? low : high) = middle;
  }
  return low;
}

}  // namespace vitreo::control
