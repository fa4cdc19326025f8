// Coil watch: which one coil, carrying less current than it was given, would explain a filter's
// innovations.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/estimator.h"

#include <Eigen/Core>

#include <cstddef>
#include <deque>
#include <vector>

namespace vitreo::control {

/// m, a column a coil.
using CoilMotions = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxCoils>;

/// Generalized likelihood ratio test of Willsky & Jones (1976) for one fault at a time, that began
/// within the last seconds, or long ago. What a coil fails to do moves the robot; through the
/// filter's own gains that leaves a signature s in the innovations v of covariance S. With the sums
/// A = sum s' S^-1 s and b = sum s' S^-1 v since the fault's begin the most probable lack is
/// c = b / A of the coil's current, and 2 ln of the likelihood ratio is b^2 / A. A lack that lasts
/// is soon taken for a disturbance; a tone in the null space of the allocation
/// (FieldAllocator::tone) keeps every coil apart from the others.
class CoilWatch {
 public:
  /// Throws std::invalid_argument.
  explicit CoilWatch(int coils);
  /// One measurement that the filter used, `span` s after the one before. `given`: m, what each
  /// coil's current moved the robot since then, as believed.
  void add(const Innovation& innovation, const Eigen::Matrix3d& position_gain,
           const Eigen::Matrix3d& velocity_gain, double span, const CoilMotions& given);
  /// One from which the filter began anew: its position is what was measured, the rest is kept.
  void restart(double span);
  struct Finding {
    int coil = 0;         // from 1; 0: nothing is known yet
    double lack = 0;      // part of its current that is missing: 1 for a dead coil
    double evidence = 0;  // 2 ln of the likelihood ratio against "no coil"
    double next = 0;      // the same of the next coil
    double rest = 0;      // squared innovations that it leaves, over their degrees of freedom
  };
  /// The coil and begin with the most evidence.
  Finding most_suspect() const;
  void reset();

 private:
  static constexpr double kEvery = 0.4;  // s, between the begins that are tried
  static constexpr double kOldest = 4;   // s
  static constexpr double kYoungest = 0.4;
  static constexpr double kMemory = 2.5;   // s, of the one that began long ago
  static constexpr double kStanding = 10;  // s, until that one is heard
  struct Signature {
    Eigen::Vector3d position{0, 0, 0};  // m per unit of lack: error of the filter's prediction
    Eigen::Vector3d velocity{0, 0, 0};  // m/s
    double information = 0;             // A
    double product = 0;                 // b
  };
  struct Begin {
    double age = 0;    // s
    double count = 0;  // innovations
    double power = 0;  // sum v' S^-1 v
    std::vector<Signature> coils;
  };
  static void take(Begin& begin, const Innovation& innovation, const Eigen::Matrix3d& weight,
                   const Eigen::Matrix3d& position_gain, const Eigen::Matrix3d& velocity_gain,
                   double span, const CoilMotions& given);
  Finding suspect_of(const Begin& begin) const;
  void age(double span);
  std::size_t coils_;
  Begin standing_;            // as if it had always been so, with faded sums
  std::deque<Begin> begins_;  // the oldest first
};

}  // namespace vitreo::control
