// SPDX-License-Identifier: Apache-2.0
#include "vision/look_memory.h"

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr std::size_t kNeighbors = 64;
constexpr std::size_t kNearest = 16;  // of them, whose mean counts
constexpr double kBandwidth = 0.45;   // of the densities, in units of the features
constexpr double kLeastDensity = 1e-4;
// Of looks at what no training image showed: a look that is like none at the object is not at it.
constexpr double kUnknownDensity = 2e-3;
// Means of chi^2 of two and three degrees of freedom.
constexpr double kCenterMean = 2;
constexpr double kShapeMean = 3;
// The largest of the neighbors' squared errors lies at the edge of this region: a vessel beside the
// rim moves one look in twenty by much and leaves no trace in it, so tails are heavier than a
// Gaussian's, and what errs most in training is to lie well within 5 sigma.
constexpr double kLargest = 14;
constexpr double kCaution = 1.3;  // of a variance from 16 looks
constexpr double kMostFactor = 400;
constexpr double kFewestOthers = 30;  // for which their density stands
constexpr int kMostLooks = 20000;     // of a file

// exp(-d2 / (2 bandwidth^2)) up to three deviations, by linear interpolation in a table: 2e-6 off
// at most, and a frame asks for hundreds.
class Kernel {
 public:
  Kernel() {
    for (std::size_t k = 0; k < values_.size(); ++k)
      values_[k] = static_cast<float>(std::exp(-kMost * static_cast<double>(k) / kSteps));
  }
  float operator()(float d2) const {
    const float at = d2 * static_cast<float>(kSteps / (kMost * 2 * kBandwidth * kBandwidth));
    if (!(at < kSteps)) return 0;
    const auto k = static_cast<std::size_t>(at);
    return values_[k] + (at - static_cast<float>(k)) * (values_[k + 1] - values_[k]);
  }

 private:
  static constexpr double kMost = 4.5;
  static constexpr int kSteps = 1024;
  std::array<float, kSteps + 1> values_{};
};

const Kernel& kernel() {
  static const Kernel kTable;
  return kTable;
}

// Squared errors of neighbors. factor(): the mean of the nearest over what it should be, or what
// the largest of all demands.
struct Errors {
  double sum = 0;
  double largest = 0;
  double count = 0;
  void add(double squared, bool nearest) {
    largest = std::max(largest, squared);
    if (nearest) sum += squared, ++count;
  }
  double factor(double mean) const {
    return std::clamp(std::max(kCaution * sum / (count * mean), largest / kLargest), 1.0,
                      kMostFactor);
  }
};

void save_look(ByteWriter& out, const LookFeatures& look) {
  for (const float value : look) out.f32(value);
}

LookFeatures load_look(ByteReader& in, int features) {
  LookFeatures look{};
  for (int k = 0; k < features; ++k) look[static_cast<std::size_t>(k)] = in.f32(-100, 100);
  return look;
}

}  // namespace

void LookMemory::Looks::add(const LookFeatures& look) {
  for (std::size_t f = 0; f < look.size(); ++f) columns[f].push_back(look[f]);
}

void LookMemory::Looks::append(const Looks& other) {
  for (std::size_t f = 0; f < columns.size(); ++f)
    columns[f].insert(columns[f].end(), other.columns[f].begin(), other.columns[f].end());
}

LookFeatures LookMemory::Looks::at(std::size_t k) const {
  LookFeatures look;
  for (std::size_t f = 0; f < look.size(); ++f) look[f] = columns[f][k];
  return look;
}

// At most kBlock; plain loops that a compiler makes vectors of.
void LookMemory::squared_distances(const Looks& looks, const LookFeatures& from, std::size_t first,
                                   std::size_t count, float* to) {
  for (std::size_t k = 0; k < count; ++k) to[k] = 0;
  for (std::size_t f = 0; f < from.size(); ++f) {
    const float* column = looks.columns[f].data() + first;
    const float value = from[f];
    for (std::size_t k = 0; k < count; ++k) to[k] += (column[k] - value) * (column[k] - value);
  }
}

// How many of the looks were at that size, by the kernel of the densities in it alone: densities
// are those among looks of one size, of which a training has more at its own than at others.
double LookMemory::count_of_size(const Looks& looks, const LookFeatures& look) {
  const Kernel& kernel_of = kernel();
  double count = 0;
  for (const float size : looks.columns[kSizeFeature]) {
    const float away = size - look[kSizeFeature];
    count += std::abs(away) < 0.01F ? 1 : kernel_of(away * away);
  }
  return count;
}

// Density of the looks at anything else: Gaussian kernels (Parzen).
double LookMemory::density_of(const Looks& looks, const LookFeatures& look) {
  const Kernel& kernel_of = kernel();
  std::array<float, kBlock> squared{};
  double sum = 0;
  for (std::size_t first = 0; first < looks.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, looks.size() - first);
    squared_distances(looks, look, first, count, squared.data());
    for (std::size_t k = 0; k < count; ++k) sum += kernel_of(squared[k]);
  }
  return sum / std::max(count_of_size(looks, look), kFewestOthers);
}

void LookMemory::add_object(const LookFeatures& look, double center, double shape) {
  objects_.add(look);
  center_.push_back(static_cast<float>(center));
  shape_.push_back(static_cast<float>(shape));
}

void LookMemory::add_other(const LookFeatures& look) { others_.add(look); }

void LookMemory::append(const LookMemory& other) {
  objects_.append(other.objects_);
  center_.insert(center_.end(), other.center_.begin(), other.center_.end());
  shape_.insert(shape_.end(), other.shape_.begin(), other.shape_.end());
  others_.append(other.others_);
}

// k nearest neighbors for the errors, Parzen densities (Gaussian kernels) for the likeness. A look
// farther from all neighbors than the bandwidth is unlike anything in memory: its errors grow with
// the distance.
LookWorth LookMemory::worth(const LookFeatures& look) const {
  LookWorth result;
  if (empty()) return result;
  struct Near {
    float distance = 1e30F;
    std::uint32_t object = 0;
    bool operator<(const Near& other) const { return distance < other.distance; }
  };
  std::array<Near, kNeighbors> near;  // a heap, the farthest first; on the stack, not allocated
  const Kernel& kernel_of = kernel();
  std::array<float, kBlock> squared{};
  double like = 0;
  for (std::size_t first = 0; first < objects_.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, objects_.size() - first);
    squared_distances(objects_, look, first, count, squared.data());
    for (std::size_t k = 0; k < count; ++k) {
      like += kernel_of(squared[k]);
      if (squared[k] >= near.front().distance) continue;
      std::pop_heap(near.begin(), near.end());
      near.back() = {squared[k], static_cast<std::uint32_t>(first + k)};
      std::push_heap(near.begin(), near.end());
    }
  }
  std::sort_heap(near.begin(), near.end());
  Errors center;
  Errors shape;
  for (std::size_t k = 0; k < std::min(near.size(), objects_.size()); ++k) {
    center.add(static_cast<double>(center_[near[k].object]), k < kNearest);
    shape.add(static_cast<double>(shape_[near[k].object]), k < kNearest);
  }
  const double strange =
      std::max(1.0, static_cast<double>(near.front().distance) / (4 * kBandwidth * kBandwidth));
  result.center = strange * center.factor(kCenterMean);
  result.shape = strange * shape.factor(kShapeMean);
  result.likeness = std::log((like / std::max(count_of_size(objects_, look), 1.0) + kLeastDensity) /
                             (density_of(others_, look) + kUnknownDensity));
  return result;
}

void LookMemory::save(ByteWriter& out) const {
  out.u32(static_cast<std::uint32_t>(objects_.size()));
  for (std::size_t k = 0; k < objects_.size(); ++k) {
    save_look(out, objects_.at(k));
    out.f32(center_[k]);
    out.f32(shape_[k]);
  }
  out.u32(static_cast<std::uint32_t>(others_.size()));
  for (std::size_t k = 0; k < others_.size(); ++k) save_look(out, others_.at(k));
}

LookMemory LookMemory::load(ByteReader& in, int features) {
  LookMemory memory;
  const int objects = in.integer(0, kMostLooks);
  for (int k = 0; k < objects; ++k) {
    const LookFeatures look = load_look(in, features);
    const double center = in.f32(0, 1e9F);
    memory.add_object(look, center, in.f32(0, 1e9F));
  }
  const int others = in.integer(0, kMostLooks);
  for (int k = 0; k < others; ++k) memory.others_.add(load_look(in, features));
  return memory;
}

}  // namespace vitreo::vision
