// Head model: which end of an object is its head, and where its tip is, learnt from images in which
// the tip was pointed at (thesis figures 8.2 and 8.8: an arrow on a MagMite, a needle on a magnet).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/bytes.h"
#include "vision/color_model.h"
#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <optional>
#include <span>
#include <vector>

namespace vitreo::vision {

/// Direction from the object's center to its tip.
struct Heading {
  double angle = 0;        ///< rad, from +u towards +v, in (-pi, pi]
  double probability = 0;  ///< that it is not the opposite one
};

struct TipMeasurement {
  Eigen::Vector2d at_px{0, 0};
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< px^2
  bool seen = false;  ///< found in the image; else where the ellipse says that it is
};

class HeadModel {
 public:
  /// `tips_px`: one an image, not finite where it was not pointed at. Masks are those of the body,
  /// without a needle. Throws std::invalid_argument for fewer than four tips, for one in the body's
  /// center, and for another number of tips than images.
  static HeadModel train(std::span<const LabeledImage> images,
                         std::span<const Eigen::Vector2d> tips_px);
  /// Nothing was learnt: there is no heading and no tip.
  bool empty() const { return mean_.empty(); }
  /// Log of the odds that the head lies along `body.angle` and not opposite to it, by this image
  /// alone; calibrated on images that the template had not seen, under disturbances.
  double log_odds(const cv::Mat& image, const Ellipse& body) const;
  /// Those odds of an image of the training, on average: below about 3 the ends look alike.
  double sureness() const { return sureness_; }
  /// `body`: as a tracker reports it, with its covariance; `heading` in rad. Nothing where the tip
  /// would be out of the image.
  std::optional<TipMeasurement> tip(const cv::Mat& image, const EllipseMeasurement& body,
                                    double heading) const;

  void save(ByteWriter& out) const;
  static HeadModel load(ByteReader& in);

  // Samples of the whole object, in the body's frame with x towards the head: `kColumns` x `kRows`.
  static constexpr int kColumns = 40;
  static constexpr int kRows = 16;
  // Around the tip, at a pixel's distance: patch, and how far it is searched either way.
  static constexpr int kPatchColumns = 21;
  static constexpr int kPatchRows = 15;
  static constexpr int kSearch = 5;
  static constexpr int kShifts = 2 * kSearch + 1;
  struct Known {  // an image of the training
    cv::Mat image;
    Ellipse body;  // its angle is the heading
    Eigen::Vector2d tip_px;
  };

 private:
  void learn(std::span<const Known> images);
  void calibrate(std::span<const Known> images);
  double raw_odds(const cv::Mat& image, const Ellipse& body) const;
  void sample_whole(const cv::Mat& image, const Ellipse& body, float* to) const;
  TipMeasurement predicted_tip(const EllipseMeasurement& body, double heading) const;
  struct ShiftCosts {  // by rows of whole shifts
    std::array<double, std::size_t{kShifts} * kShifts> cost;
    std::array<double, std::size_t{kShifts} * kShifts> misfit;  // mean squared deviation
  };
  struct Shift {
    Eigen::Vector2d steps;
    Eigen::Matrix2d covariance;
  };
  ShiftCosts costs_of(const float* wide, const Eigen::Matrix2d& prior) const;
  static std::optional<Shift> minimum_of(const ShiftCosts& costs);

  Eigen::Vector2d tip_{0, 0};  // in the body's frame, in units of its scale sqrt(a b)
  Eigen::Matrix2d scatter_ = Eigen::Matrix2d::Zero();  // of `tip_`, the same units
  Eigen::Vector2d reach_{0, 0};                        // half sides of the template, scale units
  double scale_px_ = 0;                                // of the training
  std::vector<float> mean_;                            // of the whole object's samples
  std::vector<float> weight_;                          // inverse variances
  std::vector<float> patch_mean_;
  std::vector<float> patch_weight_;
  double odds_factor_ = 1;
  double sureness_ = 0;
  double tip_factor_ = 1;  // on the covariance of a tip that was seen
};

}  // namespace vitreo::vision
