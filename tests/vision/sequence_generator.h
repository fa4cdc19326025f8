// Generated image sequences with known truth: a metallic robot over a retina-like ground, through
// defocus, uneven and flickering light, a color mosaic and noise; hidden or not, before vessels of
// its own color or not.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <numbers>
#include <random>
#include <vector>

namespace vitreo::vision::generated {

/// Another body in the picture: where it is in frame k, and what its surface does to blue, green
/// and red.
struct Companion {
  std::function<Ellipse(int)> path;
  cv::Vec3f tint{0.98F, 1.0F, 1.03F};  ///< the robot's own: steel
};

struct SequenceSettings {
  std::uint64_t seed = 1;
  cv::Size size{640, 480};
  double semi_major_px = 30, semi_minor_px = 15;
  double drift_px = 0;  ///< of the ground per frame
  bool dark_vessels =
      false;  ///< vessels whose color is near the robot's: r(RG) near the thesis' 1.65
  int hidden_from = -1, half_hidden_from = -1, hidden_frames = 20;
  double noise = 2.5;  ///< gray levels at mid scale
  /// A fundus as a camera's field stop shows it: bright disc, dark macula, vessels that leave the
  /// disc and branch, a black rim around.
  bool fundus = false;
  double blur_px = 1.3;       ///< mean of the defocus, which varies by a third of it
  double flicker = 0.02;      ///< of the lamp, either way
  double motion_blur_px = 0;  ///< length of the smear of robot and ground, along u
  int jpeg_quality = 0;       ///< 0: not compressed
  double speed = 1;           ///< of the robot's wandering
  std::vector<Companion> companions{};
  std::function<Ellipse(int)> path{};  ///< of the robot, instead of its wandering
  double shadow = 0.10;                ///< share of the light that the robot's shadow takes
  /// What the lamp does to blue, green and red in frame k; the training is in its full light.
  std::function<cv::Vec3f(int)> lamp{};
};

struct Frame {
  cv::Mat image;  ///< CV_8UC3, BGR
  Ellipse truth;
  double visible = 1;  ///< share of the robot
  std::vector<Ellipse> companions{};
};

class Sequence {
 public:
  explicit Sequence(const SequenceSettings& settings)
      : settings_(settings), random_(settings.seed) {
    std::uniform_real_distribution<double> unit(0, 1);
    for (double& p : phase_) p = 2 * std::numbers::pi * unit(random_);
    if (settings.fundus)
      paint_fundus();
    else
      paint_ground();
    noise_.create(settings.size.height + 64, settings.size.width + 64, CV_32FC3);
    std::normal_distribution<float> normal;
    for (int v = 0; v < noise_.rows; ++v) {
      auto* row = noise_.ptr<float>(v);
      for (int u = 0; u < 3 * noise_.cols; ++u) row[u] = normal(random_);
    }
  }

  Ellipse truth(int k) const {
    if (settings_.path) return settings_.path(k);
    // Up to some 6 px and 3 degrees a frame, wherever it goes.
    const double t = settings_.speed * k;
    const double w = settings_.size.width, h = settings_.size.height;
    return {
        {w / 2 + 0.33 * w * std::sin(0.021 * t + phase_[0]) + 3 * std::sin(0.31 * t + phase_[4]),
         h / 2 + 0.31 * h * std::sin(0.029 * t + phase_[1]) + 2 * std::sin(0.27 * t + phase_[5])},
        settings_.semi_major_px * (1 + 0.06 * std::sin(0.017 * t + phase_[2])),
        settings_.semi_minor_px * (1 + 0.05 * std::sin(0.023 * t + phase_[3])),
        std::remainder(0.9 * std::sin(0.033 * t + phase_[2]) + 0.012 * t + phase_[3],
                       std::numbers::pi)};
  }

  Frame frame(int k) {
    Frame out;
    out.truth = truth(k);
    cv::Mat light = view_of_ground(k);
    for (const Companion& one : settings_.companions) {
      out.companions.push_back(one.path(k));
      shade(light, out.companions.back(), k, one.tint);
    }
    shade(light, out.truth, k);
    out.visible = cover(light, out.truth, k);
    illuminate(light, k);
    if (settings_.lamp) {
      const cv::Vec3f factor = settings_.lamp(k);
      cv::multiply(light, cv::Scalar(factor[0], factor[1], factor[2]), light);
    }
    if (settings_.motion_blur_px > 1)
      cv::blur(light, light, {static_cast<int>(settings_.motion_blur_px), 1});
    out.image = camera(light, k);
    if (settings_.jpeg_quality > 0) compress(out.image);
    return out;
  }

  /// Masks as a person would draw them: the truth's pixels. Frames of another time than those
  /// tracked. `who`: the robot, or companion `who` from 0.
  std::vector<LabeledImage> training(int count, int from = 5000, int step = 37, int who = -1) {
    SequenceSettings plain = settings_;
    plain.hidden_from = plain.half_hidden_from = -1;
    plain.lamp = {};
    std::swap(settings_, plain);
    std::vector<LabeledImage> images;
    for (int k = 0; k < count; ++k) {
      const Frame one = frame(from + step * k);
      images.push_back(
          {one.image, mask_of(who < 0 ? one.truth : one.companions[static_cast<std::size_t>(who)],
                              settings_.size)});
    }
    std::swap(settings_, plain);
    return images;
  }

  static cv::Mat mask_of(const Ellipse& e, const cv::Size& size) {
    cv::Mat mask(size, CV_8UC1);
    const double c = std::cos(e.angle), s = std::sin(e.angle);
    for (int v = 0; v < size.height; ++v) {
      for (int u = 0; u < size.width; ++u) {
        const double du = u - e.center_px.x(), dv = v - e.center_px.y();
        const double x = (c * du + s * dv) / e.semi_major_px,
                     y = (c * dv - s * du) / e.semi_minor_px;
        mask.at<unsigned char>(v, u) = x * x + y * y <= 1 ? 255 : 0;
      }
    }
    return mask;
  }

 private:
  static constexpr int kBorder = 200;  // of the ground around the view, for its drift

  void paint_mottle() {
    const cv::Size size(settings_.size.width + 2 * kBorder, settings_.size.height + 2 * kBorder);
    ground_.create(size, CV_32FC3);
    ground_.setTo(cv::Scalar(52, 92, 168));  // blue, green, red
    std::normal_distribution<float> normal;
    for (const int pitch : {90, 25, 7}) {
      cv::Mat coarse(size.height / pitch + 3, size.width / pitch + 3, CV_32FC1), mottle;
      for (int v = 0; v < coarse.rows; ++v) {
        for (int u = 0; u < coarse.cols; ++u) coarse.at<float>(v, u) = normal(random_);
      }
      cv::resize(coarse, mottle, size, 0, 0, cv::INTER_CUBIC);
      cv::Mat tint;
      cv::merge(std::vector<cv::Mat>{2.5 * mottle, 4 * mottle, 6 * mottle}, tint);
      ground_ += tint;
    }
  }

  void paint_ground() {
    paint_mottle();
    const cv::Size size = ground_.size();
    std::uniform_real_distribution<double> unit(0, 1);
    const int vessels = settings_.dark_vessels ? 60 : 26;
    for (int k = 0; k < vessels; ++k)
      vessel(unit(random_) * size.width, unit(random_) * size.height, k % 3 == 0);
  }

  // A bent line that branches off nowhere: absorbs green and blue more than red.
  void vessel(double u, double v, bool wide) {
    std::uniform_real_distribution<double> unit(0, 1);
    std::normal_distribution<double> normal;
    cv::Mat line = cv::Mat::zeros(ground_.size(), CV_32FC1);
    double heading = 2 * std::numbers::pi * unit(random_);
    const int thickness = static_cast<int>(wide ? 7 + 5 * unit(random_) : 2 + 4 * unit(random_));
    cv::Rect box;
    for (int k = 0; k < 60; ++k) {
      heading += 0.12 * normal(random_);
      const double to_u = u + 12 * std::cos(heading), to_v = v + 12 * std::sin(heading);
      cv::line(line, cv::Point2d(u, v), cv::Point2d(to_u, to_v), 1.0, thickness, cv::LINE_AA);
      for (const auto& [x, y] : {std::pair(u, v), std::pair(to_u, to_v)})
        box |= cv::Rect(static_cast<int>(x) - 24, static_cast<int>(y) - 24, 48, 48);
      u = to_u, v = to_v;
    }
    box &= cv::Rect({0, 0}, line.size());
    if (box.empty()) return;
    line = line(box);
    cv::GaussianBlur(line, line, {0, 0}, 1.5);
    // Dark vessels keep so little red that they come near the robot's gray.
    const cv::Vec3f keep =
        settings_.dark_vessels ? cv::Vec3f(0.95F, 0.70F, 0.43F) : cv::Vec3f(0.75F, 0.62F, 0.78F);
    for (int y = 0; y < line.rows; ++y) {
      const float* share = line.ptr<float>(y);
      auto* to = ground_.ptr<cv::Vec3f>(box.y + y) + box.x;
      for (int x = 0; x < line.cols; ++x) {
        for (int c = 0; c < 3 && share[x] > 0; ++c) to[x][c] *= 1 - share[x] * (1 - keep[c]);
      }
    }
  }

  // A tree of vessels: arteries and veins leave the disc, bend towards the macula, branch and thin.
  void branch(cv::Mat& veins, cv::Point2d from, double heading, double width, double bend,
              int depth) {
    std::normal_distribution<double> normal;
    std::uniform_real_distribution<double> unit(0, 1);
    const int steps = 14 + static_cast<int>(10 * unit(random_));
    for (int k = 0; k < steps; ++k) {
      heading += bend + 0.10 * normal(random_);
      const cv::Point2d to = from + 9.0 * cv::Point2d(std::cos(heading), std::sin(heading));
      cv::line(veins, from, to, 1.0, std::max(1, static_cast<int>(std::lround(width))),
               cv::LINE_AA);
      from = to;
      width *= 0.985;
    }
    if (depth == 0 || width < 1.2) return;
    const double fork = 0.35 + 0.3 * unit(random_);
    branch(veins, from, heading - fork, 0.72 * width, bend, depth - 1);
    branch(veins, from, heading + fork, 0.82 * width, bend, depth - 1);
  }

  void paint_fundus() {
    std::uniform_real_distribution<double> unit(0, 1);
    paint_mottle();
    const cv::Size size = ground_.size();
    const cv::Point2d disc(size.width * (0.35 + 0.1 * unit(random_)),
                           size.height * (0.45 + 0.1 * unit(random_)));
    const cv::Point2d macula = disc + cv::Point2d(0.26 * size.width, 0.03 * size.height);
    cv::Mat veins = cv::Mat::zeros(size, CV_32FC1), arteries = veins.clone();
    for (int k = 0; k < 10; ++k) {
      const double heading = 2 * std::numbers::pi * (k + 0.5 * unit(random_)) / 10;
      const double bend =
          0.02 * (std::sin(heading) > 0 ? -1 : 1) * (std::cos(heading) > 0 ? 1 : -1);
      branch(k % 2 == 0 ? veins : arteries, disc, heading, k % 2 == 0 ? 11 : 8, bend, 4);
    }
    for (cv::Mat* one : {&veins, &arteries}) cv::GaussianBlur(*one, *one, {0, 0}, 1.2);
    for (int v = 0; v < size.height; ++v) {
      auto* to = ground_.ptr<cv::Vec3f>(v);
      for (int u = 0; u < size.width; ++u) {
        const double du = u - disc.x, dv = 0.9 * (v - disc.y), r = std::hypot(du, dv);
        const auto bright = static_cast<float>(1 / (1 + std::exp((r - 42) / 4)));
        const double dark =
            0.35 * std::exp(-((u - macula.x) * (u - macula.x) + (v - macula.y) * (v - macula.y)) /
                            (2 * 55.0 * 55.0));
        to[u] *= static_cast<float>(1 - dark);
        to[u] = (1 - bright) * to[u] + bright * cv::Vec3f(120, 175, 225);
        const float vein = veins.at<float>(v, u), artery = arteries.at<float>(v, u);
        const cv::Vec3f keep_vein(0.80F, 0.42F, 0.58F), keep_artery(0.72F, 0.60F, 0.82F);
        for (int c = 0; c < 3; ++c)
          to[u][c] *= (1 - vein * (1 - keep_vein[c])) * (1 - artery * (1 - keep_artery[c]));
      }
    }
  }

  void compress(cv::Mat& image) const {
    // What JPEG does, without its file: 8 x 8 cosine coefficients of luma and halved chroma,
    // rounded to its tables.
    cv::Mat ycc;
    cv::cvtColor(image, ycc, cv::COLOR_BGR2YCrCb);
    std::vector<cv::Mat> planes;
    cv::split(ycc, planes);
    const double scale = settings_.jpeg_quality < 50 ? 50.0 / settings_.jpeg_quality
                                                     : 2 - settings_.jpeg_quality / 50.0;
    for (int p = 0; p < 3; ++p) {
      cv::Mat plane;
      if (p > 0) cv::resize(planes[p], planes[p], {}, 0.5, 0.5, cv::INTER_AREA);
      planes[p].convertTo(plane, CV_32F, 1, -128);
      for (int v = 0; v + 8 <= plane.rows; v += 8) {
        for (int u = 0; u + 8 <= plane.cols; u += 8) {
          cv::Mat block = plane(cv::Rect(u, v, 8, 8)), coefficients;
          cv::dct(block, coefficients);
          for (int i = 0; i < 64; ++i) {
            const double step =
                std::max(1.0, scale * ((p == 0 ? 11 : 15) + (p == 0 ? 7 : 11) * (i / 8 + i % 8)));
            auto& c = coefficients.at<float>(i / 8, i % 8);
            c = static_cast<float>(step * std::round(c / step));
          }
          cv::idct(coefficients, block);
        }
      }
      plane.convertTo(planes[p], CV_8U, 1, 128);
      if (p > 0) cv::resize(planes[p], planes[p], image.size(), 0, 0, cv::INTER_LINEAR);
    }
    cv::merge(planes, ycc);
    cv::cvtColor(ycc, image, cv::COLOR_YCrCb2BGR);
  }

  double blur(int k) const {
    return settings_.blur_px / 1.3 * (1.3 + 0.45 * std::sin(0.041 * k + phase_[1]));
  }

  cv::Mat view_of_ground(int k) const {
    if (settings_.drift_px == 0)
      return ground_(cv::Rect({kBorder, kBorder}, settings_.size)).clone();
    double along = settings_.drift_px * k;
    along = kBorder * 0.9 *
            std::sin(along / (kBorder * 0.9));  // back and forth, as fast as asked in the middle
    const double across = 0.4 * kBorder * std::sin(settings_.drift_px * k / (0.8 * kBorder));
    const cv::Mat move = (cv::Mat_<double>(2, 3) << 1, 0, kBorder + along, 0, 1, kBorder + across);
    cv::Mat view;
    cv::warpAffine(ground_, view, move, settings_.size, cv::INTER_LINEAR | cv::WARP_INVERSE_MAP);
    return view;
  }

  // The robot and its faint shadow, both defocused, into the light.
  void shade(cv::Mat& light, const Ellipse& e, int k,
             const cv::Vec3f& tint = {0.98F, 1.0F, 1.03F}) const {
    const int reach = static_cast<int>(e.semi_major_px) + 16;
    const int u0 = static_cast<int>(e.center_px.x()) - reach,
              v0 = static_cast<int>(e.center_px.y()) - reach;
    cv::Mat cover = cv::Mat::zeros(2 * reach + 1, 2 * reach + 1, CV_32FC1), body = cover.clone(),
            shadow = cover.clone();
    const double c = std::cos(e.angle), s = std::sin(e.angle), lamp = 0.9 + 0.0012 * k;
    for (int j = 0; j < cover.rows; ++j) {
      for (int i = 0; i < cover.cols; ++i) {
        for (int q = 0; q < 9; ++q) {
          const double du = u0 + i + (q % 3 - 1) / 3.0 - e.center_px.x(),
                       dv = v0 + j + (q / 3 - 1) / 3.0 - e.center_px.y();
          const double x = (c * du + s * dv) / e.semi_major_px,
                       y = (c * dv - s * du) / e.semi_minor_px;
          const double sx = (c * (du - 3) + s * (dv - 3)) / e.semi_major_px,
                       sy = (c * (dv - 3) - s * (du - 3)) / e.semi_minor_px;
          if (sx * sx + sy * sy <= 1) shadow.at<float>(j, i) += 1.0F / 9;
          if (x * x + y * y > 1) continue;
          cover.at<float>(j, i) += 1.0F / 9;
          body.at<float>(j, i) += static_cast<float>(metal(x, y, lamp - e.angle) / 9);
        }
      }
    }
    for (cv::Mat* one : {&cover, &body})
      cv::GaussianBlur(*one, *one, {0, 0}, blur(k), 0, cv::BORDER_CONSTANT);
    cv::GaussianBlur(shadow, shadow, {0, 0}, blur(k) + 2.5, 0, cv::BORDER_CONSTANT);
    for (int j = 0; j < cover.rows; ++j) {
      for (int i = 0; i < cover.cols; ++i) {
        const int u = u0 + i, v = v0 + j;
        if (u < 0 || v < 0 || u >= light.cols || v >= light.rows) continue;
        auto& at = light.at<cv::Vec3f>(v, u);
        const float gray = body.at<float>(j, i), rest = 1 - cover.at<float>(j, i);
        at *= 1 - static_cast<float>(settings_.shadow) * shadow.at<float>(j, i);
        at = rest * at + gray * tint;
      }
    }
  }

  // Gray level of a metal body: shaded, with a broad and a sharp highlight, at (x, y) of its unit
  // disc.
  static double metal(double x, double y, double lamp) {
    const double z = std::sqrt(std::max(1 - x * x - y * y, 0.0));
    const double toward = 0.4 * (x * std::cos(lamp) + y * std::sin(lamp)) + 0.9 * z;
    const double sharp = std::pow(
        std::clamp(0.373 * std::cos(lamp) * x + 0.373 * std::sin(lamp) * y + 0.928 * z, 0.0, 1.0),
        60);
    return 46 + 34 * std::max(toward, 0.0) + 95 * sharp;
  }

  // A gray bar over the robot; returns how much of the robot it leaves.
  double cover(cv::Mat& light, const Ellipse& e, int k) const {
    const auto during = [&](int from) {
      return from >= 0 && k >= from && k < from + settings_.hidden_frames;
    };
    const bool all = during(settings_.hidden_from), half = during(settings_.half_hidden_from);
    if (!all && !half) return 1;
    // Upright; covers all, or what lies left of a line that wanders about the middle.
    const double edge =
        half ? e.center_px.x() + 5 * std::sin(0.9 * k) : e.center_px.x() + e.semi_major_px + 12;
    const double start = e.center_px.x() - e.semi_major_px - 14;
    const int from = std::clamp(static_cast<int>(start), 0, light.cols),
              to = std::clamp(static_cast<int>(edge), 0, light.cols);
    if (to > from) light(cv::Rect(from, 0, to - from, light.rows)).setTo(cv::Scalar(88, 92, 96));
    cv::Mat around = light.colRange(std::max(to - 8, 0), std::min(to + 8, light.cols));
    cv::GaussianBlur(around, around, {0, 0}, blur(k));
    int seen = 0, count = 0;
    for (int q = 0; q < 400; ++q) {
      const double r = std::sqrt((q + 0.5) / 400), t = 2.399963 * q;
      const Ellipse inner{e.center_px, r * e.semi_major_px, r * e.semi_minor_px, e.angle};
      ++count;
      seen += inner.point(t).x() >= to;
    }
    return static_cast<double>(seen) / count;
  }

  void illuminate(cv::Mat& light, int k) const {
    const double flicker = 1 + settings_.flicker * std::sin(2.1 * k + phase_[0]);
    const double hot_u = light.cols * (0.5 + 0.25 * std::sin(0.013 * k + phase_[4]));
    const double hot_v = light.rows * (0.5 + 0.25 * std::cos(0.011 * k + phase_[5]));
    const double cu = light.cols / 2.0, cv_ = light.rows / 2.0, far = cu * cu + cv_ * cv_;
    std::vector<float> hot_of_column(static_cast<std::size_t>(light.cols));
    for (int u = 0; u < light.cols; ++u)
      hot_of_column[static_cast<std::size_t>(u)] =
          static_cast<float>(std::exp(-(u - hot_u) * (u - hot_u) / (2 * 160.0 * 160.0)));
    for (int v = 0; v < light.rows; ++v) {
      auto* row = light.ptr<cv::Vec3f>(v);
      const auto hot =
          static_cast<float>(0.16 * std::exp(-(v - hot_v) * (v - hot_v) / (2 * 160.0 * 160.0)));
      for (int u = 0; u < light.cols; ++u) {
        const double away = ((u - cu) * (u - cu) + (v - cv_) * (v - cv_)) / far;
        row[u] *= static_cast<float>(flicker * (1 - 0.22 * away)) +
                  hot * hot_of_column[static_cast<std::size_t>(u)];
        if (settings_.fundus)
          row[u] *= static_cast<float>(1 / (1 + std::exp((std::sqrt(away) - 0.97) * 120))) + 0.01F;
      }
    }
  }

  // Shot and read noise on the color mosaic, eight bits, then as a camera's driver interpolates it.
  cv::Mat camera(const cv::Mat& light, int k) const {
    std::mt19937_64 random(settings_.seed * 7919 + static_cast<std::uint64_t>(k));
    const int du = static_cast<int>(random() % 64), dv = static_cast<int>(random() % 64);
    cv::Mat mosaic(light.size(), CV_8UC1), image;
    for (int v = 0; v < light.rows; ++v) {
      const auto* from = light.ptr<cv::Vec3f>(v);
      const auto* noise = noise_.ptr<cv::Vec3f>(v + dv) + du;
      auto* to = mosaic.ptr<unsigned char>(v);
      for (int u = 0; u < light.cols; ++u) {
        const int channel =
            (v & 1) == 0 ? ((u & 1) == 0 ? 2 : 1) : ((u & 1) == 0 ? 1 : 0);  // RG over GB
        const float level = from[u][channel];
        const float sigma =
            static_cast<float>(settings_.noise) * std::sqrt(0.2F + std::max(level, 0.0F) / 128);
        to[u] = cv::saturate_cast<unsigned char>(level + sigma * noise[u][channel]);
      }
    }
    cv::cvtColor(mosaic, image,
                 cv::COLOR_BayerBG2BGR);  // OpenCV names the mosaic by its second row
    return image;
  }

  SequenceSettings settings_;
  std::mt19937_64 random_;
  std::array<double, 6> phase_{};
  cv::Mat ground_, noise_;
};

}  // namespace vitreo::vision::generated
