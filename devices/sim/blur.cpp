// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/blur.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::sim {
namespace {

constexpr int kOversampling = 5;  // samples a pixel, each way, while the kernel is made
constexpr double kKept = 0.998;   // of the kernel's energy (sum of squares), by its singular values
// Radius to which the Airy pattern is kept, its third dark ring, in units of lambda / (2 NA): the
// third zero of J_1 is 10.17 = 3.24 pi.
constexpr double kAiryRings = 3.24;

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

}  // namespace

// The kernel is made on a grid five times finer than the pixels, as disc * Airy pattern * pixel
// (convolutions): the Airy pattern alone in focus, the geometric disc far out of it, and an
// approximation between them.
cv::Mat point_spread(const Aperture& aperture, double defocus) {
  const double step = aperture.pixel / kOversampling;
  const double disc = std::abs(defocus) * aperture.numerical_aperture;
  const double airy_reach = kAiryRings * aperture.wavelength / (2 * aperture.numerical_aperture);
  const int reach = std::max(1, static_cast<int>(std::ceil((disc + airy_reach) / aperture.pixel)));
  const int half = reach * kOversampling + kOversampling / 2;
  const cv::Mat diffraction =
      sampled(half, step, [&](double r) { return r <= airy_reach ? airy(r, aperture) : 0; });
  // Radius |defocus| NA, for small NA. The rim is softened over one sample, so that the kernel
  // changes smoothly with the radius; the middle never vanishes, so that no defocus is the
  // identity.
  const cv::Mat geometric = sampled(half, step, [&](double r) {
    return std::clamp((disc - r) / step + 0.5, r == 0 ? 1e-3 : 0.0, 1.0);
  });
  cv::Mat fine;
  cv::filter2D(diffraction, fine, CV_32F, geometric, cv::Point(-1, -1), 0, cv::BORDER_CONSTANT);
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
