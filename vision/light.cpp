// SPDX-License-Identifier: Apache-2.0
#include "vision/light.h"

#include <algorithm>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr int kGridStep = 24;           // px
constexpr double kLightInside = 0.75;   // of an ellipse: its rim is half ground
constexpr int kFewestInside = 12;       // pixels
constexpr int kLightSaturated = 250;    // gray levels
constexpr double kMostSaturated = 0.1;  // share
// Below this a gain is none: the colors of the training cover it, and a table that changes with
// every flicker of the lamp makes no look better.
constexpr double kDeadBand = 0.12;
constexpr double kGainStep = 0.05;   // of the gains in use: fewer tables
constexpr double kAlikeGains = 0.2;  // between two guesses
constexpr double kMostGain = 1.9;    // e^1.9 = 6.7 either way; beyond it eight bits hold no color
// How far the object's gains may be from the ground's: what is followed would else teach its own
// colors, whatever it is.
constexpr double kFromGround = 0.9;
constexpr double kObjectGain = 0.3;      // share of a sure look
constexpr double kMostLightStep = 0.12;  // of one look
constexpr double kGroundJump = 0.35;     // of the ground from image to image that is the light's

// ln of 0 to 255; 0 counts as a half.
const std::array<float, 256>& logarithms() {
  static const std::array<float, 256> kTable = [] {
    std::array<float, 256> table{};
    for (std::size_t k = 0; k < table.size(); ++k)
      table[k] = static_cast<float>(std::log(std::max<double>(static_cast<double>(k), 0.5)));
    return table;
  }();
  return kTable;
}

/// Levels of one channel; what lies within one is spread evenly over it.
struct LevelCounts {
  std::array<int, 256> counts{};
  double median(int of) const {
    int below = 0;
    for (std::size_t level = 0; level < counts.size(); ++level) {
      if (2 * (below + counts[level]) < of) {
        below += counts[level];
        continue;
      }
      const double within = (of / 2.0 - below) / counts[level];
      return static_cast<double>(level) - 0.5 + within;
    }
    return 255;
  }
};

LogColor clamped_light(const LogColor& value, double most) { return value.max(-most).min(most); }

}  // namespace

LogColor log_light(const cv::Mat& image, const cv::Mat& mask) {
  const std::array<float, 256>& ln = logarithms();
  LogColor sum = LogColor::Zero();
  int count = 0;
  for (int v = kGridStep / 2; v < image.rows; v += kGridStep) {
    const auto* row = image.ptr<cv::Vec3b>(v);
    const auto* out = mask.empty() ? nullptr : mask.ptr<unsigned char>(v);
    for (int u = kGridStep / 2; u < image.cols; u += kGridStep) {
      if (out != nullptr && out[u] != 0) continue;
      for (int c = 0; c < 3; ++c) sum[c] += ln[row[u][c]];
      ++count;
    }
  }
  return sum / std::max(count, 1);
}

// Every second pixel of every second row. The median: a labeled ellipse may lie over the ground by
// a third, and the mean would be of both.
std::optional<LogColor> log_color_within(const cv::Mat& image, const Ellipse& ellipse) {
  const double a = kLightInside * ellipse.semi_major_px;
  const double b = kLightInside * ellipse.semi_minor_px;
  const double c = std::cos(ellipse.angle) / a;
  const double s = std::sin(ellipse.angle) / a;
  const auto reach = static_cast<int>(a) + 1;
  const auto u0 = static_cast<int>(ellipse.center_px.x());
  const auto v0 = static_cast<int>(ellipse.center_px.y());
  std::array<LevelCounts, 3> levels{};
  int count = 0;
  int saturated = 0;
  for (int v = std::max(v0 - reach, 0); v < std::min(v0 + reach + 1, image.rows); v += 2) {
    const auto* row = image.ptr<cv::Vec3b>(v);
    for (int u = std::max(u0 - reach, 0); u < std::min(u0 + reach + 1, image.cols); u += 2) {
      const double du = u - ellipse.center_px.x();
      const double dv = v - ellipse.center_px.y();
      const double x = c * du + s * dv;
      const double y = (c * dv - s * du) * a / b;
      if (x * x + y * y > 1) continue;
      for (std::size_t channel = 0; channel < 3; ++channel)
        ++levels[channel].counts[row[u][static_cast<int>(channel)]];
      saturated += std::max({row[u][0], row[u][1], row[u][2]}) >= kLightSaturated;
      ++count;
    }
  }
  if (count < kFewestInside || saturated > kMostSaturated * count) return std::nullopt;
  LogColor color;
  for (std::size_t channel = 0; channel < 3; ++channel)
    color[static_cast<Eigen::Index>(channel)] =
        std::log(std::max(levels[channel].median(count), 0.5));
  return color;
}

void LightTable::set(const LogColor& gains) {
  constexpr std::array<int, 3> kShift{12, 6, 0};
  gains_ = gains;
  for (std::size_t c = 0; c < 3; ++c) {
    const double divide = std::exp(-gains[static_cast<Eigen::Index>(c)]);
    for (std::size_t level = 0; level < 256; ++level) {
      const double there = gains[static_cast<Eigen::Index>(c)] == 0
                               ? static_cast<double>(level)
                               : std::min(std::round(static_cast<double>(level) * divide), 255.0);
      cells_[c][level] = static_cast<std::uint32_t>(static_cast<unsigned>(there) >> 2) << kShift[c];
    }
  }
}

// The first image has nothing before it; after a cut of the view the ground's light is another one
// for other reasons.
void LightMemory::next(const TrainedLight& trained, const cv::Mat& image) {
  if (!trained.known) return;
  const LogColor now = clamped_light(log_light(image) - trained.ground, kMostGain);
  const LogColor change = now - ground_;
  const bool smooth = change.abs().maxCoeff() < kGroundJump;
  if (started_ && smooth) gains_ = clamped_light(gains_ + change, kMostGain);
  since_jump_ = smooth || !started_ ? std::min(since_jump_ + 1, kJumpFrames) : 0;
  ground_ = now;
  started_ = true;
}

void LightMemory::seen(const TrainedLight& trained, const cv::Mat& image, const Ellipse& object) {
  if (!trained.known) return;
  const auto color = log_color_within(image, object);
  if (!color) return;
  const LogColor error = *color - trained.object - gains_;
  gains_ += clamped_light(kObjectGain * error, kMostLightStep);
  gains_ = ground_ + clamped_light(gains_ - ground_, kFromGround);
}

LogColor LightMemory::gains() const {
  if (gains_.abs().maxCoeff() < kDeadBand) return LogColor::Zero();
  return (gains_ / kGainStep).round() * kGainStep;
}

LightMemory::Guesses LightMemory::guesses(const TrainedLight& trained) const {
  Guesses guesses;
  const auto add = [&guesses](const LogColor& gains) {
    for (std::size_t k = 0; k < guesses.count; ++k)
      if ((guesses.gains[k] - gains).abs().maxCoeff() < kAlikeGains) return;
    guesses.gains[guesses.count++] = gains;
  };
  add(gains());
  if (!trained.known) return guesses;
  add((ground_ / kGainStep).round() * kGainStep);
  add(LogColor::Zero());
  return guesses;
}

}  // namespace vitreo::vision
