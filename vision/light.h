// Light of an image against that of the training images: the gains of its channels, seen on the
// ground and on the object, and the color table read through them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <cstdint>
#include <optional>

namespace vitreo::vision {

/// Natural logarithms of factors, or of levels, of blue, green and red.
using LogColor = Eigen::Array3d;

/// Mean logarithm of the levels on a coarse grid over the whole image (CV_8UC3): a measure of the
/// light on the ground, of which the object is a small part. `mask` (or empty): pixels to leave out
/// where it is not 0.
LogColor log_light(const cv::Mat& image, const cv::Mat& mask = {});

/// Logarithm of each channel's median within three quarters of an ellipse. Nothing where a tenth of
/// it is saturated, or it is not in the image: that says nothing of the light.
std::optional<LogColor> log_color_within(const cv::Mat& image, const Ellipse& ellipse);

/// What the training images' light was.
struct TrainedLight {
  LogColor ground = LogColor::Zero();
  LogColor object = LogColor::Zero();
  bool known = false;
};

/// Cells of a color model's table by the levels of an image whose light differs: each level is
/// divided by its channel's gain first. One look-up a channel.
class LightTable {
 public:
  LightTable() { set(LogColor::Zero()); }
  void set(const LogColor& gains);
  const LogColor& gains() const { return gains_; }
  std::size_t cell_of(unsigned blue, unsigned green, unsigned red) const {
    return cells_[0][blue] | cells_[1][green] | cells_[2][red];
  }

 private:
  LogColor gains_ = LogColor::Zero();
  std::array<std::array<std::uint32_t, 256>, 3> cells_{};
};

/// Gains learnt on the way: what the ground says at once, what the object itself says slowly, and
/// only of looks that are sure of it. A part of a tracker's memory: a frame can be undone.
class LightMemory {
 public:
  /// What may be the light where the object is to be found: as it was, as the ground has it, as in
  /// training. Those that are alike once; the first `count` of them.
  struct Guesses {
    std::array<LogColor, 3> gains;
    std::size_t count = 0;
  };
  /// A new image: the gains follow what its ground did since the last one.
  void next(const TrainedLight& trained, const cv::Mat& image);
  /// A sure look at the object.
  void seen(const TrainedLight& trained, const cv::Mat& image, const Ellipse& object);
  /// In use; zero while the light is about that of the training.
  LogColor gains() const;
  Guesses guesses(const TrainedLight& trained) const;
  /// Whether the ground's light jumped in one of the last images: a lamp that was switched, or
  /// another view. Its gains are a guess then, and not in use.
  bool jumped() const { return since_jump_ < kJumpFrames; }
  /// One of them turned out right.
  void take(const LogColor& gains) { gains_ = gains; }

 private:
  LogColor gains_ = LogColor::Zero();
  LogColor ground_ = LogColor::Zero();  // of the last image, against training
  bool started_ = false;
  static constexpr int kJumpFrames = 4;
  int since_jump_ = kJumpFrames;
};

}  // namespace vitreo::vision
