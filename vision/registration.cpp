// SPDX-License-Identifier: Apache-2.0
#include "vision/registration.h"

#include "vision/preconditions.h"
#include "vision/registration_refine.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::vision {
namespace {

constexpr int kCoarsest = RegistrationView::kLevels - 1;
constexpr int kShrink = 1 << kCoarsest;
// rad: half of it shifts the border of a VGA view by 2 px at a quarter of the resolution.
constexpr double kAngleStep = 3 * std::numbers::pi / 180;
constexpr int kPeaks = 2;  // of each angle's correlation that are evaluated
constexpr int kTaper = 8;  // px at a quarter resolution: an edge would correlate with an edge
// 1: phase correlation, which noise dominates; 0: plain correlation, which the largest structures
// dominate.
constexpr double kWhitening = 0.75;
// Of the overlap's parts with structure: fewer are no verification.
constexpr int kFewestParts = 3;
constexpr double kLeastAgreeing = 0.6;
constexpr double kMostOff_px = 1.0;  // of them: beyond it the model does not fit
// Of the smooth part of that, as a distance; a measured distortion is seen too small by a third
// where the overlap is narrow, and nothing beyond a pixel may pass.
constexpr double kMostField_px = 0.6;
// Of its noise: chi^2 of the field's twelve exceeds it by chance in one pair of 2000.
constexpr double kFieldShows = 1.7;
constexpr double kElsewhere_px = 6;  // at a quarter resolution: another pose
constexpr double kRival = 0.8;       // of the best score: a second peak that is verified as well
// A retina that did not move under the sensor.
constexpr double kAtRest_px = 4;
constexpr double kSameStructure = 1.2;    // standard deviations of the view
constexpr double kRestCorrelation = 0.2;  // of the views without what is the same in both
constexpr double kRestOff_px = 1;

// Linear taper to 0 at the border, against the spectrum's leakage.
cv::Mat tapered(const cv::Mat& image) {
  cv::Mat result = image.clone();
  for (int v = 0; v < image.rows; ++v) {
    for (int u = 0; u < image.cols; ++u) {
      const int rim = std::min({u, v, image.cols - 1 - u, image.rows - 1 - v});
      if (rim < kTaper) result.at<float>(v, u) *= static_cast<float>((rim + 0.5) / kTaper);
    }
  }
  return result;
}

// Zero padding to twice the size: the correlation is linear, not circular, so a shift beyond half
// the view is not aliased.
// The spectrum of a real image, both halves, so that products need no special rows.
cv::Mat spectrum_of(const cv::Mat& image) {
  cv::Mat padded = cv::Mat::zeros(cv::getOptimalDFTSize(2 * image.rows),
                                  cv::getOptimalDFTSize(2 * image.cols), CV_32F);
  image.copyTo(padded(cv::Rect(0, 0, image.cols, image.rows)));
  cv::Mat spectrum;
  cv::dft(padded, spectrum, cv::DFT_COMPLEX_OUTPUT, image.rows);
  return spectrum;
}

// Cross-correlation by the spectra's product A conj(B), divided by |A B|^0.75: between phase
// correlation (Kuglin & Hines 1975, exponent 1) and plain correlation (0).
cv::Mat correlation_of(const cv::Mat& first, const cv::Mat& second) {
  cv::Mat product;
  cv::Mat correlation;
  cv::mulSpectrums(first, second, product, 0, true);
  for (int v = 0; v < product.rows; ++v) {
    cv::Vec2f* const row = product.ptr<cv::Vec2f>(v);
    for (int u = 0; u < product.cols; ++u) {
      const float size = row[u][0] * row[u][0] + row[u][1] * row[u][1];
      row[u] *= std::pow(size + 1e-12F, static_cast<float>(-kWhitening / 2));
    }
  }
  cv::dft(product, correlation, cv::DFT_INVERSE | cv::DFT_REAL_OUTPUT);
  return correlation;
}

// The highest peaks, as shifts in p_first = p_turned + shift, px; those beyond half the padded size
// are negative.
// Paints over the correlation, of which the caller has no further use.
std::vector<Eigen::Vector2d> peaks_of(cv::Mat correlation) {
  std::vector<Eigen::Vector2d> shifts;
  for (int k = 0; k < kPeaks; ++k) {
    cv::Point at;
    cv::minMaxLoc(correlation, nullptr, nullptr, nullptr, &at);
    shifts.emplace_back(at.x > correlation.cols / 2 ? at.x - correlation.cols : at.x,
                        at.y > correlation.rows / 2 ? at.y - correlation.rows : at.y);
    cv::circle(correlation, at, 4, cv::Scalar(-1e9), cv::FILLED);  // the next is another peak
  }
  return shifts;
}

struct Candidate {
  Eigen::Affine2d first_from_second = Eigen::Affine2d::Identity();  // at the coarsest level
  double score = 0;
};

Eigen::Affine2d turn_about_center(const cv::Size& size, double angle) {
  const Eigen::Vector2d center((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  return Eigen::Translation2d(center) * Eigen::Rotation2Dd(angle) * Eigen::Translation2d(-center);
}

// The image in the frame that `to_from` maps to.
// Of the same size; what has no source is 0, the flattened mean.
cv::Mat warped(const cv::Mat& image, const Eigen::Affine2d& to_from) {
  const Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = to_from.matrix().topRows<2>();
  cv::Mat result;
  cv::warpAffine(image, result, cv::Mat(2, 3, CV_64F, const_cast<double*>(m.data())), image.size());
  return result;
}

// Exhaustive over rotation, by correlation over translation, at the coarsest level; no features, no
// RANSAC. The best candidate is that of the highest Pearson correlation times the root of the
// overlap; the second is the best of those that lie elsewhere. Either may be missing.
// The first view's spectrum is computed once; each angle costs one transform forwards and one back.
std::vector<Candidate> search_pose(const RegistrationView& first, const RegistrationView& second,
                                   const RegistrationSettings& settings) {
  const cv::Mat a = spectrum_of(tapered(first.level(kCoarsest).image));
  const cv::Mat b = tapered(second.level(kCoarsest).image);
  const int turns = static_cast<int>(std::ceil(settings.max_rotation / kAngleStep));
  std::vector<Candidate> found;
  for (int k = -turns; k <= turns; ++k) {
    // Steps of at most kAngleStep that include both ends and 0.
    const double angle = turns == 0 ? 0 : k * settings.max_rotation / turns;
    const Eigen::Affine2d turn = turn_about_center(b.size(), angle);
    for (const Eigen::Vector2d& shift : peaks_of(correlation_of(a, spectrum_of(warped(b, turn))))) {
      const Eigen::Affine2d first_from_second = Eigen::Translation2d(shift) * turn;
      const ViewOverlap overlap =
          overlap_of(first, second, first_from_second.inverse(), kCoarsest, 2);
      if (overlap.share < settings.min_overlap) continue;
      // By chance a correlation of n pixels reaches about 1 / sqrt(n).
      const double score = overlap.correlation * std::sqrt(overlap.share);
      if (score > 0) found.push_back({first_from_second, score});
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const Candidate& x, const Candidate& y) { return x.score > y.score; });
  const Eigen::Vector2d middle(b.cols / 2.0, b.rows / 2.0);
  std::vector<Candidate> best;
  for (const Candidate& one : found) {
    const auto there = [&](const Candidate& other) {
      return (one.first_from_second * middle - other.first_from_second * middle).norm() <
             kElsewhere_px;
    };
    if (best.size() < 2 && std::none_of(best.begin(), best.end(), there)) best.push_back(one);
  }
  return best;
}

// To a pyramid level `by` times as fine: the linear part is the same at all levels.
// A pixel of the finer level is half as wide, hence the factor on the shift.
void scale_shift(Eigen::Affine2d& transform, double by) { transform.translation() *= by; }

// By the parts of the overlap at half the resolution, where noise matters less: a pose that only
// what is fixed to the sensor agrees with, or a model that does not fit, shows there. Adds to
// `result` what it shows.
bool verified(const RegistrationView& first, const RegistrationView& second,
              Eigen::Affine2d second_from_first, Registration& result) {
  scale_shift(second_from_first, 0.5);
  const PartAgreement parts = agreement_of(first, second, second_from_first, 1);
  const double off = 2 * parts.rms_px;  // of full resolution
  if (parts.parts < kFewestParts || parts.agreeing < kLeastAgreeing * parts.parts ||
      off > kMostOff_px)
    return false;
  result.agreeing = static_cast<double>(parts.agreeing) / parts.parts;
  // The smooth part of it is what the model cannot follow: distortion, or a tilt.
  const double shown =
      parts.field_px > kFieldShows * parts.field_noise_px
          ? parts.field_px * parts.field_px - parts.field_noise_px * parts.field_noise_px
          : 0;
  const double misfit = 2 * std::sqrt(shown);
  if (misfit > kMostField_px) return false;
  result.sigma_px = std::hypot(result.sigma_px, misfit);
  return true;
}

// Coarse to fine: the pyramid's levels in turn, each from the result of the one before.
// Correlation and overlap in the result are those of the coarsest level, sigma_px is that of full
// resolution.
std::optional<Registration> refine_levels(const RegistrationView& first,
                                          const RegistrationView& second,
                                          const Eigen::Affine2d& first_from_second,
                                          const RegistrationSettings& settings) {
  Eigen::Affine2d second_from_first = first_from_second.inverse();
  scale_shift(second_from_first, 1.0 / kShrink);
  Registration result;
  for (int level = kCoarsest; level >= 0; --level) {
    const std::optional<double> sigma =
        refine_at_level(first, second, second_from_first, level, settings.model);
    if (!sigma) return std::nullopt;
    result.sigma_px = *sigma;
    // The decision is taken here: at full resolution noise lowers the correlation.
    if (level == kCoarsest) {
      const ViewOverlap overlap = overlap_of(first, second, second_from_first, level, 1);
      if (overlap.correlation < settings.min_correlation || overlap.share < settings.min_overlap)
        return std::nullopt;
      result.correlation = overlap.correlation;
      result.overlap = overlap.share;
    }
    if (level > 0) scale_shift(second_from_first, 2);
  }
  result.first_from_second = second_from_first.inverse();
  return result;
}

// Root mean square, over a grid on the view, of what one pose moves against another.
double apart_px(const Eigen::Affine2d& a, const Eigen::Affine2d& b, const cv::Size& size) {
  constexpr int kSide = 5;
  double sum = 0;
  for (int k = 0; k < kSide * kSide; ++k) {
    const int row = k / kSide, column = k % kSide;
    const Eigen::Vector2d p(column * (size.width - 1.0) / (kSide - 1),
                            row * (size.height - 1.0) / (kSide - 1));
    sum += (a * p - b * p).squaredNorm();
  }
  return std::sqrt(sum / (kSide * kSide));
}

// Strong structure that two views have at the same pixels, with its surroundings.
cv::Mat same_in_both(const RegistrationView& first, const RegistrationView& second) {
  const cv::Mat& a = first.level(0).image;
  const cv::Mat& b = second.level(0).image;
  cv::Mat strength;
  cv::min(cv::Mat(cv::abs(a)), cv::Mat(cv::abs(b)), strength);
  cv::Mat same = (strength > kSameStructure) & (cv::abs(a - b) < 0.5 * strength);
  cv::dilate(same, same, cv::getStructuringElement(cv::MORPH_ELLIPSE, {9, 9}));
  return same;
}

// Where the retina seems to be at rest, dirt and reflexes agree with that pose wherever the retina
// is. Without the strong structure that is the same in both views the rest must still agree, and
// what that moves is how far the sensor's own structure can have pulled the answer.
bool agrees_beyond_the_sensor(const RegistrationView& first, const RegistrationView& second,
                              const RegistrationSettings& settings, Registration& result) {
  const cv::Mat same = same_in_both(first, second);
  RegistrationView a = first;
  RegistrationView b = second;
  a.leave_out(same);
  b.leave_out(same);
  RegistrationSettings rest = settings;
  rest.min_correlation = std::min(kRestCorrelation, settings.min_correlation);
  const auto again = refine_levels(a, b, result.first_from_second, rest);
  if (!again) return false;
  const double apart = apart_px(again->first_from_second, result.first_from_second, first.size());
  if (apart > kRestOff_px) return false;
  // Less the noise of the second look, which saw fewer pixels.
  const double pull = apart * apart - again->sigma_px * again->sigma_px;
  result.sigma_px = std::hypot(result.sigma_px, std::sqrt(std::max(pull, 0.0)));
  return true;
}

}  // namespace

// Refined, verified by its parts, and, of a retina at rest, by what is not the sensor's.
std::optional<Registration> refine_registration(const RegistrationView& first,
                                                const RegistrationView& second,
                                                const Eigen::Affine2d& first_from_second,
                                                const RegistrationSettings& settings) {
  settings.check();
  require(first.size() == second.size(), "second: views must be of one size");
  require(first_from_second.matrix().allFinite() &&
              std::abs(first_from_second.linear().determinant()) > 1e-3,
          "first_from_second: must be finite and invertible");
  if (first.blank() || second.blank()) return std::nullopt;
  auto found = refine_levels(first, second, first_from_second, settings);
  if (!found || !verified(first, second, found->first_from_second.inverse(), *found))
    return std::nullopt;
  const double moved =
      apart_px(found->first_from_second, Eigen::Affine2d::Identity(), first.size());
  if (moved < kAtRest_px && !agrees_beyond_the_sensor(first, second, settings, *found))
    return std::nullopt;
  return found;
}

// The best candidate is refined; the second as well where it is about as good, or the best one
// fails, as dirt's pose does. Two that are both verified are no answer.
std::optional<Registration> register_views(const RegistrationView& first,
                                           const RegistrationView& second,
                                           const RegistrationSettings& settings) {
  settings.check();
  require(first.size() == second.size(), "second: views must be of one size");
  if (first.blank() || second.blank()) return std::nullopt;
  const std::vector<Candidate> candidates = search_pose(first, second, settings);
  std::optional<Registration> found;
  for (std::size_t k = 0; k < candidates.size(); ++k) {
    const Candidate& one = candidates[k];
    if (found && one.score < kRival * candidates.front().score) break;
    Eigen::Affine2d guess = one.first_from_second;
    scale_shift(guess, kShrink);
    const auto refined = refine_registration(first, second, guess, settings);
    if (!refined) continue;
    if (found &&
        apart_px(found->first_from_second, refined->first_from_second, first.size()) > kAtRest_px)
      return std::nullopt;
    if (found) continue;
    found = refined;
    if (candidates.size() > 1) found->second_peak = candidates[1 - k].score / one.score;
  }
  return found;
}

}  // namespace vitreo::vision
