// SPDX-License-Identifier: Apache-2.0
#include "vision/registration.h"

#include "vision/preconditions.h"
#include "vision/registration_refine.h"

#include <Eigen/Cholesky>
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
constexpr int kSmallestSide = 64;
constexpr int kTaper = 8;  // px at a quarter resolution: an edge would correlate with an edge
constexpr double kLeastContrast = 0.002;  // of the flattened view: below, it is blank
// 1: phase correlation, which noise dominates; 0: plain correlation, which the largest structures
// dominate.
constexpr double kWhitening = 0.75;

cv::Mat gray_of(const cv::Mat& view) {
  require(!view.empty() && view.dims == 2 && (view.type() == CV_8UC1 || view.type() == CV_8UC3),
          "view: wants an 8-bit gray or BGR image that is not empty");
  require(std::min(view.cols, view.rows) >= kSmallestSide, "view: wants at least 64 pixels a side");
  cv::Mat gray;
  if (view.channels() == 3)
    cv::extractChannel(view, gray, 1);
  else
    gray = view;
  cv::Mat result;
  gray.convertTo(result, CV_32F);
  return result;
}

// Vignette as a polynomial: least squares of all x^i y^j with i + j up to 4. The wide mean below
// cannot follow it at the border, and the remainder, the same in every view, would correlate views
// that have nothing else in common.
cv::Mat vignette_of(const cv::Mat& light) {
  using Terms = Eigen::Matrix<double, 15, 1>;
  const auto terms_at = [&](int u, int v) {
    const double x = 2.0 * u / light.cols - 1;
    const double y = 2.0 * v / light.rows - 1;
    Terms terms;
    int k = 0;
    for (int i = 0; i <= 4; ++i) {
      for (int j = 0; i + j <= 4; ++j) terms[k++] = std::pow(x, i) * std::pow(y, j);
    }
    return terms;
  };
  Eigen::Matrix<double, 15, 15> information = Eigen::Matrix<double, 15, 15>::Zero();
  Terms right = Terms::Zero();
  for (int v = 0; v < light.rows; ++v) {
    for (int u = 0; u < light.cols; ++u) {
      const Terms terms = terms_at(u, v);
      information.selfadjointView<Eigen::Lower>().rankUpdate(terms);
      right += light.at<float>(v, u) * terms;
    }
  }
  const Terms c = information.selfadjointView<Eigen::Lower>().ldlt().solve(right);
  cv::Mat vignette(light.size(), CV_32F);
  for (int v = 0; v < light.rows; ++v) {
    for (int u = 0; u < light.cols; ++u)
      vignette.at<float>(v, u) = static_cast<float>(std::max(c.dot(terms_at(u, v)), 1.0));
  }
  return vignette;
}

// Flat-field correction: the view, smoothed by 1 px, over its vignette times a wide Gaussian mean,
// both estimated on a small copy: uneven light goes, vessels stay.
cv::Mat flattened(const cv::Mat& gray, double sigma_px) {
  const double shrink = std::max(1.0, sigma_px / 3);
  const cv::Size size(std::max(8, static_cast<int>(gray.cols / shrink)),
                      std::max(8, static_cast<int>(gray.rows / shrink)));
  cv::Mat light;
  cv::Mat result;
  cv::resize(gray, light, size, 0, 0, cv::INTER_AREA);
  const cv::Mat vignette = vignette_of(light);
  cv::divide(light, vignette, light);
  cv::GaussianBlur(light, light, {0, 0}, sigma_px * size.width / gray.cols, 0, cv::BORDER_REFLECT);
  cv::multiply(light, vignette, light);
  cv::resize(light, light, gray.size(), 0, 0, cv::INTER_LINEAR);
  cv::GaussianBlur(gray, result, {0, 0}, 1);
  light = cv::max(light, 1.0);
  cv::divide(result, light, result);
  return result;
}

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
cv::Mat warped(const cv::Mat& image, const Eigen::Affine2d& to_from) {
  const Eigen::Matrix<double, 2, 3, Eigen::RowMajor> m = to_from.matrix().topRows<2>();
  cv::Mat result;
  cv::warpAffine(image, result, cv::Mat(2, 3, CV_64F, const_cast<double*>(m.data())), image.size());
  return result;
}

// Exhaustive over rotation, by correlation over translation, at the coarsest level; no features, no
// RANSAC. The best candidate is that of the highest Pearson correlation times the root of the
// overlap.
Candidate search_pose(const RegistrationView& first, const RegistrationView& second,
                      const RegistrationSettings& settings) {
  const cv::Mat a = spectrum_of(tapered(first.level(kCoarsest).image));
  const cv::Mat b = tapered(second.level(kCoarsest).image);
  const int turns = static_cast<int>(std::ceil(settings.max_rotation / kAngleStep));
  Candidate best;
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
      if (score > best.score) best = {first_from_second, score};
    }
  }
  return best;
}

// To a pyramid level `by` times as fine: the linear part is the same at all levels.
void scale_shift(Eigen::Affine2d& transform, double by) { transform.translation() *= by; }

}  // namespace

void RegistrationSettings::check() const {
  require(max_rotation >= 0 && max_rotation <= std::numbers::pi, "max_rotation: must be 0 to pi");
  require(flatten_sigma_px >= 3 && flatten_sigma_px <= 1000, "flatten_sigma_px: must be 3 to 1000");
  require(min_overlap > 0 && min_overlap < 1, "min_overlap: must be between 0 and 1");
  require(min_correlation > 0 && min_correlation < 1, "min_correlation: must be between 0 and 1");
}

// Flattened and standardized, then a Gaussian pyramid with central differences.
RegistrationView::RegistrationView(const cv::Mat& view, const RegistrationSettings& settings)
    : size_(view.size()) {
  settings.check();
  cv::Mat flat = flattened(gray_of(view), settings.flatten_sigma_px);
  cv::Scalar mean;
  cv::Scalar contrast;
  cv::meanStdDev(flat, mean, contrast);
  blank_ = !(contrast[0] > kLeastContrast);
  flat = (flat - mean[0]) / (blank_ ? 1 : contrast[0]);
  for (Level& level : levels_) {
    level.image = flat.clone();
    cv::Sobel(flat, level.du, CV_32F, 1, 0, 1, 0.5);
    cv::Sobel(flat, level.dv, CV_32F, 0, 1, 1, 0.5);
    cv::pyrDown(flat, flat);
  }
}

// Coarse to fine: the pyramid's levels in turn, each from the result of the one before.
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

std::optional<Registration> register_views(const RegistrationView& first,
                                           const RegistrationView& second,
                                           const RegistrationSettings& settings) {
  settings.check();
  require(first.size() == second.size(), "second: views must be of one size");
  if (first.blank() || second.blank()) return std::nullopt;
  Candidate best = search_pose(first, second, settings);
  if (best.score <= 0) return std::nullopt;
  scale_shift(best.first_from_second, kShrink);
  return refine_registration(first, second, best.first_from_second, settings);
}

}  // namespace vitreo::vision
