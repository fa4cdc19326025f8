// Speed curve: a swimmer's speed over the frequency of its field, as it was measured.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <vector>

namespace vitreo::control {

/// Straight between the points. Used is its rising part alone, up to the fastest of them: beyond
/// that more frequency gives no more speed.
class SpeedCurve {
 public:
  struct Point {
    double frequency;  // Hz
    double speed;      // m/s, forwards
  };
  /// By rising frequency, one above 0 m/s. A point that is slower than one before it is left out (a
  /// measured curve has its noise). Throws std::invalid_argument naming speeds or frequencies.
  explicit SpeedCurve(const std::vector<Point>& points);
  double lowest() const { return points_.front().frequency; }     // Hz, measured
  double fastest() const { return points_.back().frequency; }     // Hz, of the highest speed
  double slowest_speed() const { return points_.front().speed; }  // m/s, of lowest()
  /// m/s; below the lowest frequency and above the fastest that of these.
  double speed(double frequency) const;
  /// Hz, of a speed (m/s): within lowest() and fastest().
  double frequency(double speed) const;

 private:
  std::vector<Point> points_;
};

}  // namespace vitreo::control
