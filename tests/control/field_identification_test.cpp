// Field identification from motion that obeys the force law of a perturbed machine: what comes back
// is nearer to the machine than what was believed, where it moved and where it did not.
// SPDX-License-Identifier: Apache-2.0
#include "control/field_identification.h"

#include "control/allocation.h"
#include "control/multipole_fit.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

constexpr double kFrame = 1 / 15.0;  // s
constexpr double kDelay = 0.06;      // s

struct Machine {
  CoilField field = CoilField::octomag();
  Eigen::Vector3d background{20e-6, -30e-6, 10e-6};  // T
  double response = 1.08;
  double sink = 0.95;
  double noise = 4e-6;  // m

  Eigen::Vector3d velocity(const Robot& robot, const Medium& medium,
                           const Eigen::Matrix3d& mobility, const Currents& currents,
                           const Eigen::Vector3d& p) const {
    FieldGradient made = field.matrix(p) * currents;
    made.head<3>() += background;
    const double strength = made.head<3>().norm();
    const Eigen::Vector3d moment = robot.moment(strength) / strength * made.head<3>();
    const Eigen::Vector3d down(0, 0, -sink * robot.net_weight(medium));
    return mobility * (response * (force_from_field(moment) * made) + down);
  }
};

/// Currents of the believed model for levitation and a velocity, and the true motion under them. A
/// feedback of the true place keeps the robot in the workspace.
FieldMotion flight(const Machine& machine, const CoilField& believed, const Robot& robot,
                   const Medium& medium, const Eigen::Vector3d& axis, double duration,
                   std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  const Eigen::Matrix3d drag = resistance(robot, medium, axis);
  const Eigen::Matrix3d mobility = drag.inverse();
  constexpr double kField = 15e-3;
  const Eigen::Vector3d moment = robot.moment(kField) * axis;
  Eigen::Matrix<double, 6, 1> wanted;
  FieldMotion motion;
  Eigen::Vector3d place(0, 0, 0);
  std::vector<TimedCurrents> waiting;
  Currents flowing = Currents::Zero(8);
  constexpr double kStep = 1e-3;
  double frame = 0;
  for (int k = 0; k * kStep < duration; ++k) {
    const double now = k * kStep;
    if (now >= frame) {
      frame += kFrame;
      const Eigen::Vector3d goal(3e-3 * std::sin(0.31 * now), 2e-3 * std::sin(0.23 * now),
                                 2e-3 * std::sin(0.17 * now));
      const Eigen::Vector3d force =
          drag * (0.8 * (goal - place)) + Eigen::Vector3d(0, 0, robot.net_weight(medium));
      const FieldMatrix matrix = believed.matrix(place);
      Eigen::Matrix<double, 6, 8> rows;
      rows << matrix.topRows<3>(), force_from_field(moment) * matrix;
      // Fields of some ten mT beside forces of some uN: of one size for the least squares.
      rows.bottomRows<3>() *= 1e4;
      wanted << kField * axis, 1e4 * force;
      const Currents currents = rows.completeOrthogonalDecomposition().solve(wanted);
      motion.commanded.push_back({now, currents, mobility});
      waiting.push_back(motion.commanded.back());
      Eigen::Vector3d seen = place;
      for (double& x : seen) x += machine.noise * normal(random);
      motion.measured.push_back({now, seen});
    }
    while (!waiting.empty() && now >= waiting.front().time + kDelay) {
      flowing = waiting.front().currents;
      waiting.erase(waiting.begin());
    }
    if (flowing.isZero()) continue;  // held until the first set-point acts
    place += kStep * machine.velocity(robot, medium, mobility, flowing, place);
  }
  return motion;
}

class Identified8 : public testing::TestWithParam<int> {};

TEST_P(Identified8, AModelOfItsMotionIsNearerToTheMachineThanTheBelieved) {
  std::mt19937_64 random(static_cast<unsigned>(GetParam()));
  const CoilField believed = CoilField::octomag();
  Machine machine;
  machine.field = believed.perturbed({}, random);
  const Robot robot = coni_2mm();
  const Medium medium;
  std::vector<FieldMotion> motions;
  for (const Eigen::Vector3d& axis :
       {Eigen::Vector3d(1, 0, 0), Eigen::Vector3d(0, 1, 0), Eigen::Vector3d(0.6, 0, 0.8)})
    motions.push_back(flight(machine, believed, robot, medium, axis, 40, random));
  motions.push_back(flight(machine, believed, robot, medium, {0.6, 0.64, 0.48}, 40, random));
  motions.back().held_out = true;
  const FieldIdentification found = identify_field(believed, robot, medium, motions, kDelay);
  EXPECT_LT(found.fitted.after, 0.3 * found.fitted.before)
      << "of the velocity that was not explained";
  EXPECT_GT(found.fitted.rows, 150);
  // A direction of the axis that was not fitted.
  EXPECT_LT(found.held_out.after, 0.4 * found.held_out.before);
  EXPECT_GT(found.held_out.rows, 50);
  // The force of currents as they are allocated, where the robot did not go.
  double before = 0, after = 0;
  for (const Eigen::Vector3d& p :
       {Eigen::Vector3d(2e-3, -1e-3, 1e-3), Eigen::Vector3d(-1e-3, 1e-3, -1e-3)})
    for (const FieldMotion& motion : motions) {
      const TimedCurrents& row = motion.commanded[motion.commanded.size() / 2];
      const auto velocity = [&](const CoilField& field, const Eigen::Vector3d& uniform,
                                double response, double sink) {
        Machine other;
        other.field = field;
        other.background = uniform;
        other.response = response;
        other.sink = sink;
        return other.velocity(robot, medium, row.mobility, row.currents, p);
      };
      const Eigen::Vector3d truth =
          velocity(machine.field, machine.background, machine.response, machine.sink);
      before += (velocity(believed, {0, 0, 0}, 1, 1) - truth).squaredNorm();
      after +=
          (velocity(found.field, found.background, found.response.value, found.sink.value) - truth)
              .squaredNorm();
    }
  EXPECT_LT(std::sqrt(after), 0.4 * std::sqrt(before));
  double squares = 0;
  for (std::size_t k = 0; k < found.coils.size(); ++k) {
    const IdentifiedCoil& coil = found.coils[k];
    EXPECT_GT(coil.gain.sigma, 0);
    EXPECT_LE(coil.gain.sigma, coil.gain_believed) << "no less is known than before";
    EXPECT_LE(coil.angle_sigma, coil.angle_believed);
    const auto column = static_cast<Eigen::Index>(k);
    const double gain = machine.field.matrix({0, 0, 0}).col(column).head<3>().norm() /
                        believed.matrix({0, 0, 0}).col(column).head<3>().norm();
    squares += std::pow((coil.gain.value - gain) / coil.gain.sigma, 2);
  }
  // Eight numbers whose sigmas are right have a mean of 1, beyond 3 in one of a thousand.
  EXPECT_LT(squares / 8, 3);
  EXPECT_LT(found.direction_sigma, 0.7 * found.direction_believed);
}

INSTANTIATE_TEST_SUITE_P(Machines, Identified8, testing::Values(1, 2, 3));

// As calibrate_coils and calibrate_field write it, with a background.
TEST(FieldIdentification, AFileOfOneDipoleACoilIsTakenForDipolesAgain) {
  const CoilField field = CoilField::octomag();
  const Region box{Eigen::Vector3d::Constant(-0.01), Eigen::Vector3d::Constant(0.01)};
  const MultipoleField plain = multipoles_like(field, 1, box);
  const Eigen::Vector3d earth(20e-6, 0, -40e-6);
  const FieldModel read =
      MultipoleField(plain.sources(), {{{0, 0, 0}, earth.normalized(), {earth.norm()}, {}}}, box);
  const auto dipoles = dipoles_of(read);
  ASSERT_TRUE(dipoles);
  EXPECT_LT((dipoles->background - earth).norm(), 1e-12);
  const Eigen::Vector3d place(2e-3, -1e-3, 3e-3);
  EXPECT_LT((dipoles->field.matrix(place) - field.matrix(place)).norm(),
            1e-9 * field.matrix(place).norm());
  MultipoleSource higher{{0, 0, 0.1}, {0, 0, 1}, {}, {1e-6, 1e-9}};
  EXPECT_FALSE(dipoles_of(MultipoleField({{higher}}, {}, box))) << "of the second order";
}

TEST(FieldIdentification, TooLittleMotionAndBadNumbersAreRefused) {
  const CoilField believed = CoilField::octomag();
  const Robot robot = coni_2mm();
  FieldMotion motion;
  EXPECT_THROW(identify_field(believed, robot, {}, {motion}, kDelay), std::domain_error);
  motion.measured = {{0, {0, 0, 0}}, {0, {0, 0, 0}}};
  EXPECT_THROW(identify_field(believed, robot, {}, {motion}, kDelay), std::invalid_argument);
  motion.measured.clear();
  motion.commanded = {{0, Currents::Zero(7)}};
  EXPECT_THROW(identify_field(believed, robot, {}, {motion}, kDelay), std::invalid_argument);
  EXPECT_THROW(identify_field(believed, robot, {}, {}, -1), std::invalid_argument);
  FieldDoubt doubt;
  doubt.noise = 0;
  EXPECT_THROW(identify_field(believed, robot, {}, {}, kDelay, doubt), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
