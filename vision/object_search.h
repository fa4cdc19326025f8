// Object search: rough and fast detection in the whole image by the object's color and size (thesis
// 8.3.1).
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/ellipse.h"
#include "vision/evidence_source.h"

#include <opencv2/core/mat.hpp>

#include <array>
#include <cstdint>
#include <vector>

namespace vitreo::vision {

/// Sums of F on a coarse grid over boxes that fit into the object: the fullest boxes, and the axes
/// of what is around them. Vessels are narrower than such a box, which distinguishes them from the
/// object without labeling.
class ObjectSearch {
 public:
  /// `size`: semi-axes of the object, px; its center and angle are not read.
  explicit ObjectSearch(const Ellipse& size);
  /// At most `most` candidates, best first, of the searched size. `near_px`: the expected center,
  /// which decides between similar candidates. `owned` as Evidence::look. Allocates only when the
  /// image is larger than all before.
  const std::vector<Ellipse>& find(const cv::Mat& image, EvidenceSource& source,
                                   const Eigen::Vector2d& near_px, int most,
                                   const cv::Mat& owned = {}, unsigned char self = 0);
  /// Semi-axes of the object in the searches to come, px.
  void set_size(const Eigen::Vector2d& semi_axes_px);

 private:
  void read(const cv::Mat& image, const EvidenceSource& source, const cv::Mat& owned,
            unsigned char self);
  void sum_boxes(int j);
  float surround(int i, int j, std::int32_t box) const;
  void score(const Eigen::Vector2d& near_px);
  void suppress(int i, int j, int away);
  Ellipse settle(int i, int j) const;
  int step_ = 0;
  int half_ = 0;
  int around_ = 0;
  int second_ = 0;  // px from a cell's first pixel to its second, right and down; 0: one is read
  Ellipse size_;    // px
  int columns_ = 0;
  int rows_ = 0;
  std::array<std::vector<std::int8_t>, 2> pixels_;  // two of each cell of one row
  std::vector<std::int16_t> f_;                     // of each cell, ColorModel::kScale F, clamped
  std::vector<std::int32_t> sums_;                  // integral image, one row and column more
  std::vector<std::int32_t> boxes_;                 // of one row
  std::vector<float> score_;
  std::vector<float> best_;  // score of each row
  std::vector<Ellipse> found_;
};

}  // namespace vitreo::vision
