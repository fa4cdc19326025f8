// SPDX-License-Identifier: Apache-2.0
#include "devices/time/device_clock.h"

#include <algorithm>
#include <cmath>

namespace vitreo {
namespace {

// Long enough for a slope to 1 ppm out of jitters of 20 ms, short enough that a crystal's drift
// with the temperature is a straight line.
constexpr double kWindow = 30;  // s
constexpr double kBin = 0.25;   // s, of which the earliest arrival counts
constexpr double kFastest = 200e-6;
// Below this a slope is noise: the offset alone is estimated.
constexpr double kLeastSpan = 2;  // s

}  // namespace

DeviceClock::Point DeviceClock::point(Time device, Time host) {
  // Comparisons and frames come interleaved: a second back is no restart.
  constexpr double kBack = 1;
  if (!origin_ || to_seconds(device - last_) < -kBack) {
    *this = DeviceClock{};
    origin_ = device;
    offset_ = host - device;
  }
  last_ = std::max(last_, device);
  return {to_seconds(device - *origin_), to_seconds(host - device - offset_), 0};
}

void DeviceClock::forget(double before) {
  const auto old = [before](const std::deque<Point>& points) {
    return points.size() > 1 && points.front().device < before;
  };
  while (old(earliest_)) earliest_.pop_front();
  while (old(comparisons_)) comparisons_.pop_front();
}

void DeviceClock::arrived(Time device, Time host) {
  const Point now = point(device, host);
  const bool same_bin = !earliest_.empty() &&
                        std::floor(earliest_.back().device / kBin) == std::floor(now.device / kBin);
  if (!same_bin)
    earliest_.push_back(now);
  else if (now.offset < earliest_.back().offset)
    earliest_.back() = now;
  forget(now.device - kWindow);
  if (comparisons_.empty()) line_ = below({earliest_.begin(), earliest_.end()});
}

void DeviceClock::compared(Time device, Time before, Time after) {
  Point now = point(device, before + (after - before) / 2);
  now.within = std::max(to_seconds(after - before) / 2, 1e-6);
  comparisons_.push_back(now);
  forget(now.device - kWindow);
  line_ = through(comparisons_);
}

/// Delays are never negative, so the true line lies below all points; of those below, the one that
/// is highest at the points' mean time: the edge of the lower convex hull that spans it (Moon,
/// Skelly, Towsley 1999, as a linear program).
DeviceClock::Line DeviceClock::below(const std::vector<Point>& points) {
  std::vector<Point> hull;
  for (const Point& p : points) {
    // Drops the last vertex while it lies on or above the chord from the one before it to p.
    while (hull.size() >= 2) {
      const Point& a = hull[hull.size() - 2];
      const Point& b = hull.back();
      const double turn = (b.device - a.device) * (p.offset - a.offset) -
                          (b.offset - a.offset) * (p.device - a.device);
      if (turn > 0) break;
      hull.pop_back();
    }
    hull.push_back(p);
  }
  double mean = 0;
  for (const Point& p : points) mean += p.device / static_cast<double>(points.size());
  Line line{points.back().device, 0, 0};
  if (points.back().device - points.front().device >= kLeastSpan) {
    const auto right = std::find_if(hull.begin() + 1, hull.end(),
                                    [mean](const Point& p) { return p.device >= mean; });
    const Point& b = right == hull.end() ? hull.back() : *right;
    const Point& a = *(std::find_if(hull.begin(), hull.end(),
                                    [&b](const Point& p) { return p.device == b.device; }) -
                       1);
    line.slope = std::clamp((b.offset - a.offset) / (b.device - a.device), -kFastest, kFastest);
  }
  // The supporting line of that slope: a slope that was clamped touches another vertex.
  line.offset = INFINITY;
  for (const Point& p : hull)
    line.offset = std::min(line.offset, p.offset + line.slope * (line.device - p.device));
  return line;
}

/// Weighted least squares, the weight of a comparison being 1/within^2: each lies within half its
/// round trip of the truth.
DeviceClock::Line DeviceClock::through(const std::deque<Point>& points) {
  double weights = 0;
  double device = 0;
  double offset = 0;
  for (const Point& p : points) {
    const double weight = 1 / (p.within * p.within);
    weights += weight;
    device += weight * p.device;
    offset += weight * p.offset;
  }
  device /= weights;
  offset /= weights;
  double both = 0;
  double square = 0;
  for (const Point& p : points) {
    const double weight = 1 / (p.within * p.within);
    both += weight * (p.device - device) * (p.offset - offset);
    square += weight * (p.device - device) * (p.device - device);
  }
  Line line{device, offset, 0};
  if (points.back().device - points.front().device >= kLeastSpan && square > 0)
    line.slope = std::clamp(both / square, -kFastest, kFastest);
  return line;
}

std::optional<Time> DeviceClock::host_of(Time device) const {
  if (!origin_) return std::nullopt;
  const double since = to_seconds(device - *origin_);
  return device + offset_ + from_seconds(line_.offset + line_.slope * (since - line_.device));
}

}  // namespace vitreo
