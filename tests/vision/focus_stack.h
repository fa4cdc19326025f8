// A synthetic focus stack: the robot before the retina, blurred more with every step from focus,
// noisy, under a lamp that flickers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "tests/vision/synthetic.h"
#include "vision/focus.h"
#include "vision/focus_peak.h"

#include <vector>

namespace vitreo::vision::synthetic {

struct FocusStack {
  int steps = 31;
  double best = 15.3;  // step
  double sharp_sigma_px = 0.8, sigma_px_per_step = 0.35;
  double noise = 1.5;     // gray levels
  double flicker = 0.02;  // of the light, either way
  std::uint64_t seed = 1;
};

/// As the camera would see it without blur: the metal robot in the middle of 200 x 200 px.
inline cv::Mat sharp_scene(std::uint64_t seed) {
  Scene scene;
  scene.size = {200, 200};
  scene.seed = seed;
  scene.blur_sigma_px = 0.3;
  cv::Mat mean = ground_of(scene);
  draw_body(mean, {{100, 100}, 30, 15, 0.4}, metal(), scene);
  return mean;
}

inline std::vector<cv::Mat> images_of(const FocusStack& stack) {
  const cv::Mat scene = sharp_scene(stack.seed);
  std::mt19937_64 random(stack.seed + 1000);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<double> unit(-1, 1);
  std::vector<cv::Mat> images;
  for (int step = 0; step < stack.steps; ++step) {
    const double defocus = stack.sigma_px_per_step * (step - stack.best);
    cv::Mat mean, image(scene.size(), CV_8U);
    cv::GaussianBlur(scene, mean, {0, 0}, std::hypot(stack.sharp_sigma_px, defocus), 0,
                     cv::BORDER_REFLECT);
    const double light = 1 + stack.flicker * unit(random);
    for (int v = 0; v < mean.rows; ++v) {
      for (int u = 0; u < mean.cols; ++u) {
        const double noise = stack.noise * normal(random);
        image.at<unsigned char>(v, u) =
            cv::saturate_cast<unsigned char>(light * mean.at<float>(v, u) + noise);
      }
    }
    images.push_back(image);
  }
  return images;
}

/// The measure of each image over `window`, by step.
inline std::vector<FocusSample> curve_of(const std::vector<cv::Mat>& images, FocusMeasure measure,
                                         const cv::Rect& window) {
  std::vector<FocusSample> samples;
  for (const cv::Mat& image : images)
    samples.push_back({static_cast<double>(samples.size()), focus(image, window, measure).value});
  return samples;
}

}  // namespace vitreo::vision::synthetic
