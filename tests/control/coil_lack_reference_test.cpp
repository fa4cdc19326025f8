// The most probable lack beside one that tries all of them, for lacks of every size, and at bounds.
// SPDX-License-Identifier: Apache-2.0
#include "control/coil_lack.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <random>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Seen = std::array<double, 6>;

struct Draw {
  explicit Draw(unsigned seed) : random(seed) {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) + 0.5) / 4294967296.0;
  }
  Seen seen(double scale) {
    Seen made{};
    for (double& one : made) one = scale * between(-1, 1);
    return made;
  }
  std::mt19937 random;
};

double product(const Seen& a, const Seen& b) {
  double sum = 0;
  for (std::size_t k = 0; k < a.size(); ++k) sum += a[k] * b[k];
  return sum;
}

LackSums sums_of(const Seen& s, const Seen& t, const Seen& v) {
  return {product(s, v), product(t, v), product(s, s), product(s, t), product(t, t)};
}

struct Signature {
  Seen s, t;
  double fall(const Seen& v, double c) const {  // of the sum of squares
    Seen rest = v;
    for (std::size_t k = 0; k < v.size(); ++k) rest[k] -= c * s[k] + c * c * t[k];
    return product(v, v) - product(rest, rest);
  }
  Seen of(double c) const {
    Seen made{};
    for (std::size_t k = 0; k < made.size(); ++k) made[k] = c * s[k] + c * c * t[k];
    return made;
  }
};

Lack likeliest(const Signature& signature, const Seen& v, double least, double most) {
  Lack best;
  constexpr int kPlaces = 2000;
  for (int k = 0; k <= kPlaces; ++k) {
    const double c = least + (most - least) * k / kPlaces;
    if (const double fall = signature.fall(v, c); fall > best.ratio) best = {c, fall};
  }
  return best;
}

TEST(MostProbableLackReference, the_ratio_is_by_what_the_sum_of_squares_falls) {
  Draw draw(1);
  for (int round = 0; round < 200; ++round) {
    const Signature signature{draw.seen(3), draw.seen(2)};
    const Seen v = draw.seen(4);
    const double c = draw.between(-3, 3);
    // Rounding: squares of some thousands.
    EXPECT_NEAR(sums_of(signature.s, signature.t, v).ratio(c), signature.fall(v, c), 1e-9);
  }
}

// A parabola: where it is largest, or the bound that is nearest to that.
TEST(MostProbableLackReference, a_straight_signature_s_lack_is_exact) {
  Draw draw(2);
  for (int round = 0; round < 2000; ++round) {
    const Seen s = draw.seen(3), v = draw.seen(4);
    const double least = draw.between(0, 2.5), most = least + draw.between(0, 2);
    const LackSums sums = sums_of(s, {}, v);
    const double part = std::clamp(sums.linear / sums.information, least, most);
    const Lack found = most_probable_lack(sums, least, most);
    EXPECT_NEAR(found.ratio, std::max(0.0, sums.ratio(part)), 1e-9);
    if (found.ratio > 1e-6) {
      EXPECT_NEAR(found.part, part, 1e-9);
    }
  }
}

// It need not be exact where the signature bends: half a percent of the ratio, with noise of a
// tenth of the signature and less; lacks of any size.
TEST(MostProbableLackReference, a_curved_signature_s_lack_is_found_wherever_it_is) {
  Draw draw(3);
  const std::array<std::array<double, 2>, 4> bounds{
      {{0.01, 1.1}, {0.3, 1.0}, {1.2, 1.9}, {1.7, 2.5}}};
  for (int round = 0; round < 4000; ++round) {
    const auto [least, most] = bounds[round % 4];
    const Signature signature{draw.seen(10), draw.seen(6)};
    Seen v = signature.of(draw.between(least, most));
    for (double& one : v) one += draw.between(-1, 1);
    const Lack best = likeliest(signature, v, least, most);
    const Lack found = most_probable_lack(sums_of(signature.s, signature.t, v), least, most);
    EXPECT_GE(found.ratio, 0.995 * best.ratio) << least << " best " << best.part;
    if (found.ratio > 0) {
      EXPECT_NEAR(found.ratio, signature.fall(v, found.part), 1e-6);
    }
  }
}

// Signatures that lie in each other's way have their likeliest lack where the squares bend upwards:
// one place alone is allowed.
TEST(MostProbableLackReference, one_lack_alone_that_may_be_is_it) {
  for (const double c : {0.25, 0.5, 0.75, 1.0, 1.5, 2.0}) {
    const Signature signature{{1}, {0, 4 / c}};
    const Seen v{1.5 * c, 20 * c};
    const Lack found = most_probable_lack(sums_of(signature.s, signature.t, v), c, c);
    EXPECT_EQ(found.part, c);
    EXPECT_NEAR(found.ratio, signature.fall(v, c), 1e-9 * found.ratio);
    EXPECT_GT(found.ratio, 0);
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
