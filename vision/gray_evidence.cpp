// SPDX-License-Identifier: Apache-2.0
#include "vision/gray_evidence.h"

#include "vision/evidence.h"

#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

// The ring around the expected object whose levels are the ground's there, px beyond its rim: not
// nearer than a prediction may err by, and no wider than what a ground is alike over.
constexpr double kRingFrom = 3;
constexpr double kRingUntil = 12;
constexpr int kRingStep = 2;       // px between its samples
constexpr int kFewestRing = 64;    // samples, that show a ground
constexpr int kFewestSector = 24;  // and of an eighth of the ring
// Shares of the mixture that is the ground: the ring; the ground beside the object in training, for
// the blur of both; the rest is the ground of the training, for what comes into the ring next.
constexpr double kLocal = 0.7;
constexpr double kOfSector = 0.5;  // of the outline's ground: the eighth of the ring beside it
// What the inside of an outline is judged by: a level that the object has often is not clearly the
// ground's because the ground beside it has it too.
constexpr double kLocalInside = 0.35;
constexpr double kBeside = 0.15;
constexpr int kBeside_px = 6;  // how far from the object that is
constexpr int kRim_px = 6;     // how deep its rim is
// Blur mixes both over this way, px; such levels are left out of the training's densities, as they
// are those of another ground, and made anew of the ground around the object. Their shares of what
// a normal looks at, either side.
constexpr int kBlur_px = 2;
constexpr double kBlurShare = 0.15;
constexpr double kLeastStep = 4;     // gray levels between rim and ground
constexpr double kLevelSigma = 1.5;  // gray levels by which densities are smoothed
constexpr double kLeastGray = 1e-4;  // density below which a level has not been shown

GrayDensity smoothed_density(const std::array<double, kGrayLevels>& counts) {
  constexpr int kReach = 5;
  std::array<double, kReach + 1> kernel{};
  double whole = 0;
  for (int d = 0; d <= kReach; ++d) {
    kernel[static_cast<std::size_t>(d)] = std::exp(-0.5 * d * d / (kLevelSigma * kLevelSigma));
    whole += (d == 0 ? 1 : 2) * kernel[static_cast<std::size_t>(d)];
  }
  double sum = 0;
  for (const double count : counts) sum += count;
  GrayDensity density{};
  if (!(sum > 0)) return density;
  constexpr int kLast = static_cast<int>(kGrayLevels) - 1;
  for (int level = 0; level <= kLast; ++level) {
    const double count = counts[static_cast<std::size_t>(level)] / (sum * whole);
    if (count == 0) continue;
    for (int d = -kReach; d <= kReach; ++d)
      density[static_cast<std::size_t>(std::clamp(level + d, 0, kLast))] +=
          static_cast<float>(count * kernel[static_cast<std::size_t>(std::abs(d))]);
  }
  return density;
}

cv::Mat disc_of(int radius) {
  return cv::getStructuringElement(cv::MORPH_ELLIPSE, {2 * radius + 1, 2 * radius + 1});
}

bool has_color(const cv::Mat& image) {
  for (int v = 0; v < image.rows; ++v) {
    const auto* row = image.ptr<cv::Vec3b>(v);
    for (int u = 0; u < image.cols; ++u)
      if (row[u][0] != row[u][1] || row[u][1] != row[u][2]) return true;
  }
  return false;
}

void save_density(ByteWriter& out, const GrayDensity& density) {
  for (const float value : density) out.f32(value);
}

GrayDensity load_density(ByteReader& in) {
  GrayDensity density{};
  for (float& value : density) value = in.f32(0, 1.01F);
  return density;
}

// At a level between two of them.
float density_at(const GrayDensity& density, double level) {
  const auto k = static_cast<std::size_t>(level);
  if (k + 1 >= kGrayLevels) return level < static_cast<double>(kGrayLevels) ? density.back() : 0;
  const auto share = static_cast<float>(level - static_cast<double>(k));
  return density[k] + share * (density[k + 1] - density[k]);
}

double mean_level(const GrayDensity& density) {
  double sum = 0;
  double whole = 0;
  for (std::size_t level = 0; level < kGrayLevels; ++level) {
    sum += static_cast<double>(level) * static_cast<double>(density[level]);
    whole += static_cast<double>(density[level]);
  }
  return whole > 0 ? sum / whole : 0;
}

// All levels from one to the other alike.
GrayDensity evenly(double one, double other) {
  const double middle = (one + other) / 2;
  const double half = std::max(std::abs(one - other), kLeastStep) / 2;
  const auto first = static_cast<std::size_t>(std::clamp(std::lround(middle - half), 0L, 255L));
  const auto last = static_cast<std::size_t>(std::clamp(std::lround(middle + half), 0L, 255L));
  GrayDensity density{};
  for (std::size_t level = first; level <= last; ++level)
    density[level] = 1.0F / static_cast<float>(last - first + 1);
  return density;
}

// `share` of `second` in the sum of both.
GrayDensity mixed(const GrayDensity& first, const GrayDensity& second, double share) {
  GrayDensity sum;
  const auto of_second = static_cast<float>(share);
  for (std::size_t level = 0; level < kGrayLevels; ++level)
    sum[level] = (1 - of_second) * first[level] + of_second * second[level];
  return sum;
}

}  // namespace

GrayModel GrayModel::train(std::span<const LabeledImage> images) {
  GrayModel model;
  std::array<double, kGrayLevels> object{};
  std::array<double, kGrayLevels> rim{};
  std::array<double, kGrayLevels> beside{};
  std::array<double, kGrayLevels> ground{};
  for (const LabeledImage& one : images) {
    if (has_color(one.image)) return model;
    cv::Mat near;
    cv::Mat blurred;
    cv::Mat sharp;
    cv::Mat middle;
    cv::dilate(one.mask, near, disc_of(kBeside_px));
    cv::dilate(one.mask, blurred, disc_of(kBlur_px));
    cv::erode(one.mask, sharp, disc_of(kBlur_px));
    cv::erode(one.mask, middle, disc_of(kRim_px));
    for (int v = 0; v < one.image.rows; ++v) {
      const auto* row = one.image.ptr<cv::Vec3b>(v);
      const auto* mask = one.mask.ptr<unsigned char>(v);
      const auto* next = near.ptr<unsigned char>(v);
      const auto* blur = blurred.ptr<unsigned char>(v);
      const auto* clear = sharp.ptr<unsigned char>(v);
      const auto* deep = middle.ptr<unsigned char>(v);
      for (int u = 0; u < one.image.cols; ++u) {
        const std::size_t level = row[u][1];
        ++(mask[u] != 0 ? object : ground)[level];
        if (blur[u] == 0 && next[u] != 0) ++beside[level];
        if (clear[u] != 0 && deep[u] == 0) ++rim[level];
      }
    }
  }
  model.object = smoothed_density(object);
  model.rim = smoothed_density(rim);
  model.beside = smoothed_density(beside);
  model.ground = smoothed_density(ground);
  model.known = true;
  return model;
}

void GrayModel::save(ByteWriter& out) const {
  out.u32(known ? 1 : 0);
  if (!known) return;
  for (const GrayDensity* density : {&object, &rim, &beside, &ground}) save_density(out, *density);
  out.f64(thresholds.low);
  out.f64(thresholds.high);
}

GrayModel GrayModel::load(ByteReader& in) {
  GrayModel model;
  model.known = in.integer(0, 1) == 1;
  if (!model.known) return model;
  for (GrayDensity* density : {&model.object, &model.rim, &model.beside, &model.ground})
    *density = load_density(in);
  model.thresholds.low = in.f64(-8, 8);
  model.thresholds.high = in.f64(-8, 8);
  if (model.thresholds.low > model.thresholds.high)
    in.fail("its lower threshold is above the higher");
  return model;
}

GrayEvidence::GrayEvidence(const GrayModel& model) : model_(&model) { set_light(LogColor::Zero()); }

// A light of `gain` times the training's brings each level there: densities are per level of the
// images to come.
void GrayEvidence::set_light(const LogColor& gains) {
  const double gain = std::exp(gains.mean());
  for (std::size_t level = 0; level < kGrayLevels; ++level) {
    const double there = static_cast<double>(level) / gain;
    const auto of = [&](const GrayDensity& density) {
      return static_cast<double>(density_at(density, there)) / gain;
    };
    object_[level] = static_cast<float>(of(model_->object));
    rim_[level] = static_cast<float>(of(model_->rim));
    known_ground_[level] = static_cast<float>(
        (kBeside * of(model_->beside) + (1 - kLocal - kBeside) * of(model_->ground)) /
        (1 - kLocal));
  }
  take_training();
}

GrayEvidence::Table GrayEvidence::table_of(const GrayDensity& object,
                                           const GrayDensity& ground) const {
  Table table;
  for (std::size_t level = 0; level < kGrayLevels; ++level) {
    const double ratio = (static_cast<double>(object[level]) + kLeastGray) /
                         (static_cast<double>(ground[level]) + kLeastGray);
    table[level] = static_cast<std::int8_t>(
        std::lround(std::clamp(std::log(ratio) * ColorModel::kScale, -127.0, 127.0)));
  }
  return table;
}

// Each object pixel by its own level; the map's F is a mean of nine, which scatters less.
void GrayEvidence::take_inside(const GrayDensity& ground) {
  table_ = table_of(object_, ground);
  own_against_ = 0;
  for (std::size_t level = 0; level < kGrayLevels; ++level)
    if (table_[level] < -ColorModel::kScale) own_against_ += static_cast<double>(object_[level]);
}

// Where nothing is known of the surroundings: the ground of the training.
void GrayEvidence::take_training() {
  take_inside(known_ground_);
  at_rim_.tables.fill(table_of(rim_, known_ground_));
}

GrayEvidence::Sectors::Sectors(const Ellipse& e)
    : center_(e.center_px),
      along_(Eigen::Vector2d(std::cos(e.angle), std::sin(e.angle)) / e.semi_major_px),
      across_(Eigen::Vector2d(-std::sin(e.angle), std::cos(e.angle)) / e.semi_minor_px) {}

std::size_t GrayEvidence::Sectors::at(int u, int v) const {
  const Eigen::Vector2d from = Eigen::Vector2d(u, v) - center_;
  const double x = along_.dot(from);
  const double y = across_.dot(from);
  return (x < 0 ? 1U : 0U) | (y < 0 ? 2U : 0U) | (std::abs(x) > std::abs(y) ? 4U : 0U);
}

// Every second pixel of every second row.
GrayEvidence::Ring GrayEvidence::ring_of(const cv::Mat& image, const Ellipse& expected,
                                         const cv::Mat& owned, unsigned char self) const {
  const Ellipse outer = grown(expected, kRingUntil);
  const EllipseRows outside(outer);
  const EllipseRows inside(grown(expected, kRingFrom));
  Ring ring;
  const int top = static_cast<int>(outer.center_px.y() - outer.semi_major_px);
  const int bottom = static_cast<int>(outer.center_px.y() + outer.semi_major_px) + 1;
  for (int v = std::max(top, 0); v < std::min(bottom, image.rows); v += kRingStep) {
    const RowSpan row = outside.at(v);
    const RowSpan hole = inside.at(v);
    const auto* from = image.ptr<cv::Vec3b>(v);
    const auto* owner = owned.empty() ? nullptr : owned.ptr<unsigned char>(v);
    for (int u = std::max(row.first, 0); u < std::min(row.end, image.cols); u += kRingStep) {
      if (u >= hole.first && u < hole.end) continue;
      if (owner != nullptr && owner[u] != 0 && owner[u] != self) continue;
      const std::size_t sector = at_rim_.sectors.at(u, v);
      ++ring.counts[sector][from[u][1]];
      ++ring.samples[sector];
    }
  }
  return ring;
}

void GrayEvidence::surround(const cv::Mat& image, const Ellipse& expected, const cv::Mat& owned,
                            unsigned char self) {
  at_rim_.sectors = Sectors(expected);
  const Ring ring = ring_of(image, expected, owned, self);
  std::array<double, kGrayLevels> all{};
  int samples = 0;
  for (std::size_t k = 0; k < kSectors; ++k) {
    samples += ring.samples[k];
    for (std::size_t level = 0; level < kGrayLevels; ++level) all[level] += ring.counts[k][level];
  }
  if (samples < kFewestRing) return take_training();
  const GrayDensity whole = smoothed_density(all);
  take_inside(mixed(known_ground_, whole, kLocalInside));
  const GrayDensity ground = mixed(known_ground_, whole, kLocal - kOfSector);
  const double at_rim = mean_level(rim_);
  for (std::size_t k = 0; k < kSectors; ++k) {
    const GrayDensity of_sector =
        ring.samples[k] < kFewestSector ? whole : smoothed_density(ring.counts[k]);
    const double at_ground = mean_level(of_sector);
    const double between = (at_rim + at_ground) / 2;
    at_rim_.tables[k] = table_of(
        mixed(rim_, evenly(between, at_rim), kBlurShare),
        mixed(mixed(ground, of_sector, kOfSector), evenly(at_ground, between), kBlurShare));
  }
}

void GrayEvidence::read(const cv::Mat& image, int v, int u, int step, int count,
                        std::int8_t* to) const {
  const unsigned char* from = image.ptr<unsigned char>(v) + 3 * static_cast<std::ptrdiff_t>(u) + 1;
  for (int k = 0; k < count; ++k, from += 3 * static_cast<std::ptrdiff_t>(step))
    to[k] = table_[*from];
}

void GrayEvidence::Rim::read(const cv::Mat& image, int v, int u, int step, int count,
                             std::int8_t* to) const {
  const unsigned char* from = image.ptr<unsigned char>(v) + 3 * static_cast<std::ptrdiff_t>(u) + 1;
  for (int k = 0; k < count; ++k, from += 3 * static_cast<std::ptrdiff_t>(step))
    to[k] = tables[sectors.at(u + k * step, v)][*from];
}

}  // namespace vitreo::vision
