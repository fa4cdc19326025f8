// SPDX-License-Identifier: Apache-2.0
#include "control/helix.h"

#include "control/robots.h"
#include "control/step_out.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Matrix6 = Eigen::Matrix<double, 6, 6>;
constexpr double kEta = 0.485;  // Pa s

/// The reference: the 6 x 6 resistance of the filament, each small straight piece of which resists
/// by k_t along itself and k_n across, summed as forces and torques about the middle. Nothing of it
/// is a closed form. Of the head: Stokes' sphere.
Matrix6 summed(const Helix& helix, double viscosity) {
  const double logarithm = std::log(2 * helix.pitch / helix.filament_radius);
  const double k_t = 2 * std::numbers::pi * viscosity / (logarithm - 0.5);
  const double k_n = 4 * std::numbers::pi * viscosity / (logarithm + 0.5);
  const int pieces = 4000 * static_cast<int>(helix.turns);
  const double hand = helix.left_handed ? -1 : 1;
  const auto point = [&](double s) {  // s from -1/2 to 1/2
    const double angle = hand * 2 * std::numbers::pi * helix.turns * s;
    return Eigen::Vector3d(helix.radius * std::cos(angle), helix.radius * std::sin(angle),
                           helix.turns * helix.pitch * s);
  };
  Matrix6 total = Matrix6::Zero();
  for (int k = 0; k < pieces; ++k) {
    const Eigen::Vector3d from = point(double(k) / pieces - 0.5),
                          to = point((k + 1.0) / pieces - 0.5);
    const Eigen::Vector3d middle = (from + to) / 2, t = (to - from).normalized();
    const Eigen::Matrix3d drag =
        (to - from).norm() * (k_n * Eigen::Matrix3d::Identity() + (k_t - k_n) * t * t.transpose());
    Eigen::Matrix3d lever;
    lever << 0, -middle.z(), middle.y(), middle.z(), 0, -middle.x(), -middle.y(), middle.x(), 0;
    Eigen::Matrix<double, 3, 6> velocity;  // of the piece, from (v, w): v + w x r
    velocity << Eigen::Matrix3d::Identity(), -lever;
    total += velocity.transpose() * drag * velocity;
  }
  const double head = helix.head_radius;
  total.topLeftCorner<3, 3>() +=
      6 * std::numbers::pi * viscosity * head * Eigen::Matrix3d::Identity();
  total.bottomRightCorner<3, 3>() +=
      8 * std::numbers::pi * viscosity * head * head * head * Eigen::Matrix3d::Identity();
  return total;
}

TEST(Helix, ResistanceIsTheSumOverItsFilament) {
  for (const Helix& helix : {Helix{}, Helix{0.35e-3, 0.8e-3, 3, 50e-6, 0, true},
                             Helix{0.1e-3, 1.5e-3, 1, 20e-6, 0.2e-3}}) {
    const Matrix6 exact = summed(helix, kEta);
    const HelixResistance found = helix_resistance(helix, kEta);
    EXPECT_NEAR(found.along / exact(2, 2), 1, 1e-5);
    EXPECT_NEAR(found.coupling / exact(2, 5), 1, 1e-5);
    EXPECT_NEAR(found.spin / exact(5, 5), 1, 1e-5);
    EXPECT_NEAR(found.across / ((exact(0, 0) + exact(1, 1)) / 2), 1, 1e-5);
    EXPECT_NEAR(found.coupling_across / ((exact(0, 3) + exact(1, 4)) / 2), 1, 1e-5);
    EXPECT_NEAR(found.turning / ((exact(3, 3) + exact(4, 4)) / 2), 1, 0.05);  // ends in phase
  }
}

TEST(Helix, GoesTheWayOfItsHand) {
  Helix helix;
  EXPECT_GT(helix_resistance(helix, kEta).advance(), 0);
  helix.left_handed = true;
  EXPECT_LT(helix_resistance(helix, kEta).advance(), 0);
}

// Speed over rate has no viscosity in it, and scales as the length.
TEST(Helix, AdvanceIsOfTheGeometryAlone) {
  const double once = helix_resistance(Helix{}, kEta).advance();
  EXPECT_NEAR(helix_resistance(Helix{}, 1e-3).advance(), once, 1e-12);
  EXPECT_NEAR(helix_resistance(Helix{}.scaled(2), kEta).advance(), 2 * once, 1e-12);
  EXPECT_LT(once * 2 * std::numbers::pi, Helix{}.pitch);  // it slips
}

TEST(Helix, RobotIsHeavierThanOilAndStepsOutWhereItsMagnetIsTooWeak) {
  const Robot robot = robot_named("helix_2mm");
  const Medium oil;
  EXPECT_GT(robot.net_weight(oil), 0);
  // m B = 2 pi f (c - b^2 / a): a body on which no force acts.
  const HelixResistance drag = helix_resistance(*robot.helix, oil.dynamic_viscosity());
  const double torque = 2 * std::numbers::pi * step_out_frequency(robot, oil, 2e-3) *
                        (drag.spin - drag.coupling * drag.coupling / drag.along);
  EXPECT_NEAR(
      torque,
      1.2 / (4e-7 * std::numbers::pi) * std::numbers::pi * 0.125e-3 * 0.125e-3 * 0.25e-3 * 2e-3,
      1e-12);
}

TEST(Helix, NamesWhatIsWrong) {
  Helix helix;
  helix.turns = 1.5;
  EXPECT_THROW(helix.check(), std::invalid_argument);
  helix = {};
  helix.filament_radius = helix.pitch;
  EXPECT_THROW(helix_resistance(helix, kEta), std::invalid_argument);
  EXPECT_THROW(helix_resistance(Helix{}, 0), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
