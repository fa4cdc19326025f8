// SPDX-License-Identifier: Apache-2.0
#include "vision/registration_refine.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <numbers>

namespace vitreo::vision {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr int kIterations = 30;
constexpr double kConverged = 1e-3;  // px of the level
constexpr double kFewest = 400;      // pixels of overlap
constexpr double kOutlier =
    2;  // standard deviations of the difference at which a pixel's weight is halved
constexpr double kSmoothing =
    4 * std::numbers::pi;  // pixels that share their noise: images are smoothed by sigma 1 px

// Calls f(column, row, gray value of the second view there) for the pixels of the first that the
// second covers.
template <typename F>
void for_overlap(const cv::Mat& first, const cv::Mat& second,
                 const Eigen::Affine2d& second_from_first, int step, F f) {
  const double right = second.cols - 1.001, bottom = second.rows - 1.001;
  const Eigen::Vector2d along = second_from_first.linear().col(0);
  for (int v = 1; v < first.rows - 1; v += step) {
    const Eigen::Vector2d start = second_from_first * Eigen::Vector2d(0, v);
    for (int u = 1; u < first.cols - 1; u += step) {
      const double x = start.x() + u * along.x(), y = start.y() + u * along.y();
      if (!(x >= 0 && y >= 0 && x <= right && y <= bottom)) continue;
      const int i = static_cast<int>(x), j = static_cast<int>(y);
      const double s = x - i, t = y - j;
      const float *const a = second.ptr<float>(j) + i, *const b = second.ptr<float>(j + 1) + i;
      f(u, v, (1 - t) * ((1 - s) * a[0] + s * a[1]) + t * ((1 - s) * b[0] + s * b[1]));
    }
  }
}

// Means and deviations of both in the overlap: a lamp that brightened, or another contrast, is no
// difference.
struct Moments {
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  void add(double x, double y) { n += 1, a += x, b += y, aa += x * x, bb += y * y, ab += x * y; }
  double mean_a() const { return a / n; }
  double mean_b() const { return b / n; }
  double sigma_a() const { return std::sqrt(std::max(aa / n - mean_a() * mean_a(), 1e-12)); }
  double sigma_b() const { return std::sqrt(std::max(bb / n - mean_b() * mean_b(), 1e-12)); }
  double correlation() const { return (ab / n - mean_a() * mean_b()) / (sigma_a() * sigma_b()); }
};

Moments moments_of(const cv::Mat& first, const cv::Mat& second,
                   const Eigen::Affine2d& second_from_first, int step) {
  Moments m;
  for_overlap(first, second, second_from_first, step,
              [&](int u, int v, double gray) { m.add(first.at<float>(v, u), gray); });
  return m;
}

struct Equations {
  Matrix6 information = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  double squares = 0, weights = 0, count = 0;
};

// Normalized, so that an element of the affine change moves the view's rim by one pixel.
struct Frame {
  double u, v, scale;
  explicit Frame(const cv::Mat& image)
      : u((image.cols - 1) / 2.0),
        v((image.rows - 1) / 2.0),
        scale(std::max(image.cols, image.rows) / 2.0) {}
};

Equations equations_of(const RegistrationView::Level& first, const cv::Mat& second,
                       const Eigen::Affine2d& second_from_first, const Moments& m, double outlier) {
  Equations e;
  const Frame frame(first.image);
  const double a = m.mean_a(), b = m.mean_b(), sa = m.sigma_a(), sb = m.sigma_b();
  Vector6 sum = Vector6::Zero();
  for_overlap(first.image, second, second_from_first, 1, [&](int u, int v, double gray) {
    const double miss = (gray - b) / sb - (first.image.at<float>(v, u) - a) / sa;
    const double gu = first.du.at<float>(v, u) / sa, gv = first.dv.at<float>(v, u) / sa;
    const double x = (u - frame.u) / frame.scale, y = (v - frame.v) / frame.scale;
    const double w = 1 / (1 + miss * miss / (outlier * outlier));
    Vector6 row;
    row << gu * x, gu * y, gu, gv * x, gv * y, gv;
    e.information.selfadjointView<Eigen::Lower>().rankUpdate(row, w);
    sum += (w * miss) * row;
    e.squares += w * miss * miss;
    e.weights += w;
    e.count += 1;
  });
  e.information = Matrix6(e.information.selfadjointView<Eigen::Lower>());
  e.right = sum;
  return e;
}

// Which combinations of the six the model may change: all, or a small turn and the shifts.
Eigen::Matrix<double, 6, Eigen::Dynamic> freedoms_of(ViewModel model) {
  if (model == ViewModel::affine) return Matrix6::Identity();
  Eigen::Matrix<double, 6, 3> freedoms = Eigen::Matrix<double, 6, 3>::Zero();
  freedoms(1, 0) = -1, freedoms(3, 0) = 1;
  freedoms(2, 1) = 1, freedoms(5, 2) = 1;
  return freedoms;
}

Eigen::Affine2d change_of(const Vector6& d, const Frame& frame, ViewModel model) {
  Eigen::Affine2d change = Eigen::Affine2d::Identity();
  if (model == ViewModel::euclidean)
    change.linear() = Eigen::Rotation2Dd(d[3] / frame.scale).toRotationMatrix();
  else
    change.linear() += (Eigen::Matrix2d() << d[0], d[1], d[3], d[4]).finished() / frame.scale;
  const Eigen::Vector2d center(frame.u, frame.v);
  change.translation() = center - change.linear() * center + Eigen::Vector2d(d[2], d[5]);
  return change;
}

}  // namespace

ViewOverlap overlap_of(const RegistrationView& first, const RegistrationView& second,
                       const Eigen::Affine2d& second_from_first, int level, int step) {
  const cv::Mat &a = first.level(level).image, &b = second.level(level).image;
  const Moments m = moments_of(a, b, second_from_first, step);
  if (m.n < 2) return {};
  return {m.correlation(), m.n * step * step / static_cast<double>(b.total())};
}

std::optional<double> refine_at_level(const RegistrationView& first, const RegistrationView& second,
                                      Eigen::Affine2d& second_from_first, int level,
                                      ViewModel model) {
  const RegistrationView::Level& a = first.level(level);
  const cv::Mat& b = second.level(level).image;
  const Eigen::Matrix<double, 6, Eigen::Dynamic> freedoms = freedoms_of(model);
  double sigma = 0, outlier = kOutlier;
  for (int k = 0; k < kIterations; ++k) {
    const Moments m = moments_of(a.image, b, second_from_first, 2);
    if (4 * m.n < kFewest) return std::nullopt;
    const Equations e = equations_of(a, b, second_from_first, m, outlier);
    const Eigen::LDLT<Eigen::MatrixXd> solver(freedoms.transpose() * e.information * freedoms);
    if (solver.info() != Eigen::Success || solver.rcond() < 1e-9) return std::nullopt;
    const Vector6 change = freedoms * solver.solve(freedoms.transpose() * e.right);
    if (!change.allFinite()) return std::nullopt;
    // The template is the one that was moved: its change, taken back, comes first (inverse
    // compositional).
    second_from_first = second_from_first * change_of(change, Frame(a.image), model).inverse();
    const double rms = std::sqrt(e.squares / e.weights);
    outlier = kOutlier * std::max(rms, 0.05);
    const Eigen::MatrixXd inverse =
        solver.solve(Eigen::MatrixXd::Identity(freedoms.cols(), freedoms.cols()));
    const Matrix6 covariance = freedoms * inverse * freedoms.transpose() * (rms * rms * kSmoothing);
    sigma = std::sqrt(covariance.diagonal().sum() / 2);
    if (change.lpNorm<Eigen::Infinity>() < kConverged) break;
  }
  return sigma;
}

}  // namespace vitreo::vision
