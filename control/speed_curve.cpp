// SPDX-License-Identifier: Apache-2.0
#include "control/speed_curve.h"

#include "control/preconditions.h"

#include <algorithm>
#include <cmath>

namespace vitreo::control {
namespace {

using Point = SpeedCurve::Point;

// Along the chord from the last point whose `from` is not above `x`; held at both ends.
double along_chords(const std::vector<Point>& points, double Point::*from, double Point::*to,
                    double x) {
  if (!(x > points.front().*from)) return points.front().*to;
  for (std::size_t k = 1; k < points.size(); ++k) {
    if (x > points[k].*from) continue;
    const double part = (x - points[k - 1].*from) / (points[k].*from - points[k - 1].*from);
    return points[k - 1].*to + part * (points[k].*to - points[k - 1].*to);
  }
  return points.back().*to;
}

}  // namespace

SpeedCurve::SpeedCurve(const std::vector<Point>& points) {
  double last = 0;
  for (const Point& point : points) {
    require(std::isfinite(point.frequency) && point.frequency > last,
            "frequencies: must rise, and be above 0 Hz");
    require(std::isfinite(point.speed), "speeds: must be numbers");
    last = point.frequency;
    if (point.speed > (points_.empty() ? 0 : points_.back().speed)) points_.push_back(point);
  }
  require(!points_.empty(), "speeds: one above 0 m/s is wanted");
}

double SpeedCurve::speed(double frequency) const {
  return along_chords(points_, &Point::frequency, &Point::speed, frequency);
}

double SpeedCurve::frequency(double speed) const {
  return along_chords(points_, &Point::speed, &Point::frequency, speed);
}

}  // namespace vitreo::control
