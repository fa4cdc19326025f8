// Scenes of bodies that have a head: a MagMite's frame with a mark, a block with a hypodermic
// needle (thesis figures 8.2 and 8.8) and an arrow, drawn as polygons on a fine raster before a
// tissue. Nothing of the tracker's model is used: outlines are no ellipses, and the truth of an
// outline is its moments'.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"

#include <Eigen/Geometry>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <vector>

namespace vitreo::vision::needle {

enum class Body { frame, needle, arrow };

struct Settings {
  Body body = Body::needle;
  double size = 1;     ///< of the body; 1: about 60 x 30 px
  double size_to = 1;  ///< reached, times `size`, in frame 80
  double noise = 2.5;  ///< gray levels
  std::uint64_t seed = 1;
};

struct Frame {
  cv::Mat image;
  cv::Mat mask;   ///< of the body, without its needle
  Ellipse truth;  ///< of the body's moments
  double heading = 0;
  Eigen::Vector2d tip_px{0, 0};
};

class Scene {
 public:
  explicit Scene(const Settings& settings)
      : settings_(settings), random_(0x51edULL + settings.seed) {
    for (double& p : phase_) p = random_.uniform(0.0, 2 * CV_PI);
    ground_ = tissue();
  }

  Frame frame(int k) {
    const Pose pose = pose_at(k);
    cv::Mat light = ground_.clone();
    // A needle lies under the block's front, so it is drawn first.
    if (settings_.body == Body::needle) draw(light, needle_outline(), pose, {150, 156, 160});
    draw(light, outline(), pose, {78, 72, 70});
    draw(light, mark(), pose, {118, 112, 108});
    cv::GaussianBlur(light, light, {0, 0}, 1.2);
    cv::Mat noise(light.size(), CV_32FC3);
    random_.fill(noise, cv::RNG::NORMAL, 0, settings_.noise);
    light += noise;
    Frame frame;
    light.convertTo(frame.image, CV_8UC3);
    cv::Mat cover(light.size(), CV_32FC1, cv::Scalar(0));
    raster(cover, outline(), pose);
    frame.mask = cover > 0.5F;
    frame.truth = moments(cover);
    frame.heading = std::remainder(pose.angle, 2 * CV_PI);
    frame.tip_px = placed(tip(), pose);
    return frame;
  }

  /// At moments far from the frames, in the size that frame 0 has.
  std::vector<LabeledImage> training(int count, std::vector<Eigen::Vector2d>& tips_px) {
    std::vector<LabeledImage> images;
    for (int n = 0; n < count; ++n) {
      const Frame one = frame(-1000 - 53 * n);
      images.push_back({one.image, one.mask});
      tips_px.push_back(one.tip_px);
    }
    return images;
  }

 private:
  struct Pose {
    Eigen::Vector2d center_px;
    double angle;
    double size;
  };
  using Outline = std::vector<Eigen::Vector2d>;

  Pose pose_at(double k) const {
    const double size =
        settings_.size * (1 + (settings_.size_to - 1) * std::clamp(k / 80, 0.0, 1.0));
    return {{320 + 190 * std::sin(0.023 * k + phase_[0]) + 3 * std::sin(0.3 * k + phase_[1]),
             240 + 130 * std::sin(0.031 * k + phase_[2])},
            0.9 * std::sin(0.04 * k + phase_[3]) + 0.02 * k + phase_[4],
            size};
  }

  // In px at size 1, x towards the head.
  Outline outline() const {
    if (settings_.body == Body::needle)
      return {{30, 13}, {32, 0}, {30, -13}, {-30, -15}, {-30, 15}};
    if (settings_.body == Body::frame)
      return {{30, 9}, {25, 14}, {-25, 14}, {-30, 9}, {-30, -9}, {-25, -14}, {25, -14}, {30, -9}};
    return {{34, 0}, {14, 17}, {14, 12}, {-28, 12}, {-22, 0}, {-28, -12}, {14, -12}, {14, -17}};
  }
  static Outline needle_outline() {
    return {{24, 2.2}, {50, 1.8}, {62, 0}, {50, -1.8}, {24, -2.2}};
  }
  // A lighter part of the body, towards its tail.
  Outline mark() const {
    if (settings_.body == Body::needle) return {{-24, 9}, {-14, 9}, {-14, -9}, {-24, -9}};
    if (settings_.body == Body::frame) return {{4, 7}, {22, 7}, {22, -7}, {4, -7}};
    return {{-20, 5}, {2, 5}, {2, -5}, {-20, -5}};
  }
  Eigen::Vector2d tip() const {
    if (settings_.body == Body::needle) return {62, 0};
    return {settings_.body == Body::frame ? 30.0 : 34.0, 0};
  }

  static Eigen::Vector2d placed(const Eigen::Vector2d& p, const Pose& pose) {
    return pose.center_px + pose.size * (Eigen::Rotation2Dd(pose.angle) * p);
  }

  // Share of each pixel that the outline covers, by 8 x 8 samples.
  static void raster(cv::Mat& cover, const Outline& outline, const Pose& pose) {
    constexpr int kFine = 8;
    const int reach = static_cast<int>(70 * pose.size) + 4;
    const cv::Rect box = cv::Rect(cvFloor(pose.center_px.x()) - reach,
                                  cvFloor(pose.center_px.y()) - reach, 2 * reach, 2 * reach) &
                         cv::Rect({0, 0}, cover.size());
    if (box.empty()) return;
    cv::Mat fine = cv::Mat::zeros(box.height * kFine, box.width * kFine, CV_8UC1);
    std::vector<cv::Point> points;
    for (const Eigen::Vector2d& p : outline) {
      const Eigen::Vector2d at = placed(p, pose);
      // The first fine sample of a pixel lies at -1/2 + 1/16 of it; 4 bits of a fraction.
      points.emplace_back(cvRound(((at.x() - box.x + 0.5) * kFine - 0.5) * 16),
                          cvRound(((at.y() - box.y + 0.5) * kFine - 0.5) * 16));
    }
    cv::fillPoly(fine, std::vector<std::vector<cv::Point>>{points}, 255, cv::LINE_8, 4);
    fine.convertTo(fine, CV_32F, 1.0 / 255);
    cv::Mat share;
    cv::resize(fine, share, box.size(), 0, 0, cv::INTER_AREA);
    share.copyTo(cover(box));
  }

  static void draw(cv::Mat& light, const Outline& outline, const Pose& pose,
                   const cv::Vec3f& color) {
    cv::Mat cover(light.size(), CV_32FC1, cv::Scalar(0));
    raster(cover, outline, pose);
    for (int v = 0; v < light.rows; ++v) {
      auto* at = light.ptr<cv::Vec3f>(v);
      const float* share = cover.ptr<float>(v);
      for (int u = 0; u < light.cols; ++u)
        if (share[u] > 0) at[u] = (1 - share[u]) * at[u] + share[u] * color;
    }
  }

  static Ellipse moments(const cv::Mat& cover) {
    const cv::Moments m = cv::moments(cover);
    const double mean = (m.mu20 + m.mu02) / (2 * m.m00);
    const double spread = std::hypot((m.mu20 - m.mu02) / 2, m.mu11) / m.m00;
    return {{m.m10 / m.m00, m.m01 / m.m00},
            2 * std::sqrt(mean + spread),
            2 * std::sqrt(mean - spread),
            std::atan2(2 * m.mu11, m.mu20 - m.mu02) / 2};
  }

  // Smooth noise of three widths, and vessels that keep two thirds of the red.
  cv::Mat tissue() {
    const cv::Size size(640, 480);
    cv::Mat light(size, CV_32FC3, cv::Scalar(52, 88, 160));
    for (const int pitch : {97, 29, 11}) {
      cv::Mat coarse(size.height / pitch + 4, size.width / pitch + 4, CV_32FC3);
      random_.fill(coarse, cv::RNG::NORMAL, 0, 1);
      cv::Mat fine;
      cv::resize(coarse, fine, size, 0, 0, cv::INTER_CUBIC);
      light += fine.mul(cv::Scalar(2.2, 3.8, 6.5));
    }
    cv::Mat share = cv::Mat::zeros(size, CV_32FC1);
    for (int k = 0; k < 12; ++k) {
      cv::Point2d at(random_.uniform(0.0, 640.0), random_.uniform(0.0, 480.0));
      double heading = random_.uniform(0.0, 6.28);
      const int width = random_.uniform(3, 9);
      for (int step = 0; step < 60; ++step) {
        heading += random_.gaussian(0.1);
        const cv::Point2d to = at + 10.0 * cv::Point2d(std::cos(heading), std::sin(heading));
        cv::line(share, at, to, 1.0, width, cv::LINE_AA);
        at = to;
      }
    }
    cv::GaussianBlur(share, share, {0, 0}, 1.3);
    for (int v = 0; v < size.height; ++v)
      for (int u = 0; u < size.width; ++u)
        light.at<cv::Vec3f>(v, u) = light.at<cv::Vec3f>(v, u).mul(
            cv::Vec3f(1, 1, 1) - share.at<float>(v, u) * cv::Vec3f(0.08F, 0.3F, 0.35F));
    return light;
  }

  Settings settings_;
  cv::RNG random_;
  std::array<double, 5> phase_{};
  cv::Mat ground_;
};

}  // namespace vitreo::vision::needle
