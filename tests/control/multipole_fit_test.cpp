// The multipole model from probe readings: what dipoles cannot show, and what a file keeps of it.
// SPDX-License-Identifier: Apache-2.0
#include "control/multipole_fit.h"

#include "control/field_fit.h"
#include "tests/control/field_support.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <stdexcept>
#include <string>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Region kBox{Eigen::Vector3d::Constant(-12e-3), Eigen::Vector3d::Constant(12e-3)};

// A machine whose coils are more than dipoles: a third of quadrupole at the workspace, and moved
// about.
MultipoleField machine(std::mt19937_64& random) {
  const MultipoleField plain = multipoles_like(CoilField::octomag().perturbed({}, random), 2, kBox);
  std::vector<MultipoleField::Sources> coils = plain.sources();
  for (auto& sources : coils)
    sources[0].irregular[1] = 0.3 * sources[0].irregular[0] * sources[0].position.norm();
  return {coils, {}, kBox};
}

std::vector<ProbeReading> readings_of(const MultipoleField& truth,
                                      const Eigen::Vector3d& background, double noise, int count,
                                      std::mt19937_64& random) {
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

double relative_error(const MultipoleField& truth,
                      const std::function<FieldMatrix(const Eigen::Vector3d&)>& model) {
  std::mt19937_64 random(9);
  double miss = 0, size = 0;
  for (int trial = 0; trial < 100; ++trial) {
    const Eigen::Vector3d p = place_within(random, 8e-3);
    miss += (model(p) - truth.matrix(p)).squaredNorm();
    size += truth.matrix(p).squaredNorm();
  }
  return std::sqrt(miss / size);
}

TEST(FitMultipoles, finds_the_field_and_the_background_and_does_better_than_dipoles) {
  std::mt19937_64 random(1);
  const MultipoleField truth = machine(random);
  const Eigen::Vector3d earth(20e-6, 0, -45e-6);
  const double noise = 5e-6;
  const auto readings = readings_of(truth, earth, noise, 400, random);
  const MultipoleFit fit = fit_multipoles(multipoles_like(CoilField::octomag(), 2, kBox), readings);
  const DipoleFit dipoles = fit_dipoles(CoilField::octomag(), readings);
  const double error =
      relative_error(truth, [&](const Eigen::Vector3d& p) { return fit.field.matrix(p); });
  const double plain =
      relative_error(truth, [&](const Eigen::Vector3d& p) { return dipoles.field.matrix(p); });
  std::printf(
      "  error of the gradients: dipoles %.3f %%, multipoles %.3f %%; residual %.2f and %.2f uT\n",
      100 * plain, 100 * error, 1e6 * dipoles.residual_rms, 1e6 * fit.residual.rms);
  // 1200 numbers less 59 unknowns: the residual is the noise, less 2.5 %.
  EXPECT_NEAR(fit.residual.rms, noise, 0.1 * noise);
  EXPECT_LT((fit.background - earth).norm(), 2e-6);
  EXPECT_LT(error, 1e-3);
  EXPECT_LT(error, 0.5 * plain);
}

// A calibration that energizes one coil at a time: every reading leaves seven coils at exactly 0 A.
TEST(FitMultipoles, takes_readings_of_one_coil_at_a_time) {
  std::mt19937_64 random(3);
  const MultipoleField truth = machine(random);
  const Eigen::Vector3d earth(20e-6, 0, -45e-6);
  const double noise = 1e-6;
  auto readings = readings_of(truth, earth, 0, 400, random);
  std::normal_distribution<double> normal;
  for (std::size_t n = 0; n < readings.size(); ++n) {
    const auto coil = static_cast<Eigen::Index>(n % 8);
    ProbeReading& reading = readings[n];
    reading.currents.setZero();
    reading.currents[coil] = n % 16 < 8 ? 4 : -4;
    reading.field = truth.matrix(reading.position).topRows<3>() * reading.currents + earth;
    for (double& value : reading.field) value += noise * normal(random);
  }
  const MultipoleFit fit = fit_multipoles(multipoles_like(CoilField::octomag(), 2, kBox), readings);
  EXPECT_TRUE(fit.converged);
  // 1200 numbers less 59 unknowns: the residual is the noise, less 2.5 %.
  EXPECT_NEAR(fit.residual.rms, noise, 0.1 * noise);
  EXPECT_LT((fit.background - earth).norm(), 1e-6);
  EXPECT_LT(relative_error(truth, [&](const Eigen::Vector3d& p) { return fit.field.matrix(p); }),
            1e-3);
}

TEST(FitMultipoles, holds_only_where_it_was_measured) {
  std::mt19937_64 random(2);
  const MultipoleFit fit =
      fit_multipoles(multipoles_like(CoilField::octomag(), 1, kBox),
                     readings_of(machine(random), {0, 0, 0}, 1e-6, 100, random));
  EXPECT_NO_THROW(fit.field.matrix({0, 0, 0}));
  EXPECT_THROW(fit.field.matrix({11e-3, 0, 0}), std::domain_error);
}

TEST(FitMultipoles, names_what_is_wrong) {
  std::mt19937_64 random(4);
  const MultipoleField start = multipoles_like(CoilField::octomag(), 1, kBox);
  auto readings = readings_of(start, {0, 0, 0}, 0, 60, random);
  const auto complaint = [&](const std::vector<ProbeReading>& given, const MultipoleField& from) {
    try {
      fit_multipoles(from, given);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_EQ(complaint({readings.begin(), readings.begin() + 12}, start),
            "readings: 12 given, at least 17 needed");
  auto flat = readings;
  for (ProbeReading& reading : flat) reading.position.z() = 1e-3;
  EXPECT_EQ(complaint(flat, start), "readings: all in one plane, they span no box");
  auto dead = readings;
  for (ProbeReading& reading : dead) reading.currents[1] = 0;
  EXPECT_EQ(complaint(dead, start), "readings: coil 2 never had a current");
  std::vector<MultipoleField::Sources> empty = start.sources();
  empty[3][0].irregular.clear();
  EXPECT_EQ(complaint(readings, MultipoleField(empty, {}, kBox)),
            "start: coil 4 has an empty source");
  EXPECT_THROW(multipoles_like(CoilField::octomag(), 0, kBox), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
