// SPDX-License-Identifier: Apache-2.0
#include "vision/object_search.h"

#include "vision/evidence.h"
#include "vision/moments.h"

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

// Bound of |F|: a highlight must not outweigh a body.
constexpr int kMostTableF = static_cast<int>(2.5 * ColorModel::kScale);
constexpr int kLeastStep = 2;      // px of a cell
constexpr int kTwoPixels = 4;      // px of a cell from which two of its pixels are read
constexpr double kFullBox = 0.35;  // mean F over kMostTableF of a box that may be the object
// Cells round the object from its long axis on that are to be ground, in semi-minor axes, and what
// they count against a box: in dim light a wide part of the ground has the object's colors.
constexpr double kSurround = 0.5;
constexpr double kSurroundShare = 0.5;
constexpr double kFarPenalty = 0.15;  // of a full box's score at one image width's distance

}  // namespace

ObjectSearch::ObjectSearch(const Ellipse& size) : size_(size) {
  set_size({size.semi_major_px, size.semi_minor_px});
  found_.reserve(16);
}

// A cell of about 2/7 of the semi-minor axis and a box of 0.7 of it either way: the box's corners
// stay about within the object.
void ObjectSearch::set_size(const Eigen::Vector2d& semi_axes_px) {
  size_.semi_major_px = semi_axes_px.x();
  size_.semi_minor_px = semi_axes_px.y();
  step_ = std::clamp(static_cast<int>(size_.semi_minor_px / 3.5), kLeastStep, 8);
  half_ = std::max(static_cast<int>(std::lround(0.7 * size_.semi_minor_px / step_)), 1);
  around_ = static_cast<int>(
      std::lround((size_.semi_major_px + kSurround * size_.semi_minor_px) / step_));
  second_ = step_ >= kTwoPixels ? step_ / 2 : 0;
}

// F of every cell and its integral image (Crow 1984).
// Two pixels of each cell: half the variance of one; of the smallest cells, of which a box has
// many, one. Pixels of other objects count as the surest ground, so that no box covers them.
void ObjectSearch::read(const cv::Mat& image, const EvidenceSource& source, const cv::Mat& owned,
                        unsigned char self) {
  const std::int8_t* first = pixels_[0].data();
  const std::int8_t* second = second_ > 0 ? pixels_[1].data() : first;
  for (int j = 0; j < rows_; ++j) {
    source.read(image, j * step_, 0, step_, columns_, pixels_[0].data());
    if (second_ > 0)
      source.read(image, j * step_ + second_, second_, step_, columns_, pixels_[1].data());
    std::int16_t* to = f_.data() + static_cast<std::ptrdiff_t>(j) * columns_;
    for (int i = 0; i < columns_; ++i)
      to[i] = static_cast<std::int16_t>(
          std::clamp((first[i] + second[i]) / 2, -kMostTableF, kMostTableF));
    if (!owned.empty()) {
      const auto* owner = owned.ptr<unsigned char>(j * step_);
      for (int i = 0; i < columns_; ++i)
        if (owner[i * step_] != 0 && owner[i * step_] != self)
          to[i] = static_cast<std::int16_t>(-kMostTableF);
    }
    const std::int32_t* above = sums_.data() + static_cast<std::ptrdiff_t>(j) * (columns_ + 1);
    std::int32_t* sum = sums_.data() + static_cast<std::ptrdiff_t>(j + 1) * (columns_ + 1);
    std::int32_t row = 0;
    sum[0] = 0;
    for (int i = 0; i < columns_; ++i) {
      row += to[i];
      sum[i + 1] = above[i + 1] + row;
    }
  }
}

// Sums of F over the boxes around the cells of row j, cut to the image, into boxes_: four corners
// of the integral image each.
// A box cut by the border has fewer cells and so a lower score: bodies half out of the image come
// last.
void ObjectSearch::sum_boxes(int j) {
  const std::ptrdiff_t stride = columns_ + 1;
  const std::int32_t* top = sums_.data() + std::max(j - half_, 0) * stride;
  const std::int32_t* bottom = sums_.data() + std::min(j + half_ + 1, rows_) * stride;
  const auto cut = [&](int i) {
    const int left = std::max(i - half_, 0);
    const int right = std::min(i + half_ + 1, columns_);
    return bottom[right] - top[right] - bottom[left] + top[left];
  };
  const int inner = std::min(half_, columns_);
  const int end = std::max(columns_ - half_, inner);
  std::int32_t* to = boxes_.data();
  for (int i = 0; i < inner; ++i) to[i] = cut(i);
  const std::int32_t* right_top = top + half_ + 1;
  const std::int32_t* right_bottom = bottom + half_ + 1;
  const std::int32_t* left_top = top - half_;
  const std::int32_t* left_bottom = bottom - half_;
  for (int i = inner; i < end; ++i)
    to[i] = right_bottom[i] - right_top[i] - left_bottom[i] + left_top[i];
  for (int i = end; i < columns_; ++i) to[i] = cut(i);
}

// Mean F over kMostTableF, from -1 to 1, of the cells in the square of `around_` cells either way
// without those of the box, of sum `box`: -1 where the object stands before ground, a little more
// by its own ends; 1 in a wide part of the ground that has its colors.
float ObjectSearch::surround(int i, int j, std::int32_t box) const {
  const std::ptrdiff_t stride = columns_ + 1;
  const int left = std::max(i - around_, 0);
  const int right = std::min(i + around_ + 1, columns_);
  const int above = std::max(j - around_, 0);
  const int below = std::min(j + around_ + 1, rows_);
  const std::int32_t* top = sums_.data() + above * stride;
  const std::int32_t* bottom = sums_.data() + below * stride;
  const std::int32_t sum = bottom[right] - top[right] - bottom[left] + top[left] - box;
  const int side = 2 * half_ + 1;
  const int count = std::max((right - left) * (below - above) - side * side, 1);
  return static_cast<float>(sum) / static_cast<float>(count * kMostTableF);
}

// Mean F of each box over kMostTableF, less what its surroundings have of it, and a penalty that
// grows with the distance from `near_px`; -1 for a box that cannot be the object. And the best of
// each row. So of two equal boxes the one nearer to the last position, or to the middle of the
// image, is tried first.
void ObjectSearch::score(const Eigen::Vector2d& near_px) {
  const int side = 2 * half_ + 1;
  const float per_box = 1.0F / static_cast<float>(side * side * kMostTableF);
  const float per_px = static_cast<float>(kFarPenalty) / static_cast<float>(columns_ * step_);
  const auto least = static_cast<std::int32_t>(kFullBox * side * side * kMostTableF);
  std::fill(score_.begin(), score_.end(), -1.0F);
  for (int j = 0; j < rows_; ++j) {
    sum_boxes(j);
    float* to = score_.data() + static_cast<std::ptrdiff_t>(j) * columns_;
    float best = -1;
    for (int i = 0; i < columns_; ++i) {
      if (boxes_[static_cast<std::size_t>(i)] < least) continue;
      const float full = static_cast<float>(boxes_[static_cast<std::size_t>(i)]) * per_box;
      if (full < static_cast<float>(kFullBox)) continue;
      const float du = static_cast<float>(i * step_ - near_px.x());
      const float dv = static_cast<float>(j * step_ - near_px.y());
      const float wide = surround(i, j, boxes_[static_cast<std::size_t>(i)]);
      to[i] = full - static_cast<float>(kSurroundShare) * (1 + wide) / 2 -
              per_px * std::sqrt(du * du + dv * dv);
      best = std::max(best, to[i]);
    }
    best_[static_cast<std::size_t>(j)] = best;
  }
}

// Non-maximum suppression within `away` cells.
void ObjectSearch::suppress(int i, int j, int away) {
  for (int y = std::max(j - away, 0); y < std::min(j + away + 1, rows_); ++y) {
    const auto row = score_.begin() + static_cast<std::ptrdiff_t>(y) * columns_;
    std::fill(row + std::max(i - away, 0), row + std::min(i + away + 1, columns_), -1.0F);
    if (best_[static_cast<std::size_t>(y)] > -1)
      best_[static_cast<std::size_t>(y)] = *std::max_element(row, row + columns_);
  }
}

// Center and angle around a full box: moments of the cells with F > 0 within reach of it, three
// times from the center just found. The axes stay those searched for.
// The best box need not be in the body's middle; three rounds bring the disc there.
Ellipse ObjectSearch::settle(int i, int j) const {
  Ellipse at{{i, j}, size_.semi_major_px / step_, size_.semi_minor_px / step_, 0};
  double reach = 1.2 * at.semi_major_px;
  for (int round = 0; round < 3; ++round) {
    MomentSums sums;
    const Ellipse disc{at.center_px, reach, reach, 0};
    const int top = std::max(static_cast<int>(at.center_px.y() - reach), 0);
    const int bottom = std::min(static_cast<int>(at.center_px.y() + reach) + 1, rows_);
    const EllipseRows rows(disc);
    for (int y = top; y < bottom; ++y) {
      const RowSpan span = rows.at(y);
      for (int x = std::max(span.first, 0); x < std::min(span.end, columns_); ++x) {
        if (f_[static_cast<std::size_t>(y) * static_cast<std::size_t>(columns_) +
               static_cast<std::size_t>(x)] > 0)
          sums.add(x, y);
      }
    }
    if (sums.count == 0) break;
    at = sums.ellipse({0, 0});
  }
  // The mean of a cell's two pixels lies between them, in u and v.
  const Eigen::Vector2d middle = Eigen::Vector2d::Constant(second_ / 2.0);
  return {at.center_px * step_ + middle, size_.semi_major_px, size_.semi_minor_px, at.angle};
}

// At most 16, the best first; the list is overwritten by the next call. `owned` may be empty.
const std::vector<Ellipse>& ObjectSearch::find(const cv::Mat& image, EvidenceSource& source,
                                               const Eigen::Vector2d& near_px, int most,
                                               const cv::Mat& owned, unsigned char self) {
  found_.clear();
  columns_ = image.cols / step_;
  rows_ = image.rows / step_;
  if (columns_ < 2 || rows_ < 2) return found_;
  // Room for the smallest cells at once, so that another size allocates nothing.
  const auto columns = static_cast<std::size_t>(image.cols / kLeastStep);
  const auto rows = static_cast<std::size_t>(image.rows / kLeastStep);
  for (std::vector<std::int8_t>& one : pixels_) {
    one.reserve(columns);
    one.resize(static_cast<std::size_t>(columns_));
  }
  f_.reserve(columns * rows);
  score_.reserve(columns * rows);
  sums_.reserve((columns + 1) * (rows + 1));
  boxes_.reserve(columns);
  best_.reserve(rows);
  const auto cells = static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_);
  f_.resize(cells);
  score_.resize(cells);
  boxes_.resize(static_cast<std::size_t>(columns_));
  best_.resize(static_cast<std::size_t>(rows_));
  sums_.resize(cells + static_cast<std::size_t>(columns_ + rows_ + 1));
  std::fill_n(sums_.begin(), static_cast<std::size_t>(columns_) + 1, 0);
  source.prepare(image, {{0, 0}, image.size()});
  read(image, source, owned, self);
  score(near_px);
  for (int k = 0; k < std::min(most, 16); ++k) {
    const auto best = std::max_element(best_.begin(), best_.end());
    if (!(*best > -1)) break;
    const int j = static_cast<int>(best - best_.begin());
    const auto row = score_.begin() + static_cast<std::ptrdiff_t>(j) * columns_;
    const int i = static_cast<int>(std::find(row, row + columns_, *best) - row);
    found_.push_back(settle(i, j));
    suppress(i, j, static_cast<int>(size_.semi_major_px / step_) + 1);
  }
  return found_;
}

}  // namespace vitreo::vision
