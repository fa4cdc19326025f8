// Evidence of a gray camera: F of an image's levels against those of the ground around the object,
// as the same image shows them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/bytes.h"
#include "vision/color_model.h"
#include "vision/evidence_source.h"

#include <array>
#include <span>

namespace vitreo::vision {

constexpr std::size_t kGrayLevels = 256;
using GrayDensity = std::array<float, kGrayLevels>;  ///< per gray level; its sum is 1

/// Levels of the training images, where none of them has a color.
struct GrayModel {
  GrayDensity object{};
  GrayDensity rim{};     ///< of the object within some pixels of its outline
  GrayDensity beside{};  ///< ground within some pixels of the object, its blur with it included
  GrayDensity ground{};  ///< all that is not the object
  Thresholds thresholds;
  bool known = false;

  /// Not known unless blue, green and red are equal in all pixels of all images. `thresholds` are
  /// left for the caller. `images` are such as check_labeled() accepts.
  static GrayModel train(std::span<const LabeledImage> images);
  void save(ByteWriter& out) const;
  static GrayModel load(ByteReader& in);
};

/// F = log(P(level|object) / P(level|ground)), in which the ground is a mixture of the levels
/// around the expected object in this image (surround()) and those of the training. One number a
/// pixel tells little: what is as dark as the object somewhere on the ground speaks against it
/// there, and not elsewhere. Where
/// the ground is as bright as the object's middle its rim still differs: what decides on the
/// outline are the levels that the object has near it.
class GrayEvidence : public EvidenceSource {
 public:
  /// `model` must outlive it.
  explicit GrayEvidence(const GrayModel& model);
  void prepare(const cv::Mat& /*image*/, const cv::Rect& /*region*/) override {}
  void surround(const cv::Mat& image, const Ellipse& expected, const cv::Mat& owned,
                unsigned char self) override;
  void read(const cv::Mat& image, int v, int u, int step, int count,
            std::int8_t* to) const override;
  void set_light(const LogColor& gains) override;
  EvidenceSource* rim() override { return &at_rim_; }
  double own_against() const override { return own_against_; }

 private:
  using Table = std::array<std::int8_t, kGrayLevels>;
  static constexpr std::size_t kSectors = 8;
  // Which eighth of the way round an ellipse a pixel lies at, in the ellipse's frame: the ground at
  // one end of the object need not be that at the other.
  class Sectors {
   public:
    Sectors() : Sectors({{0, 0}, 1, 1, 0}) {}
    explicit Sectors(const Ellipse& ellipse);
    std::size_t at(int u, int v) const;

   private:
    Eigen::Vector2d center_;
    Eigen::Vector2d along_;   // the long axis over its square
    Eigen::Vector2d across_;  // the short one
  };
  class Rim : public EvidenceSource {
   public:
    void prepare(const cv::Mat& /*image*/, const cv::Rect& /*region*/) override {}
    void read(const cv::Mat& image, int v, int u, int step, int count,
              std::int8_t* to) const override;
    void set_light(const LogColor& /*gains*/) override {}
    Sectors sectors;
    std::array<Table, kSectors> tables{};
  };
  struct Ring {
    std::array<std::array<double, kGrayLevels>, kSectors> counts{};
    std::array<int, kSectors> samples{};
  };
  Ring ring_of(const cv::Mat& image, const Ellipse& expected, const cv::Mat& owned,
               unsigned char self) const;
  Table table_of(const GrayDensity& object, const GrayDensity& ground) const;
  void take_training();
  void take_inside(const GrayDensity& ground);
  const GrayModel* model_;
  // Densities in the light of the images to come.
  GrayDensity object_{};
  GrayDensity rim_{};
  GrayDensity known_ground_{};
  Table table_{};
  double own_against_ = 0;
  Rim at_rim_;
};

}  // namespace vitreo::vision
