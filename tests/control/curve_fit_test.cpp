// Fits against the certified values of NIST's Statistical Reference Datasets (Norris, Misra1a,
// https://www.itl.nist.gov/div898/strd/), closed forms, and the spread of repeated fits.
// SPDX-License-Identifier: Apache-2.0
#include "control/curve_fit.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const CurveSamples kNorris{
    {0.2, 337.4, 118.2, 884.6, 10.1,  226.5, 666.3, 996.3, 448.6, 777.0, 558.2, 0.4,
     0.6, 775.5, 666.9, 338.0, 447.5, 11.6,  556.0, 228.1, 995.8, 887.6, 120.2, 0.3,
     0.3, 556.8, 339.1, 887.2, 999.0, 779.0, 11.1,  118.3, 229.2, 669.1, 448.9, 0.5},
    {0.1, 338.8, 118.1, 888.0, 9.2,   228.1, 668.5, 998.5, 449.1, 778.9, 559.2, 0.3,
     0.1, 778.1, 668.8, 339.3, 448.9, 10.8,  557.7, 228.3, 998.0, 888.8, 119.6, 0.3,
     0.6, 557.6, 339.3, 888.0, 998.5, 778.9, 10.2,  117.6, 228.9, 668.4, 449.2, 0.2}};

TEST(CurveFit, OfALineIsTheCertifiedOneOfNorris) {
  const CurveFit fit = fit_polynomial(kNorris, 1);
  EXPECT_NEAR(fit.parameters[0], -0.262323073774029, 1e-11);
  EXPECT_NEAR(fit.parameters[1], 1.00211681802045, 1e-13);
  EXPECT_NEAR(fit.sigma(0), 0.232818234301152, 1e-11);
  EXPECT_NEAR(fit.sigma(1), 0.429796848199937e-3, 1e-14);
  EXPECT_NEAR(std::sqrt(fit.chi_square / fit.degrees_of_freedom), 0.884796396144373, 1e-11);
  EXPECT_EQ(fit.degrees_of_freedom, 34);
}

TEST(CurveFit, OfACurveOfOnesOwnIsTheCertifiedOneOfMisra1a) {
  const CurveSamples misra{{77.6, 114.9, 141.1, 190.8, 239.9, 289.0, 332.8, 378.4, 434.8, 477.3,
                            536.8, 593.1, 689.1, 760.0},
                           {10.07, 14.73, 17.94, 23.93, 29.61, 35.18, 40.02, 44.82, 50.76, 55.05,
                            61.01, 66.40, 75.47, 81.78}};
  const CurveFit fit =
      fit_curve([](const Eigen::VectorXd& b, double x) { return b[0] * (1 - std::exp(-b[1] * x)); },
                misra, Eigen::Vector2d(500, 1e-4));
  EXPECT_NEAR(fit.parameters[0] / 2.3894212918e+02, 1, 1e-7);
  EXPECT_NEAR(fit.parameters[1] / 5.5015643181e-04, 1, 1e-7);
  EXPECT_NEAR(fit.sigma(0) / 2.7070075241, 1, 1e-5);
  EXPECT_NEAR(fit.sigma(1) / 7.2668688436e-06, 1, 1e-5);
  EXPECT_NEAR(fit.chi_square / 1.2455138894e-01, 1, 1e-8);
}

// As micrometers come: x of 1e-5, whose fourth power is 1e-20.
TEST(CurveFit, APolynomialOfSmallNumbersComesBackToTheLastDigits) {
  CurveSamples samples;
  const double c[] = {3e-6, -2e-1, 4e3, -5e8, 6e12};
  for (int i = 0; i < 40; ++i) {
    const double x = 2e-5 + 1e-6 * i;
    samples.x.push_back(x);
    samples.y.push_back(c[0] + x * (c[1] + x * (c[2] + x * (c[3] + x * c[4]))));
  }
  const CurveFit fit = fit_polynomial(samples, 4);
  for (int k = 0; k <= 4; ++k) EXPECT_NEAR(fit.parameters[k] / c[k], 1, 1e-7) << k;
  EXPECT_LT(fit.rms, 1e-16);
}

TEST(CurveFit, AnExponentialAndAGaussianAreFoundFromTheirSamplesAlone) {
  for (const double rate : {-3.0, -0.2, 0.4})
    for (const double size : {1e-6, 1.0, 1e4}) {
      CurveSamples samples;
      for (int i = 0; i < 60; ++i) {
        samples.x.push_back(2 + 0.05 * i);
        samples.y.push_back(size * (2 * std::exp(rate * samples.x.back()) - 0.7));
      }
      const CurveFit fit = fit_exponential(samples);
      EXPECT_NEAR(fit.parameters[0] / (2 * size), 1, 1e-5) << rate << " " << size;
      EXPECT_NEAR(fit.parameters[1], rate, 1e-5) << size;
      EXPECT_NEAR(fit.parameters[2] / (-0.7 * size), 1, 1e-5) << rate;
    }
  for (const double sign : {1.0, -1.0}) {
    CurveSamples samples;
    for (int i = 0; i < 50; ++i) {
      samples.x.push_back(1e-3 + 1e-5 * i);
      samples.y.push_back(5 + sign * 2 *
                                  std::exp(-std::pow((samples.x.back() - 1.2e-3) / 6e-5, 2) / 2));
    }
    const CurveFit fit = fit_gaussian(samples);
    EXPECT_NEAR(fit.parameters[0], sign * 2, 1e-7);
    EXPECT_NEAR(fit.parameters[1] / 1.2e-3, 1, 1e-8);
    EXPECT_NEAR(fit.parameters[2] / 6e-5, 1, 1e-7);
    EXPECT_NEAR(fit.parameters[3], 5, 1e-7);
  }
}

// What is said to be uncertain by so much is: over 400 draws, with the sigmas given and without.
TEST(CurveFit, ItsSigmasAreTheSpreadOfRepeatedFits) {
  std::mt19937 generator(7);
  std::normal_distribution<double> noise(0, 0.05);
  for (const bool known : {true, false}) {
    double squares[4] = {}, chi = 0;
    constexpr int kDraws = 400;
    for (int draw = 0; draw < kDraws; ++draw) {
      CurveSamples samples;
      for (int i = 0; i < 40; ++i) {
        samples.x.push_back(0.25 * i);
        samples.y.push_back(3 * std::exp(-std::pow((samples.x.back() - 5) / 1.2, 2) / 2) + 1 +
                            noise(generator));
        if (known) samples.sigma.push_back(0.05);
      }
      const CurveFit fit = fit_gaussian(samples);
      const double truth[] = {3, 5, 1.2, 1};
      for (int k = 0; k < 4; ++k)
        squares[k] += std::pow((fit.parameters[k] - truth[k]) / fit.sigma(k), 2) / kDraws;
      chi += fit.chi_square / fit.degrees_of_freedom / kDraws;
    }
    // 400 draws: the mean of squares is 1 +- 0.07; five times that.
    for (const double mean : squares) EXPECT_NEAR(mean, 1, 0.35) << known;
    if (known) {
      EXPECT_NEAR(chi, 1, 0.06);
    }
  }
}

TEST(CurveFit, RefusesWhatItCannotFitAndLetsTheCurvesErrorsPass) {
  EXPECT_THROW(fit_polynomial({{1, 2}, {1}}, 0), std::invalid_argument);
  EXPECT_THROW(fit_polynomial({{1, 2}, {1, 2}}, 1), std::invalid_argument) << "no freedom is left";
  EXPECT_THROW(fit_polynomial({{1, 1, 1}, {1, 2, 3}}, 1), std::invalid_argument);
  EXPECT_THROW(fit_polynomial({{1, 2, 3}, {1, 2, std::nan("")}}, 1), std::invalid_argument);
  EXPECT_THROW(fit_polynomial({{1, 2, 3}, {1, 2, 3}, {1, 1, 0}}, 1), std::invalid_argument);
  const CurveSamples three{{1, 2, 3}, {1, 2, 3}};
  EXPECT_THROW(
      fit_curve([](const Eigen::VectorXd&, double) -> double { throw std::domain_error("mine"); },
                three, Eigen::Vector2d(1, 1)),
      std::domain_error);
  EXPECT_THROW(fit_curve([](const Eigen::VectorXd& p, double x) { return (p[0] + p[1]) * x; },
                         three, Eigen::Vector2d(1, 1)),
               std::runtime_error)
      << "two parameters that do the same";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
