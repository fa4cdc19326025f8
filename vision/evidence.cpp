// SPDX-License-Identifier: Apache-2.0
#include "vision/evidence.h"

#include <algorithm>
#include <cmath>

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

// The rim's quadratic form xx du^2 + 2 xy du dv + yy dv^2 = 1, solved for du along a row.
EllipseRows::EllipseRows(const Ellipse& e) : u_(e.center_px.x()), v_(e.center_px.y()) {
  const double c = std::cos(e.angle);
  const double s = std::sin(e.angle);
  const double ia = 1 / (e.semi_major_px * e.semi_major_px);
  const double ib = 1 / (e.semi_minor_px * e.semi_minor_px);
  const double xx = c * c * ia + s * s * ib;
  const double xy = c * s * (ia - ib);
  slope_ = -xy / xx;
  half_ = 1 / xx;
  falloff_ = ia * ib / (xx * xx);  // (xx yy - xy^2) / xx^2
}

// Pixels whose centers lie within; first == end where the row misses the ellipse.
RowSpan EllipseRows::at(int v) const {
  const double dv = v - v_;
  const double square = half_ - falloff_ * dv * dv;
  if (!(square > 0)) return {};
  const double middle = u_ + slope_ * dv;
  const double half = std::sqrt(square);
  return {static_cast<int>(std::ceil(middle - half)),
          static_cast<int>(std::floor(middle + half)) + 1};
}

RowSpan row_of(const Ellipse& e, int v) { return EllipseRows(e).at(v); }

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
// three; no more of it than the gate's rows v - 1, v and v + 1 ask for. Pixels outside of the image
// count as F = 0.
// A pixel's F is an int8, a sum of nine of them an int16 without overflow.
void Evidence::read_row(const cv::Mat& image, const EvidenceSource& source, const EllipseRows& gate,
                        int v) {
  const auto width = static_cast<std::size_t>(region_.width);
  RowSpan span{region_.x + region_.width, region_.x};
  for (int k = v - 1; k <= v + 1; ++k) {
    const RowSpan of = gate.at(k);
    if (of.first >= of.end) continue;
    span.first = std::max(std::min(span.first, of.first), region_.x);
    span.end = std::min(std::max(span.end, of.end), region_.x + region_.width);
  }
  if (span.first >= span.end) return;
  const int first = std::max(span.first - 1, 0);
  const int end = std::min(span.end + 1, image.cols);
  const int left = region_.x - 1;  // column of row_'s first
  if (first > span.first - 1 || end < span.end + 1)
    std::fill(row_.begin() + (span.first - 1 - left), row_.begin() + (span.end + 1 - left),
              std::int8_t{0});
  if (end > first) source.read(image, v, first, 1, end - first, row_.data() + (first - left));
  std::int16_t* sums = sums_.data() + static_cast<std::size_t>((v + 3) % 3) * width;
  const std::int8_t* f = row_.data();
  for (auto k = static_cast<std::size_t>(span.first - region_.x);
       k < static_cast<std::size_t>(span.end - region_.x); ++k)
    sums[k] = static_cast<std::int16_t>(f[k] + f[k + 1] + f[k + 2]);
}

// One row of the map: the 3 x 3 sum within the gate, kBlocked elsewhere. Returns what lies within.
// kBlocked is the lowest int16: no threshold lets the level set in.
RowSpan Evidence::fill_row(const EllipseRows& gate, int v, const cv::Mat& image) {
  const auto width = static_cast<std::size_t>(region_.width);
  RowSpan span = gate.at(v);
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
  return span;
}

// Row by row with a ring of three rows of sums, so that every pixel's F is looked up once. Other
// objects' pixels are blocked at the end.
void Evidence::look(const cv::Mat& image, EvidenceSource& source, const Ellipse& gate,
                    int max_side_px, const cv::Mat& owned, unsigned char self) {
  image_ = image.size();
  region_ = region_of(gate, max_side_px);
  source.prepare(image, region_);
  const EllipseRows rows(gate);
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
      if (v > 0) read_row(image, source, rows, v - 1);
      read_row(image, source, rows, v);
    }
    if (v + 1 < image.rows) {
      read_row(image, source, rows, v + 1);
    } else {
      std::fill_n(sums_.begin() +
                      static_cast<std::ptrdiff_t>(static_cast<std::size_t>((v + 4) % 3) * width),
                  width, std::int16_t{0});
    }
    const RowSpan span = fill_row(rows, v, image);
    if (owned.empty()) continue;
    std::int16_t* to = values_.data() + index_of(region_.x, v);
    const auto* owner = owned.ptr<unsigned char>(v);
    for (int u = span.first; u < span.end; ++u)
      if (owner[u] != 0 && owner[u] != self) to[u - region_.x] = kBlocked;
  }
}

// Two counts of one loop that a compiler makes vectors of.
double Evidence::share_above(std::int16_t least) const {
  const std::size_t size =
      static_cast<std::size_t>(region_.width) * static_cast<std::size_t>(region_.height);
  const std::int16_t* f = values_.data();
  int open = 0;
  int above = 0;
  for (std::size_t k = 0; k < size; ++k) {
    open += f[k] != kBlocked;
    above += f[k] > least;
  }
  return open > 0 ? static_cast<double>(above) / open : 0;
}

// Bilinear in fixed point of 16 bits each way: no conversion and no rounding a sample. The ends of
// the way are asked whether they lie in the region; then all of it does.
int Evidence::along(const Eigen::Vector2d& from, const Eigen::Vector2d& step, int count,
                    double most, std::int64_t* to) const {
  constexpr double kOne = 65536;
  const double u0 = from.x() - region_.x;
  const double v0 = from.y() - region_.y;
  if (!(std::abs(u0) < 20000 && std::abs(v0) < 20000)) return 0;
  auto u = static_cast<std::int64_t>(std::llround(u0 * kOne));
  auto v = static_cast<std::int64_t>(std::llround(v0 * kOne));
  const auto du = static_cast<std::int64_t>(std::llround(step.x() * kOne));
  const auto dv = static_cast<std::int64_t>(std::llround(step.y() * kOne));
  const auto limit = static_cast<std::int64_t>(most * kScale * kOne * kOne);
  const std::int64_t right = static_cast<std::int64_t>(region_.width - 1) << 16;
  const std::int64_t bottom = static_cast<std::int64_t>(region_.height - 1) << 16;
  const std::int16_t* values = values_.data();
  const std::ptrdiff_t stride = region_.width;
  for (int k = 0; k < count; ++k, u += du, v += dv) {
    if (u < 0 || v < 0 || u >= right || v >= bottom) return k;
    const std::int16_t* p = values + (v >> 16) * stride + (u >> 16);
    const std::int64_t p0 = p[0], p1 = p[1], q0 = p[stride], q1 = p[stride + 1];
    if (std::min(std::min(p0, p1), std::min(q0, q1)) == kBlocked) return k;
    const std::int64_t x = u & 0xffff;
    const std::int64_t upper = (p0 << 16) + (p1 - p0) * x;
    const std::int64_t lower = (q0 << 16) + (q1 - q0) * x;
    const std::int64_t value = (upper << 16) + (lower - upper) * (v & 0xffff);
    to[k] = std::clamp(value, -limit, limit);
  }
  return count;
}

}  // namespace vitreo::vision
