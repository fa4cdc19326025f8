// Field calibration from probe readings: it finds the machine they were taken at, and states how
// well.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_fit.h"

#include "tests/control/field_support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdio>
#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

std::vector<ProbeReading> readings_of(const CoilField& truth, const Eigen::Vector3d& background,
                                      double noise, int count, std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  std::vector<ProbeReading> readings;
  for (int n = 0; n < count; ++n) {
    ProbeReading reading;
    reading.position = place_within(random, 10e-3);
    reading.currents.resize(8);
    for (double& current : reading.currents) current = 4 * normal(random);
    reading.field = truth.matrix(reading.position).topRows<3>() * reading.currents + background;
    for (double& value : reading.field) value += noise * normal(random);
    readings.push_back(reading);
  }
  return readings;
}

TEST(FitDipoles, finds_the_machine_and_its_background_from_exact_readings) {
  std::mt19937_64 random(1);
  const CoilField truth = CoilField::octomag().perturbed({}, random);
  const Eigen::Vector3d earth(20e-6, 0, -45e-6);
  const DipoleFit fit =
      fit_dipoles(CoilField::octomag(), readings_of(truth, earth, 0, 300, random));
  EXPECT_TRUE(fit.converged);
  for (std::size_t k = 0; k < 8; ++k) {
    // Exact data: what the solver's stopping leaves, a hundred thousandth of the perturbation.
    EXPECT_LT((fit.field.dipoles()[k].position - truth.dipoles()[k].position).norm(), 1e-7);
  }
  EXPECT_LT((fit.background - earth).norm(), 1e-9);
  EXPECT_LT(fit.residual_relative, 1e-6);
}

TEST(FitDipoles, reports_the_noise_of_the_probe_and_improves_on_the_nominal_machine) {
  std::mt19937_64 random(2);
  const CoilField truth = CoilField::octomag().perturbed({}, random);
  const double noise = 20e-6;
  const auto readings = readings_of(truth, {0, 0, 0}, noise, 600, random);
  const DipoleFit fit = fit_dipoles(CoilField::octomag(), readings);
  // 1800 numbers less 51 unknowns: 1.7 % standard error and 1.4 % of bias; here four of the first.
  EXPECT_NEAR(fit.residual_rms, noise, 0.08 * noise);
  double before = 0, after = 0, size = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Vector3d p = place_within(random, 8e-3);
    const FieldMatrix true_matrix = truth.matrix(p);
    before += (CoilField::octomag().matrix(p) - true_matrix).squaredNorm();
    after += (fit.field.matrix(p) - true_matrix).squaredNorm();
    size += true_matrix.squaredNorm();
  }
  std::printf("  model error in the gradients: nominal %.2f %%, calibrated %.3f %%\n",
              100 * std::sqrt(before / size), 100 * std::sqrt(after / size));
  EXPECT_LT(after, 0.01 * before);  // a tenth of the error or less
}

TEST(FitDipoles, says_which_reading_is_the_worst) {
  std::mt19937_64 random(3);
  auto readings = readings_of(CoilField::octomag(), {0, 0, 0}, 1e-6, 200, random);
  readings[77].field.x() += 5e-3;
  EXPECT_EQ(fit_dipoles(CoilField::octomag(), readings).worst_reading, 77U);
}

TEST(FitDipoles, names_what_is_wrong_with_the_readings) {
  std::mt19937_64 random(4);
  const auto good = readings_of(CoilField::octomag(), {0, 0, 0}, 0, 60, random);
  const auto complaint = [](const std::vector<ProbeReading>& readings) {
    try {
      fit_dipoles(CoilField::octomag(), readings);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  auto bad = good;
  bad[3].field.y() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(complaint(bad), "reading 4: field is not finite");
  bad = good;
  for (ProbeReading& reading : bad) reading.currents[5] = 0;
  EXPECT_EQ(complaint(bad), "readings: coil 6 never had a current");
  for (ProbeReading& reading : bad) reading.currents[5] = reading.currents[2];
  EXPECT_EQ(complaint(bad), "readings: the currents never vary independently");
  bad = good;
  bad[0].currents.resize(7);
  EXPECT_EQ(complaint(bad), "reading 1: one current a coil is needed");
  EXPECT_EQ(complaint({good.begin(), good.begin() + 10}), "readings: 10 given, at least 17 needed");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
