// SPDX-License-Identifier: Apache-2.0
#include "control/motion_watch.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>
#include <vector>

namespace vitreo::control {
namespace {

constexpr double kMemory = 10;         // s
constexpr double kEvery = 0.5;         // s
constexpr double kLeastWindow = 3;     // s: one that cycles fast is named by these
constexpr double kStandingWindow = 2;  // s
constexpr double kAwayFor = 3;         // s
// m: a PD follows a target of 2 mm/s 1.3 mm behind it.
constexpr double kAway = 2e-3;
constexpr double kNearer = 0.3e-3;  // m, by which one on its way comes nearer meanwhile
constexpr double kOff = 0.2e-3;     // m, from a target that rests, and by which part nearer
constexpr double kOffNearer = 0.2;
// Of the measurement's standard deviation: an oscillation below it is no harm, and a square's
// corners are below it too.
constexpr double kAboveNoise = 3;
// What a sound loop is off by when the target's velocity changes, m per m/s: a response that is not
// found out yet, off by a quarter, over a gain of 2.5 /s. And when the axis turns, m per rad/s: the
// field's error changes with it, some tens of micrometers at 0.3 rad/s, and the filter takes
// kAfterTurn s to find the last of it. The fastest turn of the window counts whole: two short ones
// stir a loop as much as a long one. docs/control_margins.md.
constexpr double kPerVelocity = 0.1;
constexpr double kPerTurning = 0.2e-3;
constexpr double kAfterTurn = 5;  // s
// m/rad: what a turn may ask of a sound loop without moving it, as the field's error turns too.
constexpr double kToldPerTurn = 0.3e-3;
constexpr double kTurnSpan = 1;  // s: over which a turn's rate is the mean, so that a leap is one

/// Least squares: without mean and trend.
void detrend(std::vector<double>& values) {
  const double n = static_cast<double>(values.size());
  const double middle = (n - 1) / 2;
  const double mean = std::accumulate(values.begin(), values.end(), 0.0) / n;
  double slope = 0;
  for (std::size_t i = 0; i < values.size(); ++i)
    slope += (static_cast<double>(i) - middle) * values[i];
  // The sum of squares of n evenly spaced places about their middle is n (n^2 - 1) / 12.
  slope *= 12 / (n * (n * n - 1));
  for (std::size_t i = 0; i < values.size(); ++i)
    values[i] -= mean + slope * (static_cast<double>(i) - middle);
}

/// Unbiased: of the pairs that there are, by the power of both their parts.
double correlation(const std::vector<double>& values, std::size_t lag) {
  double product = 0, before = 0, after = 0;
  for (std::size_t i = lag; i < values.size(); ++i) {
    product += values[i] * values[i - lag];
    before += values[i - lag] * values[i - lag];
    after += values[i] * values[i];
  }
  const double power = std::sqrt(before * after);
  return power > 0 ? product / power : 0;
}

/// Where the correlation is largest, one turn about `lag` and at most at `most`: half of an odd
/// period is no whole number of turns.
std::size_t period_near(const std::vector<double>& values, std::size_t lag, std::size_t most) {
  std::size_t best = lag;
  for (const std::size_t other : {lag - 1, std::min(lag + 1, most)})
    if (correlation(values, other) > correlation(values, best)) best = other;
  return best;
}

/// Whether each of the newest three periods has its part of the oscillation. A swing at a goal's
/// begin, or what rings out after it, is in one of them; seen over the whole window it has the
/// autocorrelation of a cycle all the same.
bool lasts(const std::vector<double>& values, std::size_t period, double power) {
  constexpr double kPart = 0.25;  // of the mean power: half the amplitude
  constexpr std::size_t kPeriods = 3;
  for (std::size_t k = 0; k < kPeriods; ++k) {
    const auto end = values.end() - static_cast<std::ptrdiff_t>(k * period);
    const double own = std::inner_product(end - static_cast<std::ptrdiff_t>(period), end,
                                          end - static_cast<std::ptrdiff_t>(period), 0.0) /
                       static_cast<double>(period);
    if (own < kPart * power) return false;
  }
  return true;
}

/// rad/s: of the axis, the largest mean over kTurnSpan that ends within them, and the interval in
/// which the span begins: as kPerTurning was measured.
template <class Iterator>
double fastest_turn(Iterator begin, Iterator end) {
  double most = 0;
  double turned = 0;  // rad, over the span that ends with `newest`
  auto oldest = begin;
  const auto angle = [begin](Iterator one) {
    return one == begin ? 0.0 : one->turning * (one->time - std::prev(one)->time);
  };
  for (auto newest = begin; newest != end; ++newest) {
    turned += angle(newest);
    while (oldest->time < newest->time - kTurnSpan) turned -= angle(oldest++);
    most = std::max(most, turned / kTurnSpan);
  }
  return most;
}

/// m, rms: the largest error that says nothing of the loop. A target at constant velocity stirs
/// nothing, so that its changes count: the velocity about its mean, in 3-D. `turning`: rad/s.
template <class Iterator>
double sound_error(Iterator begin, Iterator end, double turning) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double sigma = 0, squares = 0;
  const auto count = static_cast<double>(end - begin);
  for (auto one = begin; one != end; ++one) {
    mean += one->reference / count;
    sigma = std::max(sigma, one->sigma);
  }
  for (auto one = begin; one != end; ++one)
    squares += (one->reference - mean).squaredNorm() / count;
  return std::hypot(kAboveNoise * sigma, kPerVelocity * std::sqrt(squares), kPerTurning * turning);
}

}  // namespace

void MotionWatch::add(const WatchedMotion& now) {
  if (!lately_.empty() && now.time == lately_.back().time) return;
  if (!lately_.empty() && now.time < lately_.back().time) reset();
  lately_.push_back(now);
  while (lately_.front().time < now.time - kMemory - kAfterTurn) lately_.pop_front();
  if (now.time < looked_ + kEvery) return;
  looked_ = now.time;
  look();
}

void MotionWatch::look() {
  oscillating_ = false;
  const double end = lately_.back().time;
  // Several lengths: three periods of a fast cycle are lost in a long window in which it begins,
  // and a slow one does not show in a short one.
  for (double window = kLeastWindow; window <= kMemory && !oscillating_; window *= 1.8) {
    if (end - lately_.front().time < window) break;
    const auto begin = std::find_if(lately_.begin(), lately_.end(),
                                    [&](const auto& one) { return one.time >= end - window; });
    const auto count = static_cast<std::size_t>(lately_.end() - begin);
    const auto stirred = std::find_if(lately_.begin(), begin, [&](const auto& one) {
      return one.time >= end - window - kAfterTurn;
    });
    const double sound = sound_error(begin, lately_.end(), fastest_turn(stirred, lately_.end()));
    for (int axis = 0; axis < 3 && !oscillating_; ++axis)
      oscillating_ = oscillates(axis, count, sound);
  }
  standing_ = stands();
  off_target_ = stays_away(kAway, kNearer);
  rests_off_ = stays_off_rest();
}

// Under a command.
bool MotionWatch::stands() const {
  const double end = lately_.back().time;
  if (end - lately_.front().time < kStandingWindow + kCaught) return false;
  Eigen::Vector3d told = Eigen::Vector3d::Zero();
  double turned = 0;  // rad
  const WatchedMotion* before = nullptr;
  const WatchedMotion* first = nullptr;
  for (const WatchedMotion& one : lately_) {
    if (one.time < end - kStandingWindow) continue;
    if (first == nullptr) first = &one;
    if (before != nullptr) {
      told += (one.time - before->time) * before->wanted;
      turned += (one.time - before->time) * one.turning;
    }
    before = &one;
  }
  const double length = told.norm();
  // Way and command are compared along the command: what goes aside, a flow, is no answer to it.
  if (length < kTold + kToldPerTurn * turned) return false;
  return told.dot(lately_.back().position - first->position) / length < length / 5;
}

bool MotionWatch::stays_away(double away, double nearer) const {
  const double end = lately_.back().time;
  if (end - lately_.front().time < kAwayFor) return false;
  const auto first = std::find_if(lately_.begin(), lately_.end(),
                                  [end](const auto& one) { return one.time >= end - kAwayFor; });
  return std::all_of(first, lately_.end(),
                     [away](const auto& one) { return one.free && one.error.norm() > away; }) &&
         first->error.norm() - lately_.back().error.norm() < nearer;
}

double MotionWatch::stays_off_rest() const {
  const double end = lately_.back().time;
  if (!stays_away(kOff, kOffNearer * lately_.back().error.norm())) return 0;
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  double count = 0;
  for (const WatchedMotion& one : lately_) {
    if (one.time < end - kAwayFor) continue;
    if (!one.reference.isZero(0)) return 0;
    sum += one.error;
    count += 1;
  }
  return (sum / count).norm();
}

// The newest `count` errors of one coordinate, taken as evenly spaced, which frames are.
bool MotionWatch::oscillates(int axis, std::size_t count, double sound) {
  constexpr double kHalf = -0.5, kWhole = 0.4;
  constexpr std::size_t kPeriods = 3;
  std::vector<double> values;
  for (auto one = lately_.end() - static_cast<std::ptrdiff_t>(count); one != lately_.end(); ++one)
    values.push_back(one->error[axis]);
  if (values.size() < 12) return false;
  detrend(values);
  const double power = std::inner_product(values.begin(), values.end(), values.begin(), 0.0) /
                       static_cast<double>(values.size());
  // Noise has a trough now and then by chance; below the noise no cycle matters anyway.
  if (!(std::sqrt(power) > sound)) return false;
  const double span =
      (lately_.back().time - (lately_.end() - static_cast<std::ptrdiff_t>(count))->time) /
      static_cast<double>(count - 1);
  // The first trough of the autocorrelation is half a period away. What returns at the whole period
  // is a cycle; a single swing or a drift that turned round has the trough alone.
  for (std::size_t half = 1; 2 * half * kPeriods <= values.size(); ++half) {
    const double here = correlation(values, half);
    if (here > kHalf || here > correlation(values, half + 1)) continue;  // not yet the trough
    const std::size_t whole = period_near(values, 2 * half, values.size() / kPeriods);
    if (correlation(values, whole) < kWhole || !lasts(values, whole, power)) return false;
    period_ = static_cast<double>(whole) * span;
    amplitude_ = std::sqrt(2 * power);
    return true;
  }
  return false;
}

}  // namespace vitreo::control
