// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/error_analysis.h"

#include "optics/numerics/preconditions.h"
#include "optics/rays/pupil.h"
#include "optics/system/first_order.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

/// Foci of one eye at equal steps of depth: d_o (from surface 2, negative) against d_ls. Empty when
/// one of them is missing.
/// A sweep with holes is no sweep: an eye that images only some depths would be compared over the
/// easy ones.
std::vector<OnAxisPoint> foci(const System& system, const AxialFocus& focus,
                              const AxisErrorOptions& options) {
  std::vector<OnAxisPoint> points;
  for (int i = 0; i < options.depths; ++i) {
    const double depth = options.depth_to * i / (options.depths - 1);
    const auto sensor = focus(system, depth);
    if (!sensor || !std::isfinite(*sensor)) return {};
    points.push_back({*sensor, depth - system.surfaces.front().thickness});
  }
  return points;
}

/// Largest |d_o by the law - d_o| over the points.
/// Nothing when one of the points falls on the law's pole, since a largest error over the rest
/// would look better than it is.
std::optional<double> worst_of(const OnAxisLaw& law, const std::vector<OnAxisPoint>& points) {
  double worst = 0;
  for (const OnAxisPoint& point : points) {
    const auto seen = law.object_from_sensor(point.sensor);
    if (!seen) return std::nullopt;
    worst = std::max(worst, std::abs(*seen - point.object));
  }
  return worst;
}

/// Thesis 4.3: calibrated on the retina with its depth known to retinal_depth_error, the first
/// point being the retina.
/// The worse of both signs of the retinal error. `points` were imaged by the true eye, `law`
/// belongs to the assumed one.
std::optional<double> worst_calibrated(const OnAxisLaw& law, const std::vector<OnAxisPoint>& points,
                                       const AxisErrorOptions& options) {
  double worst = 0;
  for (double sign : {1.0, -1.0}) {
    OnAxisPoint retina = points.front();
    retina.object += sign * options.retinal_depth_error;
    try {
      const auto error = worst_of(calibrate_biometric(law, retina, options.method).law, points);
      if (!error) return std::nullopt;
      worst = std::max(worst, *error);
    } catch (const std::invalid_argument&) {
      return std::nullopt;  // this eye's retina cannot be reached by the law
    }
  }
  return worst;
}

/// A perturbation that leaves the system unsound is an eye without an answer, not a mistake of the
/// caller.
std::optional<double> error_at(const Prescription& prescription, const Uncertainty& one,
                               double sigmas, const EyeError& error) {
  try {
    return error(perturbed(prescription, one, sigmas));
  } catch (const std::invalid_argument&) {
    return std::nullopt;
  }
}

/// Mean, rms, median, 95th percentile and maximum of the errors; all 0 when there is none.
/// `failed` is carried along, so that no statistic hides how many eyes it leaves out.
ErrorStatistics summary(std::vector<double> errors, int failed) {
  ErrorStatistics result;
  result.count = static_cast<int>(errors.size());
  result.failed = failed;
  if (errors.empty()) return result;
  std::sort(errors.begin(), errors.end());
  double squares = 0;
  for (double error : errors) {
    result.mean += error / result.count;
    squares += error * error / result.count;
  }
  // Quantiles by linear interpolation between order statistics.
  const auto at = [&](double share) {
    const double rank = share * (result.count - 1);
    const auto below = static_cast<std::size_t>(rank);
    const std::size_t above = std::min(below + 1, errors.size() - 1);
    return errors[below] + (rank - std::floor(rank)) * (errors[above] - errors[below]);
  };
  result.rms = std::sqrt(squares);
  result.median = at(0.5);
  result.percentile_95 = at(0.95);
  result.max = errors.back();
  return result;
}

/// An infinite or NaN error is no answer either: one of them would spoil every mean.
void add(const std::optional<double>& error, std::vector<double>& errors, int& failed) {
  if (error && std::isfinite(*error)) {
    errors.push_back(*error);
  } else {
    ++failed;
  }
}

}  // namespace

/// First order, (4.2) to (4.9): conic constants, aspheric terms and the stop's radius have no
/// influence.
AxialFocus paraxial_focus() {
  return [](const System& system, double depth) -> std::optional<double> {
    const auto image = axial_image(system, depth);
    return image ? std::optional(image->distance) : std::nullopt;
  };
}

/// Real rays: the sensor position of least rms spot radius, with the default bundle of 12 x 24
/// rays.
AxialFocus traced_focus() {
  return [](const System& system, double depth) -> std::optional<double> {
    const PupilTracer pupil(system, Pupil::of_stop(system));
    Spot spot;
    if (!pupil.trace({0, 0, depth}, disc_samples(), spot) || spot.rays() < 2) return std::nullopt;
    return spot.moments().best_focus();
  };
}

void AxisErrorOptions::check() const {
  detail::require_positive(depth_to, "depth_to");
  if (depths < 3 || depths > 10000)
    throw std::invalid_argument("depths: must lie within 3 and 10000");
  detail::require_not_negative(retinal_depth_error, "retinal_depth_error");
}

/// Thesis 4.2 on the axis: the true eye forms the images, the assumed eye's law takes them back.
/// The law is fitted once, to the assumed eye's own foci, as a laboratory would do with the eye it
/// believes in. The function returned holds copies of all it needs and may outlive the arguments.
EyeError axis_error(const Prescription& believed, const AxialFocus& focus,
                    const AxisErrorOptions& options) {
  options.check();
  const std::vector<OnAxisPoint> own = foci(believed.system, focus, options);
  if (own.empty())
    throw std::invalid_argument("believed: the eye has no images of all these depths");
  const OnAxisLaw law = fit_on_axis(on_axis_law(believed.system), own).law;
  return [law, focus, options](const Prescription& truth) -> std::optional<double> {
    const std::vector<OnAxisPoint> points = foci(truth.system, focus, options);
    if (points.empty()) return std::nullopt;
    return options.calibrated ? worst_calibrated(law, points, options) : worst_of(law, points);
  };
}

/// No answer at one end counts as worse than any error.
double Sensitivity::worst() const {
  if (!minus || !plus) return std::numeric_limits<double>::infinity();
  return std::max(*minus, *plus);
}

/// Thesis 4.2: each parameter perturbed by its uncertainty alone, in both senses.
/// Sorted by the worse sense; equal ones keep the order of the list, so that two runs print the
/// same table.
std::vector<Sensitivity> one_at_a_time(const Prescription& prescription,
                                       const std::vector<Uncertainty>& uncertainties,
                                       const EyeError& error) {
  std::vector<Sensitivity> list;
  for (const Uncertainty& one : uncertainties) {
    // an unknown name is a mistake, not an eye without an answer
    (void)parameter(prescription, one.parameter);
    list.push_back({one.parameter, error_at(prescription, one, -1, error),
                    error_at(prescription, one, 1, error)});
  }
  std::stable_sort(list.begin(), list.end(),
                   [](const auto& a, const auto& b) { return a.worst() > b.worst(); });
  return list;
}

/// Over eyes that were sampled beforehand: two methods can be compared on the very same eyes.
ErrorStatistics statistics(const std::vector<PerturbedEye>& eyes, const EyeError& error) {
  std::vector<double> errors;
  int failed = 0;
  for (const PerturbedEye& eye : eyes) add(error(eye.prescription), errors, failed);
  return summary(std::move(errors), failed);
}

/// Knowing one parameter exactly removes its share of the error's variance. The same sampled eyes
/// for all parameters, so that differences are not of sampling.
std::vector<MeasurementValue> variance_attribution(
    const Prescription& prescription, const std::vector<Uncertainty>& uncertainties,
    const std::function<EyeError(const Prescription&)>& make_error, int count,
    std::mt19937_64& random) {
  const std::vector<PerturbedEye> eyes = monte_carlo(prescription, uncertainties, count, random);
  // The reference: all parameters uncertain, none measured.
  const ErrorStatistics without = statistics(eyes, make_error(prescription));
  std::vector<MeasurementValue> list;
  for (const Uncertainty& one : uncertainties) {
    std::vector<double> errors;
    int failed = 0;
    for (const PerturbedEye& eye : eyes) {
      // The assumed eye has the true value of this one parameter and the prescription's values of
      // all others.
      const Override measured{one.parameter, parameter(eye.prescription, one.parameter)};
      try {
        add(make_error(with_parameters(prescription, {&measured, 1}))(eye.prescription), errors,
            failed);
      } catch (const std::invalid_argument&) {
        ++failed;  // what is then believed is no eye
      }
    }
    MeasurementValue value{one.parameter, summary(std::move(errors), failed), 0};
    if (without.rms > 0) value.reduction = 1 - value.known.rms / without.rms;
    list.push_back(value);
  }
  std::stable_sort(list.begin(), list.end(),
                   [](const auto& a, const auto& b) { return a.reduction > b.reduction; });
  return list;
}

}  // namespace vitreo::optics
