// Vectors and the plain value of numbers, for code that is templated for Ceres' Jets.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

namespace vitreo::optics::detail {

template <class T>
using Vector2 = Eigen::Matrix<T, 2, 1>;
template <class T>
using Vector3 = Eigen::Matrix<T, 3, 1>;

/// The value without derivatives.
inline double scalar(double x) { return x; }
template <class Jet>
double scalar(const Jet& x) {
  return x.a;
}

}  // namespace vitreo::optics::detail
