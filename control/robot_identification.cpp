// SPDX-License-Identifier: Apache-2.0
#include "control/robot_identification.h"

#include "control/command_history.h"
#include "control/preconditions.h"

#include <Eigen/QR>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>

namespace vitreo::control {
namespace {

constexpr std::size_t kLeastSamples = 12;

/// Linear least squares at one value of the delay.
struct LinearFit {
  Eigen::VectorXd parameters;
  Eigen::MatrixXd covariance;  // for residuals of unit variance
  Eigen::VectorXd residuals;
  double squares = std::numeric_limits<double>::infinity();
};

// Columns are scaled to unit length before the factorization: they are in m, s and m s.
LinearFit solve(const Eigen::MatrixXd& regressors, const Eigen::VectorXd& observed) {
  LinearFit fit;
  const Eigen::VectorXd scale =
      regressors.colwise().norm().transpose().cwiseMax(1e-300).cwiseInverse();
  const Eigen::MatrixXd scaled = regressors * scale.asDiagonal();
  const Eigen::ColPivHouseholderQR<Eigen::MatrixXd> factored(scaled);
  fit.parameters = scale.asDiagonal() * factored.solve(observed);
  fit.residuals = observed - regressors * fit.parameters;
  fit.squares = fit.residuals.squaredNorm();
  // Covariance of least squares, sigma^2 (A' A)^-1, by the scaled columns S: D (S' S)^-1 D with the
  // scales in D; squaring the unscaled columns would lose what their units differ by.
  const Eigen::MatrixXd information = scaled.transpose() * scaled;
  fit.covariance = scale.asDiagonal() *
                   information.ldlt().solve(Eigen::MatrixXd::Identity(scale.size(), scale.size())) *
                   scale.asDiagonal();
  return fit;
}

using FitAt = std::function<LinearFit(double delay)>;

// A coarse grid, then golden sections about its best: the sum of squares has one minimum within a
// grid's step, as the commands are band-limited by the lag and the frames.
double best_delay(const FitAt& fit, double longest) {
  constexpr double kGrid = 10e-3;   // s
  constexpr double kFine = 0.1e-3;  // s
  const double golden = (std::sqrt(5.0) - 1) / 2;
  double best = 0;
  double least = std::numeric_limits<double>::infinity();
  for (double delay = 0; delay <= longest + kGrid / 2; delay += kGrid)
    if (const double squares = fit(delay).squares; squares < least) {
      least = squares;
      best = delay;
    }
  double low = std::max(0.0, best - kGrid);
  double high = std::min(longest, best + kGrid);
  // Golden section search (Kiefer 1953): the bracket shrinks by 0.618 a pass.
  while (high - low > kFine) {
    const double a = high - golden * (high - low);
    const double b = low + golden * (high - low);
    const bool lower = fit(a).squares < fit(b).squares;
    (lower ? high : low) = lower ? b : a;
  }
  return (low + high) / 2;
}

// Residuals that hang together say less than as many that do not: the variance of a mean of a
// first-order process with correlation c is (1 + c) / (1 - c) times that of white noise.
double inflation(const Eigen::VectorXd& residuals) {
  const Eigen::Index n = residuals.size();
  const double power = residuals.squaredNorm();
  if (!(power > 0)) return 1;
  const double correlation =
      std::clamp(residuals.head(n - 1).dot(residuals.tail(n - 1)) / power, 0.0, 0.95);
  return (1 + correlation) / (1 - correlation);
}

/// The variance of one sample, with what hangs together counted once.
double variance_of(const LinearFit& fit) {
  // One degree of freedom more than the linear parameters: the delay was fitted too.
  const auto freedom = static_cast<double>(
      std::max<Eigen::Index>(1, fit.residuals.size() - fit.parameters.size() - 1));
  return fit.squares / freedom * inflation(fit.residuals);
}

// By the curvature of the sum of squares: sigma^2 = 2 s^2 / (d^2 S / d delay^2).
double delay_sigma(const FitAt& fit, double delay, double variance) {
  constexpr double kStep = 5e-3;  // s
  // A delay below 0 is no command's: near 0 the central difference is taken at one step instead.
  const double middle = std::max(delay, kStep);
  const double curvature =
      (fit(middle + kStep).squares - 2 * fit(middle).squares + fit(middle - kStep).squares) /
      (kStep * kStep);
  return curvature > 0 ? std::sqrt(2 * variance / curvature)
                       : std::numeric_limits<double>::infinity();
}

/// The standard deviation of a linear parameter: at the delay found, and by the delay's own.
double parameter_sigma(const FitAt& fit, const LinearFit& best, Eigen::Index which, double delay,
                       double sigma, double variance) {
  constexpr double kStep = 2e-3;  // s
  const double low = std::max(0.0, delay - kStep);
  // The delay was found by its own search, so that the linear covariance does not hold its doubt:
  // it comes in by d(parameter) / d(delay), to first order.
  const double slope =
      (fit(delay + kStep).parameters[which] - fit(low).parameters[which]) / (delay + kStep - low);
  const double by_delay = std::isfinite(sigma) ? slope * sigma : 0;
  return std::sqrt(variance * best.covariance(which, which) + by_delay * by_delay);
}

void check_direction(const Eigen::Vector3d& direction) {
  require(direction.allFinite() && std::abs(direction.norm() - 1) < 1e-6,
          "direction: a unit vector is wanted");
}

void check_rows(const std::vector<TimedVector>& rows, const char* what) {
  for (std::size_t i = 0; i < rows.size(); ++i) {
    if (!std::isfinite(rows[i].time) || !rows[i].value.allFinite())
      throw std::invalid_argument(std::string(what) + ": one of them is not finite");
    if (i > 0 && rows[i].time < rows[i - 1].time)
      throw std::invalid_argument(std::string(what) + ": their times run backwards");
  }
}

/// m: what the commands moved the robot until each measurement, as believed, behind `delay`.
Eigen::VectorXd commanded_motion(const DrivenMotion& motion, const Eigen::Vector3d& direction,
                                 double delay) {
  CommandHistory history(delay, motion.lag);
  const auto& measured = motion.measured;
  Eigen::VectorXd moved(static_cast<Eigen::Index>(measured.size()));
  std::size_t next = 0;
  const auto give = [&](double until) {
    for (; next < motion.commanded.size() && motion.commanded[next].time <= until; ++next)
      history.add(motion.commanded[next].time, motion.commanded[next].value);
  };
  // Before the first command the same: the stretch begins in the middle of a run.
  history.set_before(motion.commanded.front().value);
  Eigen::Vector3d velocity = motion.commanded.front().value;
  double along = 0;
  for (std::size_t i = 0; i < measured.size(); ++i) {
    // Only what was commanded by then: a command that holds until the next one acts delay s later.
    give(measured[i].time);
    if (i > 0) {
      const auto step = history.advance(velocity, measured[i - 1].time, measured[i].time);
      velocity = step.velocity;
      along += direction.dot(step.moved);
      history.forget_before(measured[i].time);
    }
    moved[static_cast<Eigen::Index>(i)] = along;
  }
  return moved;
}

// Ramp behind a first-order lag: the way of what begins to move with speed 1 at time 0.
double lagged_ramp(double time, double lag) {
  if (!(time > 0)) return 0;
  return lag > 0 ? time - lag * (1 - std::exp(-time / lag)) : time;
}

struct FallRow {
  Eigen::Index fall;
  double time;   // s, since off
  double along;  // m
};

/// Nothing can act on the robot again before `on`.
std::vector<FallRow> rows_of(const std::vector<Fall>& falls, const Eigen::Vector3d& direction) {
  std::vector<FallRow> rows;
  for (std::size_t j = 0; j < falls.size(); ++j) {
    check_rows(falls[j].measured, "measured");
    for (const TimedVector& one : falls[j].measured)
      if (one.time <= falls[j].on)
        rows.push_back(
            {static_cast<Eigen::Index>(j), one.time - falls[j].off, direction.dot(one.value)});
  }
  return rows;
}

/// m, rms: of the commanded motion what is no start, drift or slope; the rest tells the gain.
/// Commands that look like a drift tell nothing of it, however large they are: what the other
/// columns cannot make is what the fit has to see against its residuals (Frisch, Waugh, Lovell).
double excitation(const Eigen::VectorXd& times, const Eigen::VectorXd& away,
                  const Eigen::VectorXd& commanded) {
  Eigen::MatrixXd others(times.size(), 3);
  others << Eigen::VectorXd::Ones(times.size()), (times.array() - times.mean()).matrix(), away;
  return std::sqrt(solve(others, commanded).squares / static_cast<double>(times.size()));
}

}  // namespace

void DrivenMotion::check() const {
  require(measured.size() >= kLeastSamples, "measured: a dozen positions are wanted, and more");
  require(commanded.size() >= 2, "commanded: two and more are wanted");
  require(not_negative(lag), "lag: must be at least 0 s");
  check_rows(measured, "measured");
  check_rows(commanded, "commanded");
}

// Linear in start, drift, slope and gain: y = y0 + drift t + slope integral(y - mean y) + gain
// moved. The integral is of what was measured, by trapezoids: the noise in it is averaged over the
// stretch. The slope is what a field model with wrong gradients does: another drift at another
// place.
IdentifiedResponse identify_response(const DrivenMotion& motion, const Eigen::Vector3d& direction,
                                     double longest_delay) {
  motion.check();
  check_direction(direction);
  require(positive(longest_delay), "longest_delay: must be above 0 s");
  const auto count = static_cast<Eigen::Index>(motion.measured.size());
  Eigen::VectorXd along(count), times(count), away = Eigen::VectorXd::Zero(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    along[i] = direction.dot(motion.measured[static_cast<std::size_t>(i)].value);
    times[i] = motion.measured[static_cast<std::size_t>(i)].time;
  }
  // The deviation from the mean place and not the place itself: the slope's regressor is then far
  // from the drift's, which is that at the mean place.
  const double mean = along.mean();
  for (Eigen::Index i = 1; i < count; ++i)
    away[i] = away[i - 1] + (times[i] - times[i - 1]) * ((along[i] + along[i - 1]) / 2 - mean);
  enum : Eigen::Index { kStart, kDrift, kSlope, kGain, kColumns };
  const FitAt fit = [&](double delay) {
    Eigen::MatrixXd regressors(count, kColumns);
    regressors.col(kStart).setOnes();
    regressors.col(kDrift) = (times.array() - times.mean()).matrix();
    regressors.col(kSlope) = away;
    regressors.col(kGain) = commanded_motion(motion, direction, delay);
    return solve(regressors, along);
  };
  IdentifiedResponse found;
  found.delay.value = best_delay(fit, longest_delay);
  const LinearFit best = fit(found.delay.value);
  const double variance = variance_of(best);
  found.delay.sigma = delay_sigma(fit, found.delay.value, variance);
  const auto parameter = [&](Eigen::Index which) {
    return Identified{best.parameters[which], parameter_sigma(fit, best, which, found.delay.value,
                                                              found.delay.sigma, variance)};
  };
  found.gain = parameter(kGain);
  found.drift = parameter(kDrift);
  found.residual = std::sqrt(best.squares / static_cast<double>(count));
  found.excitation =
      excitation(times, away, commanded_motion(motion, direction, found.delay.value));
  if (!(found.excitation > 3 * found.residual))
    throw std::domain_error("the commands moved the robot too little to tell its response");
  return found;
}

// Of fall j, y = a_j + b_j (t - off) until it falls, then with speed v: linear in a_j, b_j and v,
// with one delay for all. b_j is how the robot drifted while it was still held.
IdentifiedFall identify_fall(const std::vector<Fall>& falls, const Eigen::Vector3d& direction,
                             double lag, double longest_delay) {
  check_direction(direction);
  require(not_negative(lag), "lag: must be at least 0 s");
  require(std::isfinite(longest_delay) && longest_delay > 0, "longest_delay: must be above 0 s");
  require(!falls.empty(), "falls: one and more are wanted");
  for (const Fall& fall : falls)
    require(std::isfinite(fall.off) && std::isfinite(fall.on) && fall.off < fall.on,
            "falls: off and on must be numbers, off the earlier one");
  const std::vector<FallRow> rows = rows_of(falls, direction);
  const auto count = static_cast<Eigen::Index>(rows.size());
  const auto columns = static_cast<Eigen::Index>(2 * falls.size() + 1);
  if (count < columns + 4)
    throw std::domain_error("too few positions were seen while the robot fell");
  Eigen::VectorXd observed(count);
  for (Eigen::Index i = 0; i < count; ++i) observed[i] = rows[static_cast<std::size_t>(i)].along;
  const FitAt fit = [&](double delay) {
    Eigen::MatrixXd regressors = Eigen::MatrixXd::Zero(count, columns);
    for (Eigen::Index i = 0; i < count; ++i) {
      const FallRow& row = rows[static_cast<std::size_t>(i)];
      const double fallen = lagged_ramp(row.time - delay, lag);
      // Three columns share a row: a_j, b_j of its own fall, and the speed that all falls have.
      // Held and fallen time add up to the time, the change from one to the other is as slow as the
      // lag.
      regressors(i, 2 * row.fall) = 1;
      regressors(i, 2 * row.fall + 1) = row.time - fallen;
      regressors(i, columns - 1) = fallen;
    }
    return solve(regressors, observed);
  };
  IdentifiedFall found;
  found.delay.value = best_delay(fit, longest_delay);
  const LinearFit best = fit(found.delay.value);
  for (const FallRow& row : rows) found.samples += row.time > found.delay.value ? 1 : 0;
  if (found.samples < static_cast<int>(2 * falls.size()))
    throw std::domain_error("too few positions were seen while the robot fell");
  const double variance = variance_of(best);
  found.delay.sigma = delay_sigma(fit, found.delay.value, variance);
  found.speed = {
      best.parameters[columns - 1],
      parameter_sigma(fit, best, columns - 1, found.delay.value, found.delay.sigma, variance)};
  found.residual = std::sqrt(best.squares / static_cast<double>(count));
  return found;
}

}  // namespace vitreo::control
