// SPDX-License-Identifier: Apache-2.0
#include "control/measured_gel.h"

#include "control/robots.h"

#include <gtest/gtest.h>

#include <cmath>
#include <complex>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

// What a rheometer does: a small force that oscillates, and the motion of the body that it moves.
// Below the yield surface F = (k + i w c) x with k = 6 pi G' r and c = 6 pi eta_s r, so the ratio
// of the quadrature to the part in phase is G'' / G' at that frequency.
std::complex<double> moved_per_force(const Gel& gel, double frequency, double force) {
  constexpr double kStep = 1e-4;
  EmbeddedRobot robot(ndfeb_cylinder_1mm(), gel);
  const double w = 2 * std::numbers::pi * frequency;
  double x = 0;
  std::complex<double> first = 0;
  const int period = static_cast<int>(std::lround(1 / frequency / kStep));
  for (int i = 0; i < 6 * period; ++i) {
    const double t = (i + 1) * kStep;
    x += kStep *
         robot.step({1, 0, 0}, {force * std::cos(w * t), 0, 0}, {0, 0, 0}, 0, kStep).velocity.x();
    if (i >= 4 * period) first += x * std::exp(std::complex<double>(0, -w * t)) / (1.0 * period);
  }
  return first / force;
}

TEST(MeasuredGel, HasTheModuliThatWereMeasuredAtTheirFrequency) {
  for (const Rheometry& measured :
       {Rheometry{14, 3, 1}, Rheometry{2.8, 1.9, 0.5}, Rheometry{40, 60, 2}}) {
    const std::complex<double> modulus =
        1.0 / moved_per_force(gel_of(measured), measured.frequency, 1e-7);
    EXPECT_NEAR(modulus.imag() / modulus.real(), measured.loss_modulus / measured.storage_modulus,
                0.02 * measured.loss_modulus / measured.storage_modulus)
        << gel_text(measured);
  }
}

TEST(MeasuredGel, YieldsAtTheStressThatItsStorageModulusGives) {
  const Gel soft = gel_of({14, 3, 1});
  const Gel stiff = gel_of({28, 3, 1});
  const EmbeddedRobot in_soft(coni_2mm(), soft);
  const EmbeddedRobot in_stiff(coni_2mm(), stiff);
  const Eigen::Vector3d x(1, 0, 0);
  EXPECT_DOUBLE_EQ(in_stiff.yield_force(x, x), 2 * in_soft.yield_force(x, x));
  EXPECT_DOUBLE_EQ(soft.yield_strain, Gel{}.yield_strain) << "what was not measured stays";
}

TEST(MeasuredGel, ItsTextIsAGelByName) {
  const Rheometry measured{14.25, 3.125, 0.1};
  const std::string text = gel_text(measured);
  EXPECT_EQ(text, "gel of G' 14.25 Pa and G'' 3.125 Pa at 0.1 Hz");
  const Gel gel = gel_named(text);
  EXPECT_DOUBLE_EQ(gel.storage_modulus, 14.25);
  EXPECT_DOUBLE_EQ(gel.solvent_viscosity, gel_of(measured).solvent_viscosity);
  for (const char* other :
       {"gel of G' 14 Pa", "gel of G' 14 Pa and G'' 3 Pa at 1 Hz, stirred", "gel_1", ""})
    EXPECT_FALSE(rheometry_in(other)) << other;
  EXPECT_THROW(gel_named("gel of G' -1 Pa and G'' 3 Pa at 1 Hz"), std::invalid_argument);
  EXPECT_THROW(gel_named("gel of G' nan Pa and G'' 3 Pa at 1 Hz"), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
