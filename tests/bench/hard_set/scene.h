// Scene of the hard set: a variant before a ground, frame by frame, with its truth.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/bench/hard_set/ground.h"
#include "tests/bench/hard_set/variant.h"
#include "vision/color_model.h"
#include "vision/ellipse.h"

#include <array>
#include <cstdint>
#include <vector>

namespace vitreo::hard_set {

struct Shot {
  cv::Mat image;  ///< CV_8UC3, BGR
  vision::Ellipse truth;
  vision::Ellipse twin;  ///< where the variant has one
  double visible = 1;    ///< share of the robot that shows
};

class Scene {
 public:
  static constexpr int kFrames = 80;
  /// `ground` must outlive it.
  Scene(const Ground& ground, const Variant& variant, std::uint64_t seed, const cv::Size& view);
  Shot shot(int k) const;
  const Variant& variant() const { return variant_; }

 private:
  vision::Ellipse robot_at(double k) const;
  vision::Ellipse twin_at(double k) const;
  cv::Mat ground_at(int k) const;
  void draw_body(cv::Mat& light, const vision::Ellipse& at) const;
  double cover_up(cv::Mat& light, const vision::Ellipse& at, int k) const;
  void shine(cv::Mat& light, int k) const;
  void add_glare(cv::Mat& light, const vision::Ellipse& at, int k) const;
  cv::Mat camera(const cv::Mat& light, int k) const;

  const Ground& ground_;
  Variant variant_;
  std::uint64_t seed_;
  cv::Size view_;
  std::array<double, 8> phase_{};
  cv::Mat vessels_;  // of the robot's gray
  cv::Mat noise_;
};

/// Images of the variant's robot and camera with nothing that makes it hard, far from the moments
/// that are judged, with the masks a person would draw: one undisturbed evening of a lab that works
/// on for a year. Vessels of the robot's gray are those of the scene with the same seed.
std::vector<vision::LabeledImage> training_of(const Ground& ground, const Variant& variant,
                                              std::uint64_t seed, const cv::Size& view);

/// Whether its training images are the plain variant's.
bool trained_as_plain(const Variant& variant);

}  // namespace vitreo::hard_set
