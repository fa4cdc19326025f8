// Innovation statistics: whether a filter's innovations are as large and as independent as it says.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/estimator.h"

#include <Eigen/Core>

namespace vitreo::control {

/// Means over about the last `memory` s, the newest counting most.
class InnovationStatistics {
 public:
  /// s, above 0 (std::invalid_argument).
  explicit InnovationStatistics(double memory);
  /// `span`: s since the one before.
  void add(const Innovation& innovation, double span);
  /// Normalized innovation squared over its 3 degrees of freedom: 1 in the mean where the filter's
  /// covariances are true, more where it is too sure; a single one counts as 10 at most. 0 before
  /// the first.
  double normalized() const { return normalized_; }
  /// Of each innovation with the one before it, over the coordinates: 0 in the mean where the
  /// filter has taken all there is in the measurements, towards 1 where it lags, towards -1 where
  /// it follows noise. In [-1, 1].
  double correlation() const;
  void reset();

 private:
  double memory_;  // s
  bool started_ = false;
  double normalized_ = 0;
  double product_ = 0;
  double power_ = 0;
  Eigen::Vector3d last_{0, 0, 0};  // standardized
};

}  // namespace vitreo::control
