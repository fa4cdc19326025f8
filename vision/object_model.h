// Object model of a color tracker: colors, shape and calibration, learnt from images with masks and
// saved as bytes.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/gray_evidence.h"
#include "vision/head_model.h"
#include "vision/level_set.h"
#include "vision/light.h"
#include "vision/look_memory.h"
#include "vision/radial_rim.h"
#include "vision/shape_model.h"

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo::vision {

/// Settings of one measurement in one frame.
struct ObjectViewSettings {
  bool shape_prior = true;  ///< cycle three of the level set
  bool refine = true;       ///< the rim to a fraction of a pixel; else the level set's moments
  std::optional<Thresholds> thresholds;  ///< instead of the color model's weighted ones
  double gate_px = 9;                    ///< how far outside the predicted rim the object may be
  double angle_sigma = 0.1;              ///< rad, of the predicted angle
  LevelSetSettings level_set;
  RadialRimSettings rim;
  ShapeFitSettings shape_fit;
  void check() const;  ///< throws std::invalid_argument naming the setting
};

/// Bias and bias covariance of a kind of measurement, on the training images, against the masks.
struct Calibration {
  Eigen::Vector2d semi_axes_px{0, 0};  ///< mean of measured less true
  /// Of the remaining error of Ellipse::vector(): the part that is common to the whole rim (shadow,
  /// highlight, shading), which the scatter along the rim cannot show.
  Eigen::Matrix<double, 5, 5> covariance = Eigen::Matrix<double, 5, 5>::Zero();
};

/// Whether the ground itself is taken for the object: the training images, the object masked out of
/// each, asked by a model that had not seen their ground.
struct FalseBelief {
  struct Asked {
    int answered = 0;            ///< of `asked`
    double most_likeness = -10;  ///< of any candidate, answered or not
  };
  int asked = 0;
  Asked as_trained;                        ///< for the object in the size of the masks
  Asked resized;                           ///< from half to twice of it
  std::vector<Eigen::Vector2d> places_px;  ///< of the answers in the trained size
};

struct ObjectModel {
  ColorModel color;
  ShapeModel shape;
  cv::Size image_size;
  Eigen::Vector2d semi_axes_px{0, 0};  ///< mean over the masks
  Calibration rim;                     ///< of measurements with ObjectViewSettings::refine
  Calibration segment;                 ///< of those without
  LookMemory looks;                    ///< empty in a model saved before there was one
  FalseBelief audit;
  HeadModel head;  ///< empty unless learnt: which end is the head, and where its tip is
  /// ONNX of learned evidence (learned_evidence.h); empty: the colors alone.
  std::string network;
  Thresholds network_thresholds;  ///< of F with the network's part
  GrayModel gray;                 ///< known where the training images have no color
  TrainedLight light;             ///< not known in a model saved before it was learnt

  /// Of the F that its evidence has.
  const Thresholds& thresholds() const {
    if (!network.empty()) return network_thresholds;
    return gray.known ? gray.thresholds : color.weighted_thresholds();
  }
  /// What a person should know before trusting it, a sentence each; none of a good model.
  std::vector<std::string> warnings() const;

  /// Colors from all of the masks; shape and calibration from the largest part of each, of those
  /// that no edge of the image cuts while there is one. `network`: ONNX of learned evidence, or
  /// empty. Throws std::invalid_argument as ColorModel::train, for images of different sizes, for
  /// masks thinner than 5 px, and for bytes that are no such network.
  static ObjectModel train(std::span<const LabeledImage> images, const ColorModelSettings& color,
                           const ObjectViewSettings& view, const std::string& network = {});
  std::string save() const;
  /// Throws std::invalid_argument for anything that save() did not write.
  static ObjectModel load(std::string_view bytes);
};

}  // namespace vitreo::vision
