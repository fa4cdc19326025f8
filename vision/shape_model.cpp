// SPDX-License-Identifier: Apache-2.0
#include "vision/shape_model.h"

#include "vision/bytes.h"
#include "vision/moments.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::vision {
namespace {

using Vector8 = Eigen::Matrix<double, 8, 1>;
using Matrix8 = Eigen::Matrix<double, 8, 8>;
using Sample = ShapeModel::Sample;

constexpr std::string_view kMagic = "VTSM";
constexpr std::uint32_t kVersion = 1;
constexpr int kGrid = ShapeModel::kGrid;
constexpr std::size_t kSamples = static_cast<std::size_t>(kGrid) * kGrid;
constexpr double kPerUnit = (kGrid - 1) / (2 * ShapeModel::kReach);  // grid steps per unit of scale
constexpr double kPointSigma = 0.7;  // px: a front pixel's distance to the true rim

// Values of mean and modes at a place of the grid, and their derivatives per unit of scale.
struct Looked {
  std::array<float, 5> value, by_x, by_y;
};

Looked look(const std::vector<Sample>& samples, double x, double y) {
  const double gx = std::clamp((x + ShapeModel::kReach) * kPerUnit, 0.0, kGrid - 1.001);
  const double gy = std::clamp((y + ShapeModel::kReach) * kPerUnit, 0.0, kGrid - 1.001);
  const auto i = static_cast<std::size_t>(gx), j = static_cast<std::size_t>(gy);
  const auto fx = static_cast<float>(gx - static_cast<double>(i)),
             fy = static_cast<float>(gy - static_cast<double>(j));
  const Sample *p = &samples[j * kGrid + i], *q = p + kGrid;
  Looked at;
  for (std::size_t k = 0; k < 5; ++k) {
    const float top = p[0][k] + fx * (p[1][k] - p[0][k]),
                bottom = q[0][k] + fx * (q[1][k] - q[0][k]);
    at.value[k] = top + fy * (bottom - top);
    at.by_y[k] = (bottom - top) * static_cast<float>(kPerUnit);
    at.by_x[k] =
        ((1 - fy) * (p[1][k] - p[0][k]) + fy * (q[1][k] - q[0][k])) * static_cast<float>(kPerUnit);
  }
  return at;
}

double mix(const std::array<float, 5>& values, const std::array<double, kMaxModes>& weights) {
  double sum = values[0];
  for (std::size_t k = 0; k < kMaxModes; ++k) sum += weights[k] * values[k + 1];
  return sum;
}

// Signed distance of a mask to its rim, px, negative inside.
cv::Mat signed_distance(const cv::Mat& mask) {
  cv::Mat inside, outside, object = mask != 0;
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

// The signed distance on the model's grid, in units of the scale.
Eigen::VectorXd registered(const cv::Mat& distance, const ShapePose& pose) {
  const double c = std::cos(pose.angle), s = std::sin(pose.angle), step = pose.scale_px / kPerUnit;
  cv::Mat image_from_grid =
      (cv::Mat_<double>(2, 3) << c * step, -s * step, 0, s * step, c * step, 0);
  const double half = (kGrid - 1) / 2.0;
  image_from_grid.at<double>(0, 2) = pose.center_px.x() - (c - s) * step * half;
  image_from_grid.at<double>(1, 2) = pose.center_px.y() - (s + c) * step * half;
  cv::Mat grid;
  cv::warpAffine(distance, grid, image_from_grid, {kGrid, kGrid},
                 cv::INTER_LINEAR | cv::WARP_INVERSE_MAP, cv::BORDER_REPLICATE);
  Eigen::VectorXd values(static_cast<Eigen::Index>(kSamples));
  for (Eigen::Index k = 0; k < values.size(); ++k) {
    values[k] =
        grid.at<float>(static_cast<int>(k) / kGrid, static_cast<int>(k) % kGrid) / pose.scale_px;
  }
  return values;
}

struct Equations {
  Matrix8 matrix = Matrix8::Zero();
  Vector8 right = Vector8::Zero();
  double cost = 0;
  int in_line = 0;
};

// One point's share of the normal equations for (u, v, angle, log scale, weights); (8.6) with a
// Tukey norm.
void add_point(Equations& sum, const std::vector<Sample>& samples, const ShapeFit& fit,
               const FrontPoint& point, const Eigen::Vector2d& turn, double tukey) {
  const double du = point.u - fit.pose.center_px.x(), dv = point.v - fit.pose.center_px.y(),
               s = fit.pose.scale_px;
  const double x = (turn.x() * du + turn.y() * dv) / s, y = (turn.x() * dv - turn.y() * du) / s;
  const Looked at = look(samples, x, y);
  const double value = mix(at.value, fit.weights), gx = mix(at.by_x, fit.weights),
               gy = mix(at.by_y, fit.weights);
  const double off = s * value - point.distance, share = 1 - off * off / (tukey * tukey);
  sum.cost +=
      tukey * tukey / 6 * (share > 0 ? 1 - share * share * share : 1) / (kPointSigma * kPointSigma);
  if (share <= 0) return;
  ++sum.in_line;
  Vector8 row;
  row << turn.y() * gy - turn.x() * gx, -turn.y() * gx - turn.x() * gy, s * (gx * y - gy * x),
      s * (value - gx * x - gy * y), s * at.value[1], s * at.value[2], s * at.value[3],
      s * at.value[4];
  const double weight = share * share / (kPointSigma * kPointSigma);
  sum.matrix.selfadjointView<Eigen::Lower>().rankUpdate(row, weight);
  sum.right -= weight * off * row;
}

}  // namespace

PlacedShape::PlacedShape(const ShapeModel& model, const ShapeFit& fit)
    : model_(&model), fit_(fit), cos_(std::cos(fit.pose.angle)), sin_(std::sin(fit.pose.angle)) {}

double PlacedShape::at(double u, double v) const {
  const double du = u - fit_.pose.center_px.x(), dv = v - fit_.pose.center_px.y(),
               s = fit_.pose.scale_px;
  return s * mix(look(model_->samples(), (cos_ * du + sin_ * dv) / s, (cos_ * dv - sin_ * du) / s)
                     .value,
                 fit_.weights);
}

ShapePose ShapeModel::pose_of(const Ellipse& e) const {
  return {e.center_px, e.angle, std::sqrt(std::max(e.semi_major_px * e.semi_minor_px, 1.0))};
}

ShapeModel ShapeModel::train(std::span<const cv::Mat> masks) {
  if (masks.empty()) throw std::invalid_argument("masks: none given");
  const auto count = static_cast<Eigen::Index>(masks.size()),
             size = static_cast<Eigen::Index>(kSamples);
  Eigen::MatrixXd shapes(size, count);
  ShapeModel model;
  for (Eigen::Index k = 0; k < count; ++k) {
    const cv::Mat& mask = masks[static_cast<std::size_t>(k)];
    const int on = mask.type() == CV_8UC1 ? cv::countNonZero(mask) : 0;
    if (on == 0 || on == mask.rows * mask.cols) {
      throw std::invalid_argument("mask " + std::to_string(k + 1) +
                                  ": must be 8-bit gray, neither empty nor full");
    }
    const cv::Mat distance = signed_distance(mask);
    ShapePose pose = model.pose_of(moments_of(mask).ellipse({0, 0}));
    shapes.col(k) = registered(distance, pose);
    if (k == 0) continue;
    // A major axis has no sense: take the one that looks more like the others.
    const Eigen::VectorXd mean = shapes.leftCols(k).rowwise().mean();
    pose.angle += 3.14159265358979323846;
    const Eigen::VectorXd turned = registered(distance, pose);
    if ((turned - mean).squaredNorm() < (shapes.col(k) - mean).squaredNorm())
      shapes.col(k) = turned;
  }
  const Eigen::VectorXd mean = shapes.rowwise().mean();
  shapes.colwise() -= mean;
  // Few masks, many samples: the eigenshapes are combinations of the masks.
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(shapes.transpose() * shapes /
                                                              static_cast<double>(count));
  model.samples_.assign(kSamples, Sample{});
  for (std::size_t p = 0; p < kSamples; ++p)
    model.samples_[p][0] = static_cast<float>(mean[static_cast<Eigen::Index>(p)]);
  const double total = std::max(solver.eigenvalues().sum(), 1e-12);
  for (int m = 0; m < kMaxModes && m < count - 1; ++m) {
    const double value = solver.eigenvalues()[count - 1 - m];
    if (!(value > 1e-6 * total) || !(value > 1e-9)) break;
    const Eigen::VectorXd mode = shapes * solver.eigenvectors().col(count - 1 - m);
    const auto column = static_cast<std::size_t>(m);
    // ||mode||^2 = count value, and a weight of 1 is one standard deviation, sqrt(value), along the
    // unit mode.
    const double unit = 1 / std::sqrt(static_cast<double>(count));
    for (std::size_t p = 0; p < kSamples; ++p) {
      model.samples_[p][column + 1] = static_cast<float>(unit * mode[static_cast<Eigen::Index>(p)]);
    }
    model.eigenvalues_[column] = value;
    model.explained_ += value / total;
    model.modes_ = m + 1;
  }
  return model;
}

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
  const double shrink =
      std::pow(settings.last_px / settings.first_px, 1.0 / std::max(settings.iterations - 1, 1));
  double tukey = settings.first_px;
  for (int i = 0; i < settings.iterations; ++i, tukey *= shrink) {
    Equations sum;
    const Eigen::Vector2d turn(std::cos(fit.pose.angle), std::sin(fit.pose.angle));
    for (std::size_t k = 0; k < front.size(); k += step)
      add_point(sum, samples_, fit, front[k], turn, tukey);
    Vector8 from_prior;
    from_prior << fit.pose.center_px - predicted.center_px, fit.pose.angle - predicted.angle,
        std::log(fit.pose.scale_px / predicted.scale_px), fit.weights[0], fit.weights[1],
        fit.weights[2], fit.weights[3];
    Vector8 stiffness = Vector8::Ones();  // (8.8): the weights count in standard deviations
    stiffness.head<4>() = sigma.cwiseProduct(sigma).cwiseInverse();
    sum.matrix.diagonal() += stiffness;
    sum.right -= stiffness.cwiseProduct(from_prior);
    fit.log_posterior = -sum.cost - 0.5 * from_prior.dot(stiffness.cwiseProduct(from_prior));
    fit.in_line = static_cast<double>(sum.in_line) / static_cast<double>(count);
    const Vector8 move = sum.matrix.selfadjointView<Eigen::Lower>().ldlt().solve(sum.right);
    if (!move.allFinite()) break;
    fit.pose.center_px += move.head<2>();
    fit.pose.angle += std::clamp(move[2], -0.3, 0.3);
    fit.pose.scale_px *= std::exp(std::clamp(move[3], -0.2, 0.2));
    for (std::size_t k = 0; k < kMaxModes; ++k) {
      fit.weights[k] =
          std::clamp(fit.weights[k] + move[static_cast<Eigen::Index>(k) + 4], -3.0, 3.0);
    }
  }
  return fit;
}

Ellipse ShapeModel::ellipse_of(const ShapeFit& fit) const {
  double n = 0, sx = 0, sy = 0, xx = 0, xy = 0, yy = 0;
  for (int j = 0; j < kGrid; j += 2) {
    for (int i = 0; i < kGrid; i += 2) {
      const Sample& sample = samples_[static_cast<std::size_t>(j * kGrid + i)];
      double value = sample[0];
      for (std::size_t k = 0; k < kMaxModes; ++k) value += fit.weights[k] * sample[k + 1];
      const double cover = std::clamp(0.5 - value * kPerUnit / 2, 0.0, 1.0);
      n += cover, sx += cover * i, sy += cover * j, xx += cover * i * i, xy += cover * i * j,
          yy += cover * j * j;
    }
  }
  if (!(n > 0)) return {};
  const double mx = sx / n, my = sy / n, unit = fit.pose.scale_px / kPerUnit,
               half = (kGrid - 1) / 2.0;
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

std::string ShapeModel::save() const {
  ByteWriter out;
  out.text(kMagic);
  out.u32(kVersion);
  out.u32(static_cast<std::uint32_t>(modes_));
  out.f64(explained_);
  for (const double value : eigenvalues_) out.f64(value);
  for (const Sample& sample : samples_) {
    for (std::size_t k = 0; k < 5; ++k) out.f32(sample[k]);
  }
  return out.sealed();
}

ShapeModel ShapeModel::load(std::string_view bytes) {
  ByteReader in(bytes, kMagic, kVersion, "shape model");
  ShapeModel model;
  model.modes_ = in.integer(0, kMaxModes);
  model.explained_ = in.f64(0, 1 + 1e-9);
  for (double& value : model.eigenvalues_) value = in.f64(0, 1e9);
  model.samples_.assign(kSamples, Sample{});
  for (Sample& sample : model.samples_) {
    for (std::size_t k = 0; k < 5; ++k) sample[k] = in.f32(-100, 100);
  }
  in.end();
  return model;
}

}  // namespace vitreo::vision
