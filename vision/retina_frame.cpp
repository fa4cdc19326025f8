// SPDX-License-Identifier: Apache-2.0
#include "vision/retina_frame.h"

#include <Eigen/Cholesky>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::vision {
namespace {

constexpr int kMapSaturated = 250;  // gray level
constexpr int kMapBorder = 3;       // px of a level
constexpr int kCellsU = 16;         // a map's points are taken evenly, from cells of the level
constexpr int kCellsV = 12;
constexpr int kMapRounds = 12;
constexpr std::size_t kFewestPoints = 40;
constexpr double kMapConverged = 2e-3;  // px of the level
constexpr double kMapBlank = 0.01;      // deviation of a flattened frame: below it there is nothing
constexpr double kMapOutlier = 2;       // standard deviations of the residual
// Neighboring points share the noise of the smoothed image: so many count as one.
constexpr double kMapShared = 3;
constexpr int kPartsU = 4;  // of the overlap, each of which must correlate
constexpr int kPartsV = 3;
constexpr double kPartCorrelates = 0.3;
constexpr int kFewestOfPart = 8;       // points
constexpr double kPartsAgree = 0.65;   // of those with structure
constexpr double kMostMapScale = 1.3;  // of a frame against the map's, either way
constexpr double kMostMapTurn = 0.35;  // rad

using Vector4 = Eigen::Matrix<double, 4, 1>;
using Matrix4 = Eigen::Matrix<double, 4, 4>;

// Sums for Pearson's correlation, and for a gain and an offset between the two.
struct MapMoments {
  double n = 0, a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  void add(double x, double y) { n += 1, a += x, b += y, aa += x * x, bb += y * y, ab += x * y; }
  double var_a() const { return std::max(aa / n - a * a / (n * n), 1e-9); }
  double var_b() const { return std::max(bb / n - b * b / (n * n), 1e-9); }
  double covariance() const { return ab / n - a * b / (n * n); }
  double correlation() const { return n < 2 ? 0 : covariance() / std::sqrt(var_a() * var_b()); }
};

// Bilinear; false outside, or where something else than retina shows.
bool map_sample(const MapLevel& level, double x, double y, double& value) {
  if (!(x >= kMapBorder && y >= kMapBorder && x < level.image.cols - 1 - kMapBorder &&
        y < level.image.rows - 1 - kMapBorder))
    return false;
  const int i = static_cast<int>(x);
  const int j = static_cast<int>(y);
  if (level.valid.at<unsigned char>(j, i) == 0) return false;
  const double s = x - i;
  const double t = y - j;
  const float* a = level.image.ptr<float>(j) + i;
  const float* b = level.image.ptr<float>(j + 1) + i;
  value = (1 - t) * ((1 - s) * a[0] + s * a[1]) + t * ((1 - s) * b[0] + s * b[1]);
  return true;
}

// Coordinates about the level's middle, in units of half its longer side.
struct MapMiddle {
  double u, v, scale;
  explicit MapMiddle(const cv::Size& size)
      : u((size.width - 1) / 2.0),
        v((size.height - 1) / 2.0),
        scale(std::max(size.width, size.height) / 2.0) {}
};

// The level's pixel k is centered on the finer level's 2 k + 1/2.
Eigen::Affine2d to_level(const Eigen::Affine2d& full, double factor) {
  const Eigen::Vector2d half = Eigen::Vector2d::Constant((factor - 1) / 2);
  Eigen::Affine2d level = full;
  level.translation() = (full.linear() * half + full.translation() - half) / factor;
  return level;
}

Eigen::Affine2d from_level(const Eigen::Affine2d& level, double factor) {
  const Eigen::Vector2d half = Eigen::Vector2d::Constant((factor - 1) / 2);
  Eigen::Affine2d full = level;
  full.translation() = factor * level.translation() + half - level.linear() * half;
  return full;
}

double factor_of(int level) { return static_cast<double>(2 << level); }

cv::Mat mask_of(const cv::Mat& image, std::span<const Ellipse> bodies) {
  cv::Mat least = image;
  if (image.channels() == 3) {
    std::array<cv::Mat, 3> planes;
    cv::split(image, planes.data());
    cv::min(planes[0], planes[1], least);
    cv::min(least, planes[2], least);
  }
  cv::Mat out = least >= kMapSaturated;
  if (cv::countNonZero(out) > 0)
    cv::dilate(out, out, cv::getStructuringElement(cv::MORPH_RECT, {25, 25}));
  for (const Ellipse& e : bodies)
    cv::ellipse(
        out,
        cv::RotatedRect({static_cast<float>(e.center_px.x()), static_cast<float>(e.center_px.y())},
                        {static_cast<float>(2.4 * e.semi_major_px + 12),
                         static_cast<float>(2.4 * e.semi_minor_px + 12)},
                        static_cast<float>(e.angle * 180 / M_PI)),
        255, cv::FILLED);
  return out;
}

// The steepest points of each cell: evenly over the frame, so that no single vessel decides.
std::vector<MapPoint> map_points_of(const MapLevel& level, std::size_t of_cell) {
  cv::Mat du;
  cv::Mat dv;
  cv::Sobel(level.image, du, CV_32F, 1, 0, 3, 0.125);
  cv::Sobel(level.image, dv, CV_32F, 0, 1, 3, 0.125);
  const MapMiddle middle(level.image.size());
  std::vector<MapPoint> points;
  std::vector<std::pair<float, cv::Point>> steep;
  for (int j = 0; j < kCellsV; ++j) {
    for (int i = 0; i < kCellsU; ++i) {
      steep.clear();
      const int u0 = std::max(i * level.image.cols / kCellsU, kMapBorder);
      const int u1 = std::min((i + 1) * level.image.cols / kCellsU, level.image.cols - kMapBorder);
      const int v0 = std::max(j * level.image.rows / kCellsV, kMapBorder);
      const int v1 = std::min((j + 1) * level.image.rows / kCellsV, level.image.rows - kMapBorder);
      for (int v = v0; v < v1; ++v)
        for (int u = u0; u < u1; ++u)
          if (level.valid.at<unsigned char>(v, u) != 0)
            steep.push_back({std::hypot(du.at<float>(v, u), dv.at<float>(v, u)), {u, v}});
      const std::size_t most = std::min(of_cell, steep.size());
      std::partial_sort(steep.begin(), steep.begin() + static_cast<std::ptrdiff_t>(most),
                        steep.end(),
                        [](const auto& a, const auto& b) { return a.first > b.first; });
      for (std::size_t k = 0; k < most; ++k) {
        const cv::Point at = steep[k].second;
        const float gu = du.at<float>(at);
        const float gv = dv.at<float>(at);
        const auto x = static_cast<float>((at.x - middle.u) / middle.scale);
        const auto y = static_cast<float>((at.y - middle.v) / middle.scale);
        points.push_back({static_cast<float>(at.x),
                          static_cast<float>(at.y),
                          level.image.at<float>(at),
                          {gv * x - gu * y, gu, gv, gu * x + gv * y}});
      }
    }
  }
  return points;
}

// A point of the map with what the image has there.
using MapSeen = std::vector<std::pair<const MapPoint*, double>>;

// Standardized residual of a point: value = gain * template + offset.
struct MapGain {
  double gain;
  double offset;
  double miss(const std::pair<const MapPoint*, double>& one) const {
    return (one.second - offset) / gain - static_cast<double>(one.first->value);
  }
};

// Fills `seen` with the points in view; a gain that is not positive is no match.
MapGain look_up(const std::vector<MapPoint>& points, const MapLevel& image,
                const Eigen::Affine2d& image_from_frame, MapSeen& seen) {
  MapMoments moments;
  seen.clear();
  for (const MapPoint& p : points) {
    const Eigen::Vector2d at = image_from_frame * Eigen::Vector2d(p.u, p.v);
    double value = 0;
    if (!map_sample(image, at.x(), at.y(), value)) continue;
    moments.add(static_cast<double>(p.value), value);
    seen.emplace_back(&p, value);
  }
  if (seen.empty()) return {1, 0};
  const double gain = std::max(moments.covariance() / moments.var_a(), 0.2);
  return {gain, moments.b / moments.n - gain * moments.a / moments.n};
}

// Normal equations with Cauchy weights, whose width is twice the residuals' deviation.
struct MapEquations {
  Matrix4 information = Matrix4::Zero();
  Vector4 right = Vector4::Zero();
  double variance = 0;  // of the residuals, weighed
  MapEquations(const MapSeen& seen, const MapGain& light) {
    double squares = 0;
    for (const auto& one : seen) squares += std::pow(light.miss(one), 2);
    const double rms = std::sqrt(squares / static_cast<double>(seen.size()));
    const double cut = kMapOutlier * std::max(rms, 0.05);
    double weights = 0;
    for (const auto& one : seen) {
      const double miss = light.miss(one);
      const double w = 1 / (1 + miss * miss / (cut * cut));
      const Vector4 slope = one.first->slope.cast<double>();
      information += w * slope * slope.transpose();
      right += (w * miss) * slope;
      variance += w * miss * miss;
      weights += w;
    }
    variance /= std::max(weights, 1.0);
  }
};

// The similarity of a step (turn, u, v, scale), about the level's middle.
Eigen::Affine2d map_change(const Vector4& d, const MapMiddle& middle) {
  const Eigen::Vector2d center(middle.u, middle.v);
  Eigen::Affine2d change = Eigen::Affine2d::Identity();
  change.linear() << 1 + d[3] / middle.scale, -d[0] / middle.scale, d[0] / middle.scale,
      1 + d[3] / middle.scale;
  change.translation() = center - change.linear() * center + d.segment<2>(1);
  return change;
}

// One level of the inverse compositional Gauss-Newton (Baker & Matthews 2004) for a similarity, on
// the map's points, with a gain and an offset between the two. The standard deviation of a point at
// the border, px of the level; nothing when the two slid off each other.
std::optional<double> align_level(const std::vector<MapPoint>& points, const MapLevel& image,
                                  Eigen::Affine2d& image_from_frame) {
  const MapMiddle middle(image.image.size());
  double sigma = 0;
  MapSeen seen;
  seen.reserve(points.size());
  for (int round = 0; round < kMapRounds; ++round) {
    const MapGain light = look_up(points, image, image_from_frame, seen);
    if (seen.size() < kFewestPoints) return std::nullopt;
    const MapEquations equations(seen, light);
    const Eigen::LDLT<Matrix4> solver(equations.information);
    if (solver.info() != Eigen::Success || solver.rcond() < 1e-8) return std::nullopt;
    const Vector4 d = solver.solve(equations.right);
    if (!d.allFinite()) return std::nullopt;
    // The step was taken on the map, so its inverse is applied before.
    image_from_frame = image_from_frame * map_change(d, middle).inverse();
    const Matrix4 inverse = solver.solve(Matrix4::Identity());
    sigma = std::sqrt(kMapShared * equations.variance * inverse.diagonal().sum() / 2);
    if (d.lpNorm<Eigen::Infinity>() < kMapConverged) break;
  }
  return sigma;
}

// At the finest level: correlation, overlap, and whether the parts of the view agree each by
// itself. What is fixed to the sensor correlates in some parts and in the others not at all.
void verify(const std::vector<MapPoint>& points, const MapLevel& image,
            const Eigen::Affine2d& image_from_frame, const RetinaMapSettings& settings,
            Alignment& result) {
  std::array<MapMoments, kPartsU * kPartsV> parts;
  MapMoments all;
  for (const MapPoint& p : points) {
    const Eigen::Vector2d at = image_from_frame * Eigen::Vector2d(p.u, p.v);
    double value = 0;
    if (!map_sample(image, at.x(), at.y(), value)) continue;
    const int i = std::min(static_cast<int>(at.x() * kPartsU / image.image.cols), kPartsU - 1);
    const int j = std::min(static_cast<int>(at.y() * kPartsV / image.image.rows), kPartsV - 1);
    parts[static_cast<std::size_t>(j * kPartsU + i)].add(static_cast<double>(p.value), value);
    all.add(static_cast<double>(p.value), value);
  }
  int asked = 0;
  int agreed = 0;
  for (const MapMoments& part : parts) {
    if (part.n < kFewestOfPart) continue;
    ++asked;
    agreed += part.correlation() > kPartCorrelates;
  }
  result.correlation = all.correlation();
  result.overlap = points.empty() ? 0 : all.n / static_cast<double>(points.size());
  const double scale = std::sqrt(std::abs(image_from_frame.linear().determinant()));
  const double turn = std::atan2(image_from_frame.linear()(1, 0), image_from_frame.linear()(0, 0));
  result.sound = result.correlation >= settings.min_correlation &&
                 result.overlap >= settings.min_overlap && asked >= 3 &&
                 agreed >= kPartsAgree * asked && scale < kMostMapScale &&
                 scale > 1 / kMostMapScale && std::abs(turn) < kMostMapTurn;
}

// Light over its local mean: vessels stay, vignette and lamp go. The mean goes over valid pixels
// alone, so that a reflex has no halo.
void flatten(cv::Mat& small, const cv::Mat& out, double flatten_px) {
  cv::Mat share;
  cv::Mat kept = small.clone();
  cv::Mat(out == 0).convertTo(share, CV_32F, 1.0 / 255);
  kept.setTo(0, out);
  const int wide = 2 * static_cast<int>(flatten_px / 2) + 1;
  cv::blur(kept, kept, {wide, wide}, {-1, -1}, cv::BORDER_REFLECT);
  cv::blur(share, share, {wide, wide}, {-1, -1}, cv::BORDER_REFLECT);
  share += 1e-3;
  cv::divide(kept, share, kept);  // the local mean
  kept += 2;                      // gray levels: the noise of a dark corner is no structure
  cv::divide(small, kept, small);
}

}  // namespace

bool make_pyramid(const cv::Mat& whole, std::span<const Ellipse> bodies, double flatten_px,
                  MapPyramid& pyramid) {
  // Of whole pixels at every level: their centers lie where to_level() has them.
  const cv::Mat image = whole(cv::Rect(0, 0, whole.cols / 8 * 8, whole.rows / 8 * 8));
  cv::Mat gray;
  if (image.channels() == 3)
    cv::extractChannel(image, gray, 1);
  else
    gray = image;
  const cv::Size half(image.cols / 2, image.rows / 2);
  cv::Mat small;
  cv::Mat out;
  cv::resize(gray, small, half, 0, 0, cv::INTER_AREA);
  small.convertTo(small, CV_32F);
  cv::resize(mask_of(image, bodies), out, half, 0, 0, cv::INTER_NEAREST);
  flatten(small, out, flatten_px);
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(small, mean, deviation, out == 0);
  if (!(deviation[0] > kMapBlank)) return false;
  small = (small - mean[0]) / deviation[0];
  small.setTo(0, out);
  cv::GaussianBlur(small, small, {3, 3}, 0.8);
  // What lies beside a mask has a steep edge that is not the retina's.
  cv::dilate(out, out, cv::getStructuringElement(cv::MORPH_RECT, {7, 7}));
  cv::Mat valid = out == 0;
  for (MapLevel& level : pyramid) {
    level.image = small;
    level.valid = valid;
    const cv::Size next(small.cols / 2, small.rows / 2);
    cv::Mat smaller;
    cv::Mat sparser;
    cv::resize(small, smaller, next, 0, 0, cv::INTER_AREA);
    cv::resize(valid, sparser, next, 0, 0, cv::INTER_NEAREST);
    small = smaller;
    valid = sparser;
  }
  return true;
}

// Twice the size, so that a shift beyond half the view is not aliased.
cv::Mat map_spectrum(const MapLevel& level) {
  cv::Mat padded = cv::Mat::zeros(cv::getOptimalDFTSize(2 * level.image.rows),
                                  cv::getOptimalDFTSize(2 * level.image.cols), CV_32F);
  level.image.copyTo(padded(cv::Rect({0, 0}, level.image.size())));
  cv::Mat spectrum;
  cv::dft(padded, spectrum, cv::DFT_COMPLEX_OUTPUT, level.image.rows);
  return spectrum;
}

MapFrame make_frame(const MapPyramid& pyramid, const Eigen::Affine2d& map_from_frame,
                    double sigma_px) {
  MapFrame frame;
  for (std::size_t k = 0; k < pyramid.size(); ++k)
    frame.points[k] = map_points_of(pyramid[k], k == 0 ? 6 : 5);
  frame.spectrum = map_spectrum(pyramid.back());
  frame.map_from_frame = map_from_frame;
  frame.sigma_px = sigma_px;
  return frame;
}

// Coarse to fine from a guess that is right within some pixels of the coarsest level.
Alignment align(const MapFrame& frame, const MapPyramid& image, const Eigen::Affine2d& guess,
                const RetinaMapSettings& settings) {
  Alignment result;
  Eigen::Affine2d full = guess;
  for (int level = kMapLevels - 1; level >= 0; --level) {
    const auto k = static_cast<std::size_t>(level);
    Eigen::Affine2d at = to_level(full, factor_of(level));
    const auto sigma = align_level(frame.points[k], image[k], at);
    if (!sigma) return result;
    result.sigma_px = *sigma * factor_of(level);
    if (level == 0) verify(frame.points[0], image[0], at, settings, result);
    full = from_level(at, factor_of(level));
  }
  result.image_from_frame = full;
  return result;
}

// The shift of the highest phase correlation (Kuglin & Hines 1975), whitened by three quarters.
Eigen::Affine2d shift_of(const MapFrame& frame, const cv::Mat& spectrum) {
  cv::Mat product;
  cv::Mat correlation;
  cv::mulSpectrums(spectrum, frame.spectrum, product, 0, true);
  for (int v = 0; v < product.rows; ++v) {
    auto* row = product.ptr<cv::Vec2f>(v);
    for (int u = 0; u < product.cols; ++u) {
      const float size = row[u][0] * row[u][0] + row[u][1] * row[u][1];
      row[u] *= std::pow(size + 1e-12F, -0.375F);
    }
  }
  cv::dft(product, correlation, cv::DFT_INVERSE | cv::DFT_REAL_OUTPUT);
  cv::Point at;
  cv::minMaxLoc(correlation, nullptr, nullptr, nullptr, &at);
  const double factor = factor_of(kMapLevels - 1);
  Eigen::Affine2d shift = Eigen::Affine2d::Identity();
  shift.translation() << factor * (at.x > correlation.cols / 2 ? at.x - correlation.cols : at.x),
      factor * (at.y > correlation.rows / 2 ? at.y - correlation.rows : at.y);
  return shift;
}

}  // namespace vitreo::vision
