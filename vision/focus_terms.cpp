// SPDX-License-Identifier: Apache-2.0
#include "vision/focus_terms.h"

#include <array>
#include <cstdlib>
#include <stdexcept>
#include <string>

namespace vitreo::vision {
namespace {

// I^2, from which the variance is mean(I^2) - mean(I)^2.
// Sums of int32 terms are taken in 64 bits by the caller.
void square_terms(const FocusRow& r) {
  const unsigned char* const row = r.rows[0];
  for (int u = r.begin; u < r.end; ++u) r.term[u - r.begin] = row[u] * row[u];
}

// Tenengrad (Tenenbaum 1970, Krotkov 1987): squared magnitude of Sobel's gradient, no threshold.
// The rows above and below stand in r.rows[-1] and r.rows[1]; u has a neighbor on either side, as
// the rule's reach is 1.
void sobel_terms(const FocusRow& r) {
  const unsigned char *const a = r.rows[-1], *const b = r.rows[0], *const c = r.rows[1];
  for (int u = r.begin; u < r.end; ++u) {
    const int right = a[u + 1] + 2 * b[u + 1] + c[u + 1];
    const int left = a[u - 1] + 2 * b[u - 1] + c[u - 1];
    const int below = c[u - 1] + 2 * c[u] + c[u + 1];
    const int above = a[u - 1] + 2 * a[u] + a[u + 1];
    r.term[u - r.begin] = (right - left) * (right - left) + (below - above) * (below - above);
  }
}

// Tenengrad of the smoothed image. The binomial (1 4 6 4 1) has the variance 1 px^2 and convolves
// with Sobel's (1 2 1) to (1 6 15 20 15 6 1) and with (-1 0 1) to (-1 -4 -5 0 5 4 1). Gradients are
// divided by 16, to 128 per gray level and pixel, so that their squares fit 32 bits.
// Noise of a pixel is what plain Sobel amplifies; smoothing by 1 px takes most of it and little of
// the edges of a focused image.
void smoothed_sobel_terms(const FocusRow& r) {
  const int count = r.end - r.begin + 6;
  if (static_cast<int>(r.scratch->size()) < 2 * count)
    r.scratch->resize(2 * static_cast<std::size_t>(count));
  std::int32_t* const smooth = r.scratch->data();
  std::int32_t* const slope = smooth + count;
  const unsigned char* row[7];
  for (int k = 0; k < 7; ++k) row[k] = r.rows[k - 3] + r.begin - 3;
  for (int i = 0; i < count; ++i) {
    const int ends = row[0][i] + row[6][i];
    const int next = row[1][i] + row[5][i];
    const int inner = row[2][i] + row[4][i];
    smooth[i] = ends + 6 * next + 15 * inner + 20 * row[3][i];
    slope[i] = row[6][i] - row[0][i] + 4 * (row[5][i] - row[1][i]) + 5 * (row[4][i] - row[2][i]);
  }
  for (int i = 3; i < count - 3; ++i) {
    const int gx = smooth[i + 3] - smooth[i - 3] + 4 * (smooth[i + 2] - smooth[i - 2]) +
                   5 * (smooth[i + 1] - smooth[i - 1]);
    const int gy = slope[i - 3] + slope[i + 3] + 6 * (slope[i - 2] + slope[i + 2]) +
                   15 * (slope[i - 1] + slope[i + 1]) + 20 * slope[i];
    const int x = gx / 16;
    const int y = gy / 16;
    r.term[i - 3] = x * x + y * y;
  }
}

// Brenner et al. 1976: squared difference of pixels two apart.
// Cheapest of all: one difference a pixel, along rows alone.
void brenner_terms(const FocusRow& r) {
  const unsigned char* const row = r.rows[0];
  for (int u = r.begin; u < r.end; ++u) {
    const int difference = row[u + 2] - row[u];
    r.term[u - r.begin] = difference * difference;
  }
}

// 4-neighbor Laplacian; its variance is the measure of Pech-Pacheco et al. 2000.
// A second derivative weighs the finest structure, and with it noise: see docs/focus_and_mosaic.md
// before using it in low light.
void laplacian_terms(const FocusRow& r) {
  const unsigned char *const a = r.rows[-1], *const b = r.rows[0], *const c = r.rows[1];
  for (int u = r.begin; u < r.end; ++u) {
    const int response = a[u] + c[u] + b[u - 1] + b[u + 1] - 4 * b[u];
    r.response[u - r.begin] = response;
    r.term[u - r.begin] = response * response;
  }
}

// Modified Laplacian |I_uu| + |I_vv| with step 1 (Nayar & Nakagawa 1994): the two directions cannot
// cancel.
void modified_laplacian_terms(const FocusRow& r) {
  const unsigned char *const a = r.rows[-1], *const b = r.rows[0], *const c = r.rows[1];
  for (int u = r.begin; u < r.end; ++u)
    r.term[u - r.begin] =
        std::abs(2 * b[u] - b[u - 1] - b[u + 1]) + std::abs(2 * b[u] - a[u] - c[u]);
}

// Vollath's F4 (1987): autocorrelation at lag 1 less that at lag 2; noise, uncorrelated, is in
// neither.
void vollath_terms(const FocusRow& r) {
  const unsigned char* const row = r.rows[0];
  for (int u = r.begin; u < r.end; ++u) r.term[u - r.begin] = row[u] * (row[u + 1] - row[u + 2]);
}

// A black window has no contrast: 0, not 0/0.
// So a black image ranks last, and no NaN reaches the search.
double over(double numerator, double denominator) {
  return denominator > 0 ? numerator / denominator : 0;
}
double term_itself(double, double term, double) { return term; }
double term_over_mean_squared(double mean, double term, double) { return over(term, mean * mean); }
// Normalized variance (Groen et al. 1985; the most robust in Sun et al. 2004): the thesis' measure
// (section 4.4.1).
double variance_over_mean(double mean, double term, double) {
  return over(term - mean * mean, mean);
}
// Scales with neither exposure nor lamp, as variance goes with the square of the light.
double variance_over_squared(double mean, double term, double) {
  return over(term - mean * mean, mean * mean);
}
// Of the Laplacian's response: its mean is near 0 in an image, but not exactly.
double response_variance(double, double term, double response) {
  return term - response * response;
}

// The number is the reach: how many pixels a rule looks to either side.
constexpr std::array<FocusRule, 8> kFocusRules{{
    {FocusMeasure::normalized_variance, "normalized_variance", 0, square_terms, variance_over_mean},
    {FocusMeasure::variance_over_mean_squared, "variance_over_mean_squared", 0, square_terms,
     variance_over_squared},
    {FocusMeasure::tenengrad, "tenengrad", 1, sobel_terms, term_itself},
    {FocusMeasure::smoothed_tenengrad, "smoothed_tenengrad", 3, smoothed_sobel_terms,
     term_over_mean_squared},
    {FocusMeasure::brenner, "brenner", 2, brenner_terms, term_itself},
    {FocusMeasure::laplacian_variance, "laplacian_variance", 1, laplacian_terms, response_variance},
    {FocusMeasure::modified_laplacian, "modified_laplacian", 1, modified_laplacian_terms,
     term_itself},
    {FocusMeasure::vollath4, "vollath4", 2, vollath_terms, term_itself},
}};

}  // namespace

// Throws std::invalid_argument for a number cast to the enum.
const FocusRule& rule_of(FocusMeasure measure) {
  for (const FocusRule& rule : kFocusRules) {
    if (rule.measure == measure) return rule;
  }
  throw std::invalid_argument("measure: no focus measure has the number " +
                              std::to_string(static_cast<int>(measure)));
}

// In the order of the rules, for menus and help.
const std::vector<FocusMeasure>& focus_measures() {
  static const std::vector<FocusMeasure> kAll = [] {
    std::vector<FocusMeasure> all;
    all.reserve(kFocusRules.size());
    for (const FocusRule& rule : kFocusRules) all.push_back(rule.measure);
    return all;
  }();
  return kAll;
}

std::string_view name_of(FocusMeasure measure) { return rule_of(measure).name; }

FocusMeasure focus_measure(std::string_view name) {
  std::string names;
  for (const FocusRule& rule : kFocusRules) {
    if (rule.name == name) return rule.measure;
    names += (names.empty() ? "" : ", ") + std::string(rule.name);
  }
  throw std::invalid_argument("measure: there is no focus measure \"" + std::string(name) +
                              "\"; there are " + names);
}

}  // namespace vitreo::vision
