// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose_solver.h"

#include "optics/numerics/linear.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>

#include <cmath>
#include <limits>

namespace vitreo::optics::detail {
namespace {

/// The order of FreeParameters: 0 to 2 position, 3 to 5 rotation, 6 the logarithm of the size.
constexpr int kFirstRotation = 3;
constexpr int kSize = 6;

/// Steps of central differences, in m, rad and 1: small enough that the projection is straight over
/// them, large enough that rounding (1e-11 px) does not show.
double difference_step(int parameter) { return parameter < kFirstRotation ? 1e-6 : 1e-4; }

/// Central differences: an error of second order in the step.
/// Nothing where one of the neighbors has no image, as at the rim of the projection.
std::optional<Eigen::MatrixXd> by_differences(const BodyResiduals& residuals,
                                              const FreeParameters& free, const BodyState& at,
                                              Eigen::Index rows) {
  const auto count = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd jacobian(rows, count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const double step = difference_step(free[static_cast<std::size_t>(i)]);
    const Eigen::VectorXd along = step * Eigen::VectorXd::Unit(count, i);
    const auto more = residuals(moved(at, free, along), nullptr);
    const auto less = residuals(moved(at, free, -along), nullptr);
    if (!more || !less) return std::nullopt;
    jacobian.col(i) = (*more - *less) / (2 * step);
  }
  return jacobian;
}

/// The columns of the free parameters: the residuals' own, else by differences.
std::optional<Eigen::MatrixXd> differentiate(const BodyResiduals& residuals,
                                             const FreeParameters& free, const BodyState& at,
                                             Eigen::Index rows) {
  Eigen::MatrixXd per_state;
  if (!residuals(at, &per_state)) return std::nullopt;
  if (per_state.rows() != rows) return by_differences(residuals, free, at, rows);
  return Eigen::MatrixXd(per_state(Eigen::all, free));
}

}  // namespace

/// Retraction: position and logarithm of the size are added to, the orientation is multiplied by
/// the exponential of a rotation vector (Rodrigues), so no parametrization has a singular attitude.
BodyState moved(const BodyState& state, const FreeParameters& free, const Eigen::VectorXd& step) {
  BodyState there = state;
  Eigen::Vector3d turn(0, 0, 0);
  for (std::size_t i = 0; i < free.size(); ++i) {
    const double by = step[static_cast<Eigen::Index>(i)];
    if (free[i] < kFirstRotation) {
      there.position[free[i]] += by;
    } else if (free[i] < kSize) {
      turn[free[i] - kFirstRotation] = by;
    } else {
      there.scale *= std::exp(by);
    }
  }
  const double angle = turn.norm();
  if (angle > 0)
    there.orientation =
        state.orientation * Eigen::AngleAxisd(angle, turn / angle).toRotationMatrix();
  return there;
}

/// 3 mm, 0.4 rad and 20 %: what counts as far in an eye. In these units one damping and one
/// threshold serve all parameters.
Eigen::VectorXd parameter_units(const FreeParameters& free) {
  Eigen::VectorXd units(static_cast<Eigen::Index>(free.size()));
  for (std::size_t i = 0; i < free.size(); ++i) {
    units[static_cast<Eigen::Index>(i)] = free[i] < kFirstRotation ? 3e-3
                                          : free[i] < kSize        ? 0.4
                                                                   : 0.2;
  }
  return units;
}

namespace {

constexpr double kSlight = 1e-9;  // damping
constexpr int kDoublings = 12;

/// Levenberg-Marquardt steps from one state, in the parameters' natural units:
/// (J^T J + lambda D) x = -J^T r with Marquardt's scaling D = diag(J^T J) and a floor.
/// The decomposition is repeated for each damping tried; J^T J is at most 7 x 7, and an evaluation
/// of the residuals costs far more.
class DampedSteps {
 public:
  DampedSteps(const Eigen::MatrixXd& scaled, const Eigen::VectorXd& residuals)
      : information_(scaled.transpose() * scaled), gradient_(scaled.transpose() * residuals) {}

  Eigen::VectorXd damped(double damping) const {
    Eigen::MatrixXd matrix = information_;
    // A floor for directions without information, which scaling by the diagonal alone would leave
    // undamped.
    matrix.diagonal() +=
        damping * (information_.diagonal().array() + 1e-3 + 1e-9 * information_.trace()).matrix();
    return -matrix.ldlt().solve(gradient_);
  }
  /// About twice the decrease of the cost that a step predicts.
  double gain(const Eigen::VectorXd& step) const { return -gradient_.dot(step); }

 private:
  Eigen::MatrixXd information_;
  Eigen::VectorXd gradient_;
};

/// Takes a step if it lowers the cost. Gauss-Newton has the residuals' slopes and not their
/// curvature: where a residual that stays is large against the noise and curved, as a body's length
/// is in its tilt seen from straight above, its steps are too short by a factor that stays, and a
/// hundred are not enough. So a step is doubled for as long as that lowers the cost again.
/// False when not even the step itself lowers the cost. `best` follows each doubling that does.
bool line_search(const BodyResiduals& residuals, const FreeParameters& free,
                 const Eigen::VectorXd& step, int doublings, Minimum& best) {
  const BodyState from = best.state;
  double factor = 1;
  for (int i = 0; i <= doublings; ++i, factor *= 2) {
    const BodyState there = moved(from, free, factor * step);
    const auto found = residuals(there, nullptr);
    if (!found || !(found->squaredNorm() < best.cost)) return i > 0;
    best.state = there;
    best.residuals = *found;
    best.cost = found->squaredNorm();
  }
  return true;
}

}  // namespace

namespace {

/// Levenberg-Marquardt from one start.
class Descent {
 public:
  Descent(const BodyResiduals& residuals, const FreeParameters& free)
      : residuals_(residuals), free_(free), units_(parameter_units(free)) {}

  std::optional<Minimum> from(const BodyState& start, bool roughly);

 private:
  enum class Step { better, converged, stuck, outside };
  Step step(Minimum& best);
  bool shortened(const DampedSteps& steps, Minimum& best);

  const BodyResiduals& residuals_;
  const FreeParameters& free_;
  Eigen::VectorXd units_;
  /// Of chi^2, a seventh of a sigma: an outline of many corners is no smoother.
  static constexpr double kRough = 0.02;
  double damping_ = 1e-3;
  double promised_ = 0;  // of chi^2, by the last step that was asked for
  bool across_ = false;  // derivatives by differences, which take the mean of both sides of a kink
};

/// Damps until a step lowers the cost; false where none does.
bool Descent::shortened(const DampedSteps& steps, Minimum& best) {
  constexpr int kSlow = 6;  // iterations after which Gauss-Newton should have converged
  constexpr double kHopeless = 1e12;
  bool better = false;
  for (; damping_ < kHopeless && !better; damping_ *= 8) {
    const Eigen::VectorXd step = steps.damped(damping_);
    // units
    constexpr double kLongest = 1.2;
    constexpr double kNone = 1e-12;
    const double length = step.cwiseAbs().maxCoeff();
    if (length < kNone) break;
    const Eigen::VectorXd by = std::fmin(1, kLongest / length) * units_.cwiseProduct(step);
    better = line_search(residuals_, free_, by, best.iterations >= kSlow ? kDoublings : 0, best);
  }
  return better;
}

/// Convergence by the predicted decrease of a step that is hardly damped: a step that is short
/// because of its damping is no sign of a minimum.
Descent::Step Descent::step(Minimum& best) {
  const auto rows = best.residuals.size();
  const auto jacobian = across_ ? by_differences(residuals_, free_, best.state, rows)
                                : differentiate(residuals_, free_, best.state, rows);
  if (!jacobian) return Step::outside;  // at the edge of what can be seen
  if (!across_) best.jacobian = *jacobian;
  const DampedSteps steps(*jacobian * units_.asDiagonal(), best.residuals);
  promised_ = steps.gain(steps.damped(kSlight));
  if (!(promised_ > 1e-10 * (1e-2 + best.cost))) return Step::converged;
  if (shortened(steps, best)) {
    // The loop has raised it once more by 8, so this is a division by 8.
    damping_ = std::fmax(damping_ / 64, 1e-9);
    return Step::better;
  }
  return promised_ < kRough ? Step::converged : Step::stuck;
}

/// Where no step along derivatives that hold is a gain, the cost has a kink: a cylinder across the
/// line of sight is the shortest there, whichever end comes forward, and plates are the narrowest
/// at 45 degrees. The state lies in the kink, but perhaps not at the lowest place along it; from
/// there derivatives by differences, which see both sides, lead on. The Jacobian that is left is
/// that of one side: what a turn out of the kink changes, not zero.
std::optional<Minimum> Descent::from(const BodyState& start, bool roughly) {
  constexpr int kIterations = 100;
  constexpr int kAlongKink = 6;
  const auto first = residuals_(start, nullptr);
  if (!first) return std::nullopt;
  Minimum best{start, *first, {}, first->squaredNorm()};
  int last = kIterations;
  for (; best.iterations < last; ++best.iterations) {
    const Step taken = step(best);
    if (taken == Step::outside) return best;
    if (taken == Step::better) continue;
    best.converged = taken == Step::converged || across_;
    if (best.converged || roughly) break;
    across_ = true;
    damping_ = 1e-3;
    last = best.iterations + kAlongKink;
  }
  // Steps that are too short by a factor that stays go on for ever, and promise less and less: seen
  // from straight above a level body's pitch is such a valley.
  const bool crept = best.iterations == kIterations && promised_ < kRough;
  best.converged = best.converged || across_ || crept;
  if (across_) {
    if (const auto one_side = differentiate(residuals_, free_, best.state, best.residuals.size()))
      best.jacobian = *one_side;
  }
  return best;
}

}  // namespace

/// `converged` is false both at the limit of iterations and at the edge of what can be projected;
/// the state is then the best one seen.
std::optional<Minimum> minimize(const BodyResiduals& residuals, const FreeParameters& free,
                                const BodyState& start, bool roughly) {
  return Descent(residuals, free).from(start, roughly);
}

/// By the eigenvectors of the information J^T J in natural units: sigma along each is 1 /
/// sqrt(eigenvalue). Directions with a sigma above one unit are not observed.
/// A lost direction must not leave finite numbers behind: what it moves gets an infinite variance
/// and no covariances.
Observed observed_from(const Eigen::MatrixXd& jacobian, const FreeParameters& free,
                       const Widen& widen) {
  constexpr double kShare = 0.02;
  constexpr double kWeak = 0.1;
  constexpr double kWholeTurn = 15.7;  // units of 0.4 rad
  const Eigen::VectorXd units = parameter_units(free);
  const auto count = static_cast<Eigen::Index>(free.size());
  const Eigen::MatrixXd scaled = jacobian * units.asDiagonal();
  const Spectrum spectrum = spectrum_of(scaled.transpose() * scaled);
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(count, count);
  Eigen::MatrixXd unobservable(count, 0);
  Eigen::Array<bool, Eigen::Dynamic, 1> lost =
      Eigen::Array<bool, Eigen::Dynamic, 1>::Constant(count, false);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::VectorXd direction = spectrum.vectors.col(i);
    double sigma = 1 / std::sqrt(std::fmax(spectrum.values[i], 1e-300));
    if (sigma > kWeak && sigma < 1) sigma = widen(direction, sigma);
    const bool seen = sigma < 1;
    if (!seen) sigma = kWholeTurn;
    covariance += sigma * sigma * direction * direction.transpose();
    if (seen) continue;
    unobservable.conservativeResize(Eigen::NoChange, unobservable.cols() + 1);
    unobservable.rightCols<1>() = direction;
    lost = lost || direction.array().abs() > kShare;
  }
  covariance = (units.asDiagonal() * covariance * units.asDiagonal()).eval();
  for (Eigen::Index i = 0; i < count; ++i) {
    if (!lost[i]) continue;
    covariance.row(i).setZero();
    covariance.col(i).setZero();
    covariance(i, i) = std::numeric_limits<double>::infinity();
  }
  return {covariance, unobservable};
}

}  // namespace vitreo::optics::detail
