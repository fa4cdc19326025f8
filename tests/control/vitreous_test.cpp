// Gels: yield, rest and elastic return.
// SPDX-License-Identifier: Apache-2.0
#include "control/vitreous.h"

#include "control/robots.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

const Eigen::Vector3d kX = Eigen::Vector3d::UnitX(), kNothing = Eigen::Vector3d::Zero();

/// m moved in `seconds` under a steady force along x.
double pulled(const Robot& robot, const Gel& gel, double force, double seconds,
              double span = 1e-3) {
  EmbeddedRobot embedded(robot, gel);
  double place = 0;
  for (int k = 0; k < std::lround(seconds / span); ++k)
    place += span * embedded.step(kX, force * kX, kNothing, 0, span).velocity.x();
  return place;
}

TEST(Gel, the_eleven_cases_stiffen_with_their_agar) {
  EXPECT_DOUBLE_EQ(artificial_vitreous(1).storage_modulus, 14);
  EXPECT_NEAR(artificial_vitreous(11).storage_modulus, 14 * std::pow(2.30 / 1.098, 2.6), 1e-9);
  for (int number = 2; number <= 11; ++number)
    EXPECT_GT(artificial_vitreous(number).storage_modulus,
              artificial_vitreous(number - 1).storage_modulus);
  EXPECT_EQ(gel_names().size(), 13U);
  for (const std::string& name : gel_names()) EXPECT_EQ(gel_named(name).name, name);
}

TEST(Gel, vitreous_out_of_its_cavity_has_a_fifth_of_the_modulus) {
  EXPECT_DOUBLE_EQ(gel_named("porcine_vitreous").storage_modulus /
                       gel_named("porcine_vitreous_removed").storage_modulus,
                   5);
}

TEST(Gel, names_what_is_wrong) {
  EXPECT_THROW(artificial_vitreous(0), std::invalid_argument);
  EXPECT_THROW(artificial_vitreous(12), std::invalid_argument);
  EXPECT_THROW(gel_named("jelly"), std::invalid_argument);
  for (double Gel::*part : {&Gel::storage_modulus, &Gel::yield_strain, &Gel::solvent_viscosity,
                            &Gel::plastic_viscosity, &Gel::density}) {
    Gel gel;
    gel.*part = -1;
    EXPECT_THROW(EmbeddedRobot(coni_2mm(), gel), std::invalid_argument);
  }
}

TEST(EmbeddedRobot, below_the_yield_it_stretches_the_gel_and_comes_back) {
  const Robot robot = ndfeb_cylinder_1mm();
  const Gel gel = artificial_vitreous(1);
  EmbeddedRobot embedded(robot, gel);
  const double force = 0.5 * embedded.yield_force(kX, kX);
  double place = 0;
  for (int k = 0; k < 1000; ++k)
    place += 1e-3 * embedded.step(kX, force * kX, kNothing, 0, 1e-3).velocity.x();
  // at rest the spring carries all: F / k, k = 6 pi G' r_e
  const double spring =
      6 * std::numbers::pi * gel.storage_modulus * std::cbrt(0.5e-3 * 0.25e-3 * 0.25e-3);
  EXPECT_NEAR(place, force / spring, 1e-6 * place);
  for (int k = 0; k < 1000; ++k)
    place += 1e-3 * embedded.step(kX, kNothing, kNothing, 0, 1e-3).velocity.x();
  EXPECT_NEAR(place, 0, 1e-9);
}

TEST(EmbeddedRobot, above_the_yield_it_flows_at_the_speed_of_the_two_viscosities) {
  const Robot robot = ndfeb_cylinder_1mm();
  const Gel gel = artificial_vitreous(3);
  EmbeddedRobot embedded(robot, gel);
  const double yield = embedded.yield_force(kX, kX), force = 2 * yield;
  double speed = 0;
  for (int k = 0; k < 4000; ++k)
    speed = embedded.step(kX, force * kX, kNothing, 0, 1e-3).velocity.x();
  // F = s + c_s v and v = (s - F_y) / c_p together: v = (F - F_y) / (c_s + c_p)
  const double size = 6 * std::numbers::pi * std::cbrt(0.5e-3 * 0.25e-3 * 0.25e-3);
  EXPECT_NEAR(speed, (force - yield) / (size * (gel.solvent_viscosity + gel.plastic_viscosity)),
              1e-6 * speed);
}

TEST(EmbeddedRobot, the_step_does_not_decide_where_it_goes) {
  const Robot robot = ndfeb_cylinder_1mm();
  const Gel gel = artificial_vitreous(8);
  const double force = 1.3 * EmbeddedRobot(robot, gel).yield_force(kX, kX);
  const double fine = pulled(robot, gel, force, 0.5, 1e-5);
  EXPECT_NEAR(pulled(robot, gel, force, 0.5, 1e-3), fine, 0.01 * fine)
      << "first order: 1 % at a step of 1 ms";
}

TEST(EmbeddedRobot, the_yield_along_the_axis_is_that_of_the_facts) {
  const EmbeddedRobot embedded(ndfeb_cylinder_1mm(), artificial_vitreous(1));
  EXPECT_NEAR(embedded.yield_force(kX, kX), 14 * std::numbers::pi * 0.25e-3 * 0.25e-3 * 16.8,
              1e-12);
  EXPECT_NEAR(embedded.yield_force(kX, Eigen::Vector3d::UnitZ()), 2 * embedded.yield_force(kX, kX),
              1e-12)
      << "across, its silhouette is twice as long";
}

TEST(EmbeddedRobot, a_robot_that_turns_hard_enough_can_be_pulled_by_less) {
  const Robot robot = coni_2mm();
  const Gel gel = artificial_vitreous(1);
  EmbeddedRobot still(robot, gel), turning(robot, gel);
  const double force = 0.5 * still.yield_force(kX, kX);
  const Eigen::Vector3d torque = 1.5 * still.yield_torque() * Eigen::Vector3d::UnitY();
  double without = 0, with = 0;
  for (int k = 0; k < 3000; ++k) {
    without = still.step(kX, force * kX, kNothing, 0, 1e-3).velocity.x();
    with = turning.step(kX, force * kX, torque, 0, 1e-3).velocity.x();
  }
  EXPECT_LT(without, 1e-9);
  EXPECT_GT(with, 1e-4);
}

TEST(EmbeddedRobot, a_stiff_magnet_turns_to_its_field_without_swinging_past) {
  EmbeddedRobot embedded(ndfeb_cylinder_1mm(), artificial_vitreous(1));
  double angle = 0.5;
  const double stiffness = 4e-6;  // N m/rad: 20 mT; its time in the solvent is 15 us
  for (int k = 0; k < 200; ++k) {
    angle -=
        1e-3 *
        embedded.step(kX, kNothing, stiffness * angle * Eigen::Vector3d::UnitZ(), stiffness, 1e-3)
            .turning.z();
    EXPECT_GT(angle, -1e-9);
  }
  EXPECT_LT(angle, 0.05);
}

TEST(RobotMoment, along_the_axis_it_is_the_robots_own_law) {
  for (const std::string_view name : robot_names()) {
    const Robot robot = robot_named(name);
    for (const double field : {1e-3, 10e-3, 20e-3, 60e-3}) {
      const Eigen::Vector3d moment = robot_moment(robot, kX, field * kX);
      EXPECT_NEAR(moment.x(), robot.moment(field), 1e-9 * robot.moment(field)) << name;
      EXPECT_NEAR(moment.tail<2>().norm(), 0, 1e-12 * moment.x());
    }
  }
}

TEST(RobotMoment, a_soft_robots_torque_saturates_at_its_anisotropys) {
  const Robot robot = coni_2mm();
  double most = 0;
  for (double angle = 0; angle < 1.57; angle += 0.01) {
    const Eigen::Vector3d field =
        2 * Eigen::Vector3d(std::cos(angle), std::sin(angle), 0);  // T: far in saturation
    const double torque = robot_moment(robot, kX, field).cross(field).z();
    EXPECT_GE(torque, -1e-12) << "towards the easy axis' end of the field";
    most = std::max(most, torque);
  }
  const double law = 0.5 * 4e-7 * std::numbers::pi * robot.solid_volume * robot.anisotropy *
                     robot.saturation * robot.saturation;
  EXPECT_NEAR(most, law, 0.02 * law);
}

TEST(RotationalResistance, a_spheres_is_8_pi_eta_R3) {
  const Robot sphere = ndfeb_sphere_500um();
  const Medium oil;
  const double law = 8 * std::numbers::pi * oil.dynamic_viscosity() * std::pow(0.25e-3, 3);
  EXPECT_NEAR(rotational_resistance(sphere, oil), law, 1e-6 * law);
}

TEST(RotationalResistance, perrins_formula_holds) {
  const Robot robot = coni_2mm();
  const Medium oil;
  const double a = 1e-3, b = 0.5e-3, q = std::sqrt(a * a - b * b),
               s = 2 / q * std::log((a + q) / b);
  const double law = 32. / 3 * std::numbers::pi * oil.dynamic_viscosity() *
                     (std::pow(a, 4) - std::pow(b, 4)) / ((2 * a * a - b * b) * s - 2 * a);
  EXPECT_NEAR(rotational_resistance(robot, oil), law, 1e-9 * law);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
