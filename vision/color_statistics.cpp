// SPDX-License-Identifier: Apache-2.0
#include "vision/color_statistics.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <limits>
#include <numeric>

namespace vitreo::vision {
namespace {

constexpr std::array<double, 3> kDefocus_px{2, 4, 8};  // standard deviations
constexpr float kLeastMixed = 0.1F;                    // share of either side in a mixed color

constexpr std::size_t kTableLevels = ColorModel::kLevels;
constexpr std::size_t kCells = kTableLevels * kTableLevels * kTableLevels;
// Probability added to every bin of both histograms (additive smoothing): below it a bin's share is
// chance, and a color that occurred in neither comes out as F = 0.
constexpr double kProbabilityFloor = 2e-5;
constexpr double kFlat = 1e-3;  // how far above its minimum g(t) still counts as flat

// The histogram bin of every cell.
// From the 64^3 cells of the table to bins of the space used. Made once per model, so that a
// pixel's conversion is a look-up.
std::vector<std::size_t> bins_of(const ColorModelSettings& settings) {
  const std::vector<int> used = indices_of(settings.channels.set);
  std::vector<std::size_t> bins(kCells);
  // A level stands for the four gray levels 4 k to 4 k + 3, whose center is 4 k + 1.5.
  const auto center = [](std::size_t level) {
    return (4.0 * static_cast<double>(level) + 1.5) / 255;
  };
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    const auto value = convert(settings.channels.space, center(cell % kTableLevels),
                               center(cell / kTableLevels % kTableLevels), center(cell >> 12));
    std::size_t bin = 0;
    for (const int k : used) {
      // A value of exactly 1 belongs to the last bin.
      const int index = static_cast<int>(value[static_cast<std::size_t>(k)] * settings.bins);
      bin = bin * static_cast<std::size_t>(settings.bins) +
            static_cast<std::size_t>(std::clamp(index, 0, settings.bins - 1));
    }
    bins[cell] = bin;
  }
  return bins;
}

// One Gaussian pass along the axis whose neighbors are `stride` apart, ends repeated. A hue's two
// ends are not joined, so a red object's histogram is split there.
void smooth_along(std::vector<double>& histogram, std::size_t stride, int bins,
                  const std::vector<double>& kernel) {
  const int reach = static_cast<int>(kernel.size()) - 1;
  const std::vector<double> before = histogram;
  for (std::size_t k = 0; k < histogram.size(); ++k) {
    const int at = static_cast<int>(k / stride % static_cast<std::size_t>(bins));
    double sum = 0;
    for (int d = -reach; d <= reach; ++d) {
      const int to = std::clamp(at + d, 0, bins - 1) - at;
      const auto source = static_cast<std::ptrdiff_t>(k) + to * static_cast<std::ptrdiff_t>(stride);
      sum +=
          kernel[static_cast<std::size_t>(std::abs(d))] * before[static_cast<std::size_t>(source)];
    }
    histogram[k] = sum;
  }
}

// Separable Gaussian smoothing, cut at two standard deviations: a Parzen window on the histogram.
// Below a tenth of a bin the kernel is one bin wide, and nothing changes.
void smooth_histogram(std::vector<double>& histogram, const ColorModelSettings& settings) {
  if (settings.smoothing_bins < 0.1) return;
  const int reach = static_cast<int>(std::ceil(2 * settings.smoothing_bins));
  std::vector<double> kernel;
  double sum = 0;
  for (int d = 0; d <= reach; ++d) {
    kernel.push_back(std::exp(-0.5 * d * d / (settings.smoothing_bins * settings.smoothing_bins)));
    sum += d == 0 ? kernel.back() : 2 * kernel.back();
  }
  for (double& k : kernel) k /= sum;
  std::size_t stride = 1;
  for (std::size_t k = 0; k < indices_of(settings.channels.set).size(); ++k) {
    smooth_along(histogram, stride, settings.bins, kernel);
    stride *= static_cast<std::size_t>(settings.bins);
  }
}

// P(u | x in Omega) of thesis 8.1.1: the normalized joint histogram of the used channels.
// `counts` by cell of RGB; `bins` has each cell's bin in the space used.
std::vector<double> histogram_of(const std::vector<double>& counts,
                                 const std::vector<std::size_t>& bins,
                                 const ColorModelSettings& settings) {
  std::size_t size = 1;
  for (std::size_t k = 0; k < indices_of(settings.channels.set).size(); ++k) {
    size *= static_cast<std::size_t>(settings.bins);
  }
  std::vector<double> histogram(size, 0.0);
  double sum = 0;
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    histogram[bins[cell]] += counts[cell];
    sum += counts[cell];
  }
  for (double& h : histogram) h /= sum;
  smooth_histogram(histogram, settings);
  return histogram;
}

// Omega_n of thesis 8.1.1: the mask dilated by a disc omega, without the mask.
// Only the neighborhood counts for quality and thresholds, since a tracker meets that and not the
// whole image.
cv::Mat neighborhood(const cv::Mat& mask, int radius) {
  const cv::Mat disc =
      cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * radius + 1, 2 * radius + 1});
  cv::Mat grown;
  cv::dilate(mask, grown, disc);
  grown.setTo(0, mask);
  return grown;
}

// F over a mask in ascending order: shares above a threshold are then one binary search.
// Floats suffice: F has steps of 1/16 before it is smoothed.
std::vector<float> sorted_values(const cv::Mat& f, const cv::Mat& mask) {
  std::vector<float> values;
  for (int v = 0; v < f.rows; ++v) {
    for (int u = 0; u < f.cols; ++u) {
      if (mask.at<unsigned char>(v, u) != 0) values.push_back(f.at<float>(v, u));
    }
  }
  std::sort(values.begin(), values.end());
  return values;
}

// Share of the values above `t`.
double share_above(const std::vector<float>& sorted, double t) {
  if (sorted.empty()) return 0;
  const auto from = std::upper_bound(sorted.begin(), sorted.end(), static_cast<float>(t));
  return static_cast<double>(sorted.end() - from) / static_cast<double>(sorted.size());
}

// The ends of the range where `cost` stays within `slack` of its minimum, over thresholds of F from
// -4 to 4 in steps of 1/32, half a step of the table.
Thresholds flat_part(const std::function<double(double)>& cost, double slack) {
  constexpr double kEnd = 4;
  constexpr double kThresholdStep = 1.0 / 32;
  double least = std::numeric_limits<double>::infinity();
  for (double t = -kEnd; t <= kEnd; t += kThresholdStep) least = std::min(least, cost(t));
  Thresholds ends{kEnd, -kEnd};
  for (double t = -kEnd; t <= kEnd; t += kThresholdStep) {
    if (cost(t) > least + slack) continue;
    ends.low = std::min(ends.low, t);
    ends.high = std::max(ends.high, t);
  }
  return ends;
}

// Image and mask blurred alike: the mask says how much of each pixel is the object's.
void count_mixed(const LabeledImage& one, double sigma, ColorCounts& mixed) {
  const int reach = static_cast<int>(4 * sigma);
  const cv::Rect object = cv::boundingRect(one.mask);
  const cv::Rect part = cv::Rect(object.x - reach, object.y - reach, object.width + 2 * reach,
                                 object.height + 2 * reach) &
                        cv::Rect({0, 0}, one.image.size());
  cv::Mat image;
  cv::Mat share;
  cv::GaussianBlur(one.image(part), image, {}, sigma);
  cv::Mat(one.mask(part) != 0).convertTo(share, CV_32F, 1.0 / 255);
  cv::GaussianBlur(share, share, {}, sigma);
  for (int v = 0; v < image.rows; ++v) {
    const auto* from = image.ptr<cv::Vec3b>(v);
    const auto* of_object = share.ptr<float>(v);
    for (int u = 0; u < image.cols; ++u) {
      if (of_object[u] < kLeastMixed || of_object[u] > 1 - kLeastMixed) continue;
      auto& side = of_object[u] > 0.5F ? mixed.object : mixed.ground;
      side[ColorModel::cell_of(from[u][0], from[u][1], from[u][2])] += 1;
    }
  }
}

double midpoint(const Thresholds& t) { return (t.low + t.high) / 2; }

}  // namespace

// F of every pixel.
// In natural units, log of a ratio; the table has sixteenths.
cv::Mat table_image(const cv::Mat& image, const std::vector<std::int8_t>& table) {
  cv::Mat f(image.size(), CV_32F);
  for (int v = 0; v < image.rows; ++v) {
    const auto* from = image.ptr<cv::Vec3b>(v);
    auto* to = f.ptr<float>(v);
    for (int u = 0; u < image.cols; ++u) {
      to[u] = static_cast<float>(table[ColorModel::cell_of(from[u][0], from[u][1], from[u][2])] /
                                 ColorModel::kScale);
    }
  }
  return f;
}

// Omega_o against its whole complement Omega_b, as thesis 8.1.1 defines the histograms; only
// quality and thresholds look at the neighborhood.
// By cell of RGB, whatever the space, so that one pass over the images serves all spaces.
ColorCounts count_colors(std::span<const LabeledImage> images) {
  ColorCounts counts{std::vector<double>(kCells, 0.0), std::vector<double>(kCells, 0.0)};
  for (const LabeledImage& one : images) {
    for (int v = 0; v < one.image.rows; ++v) {
      const auto* from = one.image.ptr<cv::Vec3b>(v);
      const auto* mask = one.mask.ptr<unsigned char>(v);
      for (int u = 0; u < one.image.cols; ++u) {
        auto& side = mask[u] != 0 ? counts.object : counts.ground;
        side[ColorModel::cell_of(from[u][0], from[u][1], from[u][2])] += 1;
      }
    }
  }
  return counts;
}

// Of the few pixels of an object the rim's are a large share, and of all the ground's they are next
// to none: by the images' own counts a color that is mixed of a fifth of the object is the
// object's, and one out of focus grows until its outline finds no end. So what is mixed counts as
// much on both sides.
void add_mixed_colors(ColorCounts& counts, std::span<const LabeledImage> images, double share) {
  if (share <= 0) return;
  ColorCounts mixed{std::vector<double>(kCells, 0.0), std::vector<double>(kCells, 0.0)};
  for (const LabeledImage& one : images)
    for (const double sigma : kDefocus_px) count_mixed(one, sigma, mixed);
  const auto add = [share](std::vector<double>& to, const std::vector<double>& more) {
    const double seen = std::accumulate(to.begin(), to.end(), 0.0);
    const double of_more = std::accumulate(more.begin(), more.end(), 0.0);
    if (of_more <= 0) return;
    for (std::size_t k = 0; k < to.size(); ++k) to[k] += share * seen / of_more * more[k];
  };
  add(counts.object, mixed.object);
  add(counts.ground, mixed.ground);
}

// F = log(P(u|object) / P(u|ground)) of thesis 8.2.1, cycle one, of every cell, clamped to +-127 /
// 16.
// Rounded to int8: sixteenths between -7.94 and 7.94, which one byte per cell holds.
std::vector<std::int8_t> compile_table(const ColorCounts& counts,
                                       const ColorModelSettings& settings) {
  const std::vector<std::size_t> bins = bins_of(settings);
  std::vector<double> f = histogram_of(counts.object, bins, settings);
  const std::vector<double> ground = histogram_of(counts.ground, bins, settings);
  for (std::size_t k = 0; k < f.size(); ++k)
    f[k] = std::log((f[k] + kProbabilityFloor) / (ground[k] + kProbabilityFloor));
  std::vector<std::int8_t> table(kCells);
  for (std::size_t cell = 0; cell < kCells; ++cell) {
    const double scaled = std::clamp(f[bins[cell]] * ColorModel::kScale, -127.0, 127.0);
    table[cell] = static_cast<std::int8_t>(std::lround(scaled));
  }
  return table;
}

// (8.1) r_j = c_o + c_n - m_o - m_n with the binary rule F > 0, for which m_o = 1 - c_o and c_n = 1
// - m_n. Deviation over the images with divisor n.
// 8.1.1 compares mean and variance of r: a space that is good on average may fail in one image.
Quality quality_of(std::span<const LabeledImage> images, const std::vector<std::int8_t>& table,
                   int neighborhood_px) {
  Quality quality;
  for (const LabeledImage& one : images) {
    const cv::Mat f = table_image(one.image, table);
    const auto object = sorted_values(f, one.mask);
    const auto ground = sorted_values(f, neighborhood(one.mask, neighborhood_px));
    const double co = share_above(object, 0);
    const double mn = share_above(ground, 0);
    quality.of_image.push_back(co + (1 - mn) - (1 - co) - mn);  // (8.1)
  }
  const auto count = static_cast<double>(quality.of_image.size());
  for (const double r : quality.of_image) quality.mean += r / count;
  for (const double r : quality.of_image)
    quality.deviation += (r - quality.mean) * (r - quality.mean) / count;
  quality.deviation = std::sqrt(quality.deviation);
  return quality;
}

// (8.2) with c_o, m_n counted at t_h and c_n, m_o at t_l separates into g(t_h) + g(t_l), where g(t)
// = missed(t)^2 + false(t)^2; hence the two readings of ColorModel::flat_thresholds() and
// weighted_thresholds(). Averaged over the images, as the thesis does.
// Thresholds are taken on smoothed F, quality on the plain one, as the thesis' rule F > 0 is.
std::array<Thresholds, 2> thresholds_of(std::span<const LabeledImage> images,
                                        const EvidenceImage& evidence,
                                        const ColorModelSettings& settings) {
  Thresholds flat;
  Thresholds weighted;
  const auto count = static_cast<double>(images.size());
  for (const LabeledImage& one : images) {
    cv::Mat f = evidence(one.image);
    cv::blur(f, f, {3, 3});  // as Evidence does: thresholds of unsmoothed F fail on smoothed F
    const auto object = sorted_values(f, one.mask);
    const auto ground = sorted_values(f, neighborhood(one.mask, settings.neighborhood_px));
    const auto cost = [&](double t, double of_missed, double of_false) {
      const double missed = 1 - share_above(object, t);
      const double wrong = share_above(ground, t);
      return of_missed * missed * missed + of_false * wrong * wrong;
    };
    const Thresholds ends = flat_part([&](double t) { return cost(t, 1, 1); }, kFlat);
    flat.low += ends.low / count;
    flat.high += ends.high / count;
    // At t_h a missed object pixel is only undecided, at t_l a ground pixel is.
    weighted.high +=
        midpoint(flat_part([&](double t) { return cost(t, 1, settings.weight); }, 0)) / count;
    weighted.low +=
        midpoint(flat_part([&](double t) { return cost(t, settings.weight, 1); }, 0)) / count;
  }
  // With little overlap of object and ground the two optima may cross.
  weighted.high = std::max(weighted.high, weighted.low);
  return {flat, weighted};
}

}  // namespace vitreo::vision
