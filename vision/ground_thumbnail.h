// Ground thumbnail: a view's ground in a few thousand numbers, by which a later view of it is known
// for the same one, displaced: a microscope that was moved, an eye that turned.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <array>
#include <cstdint>
#include <optional>

namespace vitreo::vision {

/// Green levels of the cells of a fixed grid, whatever the image's size. Each is compared as what
/// it is against the mean of the cells around it, so that lamp, vignette and spot of light do not
/// count. Nothing is allocated.
class GroundThumbnail {
 public:
  static constexpr int kColumns = 64;
  static constexpr int kRows = 48;
  static constexpr int kReach = 12;  ///< cells, of a displacement along either axis
  /// Of no view: displaced against nothing.
  GroundThumbnail() = default;
  /// `image`: CV_8UC3 (BGR).
  explicit GroundThumbnail(const cv::Mat& image);
  bool empty() const { return cell_px_.isZero(); }
  /// What was seen at p is at p + shift (px) in `later`, a view of the same size. At most kReach
  /// cells either way, which is 120 px of 640 x 480; good to a fifth of a cell in the mean, to less
  /// than half of one. Nothing where the views have no structure or do not agree, or where another
  /// displacement within `reach` cells (1 to kReach) fits nearly as well.
  std::optional<Eigen::Vector2d> shift_to(const GroundThumbnail& later, int reach = kReach) const;

 private:
  /// Sums of four samples; 0: says nothing, as one of them is saturated.
  std::array<std::array<std::uint16_t, kColumns>, kRows> sums_{};
  Eigen::Vector2d cell_px_{0, 0};
};

/// The ground of the last images in which an object was tracked, by which a jump of the view is
/// told from the ground's own drift. A part of a tracker's memory: a frame can be undone.
class GroundHistory {
 public:
  /// A new image.
  void next() { ++age_; }
  /// It was tracked in: kept, but not every time, since what that costs is to read the image.
  void keep(const cv::Mat& image);
  /// By how much `image`, the present one, is displaced (px) against where the ground's drift would
  /// have taken it. Nothing where its ground is not known for the same.
  std::optional<Eigen::Vector2d> jump_to(const cv::Mat& image) const;
  /// After a jump, or where the object was elsewhere: nothing is known.
  void forget() { last_ = before_ = {}; }

 private:
  GroundThumbnail last_;
  GroundThumbnail before_;
  int age_ = 0;    // images since `last_`
  int apart_ = 0;  // images from `before_` to it
};

}  // namespace vitreo::vision
