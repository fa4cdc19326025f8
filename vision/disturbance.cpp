// SPDX-License-Identifier: Apache-2.0
#include "vision/disturbance.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace vitreo::vision {
namespace {

// The loss of JPEG without its file: cosine coefficients of 8 x 8 pixels of luma and of chroma at
// half the resolution, in steps that grow with the frequency, about those of the standard's annex
// K.
void compress(cv::Mat& image, int quality) {
  cv::Mat luma_chroma;
  cv::cvtColor(image, luma_chroma, cv::COLOR_BGR2YCrCb);
  std::vector<cv::Mat> planes;
  cv::split(luma_chroma, planes);
  const double scale = quality < 50 ? 50.0 / quality : 2 - quality / 50.0;
  for (std::size_t p = 0; p < 3; ++p) {
    cv::Mat plane = planes[p];
    if (p > 0) cv::resize(planes[p], plane, {}, 0.5, 0.5, cv::INTER_AREA);
    plane.convertTo(plane, CV_32F, 1, -128);
    for (int v = 0; v + 8 <= plane.rows; v += 8) {
      for (int u = 0; u + 8 <= plane.cols; u += 8) {
        cv::Mat block = plane(cv::Rect(u, v, 8, 8));
        cv::Mat c;
        cv::dct(block, c);
        for (int i = 0; i < 64; ++i) {
          const int wave = i / 8 + i % 8;
          const double step = scale * ((p == 0 ? 11 : 16) + (p == 0 ? 7 : 11) * wave);
          auto& value = c.at<float>(i / 8, i % 8);
          value = static_cast<float>(step * std::round(value / step));
        }
        cv::idct(c, block);
      }
    }
    plane.convertTo(plane, CV_8U, 1, 128);
    if (p > 0)
      cv::resize(plane, planes[p], image.size(), 0, 0, cv::INTER_LINEAR);
    else
      planes[p] = plane;
  }
  cv::merge(planes, luma_chroma);
  cv::cvtColor(luma_chroma, image, cv::COLOR_YCrCb2BGR);
}

void add_noise(cv::Mat& image, double sigma, cv::RNG& random) {
  cv::Mat noise(image.size(), CV_16SC3);
  random.fill(noise, cv::RNG::NORMAL, 0, sigma);
  cv::add(image, noise, image, cv::noArray(), CV_8UC3);
}

// All on one side of a line at `offset` semi-minor axes from the center gets one of the image's own
// colors, from a random place; `foreign`: with blue and red exchanged, which an eye's ground is
// not.
void cover(cv::Mat& image, const Ellipse& object, double offset, bool foreign, cv::RNG& random) {
  const double angle = random.uniform(0.0, 2 * CV_PI);
  const cv::Point2d across(std::cos(angle), std::sin(angle));
  const cv::Point2d along(-across.y, across.x);
  const cv::Point2d from = cv::Point2d(object.center_px.x(), object.center_px.y()) +
                           offset * object.semi_minor_px * across;
  cv::Vec3b color =
      image.at<cv::Vec3b>(random.uniform(0, image.rows), random.uniform(0, image.cols));
  if (foreign) std::swap(color[0], color[2]);
  std::vector<cv::Point> corners;
  for (const cv::Point2d& p :
       {from - 2000 * along, from + 2000 * along, from + 2000 * along + 2000 * across,
        from - 2000 * along + 2000 * across})
    corners.emplace_back(cvRound(p.x), cvRound(p.y));
  cv::fillConvexPoly(image, corners, cv::Scalar(color[0], color[1], color[2]), cv::LINE_AA);
}

// The object's own shadow on the ground beside it, a little larger than the object and without a
// sharp edge, to a random side.
void cast_shadow(cv::Mat& image, const Ellipse& object, double share, cv::RNG& random) {
  const double towards = random.uniform(0.0, 2 * CV_PI);
  const double way = random.uniform(0.15, 0.4) * object.semi_minor_px;
  Ellipse shade = object;
  shade.center_px += way * Eigen::Vector2d(std::cos(towards), std::sin(towards));
  const double soft = 0.2 * object.semi_minor_px;
  shade.semi_major_px += soft;
  shade.semi_minor_px += soft;
  const double c = std::cos(object.angle);  // of the shade, too
  const double s = std::sin(object.angle);
  const auto within = [c, s](const Ellipse& e, double u, double v) {
    const double x = (c * (u - e.center_px.x()) + s * (v - e.center_px.y())) / e.semi_major_px;
    const double y = (c * (v - e.center_px.y()) - s * (u - e.center_px.x())) / e.semi_minor_px;
    return std::hypot(x, y);
  };
  for (int v = 0; v < image.rows; ++v) {
    auto* at = image.ptr<cv::Vec3b>(v);
    for (int u = 0; u < image.cols; ++u) {
      // The blurred rim of the object itself is half ground.
      const double beside =
          std::clamp((within(object, u, v) - 1) * object.semi_minor_px + 0.5, 0.0, 1.0);
      const double deep = std::clamp(4 * (1 - within(shade, u, v)), 0.0, 1.0);
      at[u] *= 1 - share * deep * beside;
    }
  }
}

// A reflex of light that no body reflects, `away` semi-minor axes from the center.
void outshine(cv::Mat& image, const Ellipse& object, double away, double sigma, cv::RNG& random) {
  const double angle = random.uniform(0.0, 2 * CV_PI);
  const double u0 = object.center_px.x() + away * object.semi_minor_px * std::cos(angle);
  const double v0 = object.center_px.y() + away * object.semi_minor_px * std::sin(angle);
  for (int v = 0; v < image.rows; ++v) {
    auto* at = image.ptr<cv::Vec3b>(v);
    for (int u = 0; u < image.cols; ++u) {
      const double r2 = (u - u0) * (u - u0) + (v - v0) * (v - v0);
      if (r2 > 16 * sigma * sigma) continue;
      const double more = 500 * std::exp(-r2 / (2 * sigma * sigma));
      for (int c = 0; c < 3; ++c) at[u][c] = cv::saturate_cast<unsigned char>(at[u][c] + more);
    }
  }
}

void scale_channels(cv::Mat& image, double blue, double green, double red) {
  cv::multiply(image, cv::Scalar(blue, green, red), image);
}

// Light that falls off to one side, as in a corner of the view or at a spot's edge.
void slope(cv::Mat& image, double least, cv::RNG& random) {
  const double angle = random.uniform(0.0, 2 * CV_PI);
  const double c = std::cos(angle);
  const double s = std::sin(angle);
  const double half = std::hypot(image.cols, image.rows) / 2;
  for (int v = 0; v < image.rows; ++v) {
    auto* at = image.ptr<cv::Vec3b>(v);
    for (int u = 0; u < image.cols; ++u) {
      const double along = ((u - image.cols / 2.0) * c + (v - image.rows / 2.0) * s) / half;
      const double gain = 1 - (1 - least) * (along + 1) / 2;
      for (int k = 0; k < 3; ++k) at[u][k] = cv::saturate_cast<unsigned char>(at[u][k] * gain);
    }
  }
}

void smear(cv::Mat& image, int length, cv::RNG& random) {
  const double angle = random.uniform(0.0, CV_PI);
  cv::Mat kernel = cv::Mat::zeros(length, length, CV_32F);
  const double middle = (length - 1) / 2.0;
  for (double t = -middle; t <= middle; t += 0.25)
    kernel.at<float>(cvRound(middle + t * std::sin(angle)),
                     cvRound(middle + t * std::cos(angle))) += 1;
  kernel /= cv::sum(kernel)[0];
  cv::filter2D(image, image, -1, kernel);
}

// Factors of blue, green and red: light, then casts.
constexpr std::array<std::array<double, 3>, 6> kLights{{{0.5, 0.5, 0.5},
                                                        {0.25, 0.25, 0.25},
                                                        {1.3, 1.3, 1.3},
                                                        {1.6, 1.6, 1.6},
                                                        {1.15, 1, 0.88},
                                                        {0.85, 1, 1.1}}};
constexpr std::array kQualities{50, 30, 12};        // of JPEG
constexpr std::array kDefocus{2.5, 4.5, 7.5};       // px, sigma
constexpr std::array kSmears{9, 15};                // px
constexpr std::array kCovered{0.9, 0.5, 0.1};       // semi-minor axes from the center
constexpr std::array kForeign{0.9, 0.6, 0.3, 0.0};  // the same, of a color that is not the image's
constexpr std::array kShadow{0.3, 0.4, 0.5, 0.6};   // share of the light
constexpr std::array kReflexAway{1.0, 1.6};         // semi-minor axes from the center
constexpr std::array kReflexSigma{9.0, 16.0};       // px
constexpr int kFirstLight = 1;
constexpr int kSlope = kFirstLight + 6;
constexpr int kFirstQuality = kSlope + 1;
constexpr int kFirstDefocus = kFirstQuality + 3;
constexpr int kFirstSmear = kFirstDefocus + 3;
constexpr int kNoise = kFirstSmear + 2;
constexpr int kFirstCover = kNoise + 1;
constexpr int kFirstReflex = kFirstCover + 3;
constexpr int kFirstForeign = kFirstReflex + 2;
constexpr int kFirstShadow = kFirstForeign + 4;
static_assert(kFirstShadow + 4 == kDisturbances);

}  // namespace

bool is_blur(int kind) { return kind >= kFirstDefocus && kind < kFirstSmear; }

bool is_light(int kind) { return kind >= kFirstLight && kind <= kSlope; }

// The kinds in the order: light, cast, compression, defocus, smear, noise,
// cover, glare, foreign cover, shadow. A disturbed camera still has its noise.
cv::Mat disturbed(const cv::Mat& image, const Ellipse& object, int kind, std::uint64_t seed) {
  cv::RNG random(seed * 0x9e3779b97f4a7c15ULL + static_cast<std::uint64_t>(kind) + 1);
  cv::Mat result = image.clone();
  const auto of = [kind](const auto& values, int first) {
    return values[static_cast<std::size_t>(kind - first)];
  };
  if (kind < kFirstLight) return result;
  if (kind < kSlope) {
    const auto& factors = of(kLights, kFirstLight);
    scale_channels(result, factors[0], factors[1], factors[2]);
  } else if (kind == kSlope) {
    slope(result, 0.35, random);
  } else if (kind < kFirstDefocus) {
    compress(result, of(kQualities, kFirstQuality));
  } else if (kind < kFirstSmear) {
    cv::GaussianBlur(result, result, {0, 0}, of(kDefocus, kFirstDefocus));
  } else if (kind < kNoise) {
    smear(result, of(kSmears, kFirstSmear), random);
  } else if (kind == kNoise) {
    add_noise(result, 8, random);
  } else if (kind < kFirstReflex) {
    cover(result, object, of(kCovered, kFirstCover), false, random);
  } else if (kind >= kFirstShadow) {
    cast_shadow(result, object, of(kShadow, kFirstShadow), random);
  } else if (kind >= kFirstForeign) {
    cover(result, object, of(kForeign, kFirstForeign), true, random);
  } else {
    outshine(result, object, of(kReflexAway, kFirstReflex), of(kReflexSigma, kFirstReflex), random);
  }
  if (kind != kNoise) add_noise(result, 1.5, random);
  return result;
}

}  // namespace vitreo::vision
