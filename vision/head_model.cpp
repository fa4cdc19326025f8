// SPDX-License-Identifier: Apache-2.0
#include "vision/head_model.h"

#include "vision/disturbance.h"
#include "vision/moments.h"
#include "vision/preconditions.h"

#include <Eigen/Geometry>
#include <Eigen/LU>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace vitreo::vision {
namespace {

constexpr std::size_t kFewestTips = 4;
constexpr std::size_t kWhole = static_cast<std::size_t>(HeadModel::kColumns) * HeadModel::kRows;
constexpr std::size_t kPatch =
    static_cast<std::size_t>(HeadModel::kPatchColumns) * HeadModel::kPatchRows;
// Of the patch and its surroundings that are searched.
constexpr int kWideColumns = HeadModel::kPatchColumns + 2 * HeadModel::kSearch;
constexpr int kWideRows = HeadModel::kPatchRows + 2 * HeadModel::kSearch;
constexpr int kShifts = HeadModel::kShifts;
constexpr float kLeastVariance = 0.05F * 0.05F;  // of relative gray levels: noise and shading
constexpr float kMostTerm = 9;  // of a sample's squared deviation over its variance
// Samples that err as one: they lie nearer than the blur, and a vessel behind moves a dozen.
constexpr double kTogether = 10;
constexpr double kMostMisfit = 4;  // mean squared deviation over its variance of a tip that is seen
constexpr double kMostOdds = 6;    // of one image
constexpr double kCaution = 1.2;   // of a variance that is estimated
constexpr std::array<int, 6> kKinds{0, 1, 5, 8, 11, 17};  // disturbances that calibrate
// px, rad and share by which a tracker's ellipse is taken to err in the calibration.
constexpr double kErr_px = 0.3;
constexpr double kErrAngle = 0.02;
constexpr double kErrAxes = 0.01;

double scale_of(const Ellipse& e) { return std::sqrt(e.semi_major_px * e.semi_minor_px); }

// Between pixels, bilinear; beyond the border its pixels go on. Green counts half.
float gray_at(const cv::Mat& image, double u, double v) {
  const double cu = std::clamp(u, 0.0, image.cols - 1.001);
  const double cv = std::clamp(v, 0.0, image.rows - 1.001);
  const int i = static_cast<int>(cu);
  const int j = static_cast<int>(cv);
  const auto x = static_cast<float>(cu - i);
  const auto y = static_cast<float>(cv - j);
  const auto gray = [](const unsigned char* p) {
    return 0.25F * static_cast<float>(p[0] + 2 * p[1] + p[2]);
  };
  const unsigned char* p = image.ptr<unsigned char>(j) + 3 * static_cast<std::ptrdiff_t>(i);
  const unsigned char* q = image.ptr<unsigned char>(j + 1) + 3 * static_cast<std::ptrdiff_t>(i);
  return (gray(p) * (1 - x) + gray(p + 3) * x) * (1 - y) +
         (gray(q) * (1 - x) + gray(q + 3) * x) * y;
}

// Mean level within seven tenths of the ellipse, on a grid of 9 x 9 of its unit disc: what levels
// are compared with, so that neither light nor exposure counts.
float level_of(const cv::Mat& image, const Ellipse& body) {
  const Eigen::Rotation2Dd turn(body.angle);
  float sum = 0;
  int count = 0;
  for (int y = -4; y <= 4; ++y) {
    for (int x = -4; x <= 4; ++x) {
      if (x * x + y * y > 16) continue;
      const Eigen::Vector2d at =
          body.center_px + turn * Eigen::Vector2d(0.7 * x / 4 * body.semi_major_px,
                                                  0.7 * y / 4 * body.semi_minor_px);
      sum += gray_at(image, at.x(), at.y());
      ++count;
    }
  }
  return sum / static_cast<float>(count);
}

// Relative to the body's; dark bodies are not divided by noise.
float relative(float gray, float level) {
  return std::clamp((gray - level) / (level + 12), -3.0F, 3.0F);
}

// Relative gray levels around `center_px` on a grid of `step_px`, its x along `angle`.
void sample_grid(const cv::Mat& image, const Eigen::Vector2d& center_px, double angle,
                 const Eigen::Vector2d& step_px, int columns, int rows, float level, float* to) {
  const Eigen::Rotation2Dd turn(angle);
  for (int j = 0; j < rows; ++j) {
    for (int i = 0; i < columns; ++i) {
      const Eigen::Vector2d in(step_px.x() * (i - (columns - 1) / 2.0),
                               step_px.y() * (j - (rows - 1) / 2.0));
      const Eigen::Vector2d at = center_px + turn * in;
      *to++ = relative(gray_at(image, at.x(), at.y()), level);
    }
  }
}

// Mean and inverse variance of each sample; `all` by images.
void mean_and_weight(const std::vector<std::vector<float>>& all, std::vector<float>& mean,
                     std::vector<float>& weight) {
  const std::size_t size = all[0].size();
  const auto count = static_cast<float>(all.size());
  mean.assign(size, 0);
  weight.assign(size, 0);
  for (const std::vector<float>& one : all)
    for (std::size_t k = 0; k < size; ++k) mean[k] += one[k] / count;
  for (const std::vector<float>& one : all)
    for (std::size_t k = 0; k < size; ++k)
      weight[k] += (one[k] - mean[k]) * (one[k] - mean[k]) / (count - 1);
  for (float& w : weight) w = 1 / (w + kLeastVariance);
}

// A patch less its ground, which is what its columns show aside of the axis: a vessel that passes
// behind a needle moves both.
void flatten(const float* from, int stride, float* to) {
  constexpr int kRows = HeadModel::kPatchRows;
  constexpr int kAside = 3;  // rows at either side
  for (int i = 0; i < HeadModel::kPatchColumns; ++i) {
    float ground = 0;
    for (int j = 0; j < kAside; ++j)
      ground += (from[j * stride + i] + from[(kRows - 1 - j) * stride + i]) / (2 * kAside);
    for (int j = 0; j < kRows; ++j)
      to[j * HeadModel::kPatchColumns + i] = from[j * stride + i] - ground;
  }
}

}  // namespace

void HeadModel::sample_whole(const cv::Mat& image, const Ellipse& body, float* to) const {
  const double scale = scale_of(body);
  const Eigen::Vector2d step(2 * scale * reach_.x() / (kColumns - 1),
                             2 * scale * reach_.y() / (kRows - 1));
  sample_grid(image, body.center_px, body.angle, step, kColumns, kRows, level_of(image, body), to);
}

// log p(x|heading) - log p(x|opposite) of independent Gaussian samples; a half turn of the body's
// frame reverses the order of its samples, so both hypotheses look at the same ones.
double HeadModel::raw_odds(const cv::Mat& image, const Ellipse& body) const {
  std::array<float, kWhole> x;
  sample_whole(image, body, x.data());
  double sum = 0;
  for (std::size_t k = 0; k < kWhole; ++k) {
    const float along = x[k] - mean_[k];
    const float against = x[kWhole - 1 - k] - mean_[k];
    sum += static_cast<double>(std::min(against * against * weight_[k], kMostTerm) -
                               std::min(along * along * weight_[k], kMostTerm)) /
           2;
  }
  return sum / kTogether;
}

double HeadModel::log_odds(const cv::Mat& image, const Ellipse& body) const {
  return std::clamp(odds_factor_ * raw_odds(image, body), -kMostOdds, kMostOdds);
}

// Where the ellipse says that the tip is: p = c + s R(angle) t with s = sqrt(a b), so dp/da = s R t
// / (2 a), dp/db = s R t / (2 b) and dp/dangle = s R' t.
TipMeasurement HeadModel::predicted_tip(const EllipseMeasurement& body, double heading) const {
  const Ellipse& e = body.ellipse;
  const double scale = scale_of(e);
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(heading).toRotationMatrix();
  const Eigen::Vector2d offset = scale * turn * tip_;
  Eigen::Matrix<double, 2, 5> by;
  by << Eigen::Matrix2d::Identity(), offset / (2 * e.semi_major_px), offset / (2 * e.semi_minor_px),
      Eigen::Vector2d(-offset.y(), offset.x());
  return {
      e.center_px + offset,
      by * body.covariance * by.transpose() + scale * scale * turn * scatter_ * turn.transpose(),
      false};
}

// Costs of all shifts of the patch: half the squared deviations, as many as err apart, each
// bounded.
HeadModel::ShiftCosts HeadModel::costs_of(const float* wide, const Eigen::Matrix2d& prior) const {
  ShiftCosts costs;
  std::array<float, kPatch> patch;
  for (int dy = 0; dy < kShifts; ++dy) {
    for (int dx = 0; dx < kShifts; ++dx) {
      float sum = 0;
      flatten(wide + dy * kWideColumns + dx, kWideColumns, patch.data());
      for (std::size_t k = 0; k < kPatch; ++k) {
        const float off = patch[k] - patch_mean_[k];
        sum += std::min(off * off * patch_weight_[k], kMostTerm);
      }
      const Eigen::Vector2d shift(dx - kSearch, dy - kSearch);
      const auto k = static_cast<std::size_t>(dy * kShifts + dx);
      costs.misfit[k] = static_cast<double>(sum) / static_cast<double>(kPatch);
      costs.cost[k] = static_cast<double>(sum) / (2 * kTogether) + shift.dot(prior * shift) / 2;
    }
  }
  return costs;
}

// The parabola through the costs around the smallest: its minimum, and its inverse curvature, which
// is the covariance of a shift whose posterior is exp(-cost). Nothing at the border of what was
// searched, or where nothing looks like a tip.
std::optional<HeadModel::Shift> HeadModel::minimum_of(const ShiftCosts& costs) {
  const auto& cost = costs.cost;
  const auto best = static_cast<int>(std::min_element(cost.begin(), cost.end()) - cost.begin());
  const int x = best % kShifts;
  const int y = best / kShifts;
  if (x == 0 || y == 0 || x == kShifts - 1 || y == kShifts - 1) return std::nullopt;
  if (costs.misfit[static_cast<std::size_t>(best)] > kMostMisfit) return std::nullopt;
  const auto c = [&](int i, int j) {
    return cost[static_cast<std::size_t>((y + j) * kShifts + x + i)];
  };
  Eigen::Matrix2d curvature;
  curvature(0, 0) = c(1, 0) - 2 * c(0, 0) + c(-1, 0);
  curvature(1, 1) = c(0, 1) - 2 * c(0, 0) + c(0, -1);
  curvature(0, 1) = curvature(1, 0) = (c(1, 1) - c(1, -1) - c(-1, 1) + c(-1, -1)) / 4;
  if (!(curvature(0, 0) > 0 && curvature.determinant() > 0)) return std::nullopt;
  const Eigen::Matrix2d covariance = curvature.inverse();
  const Eigen::Vector2d slope((c(1, 0) - c(-1, 0)) / 2, (c(0, 1) - c(0, -1)) / 2);
  const Eigen::Vector2d finer = (-covariance * slope).cwiseMax(-1).cwiseMin(1);
  return Shift{Eigen::Vector2d(x - kSearch, y - kSearch) + finer, covariance};
}

// Maximum a posteriori over shifts of the patch, with the ellipse's prediction as the prior.
std::optional<TipMeasurement> HeadModel::tip(const cv::Mat& image, const EllipseMeasurement& body,
                                             double heading) const {
  TipMeasurement result = predicted_tip(body, heading);
  const Eigen::Vector2d& at = result.at_px;
  if (!(at.x() >= 0 && at.y() >= 0 && at.x() <= image.cols - 1 && at.y() <= image.rows - 1))
    return std::nullopt;
  const double unit = scale_of(body.ellipse) / scale_px_;  // px of a step
  std::array<float, std::size_t{kWideColumns} * kWideRows> wide;
  sample_grid(image, at, heading, Eigen::Vector2d::Constant(unit), kWideColumns, kWideRows,
              level_of(image, body.ellipse), wide.data());
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(heading).toRotationMatrix();
  const Eigen::Matrix2d prior =
      unit * unit * (turn.transpose() * result.covariance * turn).inverse();  // of steps
  const auto shift = minimum_of(costs_of(wide.data(), prior));
  if (!shift) return result;
  result.at_px += unit * turn * shift->steps;
  result.covariance = tip_factor_ * unit * unit * turn * shift->covariance * turn.transpose();
  result.seen = true;
  return result;
}

// Template of the whole object, and patch around the tip; offsets of the tip with their scatter.
void HeadModel::learn(std::span<const Known> images) {
  const auto count = static_cast<double>(images.size());
  std::vector<Eigen::Vector2d> offsets;
  scale_px_ = 0;
  tip_.setZero();
  reach_.setZero();
  for (const Known& one : images) {
    const double scale = scale_of(one.body);
    offsets.push_back(Eigen::Rotation2Dd(-one.body.angle) * (one.tip_px - one.body.center_px) /
                      scale);
    tip_ += offsets.back() / count;
    scale_px_ += scale / count;
    reach_ = reach_.cwiseMax(Eigen::Vector2d(1.2 * one.body.semi_major_px / scale,
                                             1.2 * one.body.semi_minor_px / scale));
  }
  reach_.x() = std::max(reach_.x(), 1.1 * tip_.norm());
  scatter_.setZero();
  for (const Eigen::Vector2d& offset : offsets)
    scatter_ += (offset - tip_) * (offset - tip_).transpose() / (count - 1);
  // A person points to half a pixel.
  scatter_.diagonal().array() += 0.25 / (scale_px_ * scale_px_);
  std::vector<std::vector<float>> wholes;
  std::vector<std::vector<float>> patches;
  for (const Known& one : images) {
    wholes.emplace_back(kWhole);
    sample_whole(one.image, one.body, wholes.back().data());
    std::array<float, kPatch> patch;
    patches.emplace_back(kPatch);
    sample_grid(one.image, one.tip_px, one.body.angle,
                Eigen::Vector2d::Constant(scale_of(one.body) / scale_px_), kPatchColumns,
                kPatchRows, level_of(one.image, one.body), patch.data());
    flatten(patch.data(), kPatchColumns, patches.back().data());
  }
  mean_and_weight(wholes, mean_, weight_);
  mean_and_weight(patches, patch_mean_, patch_weight_);
}

// Two folds: what one half taught is asked of the other half, disturbed, from ellipses that err as
// a tracker's. Of Gaussian odds with mean m and variance v the true log odds are 2 m / v times
// them.
void HeadModel::calibrate(std::span<const Known> images) {
  std::array<std::vector<Known>, 2> halves;
  for (std::size_t k = 0; k < images.size(); ++k) halves[k % 2].push_back(images[k]);
  cv::RNG random(4711);
  double sum = 0;
  double squares = 0;
  double odds = 0;
  double excess = 0;
  double tips = 0;
  for (std::size_t half = 0; half < 2; ++half) {
    HeadModel other;
    other.learn(halves[1 - half]);
    for (std::size_t k = 0; k < halves[half].size(); ++k) {
      const Known& one = halves[half][k];
      for (const int kind : kKinds) {
        const cv::Mat image = disturbed(one.image, one.body, kind, 100 * half + k);
        EllipseMeasurement seen;
        seen.ellipse = one.body;
        seen.ellipse.center_px +=
            Eigen::Vector2d(random.gaussian(kErr_px), random.gaussian(kErr_px));
        seen.ellipse.angle += random.gaussian(kErrAngle);
        seen.ellipse.semi_major_px *= 1 + random.gaussian(kErrAxes);
        seen.ellipse.semi_minor_px *= 1 + random.gaussian(kErrAxes);
        seen.covariance.diagonal() << kErr_px * kErr_px, kErr_px * kErr_px,
            std::pow(kErrAxes * one.body.semi_major_px, 2),
            std::pow(kErrAxes * one.body.semi_minor_px, 2), kErrAngle * kErrAngle;
        const double raw = other.raw_odds(image, seen.ellipse);
        sum += raw, squares += raw * raw, ++odds;
        const auto tip = other.tip(image, seen, seen.ellipse.angle);
        if (!tip || !tip->seen) continue;
        const Eigen::Vector2d off = tip->at_px - one.tip_px;
        excess += off.dot(tip->covariance.inverse() * off) / 2;
        ++tips;
      }
    }
  }
  const double mean = sum / odds;
  const double variance = std::max(squares / odds - mean * mean, 1e-6);
  odds_factor_ = std::clamp(2 * mean / variance, 0.0, 1.0);
  sureness_ = odds_factor_ * mean;
  if (tips > 0) tip_factor_ = std::max(kCaution * excess / tips, 1.0);
}

HeadModel HeadModel::train(std::span<const LabeledImage> images,
                           std::span<const Eigen::Vector2d> tips_px) {
  require(images.size() == tips_px.size(), "tips: wants one an image, not finite where unknown");
  check_labeled(images);
  std::vector<Known> known;
  for (std::size_t k = 0; k < images.size(); ++k) {
    if (!tips_px[k].allFinite()) continue;
    Ellipse body = moments_of(images[k].mask).ellipse({0, 0});
    const Eigen::Vector2d along = tips_px[k] - body.center_px;
    require(along.norm() > body.semi_minor_px / 2,
            "tip of image " + std::to_string(k + 1) + ": lies in the middle of the body");
    // The end of the body's axis that is nearer to the tip.
    const Eigen::Vector2d axis(std::cos(body.angle), std::sin(body.angle));
    if (axis.dot(along) < 0)
      body.angle = std::remainder(body.angle + std::numbers::pi, 2 * std::numbers::pi);
    known.push_back({images[k].image, body, tips_px[k]});
  }
  require(known.size() >= kFewestTips, "tips: wants at least four images in which it is known");
  HeadModel model;
  model.calibrate(known);
  model.learn(known);
  return model;
}

// Sizes are constants; an empty model is a zero.
void HeadModel::save(ByteWriter& out) const {
  out.u32(empty() ? 0 : 1);
  if (empty()) return;
  for (const double value : tip_) out.f64(value);
  for (const double value : scatter_.reshaped()) out.f64(value);
  for (const double value : reach_) out.f64(value);
  for (const double value : {scale_px_, odds_factor_, sureness_, tip_factor_}) out.f64(value);
  for (const auto* samples : {&mean_, &weight_, &patch_mean_, &patch_weight_})
    for (const float value : *samples) out.f32(value);
}

HeadModel HeadModel::load(ByteReader& in) {
  HeadModel model;
  if (in.integer(0, 1) == 0) return model;
  for (double& value : model.tip_) value = in.f64(-100, 100);
  for (double& value : model.scatter_.reshaped()) value = in.f64(-1e4, 1e4);
  for (double& value : model.reach_) value = in.f64(0.1, 1000);
  model.scale_px_ = in.f64(1, 1e4);
  model.odds_factor_ = in.f64(0, 1);
  model.sureness_ = in.f64(-1e6, 1e6);
  model.tip_factor_ = in.f64(1, 1e9);
  const auto read = [&in](std::vector<float>& samples, std::size_t size, float most) {
    samples.resize(size);
    for (float& value : samples) value = in.f32(-most, most);
  };
  read(model.mean_, kWhole, 3);
  read(model.weight_, kWhole, 1e4F);
  read(model.patch_mean_, kPatch, 3);
  read(model.patch_weight_, kPatch, 1e4F);
  return model;
}

}  // namespace vitreo::vision
