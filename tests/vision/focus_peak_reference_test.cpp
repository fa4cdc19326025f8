// The focus peak compared with exact Gaussians, docs/focus_and_mosaic.md in plain loops, and noise.
// SPDX-License-Identifier: Apache-2.0
#include "vision/focus_peak.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <random>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::vision {
namespace VITREO_TEST_FILE {

using Samples = std::vector<FocusSample>;
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

Samples gaussian(const std::vector<double>& positions, double peak, double width, double height) {
  Samples samples;
  for (const double x : positions)
    samples.push_back({x, height * std::exp(-(x - peak) * (x - peak) / (2 * width * width))});
  return samples;
}

std::vector<double> steps(int count, double first, double step) {
  std::vector<double> positions;
  for (int i = 0; i < count; ++i) positions.push_back(first + i * step);
  return positions;
}

/// Skewed by a little, as spherical aberration does, so that the depth of the fit matters but no
/// residual is large against the noise granted; in order, at equal steps.
Samples skewed(int count, double first, double step, double peak) {
  Samples samples;
  for (const double x : steps(count, first, step)) {
    const double t = (x - peak) / 1.7;
    samples.push_back({x, 5.3 * std::exp(-t * t / 2 + 0.004 * t * t * t)});
  }
  return samples;
}

struct Parabola {
  double position = 0;
  double value = 0;
  double sigma = 0;    // of the noise alone
  double depth = 0;    // that was used
  double misfit = 0;   // weighted sum of the squared residuals
  double weights = 0;  // their sum
};

/// Step 3 for samples in order of position whose Tukey weights are all 1.
Parabola fit(const Samples& samples, double depth, double noise) {
  const std::size_t count = samples.size();
  std::vector<double> y;
  for (const FocusSample& s : samples) y.push_back(std::log(s.value));
  std::vector<double> smooth = y;
  for (std::size_t i = 1; i + 1 < count; ++i) smooth[i] = (y[i - 1] + 2 * y[i] + y[i + 1]) / 4;
  const auto most = static_cast<std::size_t>(std::ranges::max_element(smooth) - smooth.begin());
  const double height = smooth[most] - *std::ranges::min_element(smooth);
  const double d = std::min(depth, 0.6 * height);
  std::size_t first = most;
  std::size_t end = most + 1;
  while (first > 0 && smooth[first - 1] > smooth[most] - d) --first;
  while (end < count && smooth[end] > smooth[most] - d) ++end;
  // Normal equations about the middle, and their inverse by cofactors.
  const double middle = samples[most].position;
  std::array<double, 5> m{};
  std::array<double, 3> r{};
  for (std::size_t i = first; i < end; ++i) {
    const double w = (smooth[i] - smooth[most] + d) / d;
    const double t = samples[i].position - middle;
    for (int k = 0; k < 5; ++k) m[k] += w * std::pow(t, k);
    for (int k = 0; k < 3; ++k) r[k] += w * std::pow(t, k) * y[i];
  }
  const double determinant = m[0] * (m[2] * m[4] - m[3] * m[3]) -
                             m[1] * (m[1] * m[4] - m[2] * m[3]) +
                             m[2] * (m[1] * m[3] - m[2] * m[2]);
  const double inverse[3][3] = {
      {m[2] * m[4] - m[3] * m[3], m[2] * m[3] - m[1] * m[4], m[1] * m[3] - m[2] * m[2]},
      {m[2] * m[3] - m[1] * m[4], m[0] * m[4] - m[2] * m[2], m[1] * m[2] - m[0] * m[3]},
      {m[1] * m[3] - m[2] * m[2], m[1] * m[2] - m[0] * m[3], m[0] * m[2] - m[1] * m[1]}};
  std::array<double, 3> c{};
  for (int i = 0; i < 3; ++i)
    for (int k = 0; k < 3; ++k) c[i] += inverse[i][k] * r[k] / determinant;
  const double t = -c[1] / (2 * c[2]);
  // Each sample's noise moves the vertex by its own share.
  double sum = 0;
  double misfit = 0;
  for (std::size_t i = first; i < end; ++i) {
    const double w = (smooth[i] - smooth[most] + d) / d;
    const double x = samples[i].position - middle;
    double d1 = 0;
    double d2 = 0;
    for (int k = 0; k < 3; ++k) {
      d1 += inverse[1][k] * w * std::pow(x, k) / determinant;
      d2 += inverse[2][k] * w * std::pow(x, k) / determinant;
    }
    sum += std::pow(-d1 / (2 * c[2]) + d2 * c[1] / (2 * c[2] * c[2]), 2);
    misfit += w * std::pow(y[i] - c[0] - c[1] * x - c[2] * x * x, 2);
  }
  return {middle + t, std::exp(c[0] + c[1] * t + c[2] * t * t), noise * std::sqrt(sum), d, misfit,
          m[0]};
}

TEST(FocusPeakReference, finds_the_middle_of_an_exact_gaussian) {
  std::mt19937_64 random(3);
  std::uniform_real_distribution<double> share(0, 1);
  for (int trial = 0; trial < 50; ++trial) {
    const double width = 0.4 + 2 * share(random);
    const double peak = -7 + 20 * share(random);
    const double height = std::exp(-4 + 9 * share(random));
    std::vector<double> positions = steps(13, peak - (2.2 + share(random)) * width, 0.41 * width);
    if (trial % 2 == 1)  // unequal steps
      for (double& x : positions) x += 0.15 * width * share(random);
    Samples samples = gaussian(positions, peak, width, height);
    const FocusPeakFit sorted = find_focus_peak(samples);
    ASSERT_EQ(sorted.answer, FocusAnswer::found);
    ASSERT_TRUE(sorted.peak.has_value());
    EXPECT_NEAR(sorted.peak->position, peak, 1e-9 * width);
    EXPECT_NEAR(sorted.peak->value, height, 1e-9 * height);
    EXPECT_GT(sorted.peak->sigma, 0);
    std::ranges::shuffle(samples, random);
    samples.push_back(samples[2]);
    samples.push_back(samples[7]);
    const FocusPeakFit shuffled = find_focus_peak(samples);
    ASSERT_TRUE(shuffled.peak.has_value());
    EXPECT_NEAR(shuffled.peak->position, peak, 1e-9 * width);
    EXPECT_NEAR(shuffled.peak->value, height, 1e-9 * height);
  }
}

TEST(FocusPeakReference, the_parabola_is_that_of_the_document) {
  for (const double depth : {0.3, 0.7, 1.1, 50.0}) {
    for (const double peak : {0.37, 1.02, -0.61}) {
      FocusPeakSettings settings;
      settings.depth = depth;
      settings.least_noise = 0.02;
      const Samples samples = skewed(61, -4.1, 0.13, peak);
      const FocusPeakFit found = find_focus_peak(samples, settings);
      ASSERT_EQ(found.answer, FocusAnswer::found);
      EXPECT_EQ(found.noise, 0.02);
      const Parabola wanted = fit(samples, depth, 0.02);
      // The skew moves the peak by 0.0017 to 0.012 as the depth grows; this is a fortieth of it.
      // The document does not say how ends are smoothed, of which the limit of 0.6 of the height
      // and so the last depth depend.
      EXPECT_NEAR(found.peak->position, wanted.position, depth > 2 ? 3e-4 : 8e-5);
      EXPECT_GT(std::abs(wanted.position - peak), 1e-3);
      EXPECT_NEAR(found.peak->value, wanted.value, depth > 2 ? 1e-3 : 2e-4);
      // And what half the depth says otherwise.
      const double misfit = fit(samples, wanted.depth / 2, 0.02).position - wanted.position;
      EXPECT_NEAR(found.peak->sigma / std::hypot(wanted.sigma, misfit), 1, 0.03);
    }
  }
}

TEST(FocusPeakReference, noise_is_the_median_misfit_of_cubics_through_the_neighbors) {
  std::mt19937_64 random(4);
  std::normal_distribution<double> normal;
  int equal = 0;
  for (int trial = 0; trial < 20; ++trial) {
    const std::size_t count = 9 + static_cast<std::size_t>(trial);
    Samples samples;
    double x = -3;
    for (std::size_t i = 0; i < count; ++i) {
      x += trial % 2 == 0 ? 0.31 : 0.2 + 0.2 * std::abs(normal(random));
      samples.push_back({x, 7.3 * std::exp(-x * x / 11 + 0.02 * normal(random))});
    }
    std::vector<double> misfits;
    for (std::size_t i = 2; i + 2 < count; ++i) {
      double off = std::log(samples[i].value);
      double carried = 1;  // variances of the sample and of the cubic there
      for (const std::size_t a : {i - 2, i - 1, i + 1, i + 2}) {
        double share = 1;
        for (const std::size_t b : {i - 2, i - 1, i + 1, i + 2}) {
          if (a == b) continue;
          share *= (samples[i].position - samples[b].position) /
                   (samples[a].position - samples[b].position);
        }
        off -= share * std::log(samples[a].value);
        carried += share * share;
      }
      misfits.push_back(std::abs(off) / std::sqrt(carried));
    }
    std::ranges::sort(misfits);
    const double wanted = 1.4826 * misfits[misfits.size() / 2];  // of an even number the upper
    std::ranges::shuffle(samples, random);
    const double noise = find_focus_peak(samples).noise;
    EXPECT_NEAR(noise, std::max(0.002, wanted), 1e-9 * wanted);
    FocusPeakSettings settings;
    settings.least_noise = 0.5;
    EXPECT_EQ(find_focus_peak(samples, settings).noise, 0.5);
    equal += trial % 2 == 0;
  }
  EXPECT_EQ(equal, 10);
}

/// exp(-x^2 / 2) about 0 at equal steps; `bent`: of x^4 in the exponent.
Samples around_zero(int count, double step, double bent = 0) {
  Samples samples;
  for (const double x : steps(count, -(count - 1) / 2.0 * step, step))
    samples.push_back({x, std::exp(-x * x / 2 - bent * x * x * x * x)});
  return samples;
}

// A curve that is the same on either side has no misfit between depths, so that its sigma is that
// of the noise alone: up to 11 samples the residuals tell it, from 12 on what the neighbors say.
TEST(FocusPeakReference, of_few_samples_the_residuals_are_a_noise_too) {
  for (const int count : {11, 13}) {
    FocusPeakSettings settings;
    settings.depth = 50;
    const Samples samples = around_zero(count, 0.4, 0.03);
    const FocusPeakFit found = find_focus_peak(samples, settings);
    ASSERT_TRUE(found.peak.has_value());
    const Parabola wanted = fit(samples, 50, 1);
    const double noise = count < 12 ? std::sqrt(wanted.misfit / (wanted.weights - 3)) : found.noise;
    // Tukey's weights, a little below 1, are left out here
    EXPECT_NEAR(found.peak->sigma / (noise * wanted.sigma), 1.08, 0.07) << count;
  }
}

TEST(FocusPeakReference, four_samples_cannot_show_which_of_them_is_wrong_but_five_can) {
  FocusPeakSettings settings;
  settings.depth = 1.2;  // four samples are higher
  Samples four = around_zero(6, 1);
  four[3].value *= 1.05;
  EXPECT_NEAR(find_focus_peak(four, settings).peak->position, fit(four, 1.2, 1).position, 1e-12);
  settings.depth = 2.02;  // five samples are higher
  Samples five = around_zero(7, 1);
  five[4].value *= 1.05;
  const double plain = fit(five, 2.02, 1).position;
  EXPECT_GT(plain, 0.01);
  EXPECT_LT(find_focus_peak(five, settings).peak->position, 0.99 * plain);
}

// Where half the depth holds too few samples for a parabola, nothing is said of the misfit: sigma
// stays in proportion to the noise.
TEST(FocusPeakReference, sigma_grows_with_the_noise_alone_where_half_the_depth_tells_nothing) {
  const Samples samples = around_zero(61, 0.1);
  double last = 0;
  for (double noise = 0.01; noise < 0.35; noise *= 1.2) {
    FocusPeakSettings settings;
    settings.least_noise = noise;
    const FocusPeakFit found = find_focus_peak(samples, settings);
    if (!found.peak) break;
    last = noise;
    EXPECT_NEAR(found.peak->sigma / fit(samples, settings.depth, noise).sigma, 1, 0.01) << noise;
  }
  EXPECT_GT(last, 0.1);
}

TEST(FocusPeakReference, units_and_directions_change_nothing_else) {
  const Samples samples = skewed(31, -2.3, 0.19, 0.44);
  const FocusPeakFit plain = find_focus_peak(samples);
  ASSERT_TRUE(plain.peak.has_value());
  for (const double by : {1e-3, 40.0, -1.0}) {
    Samples other;
    for (const FocusSample& s : samples) other.push_back({7 + by * s.position, 1e4 * s.value});
    const FocusPeakFit fit = find_focus_peak(other);
    ASSERT_TRUE(fit.peak.has_value());
    EXPECT_NEAR(fit.peak->position, 7 + by * plain.peak->position, 1e-8 * std::abs(by));
    EXPECT_NEAR(fit.peak->sigma / plain.peak->sigma, std::abs(by), 1e-6 * std::abs(by));
    EXPECT_NEAR(fit.peak->value / plain.peak->value, 1e4, 1e-4);
    EXPECT_NEAR(fit.noise, plain.noise, 1e-12);
  }
}

TEST(FocusPeakReference, sigma_is_that_of_repeated_noise_and_outliers_are_left_out) {
  std::mt19937_64 random(9);
  std::normal_distribution<double> normal;
  double squares = 0;
  int found = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const double truth = 0.3 * normal(random);
    Samples samples = gaussian(steps(31, -3, 0.2), truth, 1.3, 4);
    for (FocusSample& s : samples) s.value *= std::exp(0.02 * normal(random));
    if (trial % 2 == 1) samples[17].value *= 1.4;  // a flash near the peak
    const FocusPeakFit fit = find_focus_peak(samples);
    if (!fit.peak) continue;
    ++found;
    squares += std::pow((fit.peak->position - truth) / fit.peak->sigma, 2);
  }
  EXPECT_GT(found, 390);
  EXPECT_GT(squares / found, 0.3);
  EXPECT_LT(squares / found, 1.6);
}

TEST(FocusPeakReference, a_measure_that_rises_at_an_end_says_where_to_go_on) {
  for (const double peak : {-9.0, -2.9, 5.9, 14.0}) {
    const FocusPeakFit fit = find_focus_peak(gaussian(steps(18, -2.1, 0.4), peak, 2.3, 5));
    EXPECT_EQ(fit.answer, peak < 0 ? FocusAnswer::at_low_end : FocusAnswer::at_high_end) << peak;
    EXPECT_FALSE(fit.peak.has_value());
  }
}

TEST(FocusPeakReference, what_does_not_stand_out_of_the_noise_is_no_peak) {
  // Rising again at both ends, so that lowest and highest have two neighbors each.
  Samples samples = gaussian(steps(21, -2, 0.2), 0.03, 0.7, 4);
  for (const std::size_t i : {0U, 1U, 19U, 20U}) samples[i].value = samples[i < 9 ? 4 : 16].value;
  double low = 1e9;
  double high = -1e9;
  for (std::size_t i = 1; i + 1 < samples.size(); ++i) {
    const double smooth = (std::log(samples[i - 1].value) + 2 * std::log(samples[i].value) +
                           std::log(samples[i + 1].value)) /
                          4;
    low = std::min(low, smooth);
    high = std::max(high, smooth);
  }
  for (const double noise : {0.02, 0.1}) {
    FocusPeakSettings settings;
    settings.least_noise = noise;
    const double found_noise = find_focus_peak(samples, settings).noise;
    settings.significance = (high - low) / found_noise * 0.999;
    EXPECT_EQ(find_focus_peak(samples, settings).answer, FocusAnswer::found);
    settings.significance = (high - low) / found_noise * 1.001;
    const FocusPeakFit fit = find_focus_peak(samples, settings);
    EXPECT_EQ(fit.answer, FocusAnswer::no_peak);
    EXPECT_FALSE(fit.peak.has_value());
  }
  for (const Samples& few :
       {Samples{}, Samples{{1, 2}}, Samples{{0, 1}, {1, 5}},
        Samples{{0, 1}, {1, 5}, {1, 6}, {0, 1}}, Samples{{0, 0}, {1, 0}, {2, 0}, {3, 0}},
        Samples{{0, 3}, {1, 3}, {2, 3}, {3, 3}, {4, 3}}})
    EXPECT_EQ(find_focus_peak(few).answer, FocusAnswer::no_peak);
  EXPECT_EQ(find_focus_peak(Samples{{0, 1}, {1, 5}, {2, 1.5}}).answer, FocusAnswer::found);
}

TEST(FocusPeakReference, names_and_refusals) {
  EXPECT_EQ(name_of(FocusAnswer::found), "found");
  EXPECT_EQ(name_of(FocusAnswer::at_low_end), "at low end");
  EXPECT_EQ(name_of(FocusAnswer::at_high_end), "at high end");
  EXPECT_EQ(name_of(FocusAnswer::no_peak), "no peak");
  const Samples good = gaussian(steps(15, -3, 0.5), 0.8, 1.7, 7);
  const auto refused = [](const Samples& samples, const FocusPeakSettings& settings) {
    try {
      find_focus_peak(samples, settings);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("nothing");
  };
  EXPECT_EQ(refused(good, {}), "nothing");
  for (const std::size_t at : {0U, 6U, 14U}) {
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      Samples samples = good;
      samples[at].value = bad;
      EXPECT_EQ(refused(samples, {}), "samples: a value is not finite");
      samples = good;
      samples[at].position = bad;
      EXPECT_EQ(refused(samples, {}), "samples: a position is not finite");
    }
  }
  using Member = double FocusPeakSettings::*;
  for (const auto& [member, message] :
       {std::pair<Member, const char*>{&FocusPeakSettings::depth, "depth: must be positive"},
        {&FocusPeakSettings::least_noise, "least_noise: must be positive"},
        {&FocusPeakSettings::significance, "significance: must be positive"}}) {
    for (const double bad : {-1.0, 0.0, kNan, kInfinity, -kInfinity}) {
      FocusPeakSettings settings;
      settings.*member = bad;
      EXPECT_THROW(settings.check(), std::invalid_argument) << message << bad;
      EXPECT_EQ(refused(good, settings), message) << bad;
    }
    FocusPeakSettings settings;
    settings.*member = 1e-6;
    EXPECT_NO_THROW(settings.check());
  }
  EXPECT_NO_THROW(FocusPeakSettings{}.check());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::vision
