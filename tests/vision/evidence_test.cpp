// Evidence within a gate: what is read along a line, and rows of the gate, against their
// definitions.
// SPDX-License-Identifier: Apache-2.0
#include "vision/evidence.h"

#include "vision/moments.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <tuple>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

/// F of a pixel is its blue level less 128, in steps of the table.
class BlueEvidence final : public EvidenceSource {
 public:
  void prepare(const cv::Mat& /*image*/, const cv::Rect& /*region*/) override {}
  void read(const cv::Mat& image, int v, int u, int step, int count,
            std::int8_t* to) const override {
    for (int k = 0; k < count; ++k)
      to[k] = static_cast<std::int8_t>(image.at<cv::Vec3b>(v, u + k * step)[0] - 128);
  }
  void set_light(const LogColor& /*gains*/) override {}
};

cv::Mat noise() {
  cv::Mat image(120, 160, CV_8UC3);
  cv::RNG random(3);
  random.fill(image, cv::RNG::UNIFORM, 2, 255);
  return image;
}

const Ellipse kGate{{80.3, 61.7}, 34, 19, 0.6};

/// F at a place, bilinear, or NaN where a pixel beside it is blocked or not in the region.
double between(const Evidence& evidence, const Eigen::Vector2d& at) {
  const int u = static_cast<int>(std::floor(at.x())), v = static_cast<int>(std::floor(at.y()));
  const double x = at.x() - u, y = at.y() - v;
  double sum = 0;
  for (const auto& [i, j, share] : {std::tuple{0, 0, (1 - x) * (1 - y)},
                                    {1, 0, x * (1 - y)},
                                    {0, 1, (1 - x) * y},
                                    {1, 1, x * y}}) {
    if (!evidence.region().contains({u + i, v + j}) ||
        evidence.at(u + i, v + j) == Evidence::kBlocked)
      return std::nan("");
    sum += share * evidence.at(u + i, v + j);
  }
  return sum / Evidence::kScale;
}

TEST(Evidence, is_the_sum_of_nine_pixels_within_the_gate_and_blocked_elsewhere) {
  const cv::Mat image = noise();
  BlueEvidence source;
  Evidence evidence;
  for (const Ellipse& gate : {kGate, Ellipse{{4, 116}, 34, 19, 0.6}, Ellipse{{158, 2}, 20, 9, 2}}) {
    evidence.look(image, source, gate, 200);
    const cv::Rect& region = evidence.region();
    int within = 0;
    for (int v = region.y; v < region.y + region.height; ++v) {
      for (int u = region.x; u < region.x + region.width; ++u) {
        const double c = std::cos(gate.angle), s = std::sin(gate.angle);
        const double x = c * (u - gate.center_px.x()) + s * (v - gate.center_px.y());
        const double y = c * (v - gate.center_px.y()) - s * (u - gate.center_px.x());
        const double r = std::hypot(x / gate.semi_major_px, y / gate.semi_minor_px);
        if (r > 1.001 || !evidence.in_image(u, v)) {
          EXPECT_EQ(evidence.at(u, v), Evidence::kBlocked) << u << ", " << v;
          continue;
        }
        if (r > 0.999) continue;
        int sum = 0;
        for (int j = -1; j <= 1; ++j)
          for (int i = -1; i <= 1; ++i)
            if (evidence.in_image(u + i, v + j)) sum += image.at<cv::Vec3b>(v + j, u + i)[0] - 128;
        EXPECT_EQ(evidence.at(u, v), sum) << u << ", " << v;
        ++within;
      }
    }
    EXPECT_GT(within, 100);
  }
}

TEST(Evidence, along_a_line_is_what_it_is_between_pixels_up_to_the_first_that_is_unknown) {
  const cv::Mat image = noise();
  BlueEvidence source;
  Evidence evidence;
  cv::Mat owned = cv::Mat::zeros(image.size(), CV_8UC1);
  owned(cv::Rect(90, 60, 5, 5)) = 7;
  evidence.look(image, source, kGate, 200, owned);
  int ended = 0;
  for (int k = 0; k < 400; ++k) {
    const double t = 0.7 * k;
    const Eigen::Vector2d step(std::cos(t), std::sin(t));
    const Eigen::Vector2d from =
        kGate.center_px + 0.05 * k * Eigen::Vector2d(std::sin(1.3 * k), std::cos(0.4 * k));
    std::array<std::int64_t, Evidence::kMostAlong> read{};
    const int count = evidence.along(from, step, 17, 4, read.data());
    for (int i = 0; i < count; ++i) {
      const Eigen::Vector2d at = from + i * step;
      const double there = between(evidence, at);
      ASSERT_TRUE(std::isfinite(there));
      EXPECT_NEAR(static_cast<double>(read[static_cast<std::size_t>(i)]) / Evidence::kAlongScale,
                  std::clamp(there, -4.0, 4.0), 4e-3);
    }
    if (count == 17) continue;
    ++ended;
    const Eigen::Vector2d beyond = from + count * step;
    EXPECT_TRUE(std::isnan(between(evidence, beyond)));
  }
  EXPECT_GT(ended, 20);
}

TEST(MomentSums, of_a_run_are_those_of_its_pixels) {
  MomentSums runs, pixels;
  for (const auto& [first, end, y] :
       {std::array{0, 1, 0}, {3, 40, 7}, {11, 11, 2}, {250, 333, 90}}) {
    runs.add_run(first, end, y);
    for (int x = first; x < end; ++x) pixels.add(x, y);
  }
  for (const auto sum : {&MomentSums::count, &MomentSums::u, &MomentSums::v, &MomentSums::uu,
                         &MomentSums::uv, &MomentSums::vv})
    EXPECT_EQ(runs.*sum, pixels.*sum);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
