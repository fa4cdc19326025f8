// SPDX-License-Identifier: Apache-2.0
#include "control/loop_margins.h"

#include "control/preconditions.h"

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::control {
namespace {

// Gains searched, and the ladder's ratio.
constexpr double kHighestGain = 100;
constexpr double kLowestGain = 1e-2;
constexpr double kGainStep = 1.2;
constexpr double kRounding = 1e-9;  // s
// Dead times: delays beyond are not searched.
constexpr double kLongestSearched = 6;

/// Where the scalar state stands: what is true, what the observer holds, and the last commands.
struct Coordinate {
  double position = 0;
  double velocity = 0;  // behind the lag
  double estimate = 0;
  double disturbance = 0;
  double believed_velocity = 0;  // behind the lag, as the observer has it
  std::vector<double> commands;  // the newest first
};

struct Path {
  double moved = 0;
  double velocity = 0;  // behind the lag, at the end
};

/// The motion from `from` to `to` (s after the newest measurement) by the commands of `history`,
/// the newest of which was given at `given` and each one before it a period sooner; they act
/// `delay` later, through the lag, each until the next.
Path advance(const SampledLoop& loop, const std::vector<double>& history, double given,
             double delay, double velocity, double from, double to) {
  Path path{0, velocity};
  double now = from;
  const auto pass = [&](double command, double until) {
    const double span = until - now;
    if (!(span > 0)) return;
    const double decay = loop.command_lag > 0 ? std::exp(-span / loop.command_lag) : 0;
    path.moved += command * span + (path.velocity - command) * loop.command_lag * (1 - decay);
    path.velocity = command + (path.velocity - command) * decay;
    now = until;
  };
  for (std::size_t k = history.size(); k-- > 0;) {
    const double ends = k == 0 ? to : given - static_cast<double>(k - 1) * loop.period + delay;
    pass(history[k], std::clamp(ends, now, to));
  }
  return path;
}

/// From one measurement to the next: the command of the first, the motion, the second's update.
Coordinate next(const SampledLoop& loop, Coordinate x, double gain, double delay) {
  const double given = loop.latency;
  const double acts = loop.command_delay;
  // What is known when the command is given: the one before it is the newest.
  const Path ahead = advance(loop, x.commands, given - loop.period, acts, x.believed_velocity, 0,
                             given + loop.horizon);
  const double predicted = x.estimate + ahead.moved + (given + loop.horizon) * x.disturbance;
  x.commands.insert(x.commands.begin(), -loop.proportional * predicted - x.disturbance);
  const Path truth = advance(loop, x.commands, given, acts + delay, x.velocity, 0, loop.period);
  const Path model = advance(loop, x.commands, given, acts, x.believed_velocity, 0, loop.period);
  x.commands.pop_back();
  x.position += gain * truth.moved;
  x.velocity = truth.velocity;
  x.estimate += model.moved + loop.period * x.disturbance;
  x.believed_velocity = model.velocity;
  const double innovation = x.position - x.estimate;
  x.estimate += loop.position_gain * innovation;
  x.disturbance += loop.velocity_gain * innovation;
  return x;
}

Eigen::VectorXd packed(const Coordinate& x) {
  Eigen::VectorXd v(5 + static_cast<Eigen::Index>(x.commands.size()));
  v << x.position, x.velocity, x.estimate, x.disturbance, x.believed_velocity,
      Eigen::Map<const Eigen::VectorXd>(x.commands.data(),
                                        static_cast<Eigen::Index>(x.commands.size()));
  return v;
}

Coordinate unit(Eigen::Index k, std::size_t commands) {
  Coordinate x;
  x.commands.assign(commands, 0.0);
  double* const values[] = {&x.position, &x.velocity, &x.estimate, &x.disturbance,
                            &x.believed_velocity};
  if (k < 5)
    *values[k] = 1;
  else
    x.commands[static_cast<std::size_t>(k) - 5] = 1;
  return x;
}

/// The last value between `good` and `bad` for which the loop is stable, by bisection.
template <typename IsStable>
double edge(double good, double bad, const IsStable& is_stable) {
  while (std::abs(bad - good) > 1e-3 * std::abs(good + bad)) {
    const double middle = (good + bad) / 2;
    (is_stable(middle) ? good : bad) = middle;
  }
  return good;
}

/// The edge before the first value of the ladder for which the loop is not stable, since it may be
/// so again beyond; the last where it is stable for all. The first is stable.
template <typename IsStable>
double edge_on(const std::vector<double>& ladder, const IsStable& is_stable) {
  for (std::size_t k = 1; k < ladder.size(); ++k)
    if (!is_stable(ladder[k])) return edge(ladder[k - 1], ladder[k], is_stable);
  return ladder.back();
}

/// From `first` to `last` in equal steps of about `step`.
std::vector<double> steps(double first, double last, double step) {
  const int count = std::max(1, static_cast<int>(std::ceil(std::abs(last - first) / step)));
  std::vector<double> ladder;
  for (int k = 0; k <= count; ++k) ladder.push_back(first + (last - first) * k / count);
  return ladder;
}

}  // namespace

void SampledLoop::check() const {
  require(positive(period), "period: must be above 0 s");
  require(not_negative(latency), "latency: must be at least 0 s");
  require(not_negative(command_delay), "command_delay: must be at least 0 s");
  require(not_negative(command_lag), "command_lag: must be at least 0 s");
  require(not_negative(horizon), "horizon: must be at least 0 s");
  require(not_negative(proportional), "proportional: must be at least 0 1/s");
  require(std::isfinite(position_gain), "position_gain: not finite");
  require(std::isfinite(velocity_gain), "velocity_gain: not finite");
}

// The step is linear, so its matrix has the images of the unit vectors as columns.
double spectral_radius(const SampledLoop& loop, double gain, double delay) {
  loop.check();
  require(std::isfinite(gain), "gain: not finite");
  require(std::isfinite(delay) && delay >= -loop.command_delay - loop.latency - kRounding,
          "delay: less than none is left");
  const double longest = loop.latency + loop.command_delay + std::max(delay, 0.0);
  const auto commands = static_cast<std::size_t>(std::ceil(longest / loop.period)) + 2;
  const auto size = static_cast<Eigen::Index>(commands) + 5;
  Eigen::MatrixXd step(size, size);
  for (Eigen::Index k = 0; k < size; ++k)
    step.col(k) = packed(next(loop, unit(k, commands), gain, delay));
  return step.eigenvalues().cwiseAbs().maxCoeff();
}

LoopMargins loop_margins(const SampledLoop& loop) {
  LoopMargins margins;
  const auto with_gain = [&loop](double gain) { return spectral_radius(loop, gain, 0) < 1; };
  const auto with_delay = [&loop](double delay) { return spectral_radius(loop, 1, delay) < 1; };
  margins.longest_searched =
      kLongestSearched * (loop.latency + loop.command_delay + loop.command_lag + loop.period / 2);
  margins.stable = with_gain(1);
  if (!margins.stable) return margins;
  std::vector<double> up{1}, down{1};
  while (up.back() < kHighestGain) up.push_back(up.back() * kGainStep);
  while (down.back() > kLowestGain) down.push_back(down.back() / kGainStep);
  margins.gain_up = edge_on(up, with_gain);
  margins.gain_down = edge_on(down, with_gain);
  if (margins.gain_down <= kLowestGain) margins.gain_down = 0;
  const double step = loop.period / 4;
  margins.delay_more = edge_on(steps(0, margins.longest_searched, step), with_delay);
  const double whole = loop.command_delay + loop.latency;
  margins.delay_less = whole > 0 ? -edge_on(steps(0, -whole, step), with_delay) : 0;
  return margins;
}

}  // namespace vitreo::control
