// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/blur.h"

#include "devices/sim/defocus_wave.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::sim {
namespace {

constexpr int kOversampling = 5;  // samples a pixel, each way, while the kernel is made
constexpr double kKept = 0.998;   // of the kernel's energy (sum of squares), by its singular values
// Radius to which the Airy pattern is kept, its third dark ring, in units of lambda / (2 NA): the
// third zero of J_1 is 10.17 = 3.24 pi.
constexpr double kAiryRings = 3.24;
constexpr double kAiryRadius = 1.22;  // the first dark ring, in the same units
// Up to which disc, in Airy radii, the wave is calculated: 60 radians of defocus at the rim. A
// kernel there takes milliseconds; beyond it geometry is enough.
constexpr double kWaveDiscs = 16;
constexpr double kBand = 0.09;  // half width of a color's light, relative to its wavelength

// The Airy pattern of a circular aperture, (2 J_1(x) / x)^2 with x = 2 pi NA r / lambda (Born &
// Wolf 1999, 8.5.2); 1 in the middle.
double airy(double r, const Aperture& aperture) {
  const double x = 2 * M_PI * aperture.numerical_aperture * r / aperture.wavelength;
  if (x < 1e-6) return 1;
  const double j = 2 * std::cyl_bessel_j(1.0, x) / x;
  return j * j;
}

// A function of the radius, sampled on a square grid of `half` samples each way, normalized.
template <typename Function>
cv::Mat sampled(int half, double step, Function value) {
  cv::Mat grid(2 * half + 1, 2 * half + 1, CV_32F);
  for (int j = -half; j <= half; ++j)
    for (int i = -half; i <= half; ++i)
      grid.at<float>(j + half, i + half) = static_cast<float>(value(std::hypot(i, j) * step));
  return grid / cv::sum(grid)[0];
}

/// Of the band's colors, each with the same energy through the aperture, which spreads over an area
/// as its wavelength squared; a function of the radius in steps of half a sample.
std::vector<double> wave_profile(const Aperture& aperture, double defocus, double step,
                                 std::size_t count) {
  constexpr int kColors = 5;
  std::vector<double> profile(count, 0.0);
  for (int color = 0; color < kColors; ++color) {
    const double part = kBand * (2.0 * color / (kColors - 1) - 1);
    const double wavelength = aperture.wavelength * (1 + part);
    const double k_na = 2 * M_PI * aperture.numerical_aperture / wavelength;
    const double u = k_na * aperture.numerical_aperture * defocus;
    for (std::size_t i = 0; i < count; ++i) {
      const double v = k_na * static_cast<double>(i) * step / 2;
      profile[i] += defocused_intensity(u, v) / (wavelength * wavelength);
    }
  }
  return profile;
}

/// Interpolated between the radii of the profile.
cv::Mat wave(const Aperture& aperture, double defocus, double reach, int half, double step) {
  const auto count = static_cast<std::size_t>(2 * reach / step) + 3;
  const std::vector<double> profile = wave_profile(aperture, defocus, step, count);
  return sampled(half, step, [&](double r) {
    if (r > reach) return 0.0;
    const double at = 2 * r / step;
    const auto i = static_cast<std::size_t>(at);
    const double part = at - static_cast<double>(i);
    return (1 - part) * profile[i] + part * profile[i + 1];
  });
}

/// Disc * Airy pattern: what the wave comes to when the disc is much larger than the pattern, but
/// for ripples at the disc's rim.
cv::Mat disc_and_airy(const Aperture& aperture, double disc, double airy_reach, int half,
                      double step) {
  const cv::Mat diffraction =
      sampled(half, step, [&](double r) { return r <= airy_reach ? airy(r, aperture) : 0; });
  // Radius |defocus| NA, for small NA. The rim is softened over one sample, so that the kernel
  // changes smoothly with the radius.
  const cv::Mat geometric =
      sampled(half, step, [&](double r) { return std::clamp((disc - r) / step + 0.5, 0.0, 1.0); });
  cv::Mat fine;
  cv::filter2D(diffraction, fine, CV_32F, geometric, cv::Point(-1, -1), 0, cv::BORDER_CONSTANT);
  return fine;
}

}  // namespace

// The kernel is made on a grid five times finer than the pixels.
cv::Mat point_spread(const Aperture& aperture, double defocus) {
  const double step = aperture.pixel / kOversampling;
  const double disc = std::abs(defocus) * aperture.numerical_aperture;
  const double ring = aperture.wavelength / (2 * aperture.numerical_aperture);
  const double airy_reach = kAiryRings * ring;
  const int reach = std::max(1, static_cast<int>(std::ceil((disc + airy_reach) / aperture.pixel)));
  const int half = reach * kOversampling + kOversampling / 2;
  const cv::Mat fine = disc <= kWaveDiscs * kAiryRadius * ring
                           ? wave(aperture, defocus, disc + airy_reach, half, step)
                           : disc_and_airy(aperture, disc, airy_reach, half, step);
  cv::Mat kernel;
  // Averages over each pixel's square.
  cv::resize(fine, kernel, cv::Size(2 * reach + 1, 2 * reach + 1), 0, 0, cv::INTER_AREA);
  return kernel / cv::sum(kernel)[0];
}

// Singular value decomposition K = sum w_k u_k v_k': each term is a separable filter, 2 n
// operations a pixel instead of n^2, and the leading terms carry almost all of the energy (Treitel
// & Shanks 1971).
const Blur::Separable& Blur::kernel(double defocus) {
  // The defocus whose disc has a radius of a tenth of a pixel.
  const double tenth = aperture_.pixel / aperture_.numerical_aperture / 10;
  const int key = static_cast<int>(std::lround(std::abs(defocus) / tenth));
  const auto found = kernels_.find(key);
  if (found != kernels_.end()) return found->second;
  const cv::Mat spread = point_spread(aperture_, key * tenth);
  cv::Mat w;
  cv::Mat u;
  cv::Mat vt;
  cv::SVD::compute(spread, w, u, vt);
  Separable separable{{}, {}, spread.rows / 2};
  const double all = w.dot(w);
  double kept = 0;
  double sum = 0;
  for (int k = 0; k < w.rows && kept < kKept * all; ++k) {
    const float root = std::sqrt(w.at<float>(k));
    separable.columns.push_back(u.col(k) * root);
    separable.rows.push_back(vt.row(k).t() * root);
    kept += w.at<float>(k) * w.at<float>(k);
    sum += cv::sum(separable.columns.back())[0] * cv::sum(separable.rows.back())[0];
  }
  // The terms left out would change the sum: blur neither adds nor takes light.
  for (cv::Mat& column : separable.columns) column /= sum;
  return kernels_.emplace(key, std::move(separable)).first->second;
}

// sum_k v_k (u_k * image), one separable pass a term; at the border the edge's pixels are repeated,
// so that an even image stays even.
void Blur::apply(cv::Mat& image, double defocus) {
  const Separable& separable = kernel(defocus);
  cv::Mat sum;
  cv::Mat part;
  for (std::size_t k = 0; k < separable.rows.size(); ++k) {
    cv::sepFilter2D(image, part, CV_32F, separable.rows[k], separable.columns[k], cv::Point(-1, -1),
                    0, cv::BORDER_REPLICATE);
    if (k == 0)
      cv::swap(sum, part);
    else
      sum += part;
  }
  cv::swap(image, sum);
}

int Blur::reach(double defocus) { return kernel(defocus).reach; }

}  // namespace vitreo::sim
