// SPDX-License-Identifier: Apache-2.0
#include "vision/evidence.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace vitreo::vision {
namespace {

// The gate's bounding box, whose half sides are hypot(a cos, b sin) and hypot(a sin, b cos), and
// kMargin blocked pixels all round, so that neighbors of a front pixel always exist.
cv::Rect region_of(const Ellipse& gate, int max_side_px) {
  const double c = std::cos(gate.angle);
  const double s = std::sin(gate.angle);
  const double a = gate.semi_major_px;
  const double b = gate.semi_minor_px;
  const auto half = [most = max_side_px / 2](double side) {
    return std::min(static_cast<int>(std::ceil(side)) + Evidence::kMargin + 1, most);
  };
  const int half_u = half(std::hypot(a * c, b * s));
  const int half_v = half(std::hypot(a * s, b * c));
  const int u0 = static_cast<int>(std::lround(gate.center_px.x()));
  const int v0 = static_cast<int>(std::lround(gate.center_px.y()));
  return {u0 - half_u, v0 - half_v, 2 * half_u + 1, 2 * half_v + 1};
}

}  // namespace

// Pixels whose centers lie within; first == end where the row misses the ellipse.
RowSpan row_of(const Ellipse& e, int v) {
  // The rim's quadratic form xx du^2 + 2 xy du dv + yy dv^2 = 1, solved for du along the row.
  const double c = std::cos(e.angle);
  const double s = std::sin(e.angle);
  const double dv = v - e.center_px.y();
  const double ia = 1 / (e.semi_major_px * e.semi_major_px);
  const double ib = 1 / (e.semi_minor_px * e.semi_minor_px);
  const double xx = c * c * ia + s * s * ib;
  const double xy = c * s * (ia - ib);
  const double yy = s * s * ia + c * c * ib;
  const double root = xy * xy * dv * dv - xx * (yy * dv * dv - 1);
  if (!(root > 0)) return {};
  const double middle = e.center_px.x() - xy * dv / xx;
  const double half = std::sqrt(root) / xx;
  return {static_cast<int>(std::ceil(middle - half)),
          static_cast<int>(std::floor(middle + half)) + 1};
}

// Not the exact parallel curve, which is no ellipse: exact on the axes.
// No axis gets shorter than 1 px, so that the result is an ellipse.
Ellipse grown(const Ellipse& ellipse, double by_px) {
  Ellipse e = ellipse;
  e.semi_major_px = std::max(e.semi_major_px + by_px, 1.0);
  e.semi_minor_px = std::max(e.semi_minor_px + by_px, 1.0);
  return e;
}

// The region's sides are at most side_px + 1, plus a pixel on either side for the sums.
// Called once with the largest gate, so that no frame allocates.
void Evidence::reserve(int side_px) {
  const auto side = static_cast<std::size_t>(side_px) + 2;
  values_.reserve(side * side);
  row_.reserve(side + 2);
  sums_.reserve(3 * side);
}

// Sums of F over three columns of row v, which lies in the image, into its slot of the ring of
// three. Pixels outside of the image count as F = 0.
// A pixel's F is an int8, a sum of nine of them an int16 without overflow.
void Evidence::read_row(const cv::Mat& image, const EvidenceSource& source, int v) {
  const auto width = static_cast<std::size_t>(region_.width);
  const int first = std::max(region_.x - 1, 0);
  const int end = std::min(region_.x + region_.width + 1, image.cols);
  std::fill(row_.begin(), row_.begin() + static_cast<std::ptrdiff_t>(width + 2), std::int8_t{0});
  if (end > first)
    source.read(image, v, first, 1, end - first, row_.data() + (first - (region_.x - 1)));
  std::int16_t* sums = sums_.data() + static_cast<std::size_t>((v + 3) % 3) * width;
  const std::int8_t* f = row_.data();
  for (std::size_t k = 0; k < width; ++k)
    sums[k] = static_cast<std::int16_t>(f[k] + f[k + 1] + f[k + 2]);
}

// One row of the map: the 3 x 3 sum within the gate, kBlocked elsewhere and on other objects'
// pixels.
// kBlocked is the lowest int16: no threshold lets the level set in.
void Evidence::fill_row(const Ellipse& gate, int v, const cv::Mat& image, const cv::Mat& owned,
                        unsigned char self) {
  const auto width = static_cast<std::size_t>(region_.width);
  RowSpan span = row_of(gate, v);
  span.first = std::max({span.first, region_.x + kMargin, 0});
  span.end = std::min({span.end, region_.x + region_.width - kMargin, image.cols});
  std::int16_t* to = values_.data() + index_of(region_.x, v);
  std::fill(to, to + width, kBlocked);
  const std::int16_t* a = sums_.data();
  const std::int16_t* b = a + width;
  const std::int16_t* c = b + width;
  for (int u = span.first; u < span.end; ++u) {
    const auto k = static_cast<std::size_t>(u - region_.x);
    to[k] = static_cast<std::int16_t>(a[k] + b[k] + c[k]);
  }
  if (owned.empty()) return;
  const auto* owner = owned.ptr<unsigned char>(v);
  for (int u = span.first; u < span.end; ++u) {
    if (owner[u] != 0 && owner[u] != self) to[u - region_.x] = kBlocked;
  }
}

// Row by row with a ring of three rows of sums, so that every pixel's F is looked up once.
void Evidence::look(const cv::Mat& image, EvidenceSource& source, const Ellipse& gate,
                    int max_side_px, const cv::Mat& owned, unsigned char self) {
  image_ = image.size();
  region_ = region_of(gate, max_side_px);
  source.prepare(image, region_);
  const auto width = static_cast<std::size_t>(region_.width);
  const auto height = static_cast<std::size_t>(region_.height);
  if (values_.size() < width * height) values_.resize(width * height);
  if (row_.size() < width + 2) row_.resize(width + 2);
  if (sums_.size() < 3 * width) sums_.resize(3 * width);
  std::fill(sums_.begin(), sums_.end(), std::int16_t{0});
  const int first = region_.y + kMargin;
  const int end = region_.y + region_.height - kMargin;
  for (int v = region_.y; v < region_.y + region_.height; ++v) {
    const bool inside = v >= std::max(first, 0) && v < std::min(end, image.rows);
    if (!inside) {
      std::fill_n(values_.begin() + static_cast<std::ptrdiff_t>(index_of(region_.x, v)), width,
                  kBlocked);
      continue;
    }
    // The ring holds the rows v - 1, v and v + 1; outside of the image a row counts as F = 0.
    if (v == std::max(first, 0)) {
      if (v > 0) read_row(image, source, v - 1);
      read_row(image, source, v);
    }
    if (v + 1 < image.rows) {
      read_row(image, source, v + 1);
    } else {
      std::fill_n(sums_.begin() +
                      static_cast<std::ptrdiff_t>(static_cast<std::size_t>((v + 4) % 3) * width),
                  width, std::int16_t{0});
    }
    fill_row(gate, v, image, owned, self);
  }
}

// NaN marks the end of what is known; callers stop there.
// F in natural units; u, v in px of the image.
double Evidence::between(double u, double v) const {
  const double fu = std::floor(u);
  const double fv = std::floor(v);
  const int i = static_cast<int>(fu);
  const int j = static_cast<int>(fv);
  if (i < region_.x || j < region_.y || i + 1 >= region_.x + region_.width ||
      j + 1 >= region_.y + region_.height) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const std::int16_t* p = values_.data() + index_of(i, j);
  const std::int16_t* q = p + region_.width;
  if (p[0] == kBlocked || p[1] == kBlocked || q[0] == kBlocked || q[1] == kBlocked) {
    return std::numeric_limits<double>::quiet_NaN();
  }
  const double x = u - fu;
  const double y = v - fv;
  return ((p[0] * (1 - x) + p[1] * x) * (1 - y) + (q[0] * (1 - x) + q[1] * x) * y) / kScale;
}

}  // namespace vitreo::vision
