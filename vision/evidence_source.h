// Sources of evidence: F, the log-likelihood ratio of object and ground, of an image's pixels; from
// their colors alone, or from a learned network (learned_evidence.h).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"
#include "vision/light.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>

namespace vitreo::vision {

class EvidenceSource {
 public:
  virtual ~EvidenceSource() = default;
  /// Called before pixels of `image` (CV_8UC3) within `region` are read, and no others are. The
  /// region may stick out of the image.
  virtual void prepare(const cv::Mat& image, const cv::Rect& region) = 0;
  /// Called before that where an object is expected in `image`, for what its surroundings say.
  /// Pixels of `owned` (CV_8UC1 of the image's size, or empty) that are not 0 and not `self` are
  /// another object's.
  virtual void surround(const cv::Mat& /*image*/, const Ellipse& /*expected*/,
                        const cv::Mat& /*owned*/, unsigned char /*self*/) {}
  /// Of `count` pixels of row `v` from column `u` on, every `step`th: ColorModel::kScale F. All lie
  /// in the image.
  virtual void read(const cv::Mat& image, int v, int u, int step, int count,
                    std::int8_t* to) const = 0;
  /// The source of what decides on the outline, where it is another one; as long as this one lives.
  virtual EvidenceSource* rim() { return this; }
  /// Share of the object's own pixels that F clearly gives to the ground (F < -1) where it is
  /// right: of an object whose shading passes the ground's levels.
  virtual double own_against() const { return 0; }
  /// Gains of the images to come against those of the training; none at first.
  virtual void set_light(const LogColor& gains) = 0;
};

/// F of a color model's table, one look-up a pixel.
class ColorEvidence : public EvidenceSource {
 public:
  /// `model` must outlive it.
  explicit ColorEvidence(const ColorModel& model) : model_(&model) {}
  void prepare(const cv::Mat& /*image*/, const cv::Rect& /*region*/) override {}
  void read(const cv::Mat& image, int v, int u, int step, int count,
            std::int8_t* to) const override;
  void set_light(const LogColor& gains) override {
    if ((gains != light_.gains()).any()) light_.set(gains);
  }
  const LightTable& light() const { return light_; }

 private:
  const ColorModel* model_;
  LightTable light_;
};

}  // namespace vitreo::vision
