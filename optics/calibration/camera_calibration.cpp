// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/camera_calibration.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <complex>
#include <stdexcept>
#include <utility>

namespace vitreo::optics {
namespace {

using Complex = std::complex<double>;

/// The plane as ImageScale turns it: +x to +u, and y up to v down, of an inverted image.
Complex upright(const Eigen::Vector2d& m) { return {-m.x(), m.y()}; }
Complex pixel(const Eigen::Vector2d& p) { return {p.x(), p.y()}; }

struct Similarity {
  // px per m, turned by the rotation, and the pixel that shows w = 0.
  Complex factor;
  Complex center;
  // spread: sum of squared distances of the plane's points from their mean
  double squares = 0;
  double largest = 0;
  double spread = 0;
};

/// Least squares of pixel = center + factor * w in complex numbers (a similarity: |factor| pixels
/// per m, arg the rotation), in closed form: factor = sum conj(w) p / sum |w|^2 about the means, as
/// Umeyama (1991) in the plane. w is mirrored first when asked.
Similarity similarity(std::span<const PointPair> pairs, bool mirrored) {
  const auto plane = [&](const PointPair& pair) {
    return mirrored ? std::conj(upright(pair.m)) : upright(pair.m);
  };
  const auto count = static_cast<double>(pairs.size());
  Complex mean_w;
  Complex mean_p;
  Complex cross;
  for (const PointPair& pair : pairs) {
    mean_w += plane(pair) / count;
    mean_p += pixel(pair.pixel_px) / count;
  }
  Similarity fit;
  for (const PointPair& pair : pairs) {
    const Complex w = plane(pair) - mean_w;
    cross += std::conj(w) * (pixel(pair.pixel_px) - mean_p);
    fit.spread += std::norm(w);
  }
  fit.factor = cross / fit.spread;
  // Residuals in pixels, since those are what was measured with an error.
  fit.center = mean_p - fit.factor * mean_w;
  for (const PointPair& pair : pairs) {
    const double residual = std::abs(pixel(pair.pixel_px) - fit.center - fit.factor * plane(pair));
    fit.squares += residual * residual;
    fit.largest = std::max(fit.largest, residual);
  }
  return fit;
}

/// Two distinct points determine scale, rotation and center.
void check_pairs(std::span<const PointPair> pairs) {
  if (pairs.size() < 2) throw std::invalid_argument("pairs: scale and rotation need two");
  double across_m = 0;
  double across_px = 0;
  for (const PointPair& pair : pairs) {
    if (!pair.m.allFinite() || !pair.pixel_px.allFinite())
      throw std::invalid_argument("pairs: must be finite");
    across_m = std::max(across_m, (pair.m - pairs.front().m).norm());
    across_px = std::max(across_px, (pair.pixel_px - pairs.front().pixel_px).norm());
  }
  if (across_m < 1e-9 || across_px < 1e-6)
    throw std::invalid_argument("pairs: all lie in one place");
}

/// z of the robot by (5.15).
/// With unit covariance: the position is wanted here, not its uncertainty.
std::optional<double> depth_at(const PoseSettings& settings, const EllipseVector& observed,
                               const Eigen::Vector3d& axis) {
  const auto start = first_guess(settings, observed, axis);
  if (!start) return std::nullopt;
  const auto found = locate(settings, observed, EllipseCovariance::Identity(), axis, *start);
  if (!found) return std::nullopt;
  return found->position_in_eye.z();
}

/// The position of a look, the variance of the known height in its own.
std::optional<PoseEstimate> look_at(const PoseSettings& settings, const EllipseVector& observed,
                                    const Eigen::Vector3d& axis, const LookNoise& noise) {
  PoseSettings unweighted = settings;
  unweighted.weighted = false;  // as depth_at() finds it
  const auto start = first_guess(unweighted, observed, axis);
  if (!start) return std::nullopt;
  auto found = locate(unweighted, observed, noise.covariance, axis, *start);
  if (found) found->covariance(2, 2) += noise.known_z_sigma * noise.known_z_sigma;
  return found;
}

/// Of the scale that puts a look at its height: sigma(z) over d z / d ln(scale). 0 where the look
/// is not found again.
double scale_sigma(const PoseSettings& calibrated, const EllipseVector& observed,
                   const Eigen::Vector3d& axis, const LookNoise& noise) {
  const auto look = look_at(calibrated, observed, axis, noise);
  if (!look) return 0;
  const auto moved = pose_sensitivity(calibrated, look->position_in_eye, axis);
  if (!moved || !(std::abs(moved->pixel.z()) > 0)) return 0;
  return std::sqrt(look->covariance(2, 2)) / std::abs(moved->pixel.z());
}

/// A larger pixel makes the observed ellipse larger in m, so the robot is placed nearer to the
/// lens.
PoseSettings scaled(PoseSettings settings, double scale) {
  settings.image.pixel *= scale;
  return settings;
}

/// The scale between `low` and `high` at which the error is zero, by bisection. The localizer may
/// give no answer at one of them, as below the retina, or above a robot that lies on it: then the
/// zero is sought between that side and where it answers.
template <class Error>
std::optional<double> zero_between(const Error& error, double low, double high) {
  constexpr int kBisections = 60;
  // m; a bisection that ends at the edge of the answers is no zero
  constexpr double kReached = 1e-7;
  const auto at_low = error(low);
  const auto at_high = error(high);
  if (!at_low && !at_high) return std::nullopt;
  if (at_low && at_high && (*at_low > 0) == (*at_high > 0)) return std::nullopt;
  // The side without an answer is given the sign that leaves a zero between the two; the halvings
  // then move towards the answers.
  const bool low_is_above = at_low ? *at_low > 0 : !(*at_high > 0);
  for (int i = 0; i < kBisections; ++i) {
    const double middle = (low + high) / 2;
    const auto value = error(middle);
    const bool towards_low = value ? (*value > 0) == low_is_above : !at_low;
    (towards_low ? low : high) = middle;
  }
  const double found = (low + high) / 2;
  const auto left = error(found);
  return left && std::abs(*left) < kReached ? std::optional(found) : std::nullopt;
}

/// The scale nearest 1 that puts the observed ellipse at the known depth, which grows with the
/// scale.
/// Outwards from 1, so that of several scales that explain the picture the one that changes the
/// camera least is taken.
double scale_for(const PoseSettings& settings, const EllipseVector& observed,
                 const Eigen::Vector3d& axis, double known_z) {
  constexpr double kSmallest = 0.7;
  constexpr double kLargest = 1.4;
  constexpr double kStep = 1.02;
  const auto error = [&](double scale) -> std::optional<double> {
    const auto z = depth_at(scaled(settings, scale), observed, axis);
    return z ? std::optional(*z - known_z) : std::nullopt;
  };
  // Outwards from 1 in steps of 2 %, on both sides in turn.
  for (double scale = 1; scale < kLargest; scale *= kStep) {
    for (double low : {scale / kStep, 1 / scale}) {
      if (low < kSmallest) continue;
      if (const auto found = zero_between(error, low, low * kStep)) return *found;
    }
  }
  throw std::invalid_argument(
      "observed: no image scale from 0.7 to 1.4 puts it at the known height");
}

}  // namespace

/// ImageScale has no rotation, so the turn is made in pixels about the image of m = 0.
Eigen::Vector2d CameraFit::pixel_from_m(const Eigen::Vector2d& m) const {
  const Eigen::Vector2d from_center = image.pixel_from_m(m) - image.center_px;
  return Eigen::Rotation2Dd(rotation) * from_center + image.center_px;
}

Eigen::Vector2d CameraFit::m_from_pixel(const Eigen::Vector2d& pixel_px) const {
  const Eigen::Vector2d from_center = pixel_px - image.center_px;
  return image.m_from_pixel(Eigen::Rotation2Dd(-rotation) * from_center + image.center_px);
}

/// A mirrored similarity that fits a hundred times better shows a sign error in the pairs.
/// v counted upwards is the usual mistake; no rotation makes up for it, and the fit would pass as a
/// poor camera.
CameraFit fit_camera(std::span<const PointPair> pairs) {
  constexpr double kClearlyBetter = 0.01;
  check_pairs(pairs);
  const Similarity straight = similarity(pairs, false);
  const Similarity mirrored = similarity(pairs, true);
  const auto count = static_cast<double>(pairs.size());
  const double floor = 1e-6 * count;  // px^2: two points, or all on a line, fit either way
  if (straight.squares > floor && mirrored.squares < kClearlyBetter * straight.squares) {
    throw std::invalid_argument("pairs: the image is mirrored; swap a sign of m or of the pixels");
  }
  detail::require(std::abs(straight.factor) > 0, "pairs: the pixels do not follow the points");
  CameraFit fit;
  fit.image.pixel = 1 / std::abs(straight.factor);
  fit.image.center_px = {straight.center.real(), straight.center.imag()};
  fit.rotation = std::arg(straight.factor);
  fit.rms_residual_px = std::sqrt(straight.squares / count);
  fit.max_residual_px = straight.largest;
  if (pairs.size() > 2) {
    // of one coordinate; four parameters
    const double variance = straight.squares / (2 * count - 4);
    // Standard deviation of the factor's parts: sigma / sqrt(sum |w|^2).
    const double of_factor = std::sqrt(variance / straight.spread);
    Complex mean;
    for (const PointPair& pair : pairs) mean += upright(pair.m) / count;
    // |factor| = 1 / pixel, so sigma(pixel) = sigma(factor) pixel^2 and sigma(rotation) = sigma /
    // |factor|.
    fit.scale_sigma = of_factor * fit.image.pixel * fit.image.pixel;
    fit.rotation_sigma = of_factor * fit.image.pixel;
    // Variance of the fitted line at w = 0: that of the mean, and the factor's over the distance of
    // the mean from there.
    fit.center_sigma_px.setConstant(
        std::sqrt(variance * (1 / count + std::norm(mean) / straight.spread)));
  }
  return fit;
}

PoseSettings PoseCalibration::applied(PoseSettings settings) const {
  return scaled(std::move(settings), image_scale);
}

/// Thesis 5.4: mean errors are accounted for by calibration with the robot resting on the retina,
/// whose depth is known.
/// Either correction makes the one known height right; they differ elsewhere. Throws
/// std::invalid_argument naming `observed`.
PoseCalibration calibrate_pose(const PoseSettings& settings, const EllipseVector& observed,
                               const Eigen::Vector3d& axis_in_eye, double known_z,
                               PoseCorrection correction, const LookNoise& noise) {
  detail::require_finite(known_z, "known_z");
  detail::require_not_negative(noise.known_z_sigma, "known_z_sigma");
  PoseCalibration calibration;
  if (correction == PoseCorrection::image_scale) {
    calibration.image_scale = scale_for(settings, observed, axis_in_eye, known_z);
    calibration.sigma = scale_sigma(calibration.applied(settings), observed, axis_in_eye, noise);
    const auto z = depth_at(calibration.applied(settings), observed, axis_in_eye);
    calibration.residual = z ? std::abs(*z - known_z) : std::abs(known_z);
    return calibration;
  }
  // One known height says nothing about x and y.
  const auto z = depth_at(settings, observed, axis_in_eye);
  if (!z) throw std::invalid_argument("observed: the localizer finds no place for it");
  calibration.offset.z() = known_z - *z;
  const auto look = look_at(settings, observed, axis_in_eye, noise);
  if (look) calibration.sigma = std::sqrt(look->covariance(2, 2));
  return calibration;
}

}  // namespace vitreo::optics
