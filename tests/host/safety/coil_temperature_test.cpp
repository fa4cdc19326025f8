// Thermal model of the coils against closed solutions of its equation.
// SPDX-License-Identifier: Apache-2.0
#include "host/safety/coil_temperature.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// Numbers of its own, so that none of them is 1 and no product has two readings.
CoilHeat heat_of_test() {
  CoilHeat heat;
  heat.resistance = 0.4;
  heat.temperature_coefficient = 0;
  heat.heat_capacity = 50;
  heat.thermal_resistance = 2;
  heat.ambient = 300;
  heat.limit = 350;
  return heat;
}

// C dT/dt = R I^2 - (T - T_a) / R_th with a constant R: T = T_a + R I^2 R_th (1 - exp(-t / (C
// R_th))).
TEST(CoilTemperature, OfAConstantResistanceIsTheClosedSolution) {
  for (const double time : {0.0, 0.25, 1.0, 1.5, 2.5, 100.0, 250.5}) {
    CoilTemperature coils(heat_of_test(), 3);
    coils.advance(time, std::array{3.0, 0.0, -3.0});
    // 0.4 ohm x 9 A^2 x 2 K/W = 7.2 K; 50 J/K x 2 K/W = 100 s
    const double wanted = 300 + 7.2 * (1 - std::exp(-time / 100));
    EXPECT_NEAR(coils.temperatures()[0], wanted, 1e-9) << time;
    EXPECT_NEAR(coils.temperatures()[1], 300, 1e-9);
    EXPECT_NEAR(coils.temperatures()[2], wanted, 1e-9) << "the sign of a current heats as much";
    EXPECT_DOUBLE_EQ(coils.hottest(), coils.temperatures()[0]);
  }
}

TEST(CoilTemperature, IsTheSameInAnyNumberOfSteps) {
  CoilTemperature at_once(heat_of_test(), 1), in_steps(heat_of_test(), 1);
  at_once.advance(7.5, std::array{5.0});
  for (int i = 0; i < 30; ++i) in_steps.advance(0.25, std::array{5.0});
  EXPECT_NEAR(at_once.temperatures()[0], in_steps.temperatures()[0], 1e-9);
}

TEST(CoilTemperature, FallsBackToAmbientWithoutACurrent) {
  CoilTemperature coils(heat_of_test(), 1);
  coils.advance(1e4, std::array{10.0});
  EXPECT_NEAR(coils.hottest(), 380, 1e-6);
  coils.advance(50, std::array{0.0});
  EXPECT_NEAR(coils.hottest(), 300 + 80 * std::exp(-0.5), 1e-6);
}

// At rest T - T_a = R_0 (1 + a (T - T_a)) I^2 R_th, so T - T_a = q / (1 - a q) with q = R_0 I^2
// R_th.
TEST(CoilTemperature, OfCopperIsHigherThanThatOfAConstantResistance) {
  CoilHeat heat = heat_of_test();
  heat.temperature_coefficient = 4e-3;
  CoilTemperature coils(heat, 1);
  coils.advance(5000, std::array{10.0});
  EXPECT_NEAR(coils.hottest() - 300, 80 / (1 - 4e-3 * 80), 1e-6);
}

TEST(CoilTemperature, TheHottestDecidesWhicheverItIs) {
  for (std::size_t hot = 0; hot < 3; ++hot) {
    CoilTemperature coils(heat_of_test(), 3);
    std::array<double, 3> currents{1, 1, 1};
    currents[hot] = 2;
    coils.advance(100, currents);
    EXPECT_DOUBLE_EQ(coils.hottest(), coils.temperatures()[hot]);
  }
}

TEST(CoilHeat, RefusesWhatNoCoilHasAndNamesIt) {
  struct Setting {
    double CoilHeat::*value;
    const char* name;
    double allowed, refused;
  };
  const double least = std::numeric_limits<double>::min();
  for (const Setting& one :
       {Setting{&CoilHeat::resistance, "resistance", 0, -least},
        Setting{&CoilHeat::temperature_coefficient, "temperature_coefficient", 0, -least},
        Setting{&CoilHeat::heat_capacity, "heat_capacity", least, 0},
        Setting{&CoilHeat::thermal_resistance, "thermal_resistance", least, 0},
        Setting{&CoilHeat::ambient, "ambient", least, 0},
        Setting{&CoilHeat::limit, "limit", 300.001, 300}}) {
    CoilHeat heat = heat_of_test();
    heat.*one.value = one.allowed;
    EXPECT_NO_THROW(heat.check()) << one.name;
    for (const double refused : {one.refused, -1.0, std::nan("")}) {
      heat.*one.value = refused;
      try {
        heat.check();
        ADD_FAILURE() << one.name << " " << refused;
      } catch (const std::invalid_argument& error) {
        EXPECT_NE(std::string(error.what()).find(one.name), std::string::npos) << error.what();
      }
      EXPECT_THROW(CoilTemperature(heat, 1), std::invalid_argument) << one.name;
    }
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
