// Evidence map: the log-likelihood ratio F of a source in a region around the predicted object,
// smoothed, with all that cannot be the object blocked.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/color_model.h"
#include "vision/ellipse.h"
#include "vision/evidence_source.h"

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <vector>

namespace vitreo::vision {

/// Which columns [first, end) of row `v` lie in the ellipse; none: first == end.
struct RowSpan {
  int first = 0;
  int end = 0;
};
RowSpan row_of(const Ellipse& ellipse, int v);

/// row_of() of one ellipse's rows: what they have in common is computed once.
class EllipseRows {
 public:
  explicit EllipseRows(const Ellipse& ellipse);
  RowSpan at(int v) const;

 private:
  double u_;
  double v_;
  double slope_;    // of the rows' middles
  double half_;     // half the middle row
  double falloff_;  // half row^2 = half_^2 - falloff_ dv^2
};

/// `ellipse` with both axes longer by `by_px`, which may be negative; no axis gets below 1 px.
Ellipse grown(const Ellipse& ellipse, double by_px);

class Evidence {
 public:
  static constexpr std::int16_t kBlocked = -32768;
  static constexpr double kScale =
      ColorModel::kScale * 9;        ///< of at(): a 3 x 3 sum of table entries
  static constexpr int kMargin = 4;  ///< blocked pixels all round the gate

  /// Makes room for regions of up to `side_px` squared at once, so that none is made later.
  void reserve(int side_px);
  /// Reads `source` of `image` (CV_8UC3) within `gate`: 3 x 3 sums of F there, kBlocked everywhere
  /// else, which the level set can never enter, so that the region bounds its work. `owned`
  /// (CV_8UC1 of the image's size, or empty): pixels not 0 and not `self` belong to another object
  /// and are blocked too. The region may stick out of the image; what is outside is blocked. A gate
  /// wider than `max_side_px` is cut to it. Allocates only when the region outgrows all before.
  void look(const cv::Mat& image, EvidenceSource& source, const Ellipse& gate, int max_side_px,
            const cv::Mat& owned = {}, unsigned char self = 0);

  const cv::Rect& region() const { return region_; }
  /// Whether the image that was looked at has that pixel.
  bool in_image(double u, double v) const {
    return u >= 0 && v >= 0 && u <= image_.width - 1 && v <= image_.height - 1;
  }
  /// At a pixel of the image, in the region.
  std::int16_t at(int u, int v) const { return values_[index_of(u, v)]; }
  std::size_t index_of(int u, int v) const {
    return static_cast<std::size_t>(v - region_.y) * static_cast<std::size_t>(region_.width) +
           static_cast<std::size_t>(u - region_.x);
  }
  const std::vector<std::int16_t>& values() const { return values_; }  ///< by rows of the region
  static constexpr int kMostAlong = 40;
  static constexpr double kAlongScale = kScale * 4294967296.0;
  /// Share of the pixels within the gate, and not blocked, that have F above `least` (at()'s
  /// units); 0 where there are none.
  double share_above(std::int16_t least) const;
  /// F between pixels, bilinear, clamped to +-`most`, at `from`, `from` + `step`, ... (px), into
  /// `to`, in units of 1 / kAlongScale. Returns how many of `count` (at most kMostAlong) were read
  /// before the first beside which a pixel is blocked or not in the region. |step| at most 2 px.
  int along(const Eigen::Vector2d& from, const Eigen::Vector2d& step, int count, double most,
            std::int64_t* to) const;

 private:
  void read_row(const cv::Mat& image, const EvidenceSource& source, const EllipseRows& gate, int v);
  RowSpan fill_row(const EllipseRows& gate, int v, const cv::Mat& image);
  cv::Rect region_;
  cv::Size image_;
  std::vector<std::int16_t> values_;
  std::vector<std::int16_t> sums_;  // three rows' sums over three columns, in turn
  std::vector<std::int8_t> row_;    // one row's F, a pixel more on either side
};

}  // namespace vitreo::vision
