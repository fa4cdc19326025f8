// SPDX-License-Identifier: Apache-2.0
#include "vision/ground_thumbnail.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace vitreo::vision {
namespace {

constexpr int kAround = 4;                // cells to each side, over which a mean is taken
constexpr int kSaturated = 250;           // gray levels: a reflex stays where it is in the image
constexpr double kDarkest = 8;            // gray levels: a mean below has no structure but noise
constexpr double kMostContrast = 0.15;    // of one cell: no bright or dark body outweighs all else
constexpr double kScale = 4096;           // of contrasts as integers
constexpr double kLeastStructure = 0.01;  // rms of the contrasts
constexpr double kLeastAgreement = 0.6;   // correlation
constexpr double kLeastMargin = 0.15;     // of the best over any that is not beside it
constexpr int kBeside = 4;                // cells
constexpr int kEvery = 4;                 // images from one that is kept to the next
constexpr int kSoon = 2;                  // and to the second one, without which no drift is known
constexpr int kDriftReach = 4;            // cells, of what the ground drifts by in so many

constexpr int kColumns = GroundThumbnail::kColumns;
constexpr int kRows = GroundThumbnail::kRows;
constexpr int kMostSearched = GroundThumbnail::kReach + 1;  // what is at the edge is no peak
constexpr int kSide = 2 * kMostSearched + 1;

// Sums over all cells above and to the left of a corner.
class Sums {
 public:
  template <typename Value>
  explicit Sums(const Value& value) {
    for (int v = 0; v < kRows; ++v)
      for (int u = 0; u < kColumns; ++u)
        at(v + 1, u + 1) = value(v, u) + at(v, u + 1) + at(v + 1, u) - at(v, u);
  }
  double within(int top, int bottom, int left, int right) const {
    return static_cast<double>(at(bottom, right) - at(top, right) - at(bottom, left) +
                               at(top, left));
  }

 private:
  std::int64_t& at(int v, int u) {
    return sums_[static_cast<std::size_t>(v)][static_cast<std::size_t>(u)];
  }
  std::int64_t at(int v, int u) const {
    return sums_[static_cast<std::size_t>(v)][static_cast<std::size_t>(u)];
  }
  std::array<std::array<std::int64_t, kColumns + 1>, kRows + 1> sums_{};
};

// Contrast of each cell with those around it, times kScale.
class Contrasts {
 public:
  // The cells around are as many to each side: a slope of the light, which has its mean in the
  // middle, is no contrast.
  template <typename Levels>
  explicit Contrasts(const Levels& levels) {
    const auto level = [&](int v, int u) {
      return std::int64_t{levels[static_cast<std::size_t>(v)][static_cast<std::size_t>(u)]};
    };
    const Sums sums(level);
    const Sums counts([&](int v, int u) { return std::int64_t{level(v, u) > 0}; });
    for (int v = 0; v < kRows; ++v)
      for (int u = 0; u < kColumns; ++u) {
        const int high = std::min({kAround, v, kRows - 1 - v});
        const int wide = std::min({kAround, u, kColumns - 1 - u});
        const double count = counts.within(v - high, v + high + 1, u - wide, u + wide + 1);
        const double sum = sums.within(v - high, v + high + 1, u - wide, u + wide + 1);
        if (level(v, u) == 0 || sum < 4 * kDarkest * count) continue;
        const double contrast = static_cast<double>(level(v, u)) * count / sum - 1;
        cells_[static_cast<std::size_t>(v)][static_cast<std::size_t>(u)] =
            static_cast<std::int16_t>(
                std::lround(kScale * std::clamp(contrast, -kMostContrast, kMostContrast)));
      }
  }
  const std::int16_t* row(int v) const { return cells_[static_cast<std::size_t>(v)].data(); }
  int at(int v, int u) const { return row(v)[u]; }

 private:
  std::array<std::array<std::int16_t, kColumns>, kRows> cells_{};
};

// Correlations of two views by displacement.
class Agreement {
 public:
  Agreement(const Contrasts& before, const Contrasts& later, int searched)
      : searched_(searched), before_(before), later_(later), of_before_(before), of_later_(later) {
    for_each([&](int du, int dv) { at(du, dv) = correlation(du, dv); });
  }
  double at(int du, int dv) const { return all_[index(du, dv)]; }
  template <typename Do>
  void for_each(const Do& act) const {
    for (int dv = -searched_; dv <= searched_; ++dv)
      for (int du = -searched_; du <= searched_; ++du) act(du, dv);
  }

 private:
  struct Moments {
    explicit Moments(const Contrasts& of)
        : sums([&](int v, int u) { return std::int64_t{of.at(v, u)}; }),
          squares([&](int v, int u) { return std::int64_t{of.at(v, u)} * of.at(v, u); }) {}
    Sums sums;
    Sums squares;
  };
  static std::size_t index(int du, int dv) {
    return static_cast<std::size_t>((dv + kMostSearched) * kSide + du + kMostSearched);
  }
  double& at(int du, int dv) { return all_[index(du, dv)]; }

  // Pearson's, over what both views show.
  double correlation(int du, int dv) const {
    const int left = std::max(-du, 0);
    const int top = std::max(-dv, 0);
    const int wide = kColumns - std::abs(du);
    const int high = kRows - std::abs(dv);
    double both = 0;
    for (int v = top; v < top + high; ++v) {
      const std::int16_t* a = before_.row(v) + left;
      const std::int16_t* b = later_.row(v + dv) + left + du;
      std::int32_t sum = 0;  // 64 products of (0.15 * 4096)^2 at most
      for (int u = 0; u < wide; ++u) sum += std::int32_t{a[u]} * b[u];
      both += sum;
    }
    const double count = double{1} * wide * high;
    const auto moment = [&](const Sums& of, int v, int u) {
      return of.within(v, v + high, u, u + wide) / count;
    };
    const double a = moment(of_before_.sums, top, left);
    const double b = moment(of_later_.sums, top + dv, left + du);
    const double aa = moment(of_before_.squares, top, left) - a * a;
    const double bb = moment(of_later_.squares, top + dv, left + du) - b * b;
    constexpr double kLeast = kLeastStructure * kScale * kLeastStructure * kScale;
    return aa < kLeast || bb < kLeast ? 0 : (both / count - a * b) / std::sqrt(aa * bb);
  }

  int searched_;
  const Contrasts& before_;
  const Contrasts& later_;
  Moments of_before_;
  Moments of_later_;
  std::array<double, kSide * kSide> all_{};
};

// Vertex of the parabola through three values a cell apart, the middle one the largest.
double vertex(double before, double at, double after) {
  const double bend = before - 2 * at + after;
  return bend < 0 ? std::clamp(0.5 * (before - after) / bend, -0.5, 0.5) : 0;
}

}  // namespace

// Four samples of one row in each cell: what it costs is the reading.
GroundThumbnail::GroundThumbnail(const cv::Mat& image)
    : cell_px_(image.cols / double{kColumns}, image.rows / double{kRows}) {
  std::array<int, 4 * kColumns> green{};
  for (std::size_t k = 0; k < green.size(); ++k)
    green[k] = 3 * (static_cast<int>(2 * k + 1) * image.cols / (8 * kColumns)) + 1;
  for (int v = 0; v < kRows; ++v) {
    const auto* row = image.ptr<unsigned char>((2 * v + 1) * image.rows / (2 * kRows));
    for (std::size_t u = 0; u < kColumns; ++u) {
      const int* at = &green[4 * u];
      const std::array<int, 4> four{row[at[0]], row[at[1]], row[at[2]], row[at[3]]};
      const bool says = *std::max_element(four.begin(), four.end()) < kSaturated;
      sums_[static_cast<std::size_t>(v)][u] =
          static_cast<std::uint16_t>(says ? four[0] + four[1] + four[2] + four[3] : 0);
    }
  }
}

std::optional<Eigen::Vector2d> GroundThumbnail::shift_to(const GroundThumbnail& later,
                                                         int reach) const {
  if (empty() || cell_px_ != later.cell_px_) return std::nullopt;
  reach = std::clamp(reach, 1, kReach);
  const Contrasts before(sums_);
  const Contrasts now(later.sums_);
  const Agreement agreement(before, now, reach + 1);
  int u = 0;
  int v = 0;
  double best = -1;
  double second = -1;
  agreement.for_each([&](int du, int dv) {
    if (agreement.at(du, dv) > best) best = agreement.at(du, dv), u = du, v = dv;
  });
  agreement.for_each([&](int du, int dv) {
    if (std::max(std::abs(du - u), std::abs(dv - v)) > kBeside)
      second = std::max(second, agreement.at(du, dv));
  });
  if (best < kLeastAgreement || best < second + kLeastMargin) return std::nullopt;
  if (std::max(std::abs(u), std::abs(v)) > reach) return std::nullopt;
  const Eigen::Vector2d cells(u + vertex(agreement.at(u - 1, v), best, agreement.at(u + 1, v)),
                              v + vertex(agreement.at(u, v - 1), best, agreement.at(u, v + 1)));
  return cells.cwiseProduct(cell_px_);
}

void GroundHistory::keep(const cv::Mat& image) {
  if (!last_.empty() && age_ < (before_.empty() ? kSoon : kEvery)) return;
  before_ = last_;
  apart_ = age_;
  last_ = GroundThumbnail(image);
  age_ = 0;
}

std::optional<Eigen::Vector2d> GroundHistory::jump_to(const cv::Mat& image) const {
  if (last_.empty()) return std::nullopt;
  std::optional<Eigen::Vector2d> shift = last_.shift_to(GroundThumbnail(image));
  if (!shift) return std::nullopt;
  if (const auto drift = before_.shift_to(last_, kDriftReach)) *shift -= age_ * *drift / apart_;
  return shift;
}

}  // namespace vitreo::vision
