// SPDX-License-Identifier: Apache-2.0
#include "vision/shape_model.h"

#include "vision/bytes.h"
#include "vision/moments.h"
#include "vision/preconditions.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;
using RowMajor8 = Eigen::Matrix<double, 8, 8, Eigen::RowMajor>;
using ShapeSample = ShapeModel::Sample;

constexpr std::string_view kShapeMagic = "VTSM";
constexpr std::uint32_t kShapeVersion = 1;
constexpr int kShapeGrid = ShapeModel::kGrid;
constexpr std::size_t kSamples = static_cast<std::size_t>(kShapeGrid) * kShapeGrid;
constexpr double kPerUnit =
    (kShapeGrid - 1) / (2 * ShapeModel::kReach);  // grid steps per unit of scale
constexpr double kMostWeight = 3;                 // standard deviations of a mode
constexpr double kPointSigma = 0.7;               // px: a front pixel's distance to the true rim

// Values of mean and modes at a position of the grid, and their derivatives per grid step; as wide
// as a sample, so that a compiler makes vectors of them.
struct ModeValues {
  ShapeSample value;
  ShapeSample by_x;
  ShapeSample by_y;
};

// Between which samples a position lies, and where.
struct GridPlace {
  std::size_t sample;
  float x;
  float y;
};

// Bilinear in the grid; x, y in units of the scale. Outside of the grid, the values at its border.
// Clamped: far outside of the shape only the sign of the distance counts.
GridPlace grid_place(double x, double y) {
  const double gx = std::clamp((x + ShapeModel::kReach) * kPerUnit, 0.0, kShapeGrid - 1.001);
  const double gy = std::clamp((y + ShapeModel::kReach) * kPerUnit, 0.0, kShapeGrid - 1.001);
  const auto i = static_cast<std::size_t>(gx);
  const auto j = static_cast<std::size_t>(gy);
  return {j * kShapeGrid + i, static_cast<float>(gx - static_cast<double>(i)),
          static_cast<float>(gy - static_cast<double>(j))};
}

ModeValues interpolate(const std::vector<ShapeSample>& samples, const GridPlace& place) {
  const ShapeSample* p = &samples[place.sample];
  const ShapeSample* q = p + kShapeGrid;
  ModeValues at;
  for (std::size_t k = 0; k < at.value.size(); ++k) {
    const float upper = p[1][k] - p[0][k];
    const float lower = q[1][k] - q[0][k];
    const float top = p[0][k] + place.x * upper;
    const float bottom = q[0][k] + place.x * lower;
    at.by_y[k] = bottom - top;
    at.by_x[k] = upper + place.y * (lower - upper);
    at.value[k] = top + place.y * at.by_y[k];
  }
  return at;
}

// One for the mean, then the weights, as (8.3) has them: mean + sum a_i v_i, the modes in units of
// their standard deviations.
ShapeSample factors_of(const std::array<double, kMaxModes>& weights) {
  ShapeSample factors{1};
  for (std::size_t k = 0; k < kMaxModes; ++k) factors[k + 1] = static_cast<float>(weights[k]);
  return factors;
}

float weighted_sum(const ShapeSample& values, const ShapeSample& factors) {
  return ((values[0] + values[1] * factors[1]) +
          (values[2] * factors[2] + values[3] * factors[3])) +
         values[4] * factors[4];
}

// Signed distance of a mask to its rim, px, negative inside.
// What is at the rim to half a pixel lets front and prior agree without a bias.
cv::Mat signed_distance(const cv::Mat& mask) {
  cv::Mat inside;
  cv::Mat outside;
  cv::Mat object = mask != 0;
  cv::distanceTransform(object, inside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  cv::distanceTransform(~object, outside, cv::DIST_L2, cv::DIST_MASK_PRECISE);
  // The transform counts from pixel center to pixel center: the rim is half a pixel before each.
  cv::Mat distance(mask.size(), CV_32F);
  for (int v = 0; v < mask.rows; ++v) {
    for (int u = 0; u < mask.cols; ++u) {
      const bool in = object.at<unsigned char>(v, u) != 0;
      distance.at<float>(v, u) =
          in ? 0.5F - inside.at<float>(v, u) : outside.at<float>(v, u) - 0.5F;
    }
  }
  return distance;
}

// The signed distance on the model's grid, in units of the scale: the similarity that maps the pose
// to the origin, angle 0 and scale 1.
// Distances are divided by the scale too, so that shapes of different size are comparable.
Eigen::VectorXd register_distance(const cv::Mat& distance, const ShapePose& pose) {
  const double c = std::cos(pose.angle);
  const double s = std::sin(pose.angle);
  const double step = pose.scale_px / kPerUnit;
  cv::Mat image_from_grid =
      (cv::Mat_<double>(2, 3) << c * step, -s * step, 0, s * step, c * step, 0);
  const double half = (kShapeGrid - 1) / 2.0;
  image_from_grid.at<double>(0, 2) = pose.center_px.x() - (c - s) * step * half;
  image_from_grid.at<double>(1, 2) = pose.center_px.y() - (s + c) * step * half;
  cv::Mat grid;
  cv::warpAffine(distance, grid, image_from_grid, {kShapeGrid, kShapeGrid},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  Eigen::VectorXd values(static_cast<Eigen::Index>(kSamples));
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    values[k] = grid.at<float>(static_cast<int>(k) / kShapeGrid, static_cast<int>(k) % kShapeGrid) /
                pose.scale_px;
  }
  return values;
}

// The radius of the circle of the ellipse's area pi a b is sqrt(a b).
ShapePose pose_from(const Ellipse& e) {
  return {e.center_px, e.angle, std::sqrt(std::max(e.semi_major_px * e.semi_minor_px, 1.0))};
}

// One column per mask: its signed distance, registered by centroid, major axis and area.
// By moments instead of the thesis' image correlation: no search, and no start that could be wrong.
Eigen::MatrixXd registered_shapes(std::span<const cv::Mat> masks) {
  const auto count = static_cast<Eigen::Index>(masks.size());
  Eigen::MatrixXd shapes(static_cast<Eigen::Index>(kSamples), count);
  for (Eigen::Index k = 0; k < count; ++k) {
    const cv::Mat& mask = masks[static_cast<std::size_t>(k)];
    const int on = mask.type() == CV_8UC1 ? cv::countNonZero(mask) : 0;
    require(on > 0 && on < mask.rows * mask.cols,
            "mask " + std::to_string(k + 1) + ": must be 8-bit gray, neither empty nor full");
    const cv::Mat distance = signed_distance(mask);
    ShapePose pose = pose_from(moments_of(mask).ellipse({0, 0}));
    shapes.col(k) = register_distance(distance, pose);
    if (k == 0) continue;
    // A major axis has no sense: the one more like the masks before is taken.
    const Eigen::VectorXd mean = shapes.leftCols(k).rowwise().mean();
    pose.angle += 3.14159265358979323846;
    const Eigen::VectorXd turned = register_distance(distance, pose);
    if ((turned - mean).squaredNorm() < (shapes.col(k) - mean).squaredNorm())
      shapes.col(k) = turned;
  }
  return shapes;
}

struct ShapeEquations {
  std::array<std::array<double, 8>, 8> matrix{};  // the lower half counts
  std::array<double, 8> right{};
  double cost = 0;
  int inliers = 0;
};

// One front point's share of the normal equations of -log (8.6) for (u, v, angle, log scale,
// weights): the residual is s phi*(x, y) - distance with (x, y) = R' (p - c) / s. In place of the
// Laplacian of (8.6) Tukey's rho(r) = t^2 / 6 (1 - (1 - (r / t)^2)^3), whose weight is (1 - (r /
// t)^2)^2: parts of the front on vessels, or missing behind an occlusion, do not pull.
void add_point(ShapeEquations& sum, const std::vector<ShapeSample>& samples, const ShapeFit& fit,
               const ShapeSample& factors, const FrontPoint& point, const Eigen::Vector2d& turn,
               double tukey) {
  const double du = point.u - fit.pose.center_px.x();
  const double dv = point.v - fit.pose.center_px.y();
  const double s = fit.pose.scale_px;
  const double x = (turn.x() * du + turn.y() * dv) / s;
  const double y = (turn.x() * dv - turn.y() * du) / s;
  const ModeValues at = interpolate(samples, grid_place(x, y));
  const double value = weighted_sum(at.value, factors);
  const double gx = kPerUnit * weighted_sum(at.by_x, factors);
  const double gy = kPerUnit * weighted_sum(at.by_y, factors);
  const double off = s * value - point.distance;
  const double share = 1 - off * off / (tukey * tukey);
  sum.cost +=
      tukey * tukey / 6 * (share > 0 ? 1 - share * share * share : 1) / (kPointSigma * kPointSigma);
  if (share <= 0) return;
  ++sum.inliers;
  const std::array<double, 8> row{turn.y() * gy - turn.x() * gx,
                                  -turn.y() * gx - turn.x() * gy,
                                  s * (gx * y - gy * x),
                                  s * (value - gx * x - gy * y),
                                  s * at.value[1],
                                  s * at.value[2],
                                  s * at.value[3],
                                  s * at.value[4]};
  const double weight = share * share / (kPointSigma * kPointSigma);
  for (std::size_t i = 0; i < 8; ++i) {
    const double of_row = weight * row[i];
    // Columns by pairs up to the diagonal: whole vectors.
    for (std::size_t j = 0; j < (i | 1) + 1; ++j) sum.matrix[i][j] += of_row * row[j];
    sum.right[i] -= of_row * off;
  }
}

}  // namespace

// Refers to `model`; the sine and cosine are taken once for all points.
PlacedShape::PlacedShape(const ShapeModel& model, const ShapeFit& fit)
    : model_(&model),
      fit_(fit),
      factors_(factors_of(fit.weights)),
      cos_(std::cos(fit.pose.angle)),
      sin_(std::sin(fit.pose.angle)) {}

// In px: the model's distances are in units of the scale.
double PlacedShape::at(double u, double v) const {
  const double du = u - fit_.pose.center_px.x();
  const double dv = v - fit_.pose.center_px.y();
  const double s = fit_.pose.scale_px;
  const GridPlace place = grid_place((cos_ * du + sin_ * dv) / s, (cos_ * dv - sin_ * du) / s);
  return s *
         static_cast<double>(weighted_sum(interpolate(model_->samples(), place).value, factors_));
}

ShapePose ShapeModel::pose_of(const Ellipse& e) const { return pose_from(e); }

// Principal components by the Gram matrix (method of snapshots, Sirovich 1987): there are far fewer
// masks than samples, and an eigenvector w of X'X / n with the eigenvalue l gives the eigenshape X
// w of the covariance X X' / n, with |X w|^2 = n l. Leventon et al. 2000 have the same from the SVD
// of X.
ShapeModel ShapeModel::train(std::span<const cv::Mat> masks) {
  require(!masks.empty(), "masks: none given");
  Eigen::MatrixXd shapes = registered_shapes(masks);
  const Eigen::Index count = shapes.cols();
  const Eigen::VectorXd mean = shapes.rowwise().mean();
  shapes.colwise() -= mean;
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(shapes.transpose() * shapes /
                                                              static_cast<double>(count));
  ShapeModel model;
  model.samples_.assign(kSamples, ShapeSample{});
  for (std::size_t p = 0; p < kSamples; ++p)
    model.samples_[p][0] = static_cast<float>(mean[static_cast<Eigen::Index>(p)]);
  const double total = std::max(solver.eigenvalues().sum(), 1e-12);
  // Eigen sorts ascending. n centered shapes have n - 1 modes at most.
  for (int m = 0; m < kMaxModes && m < count - 1; ++m) {
    const double value = solver.eigenvalues()[count - 1 - m];
    if (!(value > 1e-6 * total) || !(value > 1e-9)) break;
    const Eigen::VectorXd mode = shapes * solver.eigenvectors().col(count - 1 - m);
    const auto column = static_cast<std::size_t>(m);
    // X w / sqrt(n) has the norm sqrt(l): a weight of 1 is one standard deviation.
    const double unit = 1 / std::sqrt(static_cast<double>(count));
    for (std::size_t p = 0; p < kSamples; ++p) {
      model.samples_[p][column + 1] = static_cast<float>(unit * mode[static_cast<Eigen::Index>(p)]);
    }
    model.eigenvalues_[column] = value;
    model.explained_ += value / total;
    model.modes_ = m + 1;
  }
  model.find_reach();
  return model;
}

// Maximum a posteriori (8.4) by Gauss-Newton on -log of (8.5): the front (8.6), robust by
// re-weighting with a scale that narrows from first_px to last_px; the weights' Gaussian (8.8),
// with Sigma_k the unit matrix as they count in standard deviations; and for the pose a Gaussian
// motion prior around the prediction instead of the uniform (8.9). Steps are limited, as the
// linearization holds for small ones.
// Without a front the prediction is returned, with no inliers. The covariance of the pose is not
// kept: what is measured comes from the rim, not from here.
ShapeFit ShapeModel::fit(std::span<const FrontPoint> front, const ShapePose& predicted,
                         const ShapeFitSettings& settings) const {
  ShapeFit fit;
  fit.pose = predicted;
  if (front.empty()) return fit;
  const auto most = static_cast<std::size_t>(std::max(settings.max_points, 8));
  const std::size_t step = std::max<std::size_t>((front.size() + most - 1) / most, 1);
  const std::size_t count = (front.size() + step - 1) / step;
  const Eigen::Vector4d sigma(settings.center_px, settings.center_px, settings.angle,
                              settings.scale);
  // Geometric, so that the last round has last_px.
  const double shrink =
      std::pow(settings.last_px / settings.first_px, 1.0 / std::max(settings.iterations - 1, 1));
  double tukey = settings.first_px;
  for (int i = 0; i < settings.iterations; ++i, tukey *= shrink) {
    ShapeEquations sum;
    const Eigen::Vector2d turn(std::cos(fit.pose.angle), std::sin(fit.pose.angle));
    const ShapeSample factors = factors_of(fit.weights);
    for (std::size_t k = 0; k < front.size(); k += step)
      add_point(sum, samples_, fit, factors, front[k], turn, tukey);
    Matrix8 matrix = Eigen::Map<const RowMajor8>(sum.matrix.front().data());
    Vector8 right = Eigen::Map<const Vector8>(sum.right.data());
    Vector8 from_prior;
    from_prior << fit.pose.center_px - predicted.center_px, fit.pose.angle - predicted.angle,
        std::log(fit.pose.scale_px / predicted.scale_px), fit.weights[0], fit.weights[1],
        fit.weights[2], fit.weights[3];
    Vector8 stiffness = Vector8::Ones();  // inverse variances; 1 for the weights: (8.8)
    stiffness.head<4>() = sigma.cwiseProduct(sigma).cwiseInverse();
    matrix.diagonal() += stiffness;
    right -= stiffness.cwiseProduct(from_prior);
    fit.log_posterior = -sum.cost - 0.5 * from_prior.dot(stiffness.cwiseProduct(from_prior));
    fit.inlier_fraction = static_cast<double>(sum.inliers) / static_cast<double>(count);
    const Vector8 move = matrix.selfadjointView<Eigen::Lower>().ldlt().solve(right);
    if (!move.allFinite()) break;
    fit.pose.center_px += move.head<2>();
    fit.pose.angle += std::clamp(move[2], -0.3, 0.3);
    fit.pose.scale_px *= std::exp(std::clamp(move[3], -0.2, 0.2));
    for (std::size_t k = 0; k < kMaxModes; ++k) {
      fit.weights[k] = std::clamp(fit.weights[k] + move[static_cast<Eigen::Index>(k) + 4],
                                  -kMostWeight, kMostWeight);
    }
  }
  return fit;
}

// Of each row of the grid the even columns between which weights of up to kMostWeight may put the
// inside, or half a step beside it.
void ShapeModel::find_reach() {
  for (int j = 0; j < kShapeGrid; ++j) {
    std::pair<int, int>& reach = reach_[static_cast<std::size_t>(j)];
    reach = {0, 0};
    for (int i = 0; i < kShapeGrid; i += 2) {
      const ShapeSample& sample = samples_[static_cast<std::size_t>(j * kShapeGrid + i)];
      double least = static_cast<double>(sample[0]);
      for (std::size_t k = 1; k <= kMaxModes; ++k)
        least -= kMostWeight * std::abs(static_cast<double>(sample[k]));
      if (least * kPerUnit / 2 > 0.51) continue;
      if (reach.second == 0) reach.first = i;
      reach.second = i + 1;
    }
  }
}

// Second moments of the inside over every second sample of the grid, each covered by 1/2 - phi /
// spacing as the rim crosses it; then S = sqrt(4 covariance), turned to the pose.
// The coverage of cells at the rim makes the moments smooth in the weights.
Ellipse ShapeModel::ellipse_of(const ShapeFit& fit) const {
  double n = 0;
  double sx = 0;
  double sy = 0;
  double xx = 0;
  double xy = 0;
  double yy = 0;
  const ShapeSample factors = factors_of(fit.weights);
  for (int j = 0; j < kShapeGrid; j += 2) {
    const auto row = static_cast<std::size_t>(j * kShapeGrid);
    for (int i = reach_[static_cast<std::size_t>(j)].first;
         i < reach_[static_cast<std::size_t>(j)].second; i += 2) {
      const double value = weighted_sum(samples_[row + static_cast<std::size_t>(i)], factors);
      const double cover = std::clamp(0.5 - value * kPerUnit / 2, 0.0, 1.0);
      n += cover, sx += cover * i, sy += cover * j, xx += cover * i * i, xy += cover * i * j,
          yy += cover * j * j;
    }
  }
  if (!(n > 0)) return {};
  const double mx = sx / n;
  const double my = sy / n;
  const double unit = fit.pose.scale_px / kPerUnit;
  const double half = (kShapeGrid - 1) / 2.0;
  Eigen::Matrix2d spread;
  spread << xx / n - mx * mx, xy / n - mx * my, xy / n - mx * my, yy / n - my * my;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> solver;
  solver.computeDirect(4 * unit * unit * spread);
  const Eigen::Rotation2Dd turn(fit.pose.angle);
  const Eigen::Matrix2d shape =
      turn.toRotationMatrix() * solver.operatorSqrt() * turn.toRotationMatrix().transpose();
  return Ellipse::from_shape(
      fit.pose.center_px + unit * (turn * Eigen::Vector2d(mx - half, my - half)), shape);
}

// Format "VTSM", version 1: modes, explained variance, eigenvalues, then mean and four modes of
// each sample.
std::string ShapeModel::save() const {
  ByteWriter out;
  out.text(kShapeMagic);
  out.u32(kShapeVersion);
  out.u32(static_cast<std::uint32_t>(modes_));
  out.f64(explained_);
  for (const double value : eigenvalues_) out.f64(value);
  for (const ShapeSample& sample : samples_) {
    for (std::size_t k = 0; k < 5; ++k) out.f32(sample[k]);
  }
  return out.sealed();
}

// Throws std::invalid_argument for bytes that save() did not write.
ShapeModel ShapeModel::load(std::string_view bytes) {
  ByteReader in(bytes, kShapeMagic, kShapeVersion, "shape model");
  ShapeModel model;
  model.modes_ = in.integer(0, kMaxModes);
  model.explained_ = in.f64(0, 1 + 1e-9);
  for (double& value : model.eigenvalues_) value = in.f64(0, 1e9);
  model.samples_.assign(kSamples, ShapeSample{});
  for (ShapeSample& sample : model.samples_) {
    for (std::size_t k = 0; k < 5; ++k) sample[k] = in.f32(-100, 100);
  }
  in.end();
  model.find_reach();
  return model;
}

}  // namespace vitreo::vision
