// SPDX-License-Identifier: Apache-2.0
#include "vision/registration_refine.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <vector>

namespace vitreo::vision {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr int kIterations = 30;
constexpr double kConvergedPx = 1e-3;  // px of the level
constexpr double kFewestPixels = 400;  // pixels of overlap
constexpr double kOutlier = 2;  // standard deviations of the difference at which a weight is halved
// Pixels that share their noise, 4 pi sigma^2 for an image smoothed by a Gaussian of sigma 1 px.
constexpr double kSharedNoise = 4 * std::numbers::pi;

// Calls f(column, row, gray value of the second view there) for the pixels of the first that the
// second covers, by bilinear interpolation.
// The outermost pixels of the first view are left out, where central differences have no neighbor.
// What either view leaves out is not called for.
template <typename F>
void for_overlap(const RegistrationView::Level& in_first, const RegistrationView::Level& in_second,
                 const Eigen::Affine2d& second_from_first, int step, F f) {
  const cv::Mat& first = in_first.image;
  const cv::Mat& second = in_second.image;
  const double right = second.cols - 1.001;
  const double bottom = second.rows - 1.001;
  const Eigen::Vector2d along = second_from_first.linear().col(0);
  for (int v = 1; v < first.rows - 1; v += step) {
    const Eigen::Vector2d start = second_from_first * Eigen::Vector2d(0, v);
    for (int u = 1; u < first.cols - 1; u += step) {
      const double x = start.x() + u * along.x();
      const double y = start.y() + u * along.y();
      if (!(x >= 0 && y >= 0 && x <= right && y <= bottom)) continue;
      const int i = static_cast<int>(x);
      const int j = static_cast<int>(y);
      if (in_first.valid.at<unsigned char>(v, u) == 0 ||
          in_second.valid.at<unsigned char>(j, i) == 0)
        continue;
      const double s = x - i;
      const double t = y - j;
      const float* const a = second.ptr<float>(j) + i;
      const float* const b = second.ptr<float>(j + 1) + i;
      f(u, v, (1 - t) * ((1 - s) * a[0] + s * a[1]) + t * ((1 - s) * b[0] + s * b[1]));
    }
  }
}

// Means and deviations of both views in the overlap, to standardize them: a brighter lamp, or
// another contrast, is then no difference, as in ECC (Evangelidis & Psarakis 2008). correlation():
// Pearson's.
struct PairMoments {
  double n = 0;
  double a = 0;
  double b = 0;
  double aa = 0;
  double bb = 0;
  double ab = 0;
  void add(double x, double y) { n += 1, a += x, b += y, aa += x * x, bb += y * y, ab += x * y; }
  double mean_a() const { return a / n; }
  double mean_b() const { return b / n; }
  double sigma_a() const { return std::sqrt(std::max(aa / n - mean_a() * mean_a(), 1e-12)); }
  double sigma_b() const { return std::sqrt(std::max(bb / n - mean_b() * mean_b(), 1e-12)); }
  /// Mean square of a - b.
  double difference() const { return std::max((aa - 2 * ab + bb) / n, 0.0); }
  double correlation() const { return (ab / n - mean_a() * mean_b()) / (sigma_a() * sigma_b()); }
};

// Every `step`-th pixel and row; moments need fewer samples than the equations.
PairMoments pair_moments(const RegistrationView::Level& first,
                         const RegistrationView::Level& second,
                         const Eigen::Affine2d& second_from_first, int step) {
  PairMoments m;
  for_overlap(first, second, second_from_first, step,
              [&](int u, int v, double gray) { m.add(first.image.at<float>(v, u), gray); });
  return m;
}

struct RefineEquations {
  Matrix6 information = Matrix6::Zero();
  Vector6 right = Vector6::Zero();
  Eigen::Matrix3d moments = Eigen::Matrix3d::Zero();  // of (x, y, 1) over the overlap
  double squares = 0;
  double weights = 0;
  double count = 0;
};

// Coordinates about the view's center in units of half its longer side, so that an element of the
// affine change moves the border by one pixel.
struct ViewFrame {
  double u;
  double v;
  double scale;
  explicit ViewFrame(const cv::Mat& image)
      : u((image.cols - 1) / 2.0),
        v((image.rows - 1) / 2.0),
        scale(std::max(image.cols, image.rows) / 2.0) {}
};

// Normal equations of the inverse compositional step (Baker & Matthews 2004) for the six of an
// affine change of the first view: J = grad(first) d(warp) / d(p), residual second(warp) - first,
// both standardized; weights 1 / (1 + (r / c)^2) (Cauchy).
// Only the first view's gradients enter, which RegistrationView has computed once: that is what
// inverse compositional saves.
RefineEquations refine_equations(const RegistrationView::Level& first,
                                 const RegistrationView::Level& second,
                                 const Eigen::Affine2d& second_from_first, const PairMoments& m,
                                 double outlier) {
  RefineEquations e;
  const ViewFrame frame(first.image);
  const double a = m.mean_a();
  const double b = m.mean_b();
  const double sa = m.sigma_a();
  const double sb = m.sigma_b();
  Vector6 sum = Vector6::Zero();
  for_overlap(first, second, second_from_first, 1, [&](int u, int v, double gray) {
    const double miss = (gray - b) / sb - (first.image.at<float>(v, u) - a) / sa;
    const double gu = first.du.at<float>(v, u) / sa;
    const double gv = first.dv.at<float>(v, u) / sa;
    const double x = (u - frame.u) / frame.scale;
    const double y = (v - frame.v) / frame.scale;
    const double w = 1 / (1 + miss * miss / (outlier * outlier));
    Vector6 row;
    row << gu * x, gu * y, gu, gv * x, gv * y, gv;
    e.information.selfadjointView<Eigen::Lower>().rankUpdate(row, w);
    sum += (w * miss) * row;
    e.moments.selfadjointView<Eigen::Lower>().rankUpdate(Eigen::Vector3d(x, y, 1));
    e.squares += w * miss * miss;
    e.weights += w;
    e.count += 1;
  });
  e.information = Matrix6(e.information.selfadjointView<Eigen::Lower>());
  e.moments = Eigen::Matrix3d(e.moments.selfadjointView<Eigen::Lower>()) / e.count;
  e.right = sum;
  return e;
}

// Basis of the model's changes within the six: all, or a small turn (-y, x) and the two shifts.
// A Euclidean step has three unknowns, a similarity's a scale (x, y) as well, so that noise cannot
// become shear.
Eigen::Matrix<double, 6, Eigen::Dynamic> freedoms_of(ViewModel model) {
  if (model == ViewModel::affine) return Matrix6::Identity();
  Eigen::Matrix<double, 6, Eigen::Dynamic> freedoms =
      Eigen::MatrixXd::Zero(6, model == ViewModel::similarity ? 4 : 3);
  freedoms(1, 0) = -1, freedoms(3, 0) = 1;
  freedoms(2, 1) = 1, freedoms(5, 2) = 1;
  if (model == ViewModel::similarity) freedoms(0, 3) = 1, freedoms(4, 3) = 1;
  return freedoms;
}

// The warp of a step; Euclidean: an exact rotation by the small turn, so that no scale creeps in.
Eigen::Affine2d change_of(const Vector6& d, const ViewFrame& frame, ViewModel model) {
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

// n step^2 pixels of the first view lie in the second, of its b.total().
// An empty overlap has correlation and share 0.
ViewOverlap overlap_of(const RegistrationView& first, const RegistrationView& second,
                       const Eigen::Affine2d& second_from_first, int level, int step) {
  const RegistrationView::Level& b = second.level(level);
  const PairMoments m = pair_moments(first.level(level), b, second_from_first, step);
  if (m.n < 2) return {};
  return {m.correlation(), m.n * step * step / static_cast<double>(b.image.total())};
}

// Nothing with fewer than 400 pixels in common, or where the structure does not determine the step,
// as parallel vessels do not. `second_from_first` is improved in place.
std::optional<double> refine_at_level(const RegistrationView& first, const RegistrationView& second,
                                      Eigen::Affine2d& second_from_first, int level,
                                      ViewModel model) {
  const RegistrationView::Level& a = first.level(level);
  const RegistrationView::Level& b = second.level(level);
  const Eigen::Matrix<double, 6, Eigen::Dynamic> freedoms = freedoms_of(model);
  double sigma = 0;
  double outlier = kOutlier;
  for (int k = 0; k < kIterations; ++k) {
    const PairMoments m = pair_moments(a, b, second_from_first, 2);
    if (4 * m.n < kFewestPixels) return std::nullopt;
    const RefineEquations e = refine_equations(a, b, second_from_first, m, outlier);
    const Eigen::LDLT<Eigen::MatrixXd> solver(freedoms.transpose() * e.information * freedoms);
    if (solver.info() != Eigen::Success || solver.rcond() < 1e-9) return std::nullopt;
    const Vector6 change = freedoms * solver.solve(freedoms.transpose() * e.right);
    if (!change.allFinite()) return std::nullopt;
    // Inverse compositional: the step was taken on the first view, so its inverse is applied
    // before.
    second_from_first = second_from_first * change_of(change, ViewFrame(a.image), model).inverse();
    const double rms = std::sqrt(e.squares / e.weights);
    // The noise is estimated in each round; at first the views are standardized to 1.
    outlier = kOutlier * std::max(rms, 0.05);
    const Eigen::MatrixXd inverse =
        solver.solve(Eigen::MatrixXd::Identity(freedoms.cols(), freedoms.cols()));
    // A step's covariance is (J' W J)^-1 s^2 for independent pixels, kSharedNoise times that here.
    // sigma: of the overlap's points, the root mean square distance: tr(C M) for both coordinates.
    const Matrix6 covariance =
        freedoms * inverse * freedoms.transpose() * (rms * rms * kSharedNoise);
    sigma = std::sqrt((covariance.topLeftCorner<3, 3>() * e.moments).trace() +
                      (covariance.bottomRightCorner<3, 3>() * e.moments).trace());
    if (change.lpNorm<Eigen::Infinity>() < kConvergedPx) break;
  }
  return sigma;
}

namespace {

// Sums of one part of the overlap, for its correlation and its own shift.
struct Part {
  PairMoments moments;
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right{0, 0};
};

constexpr int kPartsPerSide = 6;
constexpr double kFewestInPart = 150;   // pixels
constexpr double kPartStructure = 0.3;  // standard deviations of the whole view
constexpr double kPartAgrees = 0.4;     // correlation
constexpr double kShown = 0.2;          // of a part's information in its best direction
// px of the level, that the flattening of two views moves a part by, each its own way.
constexpr double kFlattening = 0.1;

// One coordinate of a part's own shift, along a direction in which it shows one.
struct PartShift {
  Eigen::Vector2d at;     // of the part's middle, -1 to 1 over the view
  Eigen::Vector2d along;  // unit
  double px;
  double variance;
};

using FieldVector = Eigen::Matrix<double, 12, 1>;
using FieldMatrix = Eigen::Matrix<double, 12, 12>;

// Six terms of either coordinate.
Eigen::Matrix<double, 2, 12> field_terms(const Eigen::Vector2d& p) {
  Eigen::Matrix<double, 1, 6> terms;
  terms << 1, p.x(), p.y(), p.x() * p.x(), p.x() * p.y(), p.y() * p.y();
  Eigen::Matrix<double, 2, 12> result = Eigen::Matrix<double, 2, 12>::Zero();
  result.row(0).head<6>() = terms;
  result.row(1).tail<6>() = terms;
  return result;
}

// Weighted least squares with a weak prior (3 px), so that few parts make no wild field, reweighted
// by Cauchy's function: a part with dirt in it is moved by that alone. The covariance grows by what
// the shifts scatter about the field beyond their own variances.
void fit_field(const std::vector<PartShift>& shifts, PartAgreement& result) {
  constexpr double kPrior = 1.0 / (3 * 3);
  constexpr int kRounds = 6;
  std::vector<double> weights(shifts.size(), 1);
  FieldMatrix inverse;
  FieldVector field;
  double scatter = 0;
  for (int round = 0; round < kRounds; ++round) {
    FieldMatrix information = kPrior * FieldMatrix::Identity();
    FieldVector right = FieldVector::Zero();
    for (std::size_t k = 0; k < shifts.size(); ++k) {
      const PartShift& one = shifts[k];
      const FieldVector row = field_terms(one.at).transpose() * one.along;
      information += row * row.transpose() * (weights[k] / one.variance);
      right += row * (one.px * weights[k] / one.variance);
    }
    inverse = information.inverse();
    field = inverse * right;
    double chi2 = 0;
    double total = 0;
    for (std::size_t k = 0; k < shifts.size(); ++k) {
      const PartShift& one = shifts[k];
      const double miss = one.px - one.along.dot(field_terms(one.at) * field);
      const double squared = miss * miss / one.variance;
      chi2 += weights[k] * squared;
      total += weights[k];
      weights[k] = 1 / (1 + squared / 4);
    }
    scatter = std::max(chi2 / std::max(total - 12, 1.0), 1.0);
  }
  double squares = 0;
  double noise = 0;
  for (const PartShift& one : shifts) {
    const Eigen::Matrix<double, 2, 12> terms = field_terms(one.at);
    squares += (terms * field).squaredNorm();
    noise += (terms * inverse * terms.transpose()).trace();
  }
  const auto count = static_cast<double>(shifts.size());
  result.field_px = std::sqrt(squares / count);
  result.field_noise_px = std::sqrt(scatter * noise / count);
}

using Parts = std::array<Part, kPartsPerSide * kPartsPerSide>;

// The sums of each part of the first view.
Parts parts_of(const RegistrationView::Level& a, const RegistrationView::Level& b,
               const Eigen::Affine2d& second_from_first) {
  Parts parts;
  for_overlap(a, b, second_from_first, 1, [&](int u, int v, double gray) {
    Part& part = parts[static_cast<std::size_t>((v * kPartsPerSide / a.image.rows) * kPartsPerSide +
                                                u * kPartsPerSide / a.image.cols)];
    const double value = a.image.at<float>(v, u);
    const Eigen::Vector2d slope(a.du.at<float>(v, u), a.dv.at<float>(v, u));
    part.moments.add(value, gray);
    part.information += slope * slope.transpose();
    part.right += (gray - value) * slope;
  });
  return parts;
}

// One Gauss-Newton step of a shift alone (Lucas & Kanade 1981). A part with one straight vessel
// does not say how far it is off along it: only directions that it shows count (the aperture
// problem).
void add_shifts(const Part& part, const Eigen::Vector2d& at, std::vector<PartShift>& shifts) {
  const double noise = part.moments.difference() * kSharedNoise;
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> along(part.information);
  for (int k = 0; k < 2; ++k) {
    const double information = along.eigenvalues()[k];
    if (information < kShown * along.eigenvalues()[1] || !(information > 0)) continue;
    shifts.push_back({at, along.eigenvectors().col(k),
                      along.eigenvectors().col(k).dot(part.right) / information,
                      noise / information + kFlattening * kFlattening});
  }
}

}  // namespace

// A part whose structure shows in both views and does not correlate speaks against the pose.
PartAgreement agreement_of(const RegistrationView& first, const RegistrationView& second,
                           const Eigen::Affine2d& second_from_first, int level) {
  const Parts parts = parts_of(first.level(level), second.level(level), second_from_first);
  const auto middle = [](std::size_t k) {
    return (static_cast<double>(k) + 0.5) * 2 / kPartsPerSide - 1;
  };
  PartAgreement result;
  std::vector<PartShift> shifts;
  for (std::size_t k = 0; k < parts.size(); ++k) {
    const PairMoments& m = parts[k].moments;
    if (m.n < kFewestInPart || std::min(m.sigma_a(), m.sigma_b()) < kPartStructure) continue;
    ++result.parts;
    if (m.correlation() < kPartAgrees) continue;
    ++result.agreeing;
    add_shifts(parts[k], {middle(k % kPartsPerSide), middle(k / kPartsPerSide)}, shifts);
  }
  if (shifts.empty()) return result;
  double squares = 0;
  for (const PartShift& one : shifts) squares += one.px * one.px;
  result.rms_px = std::sqrt(squares / static_cast<double>(shifts.size()));
  fit_field(shifts, result);
  return result;
}

}  // namespace vitreo::vision
