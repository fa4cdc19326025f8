// Crossed plates in the viewing chain, and the turn of the robot's axis that all looks share.
// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_session.h"
#include "tests/optics/chain/chain_support.h"

#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

constexpr double kRatio = 0.042;  // of the CoNi robot: 42 um of 1 mm

NominalChain plates() {
  NominalChain nominal = nominal_chain();
  nominal.plate_ratio = kRatio;
  return nominal;
}

ChainSigmas with_turn() {
  ChainSigmas sigmas;
  sigmas.axis_turn = 0.04;
  return sigmas;
}

/// Semi-axes of an ellipsoid's shadow along `sight`: of x' Q^-1 x = 1 it is that of Q without what
/// lies along the sight.
Eigen::Vector2d shadow(const Eigen::Matrix3d& attitude, const Eigen::Vector3d& semi_axes,
                       const Eigen::Vector3d& sight) {
  const Eigen::Matrix3d Q = attitude * semi_axes.cwiseAbs2().asDiagonal() * attitude.transpose();
  const Eigen::Vector3d d = sight.normalized();
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - d * d.transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spectrum(across * Q * across);
  return {std::sqrt(spectrum.eigenvalues()[2]), std::sqrt(spectrum.eigenvalues()[1])};
}

// By the shadows of both plates as flat ellipsoids, of which the wider one hides the other.
TEST(ChainPlates, AreAsWideAsTheShadowOfThePlateThatIsSeenFaceOn) {
  const ViewingChain round = chain_at_zero(nominal_chain());
  const ViewingChain flat = chain_at_zero(plates());
  const double a = plates().robot.semi_axis;
  const double r = plates().robot.semi_radius;
  double narrowest = 1;
  for (const RobotPlace& place : places()) {
    if (std::abs(place.axis.z()) > 0.9) continue;  // upright it shows a cross
    const auto line = round.line(ellipse_from(*shown_ellipse(round, place)).head<2>());
    ASSERT_TRUE(line);
    const Eigen::Vector3d sight((*line)[2], (*line)[3], 1);
    const Eigen::Vector3d side = Eigen::Vector3d::UnitZ().cross(place.axis).normalized();
    Eigen::Matrix3d attitude;
    attitude << place.axis, side, place.axis.cross(side);
    const Eigen::Vector2d level = shadow(attitude, {a, r, kRatio * r}, sight);
    const Eigen::Vector2d steep = shadow(attitude, {a, kRatio * r, r}, sight);
    const Eigen::Vector2d full = shadow(attitude, {a, r, r}, sight);
    const EllipseVector plate = ellipse_from(*shown_ellipse(flat, place));
    const EllipseVector whole = ellipse_from(*shown_ellipse(round, place));
    const double expected = std::max(level[1], steep[1]) / full[1];
    // The chain's plate keeps its axes as it is pitched and rolled at once; 17 degrees are here.
    EXPECT_NEAR(plate[3] / whole[3], expected, 2e-3);
    EXPECT_NEAR(plate[2] / whole[2], 1, 2e-3) << "as long";
    narrowest = std::min(narrowest, expected);
  }
  EXPECT_LT(narrowest, 0.995) << "or the test sees nothing";
}

void expect_near(const Eigen::VectorXd& derivative, const Eigen::VectorXd& difference,
                 const std::string& name) {
  EXPECT_LT((derivative - difference).norm(), 0.02 * difference.norm() + 1e-4) << name;
}

TEST(ChainPlates, TheirDerivativesAreDifferences) {
  const NominalChain nominal = plates();
  const auto parameters = chain_parameters(nominal, {});
  const Eigen::VectorXd theta = drawn_theta(parameters, 3, 0.3);
  const ViewingChain chain(nominal, parameters, theta);
  RobotPlace place = places()[2];
  place.near_px = ellipse_from(*shown_ellipse(chain, place)).head<2>();
  const auto shown = differentiated_ellipse(chain, place);
  ASSERT_TRUE(shown);
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const Eigen::VectorXd step = 0.01 * Eigen::VectorXd::Unit(chain.size(), i);
    const auto after = shown_ellipse(ViewingChain(nominal, parameters, theta + step), place);
    const auto before = shown_ellipse(ViewingChain(nominal, parameters, theta - step), place);
    ASSERT_TRUE(after && before);
    expect_near(shown->by_theta.col(i), (*after - *before) / 0.02,
                parameters[static_cast<std::size_t>(i)].name);
  }
  for (int i = 0; i < 3; ++i) {
    RobotPlace more = place;
    RobotPlace less = place;
    more.position += 1e-5 * Eigen::Vector3d::Unit(i);
    less.position -= 1e-5 * Eigen::Vector3d::Unit(i);
    expect_near(shown->by_position.col(i) * 1e-3,
                (*shown_ellipse(chain, more) - *shown_ellipse(chain, less)) / 2e-5 * 1e-3,
                "position " + std::to_string(i));
  }
  for (int i = 0; i < 2; ++i) {
    RobotPlace more = place;
    RobotPlace less = place;
    more.axis = (place.axis + 1e-4 * shown->across.col(i)).normalized();
    less.axis = (place.axis - 1e-4 * shown->across.col(i)).normalized();
    expect_near(shown->by_axis.col(i),
                (*shown_ellipse(chain, more) - *shown_ellipse(chain, less)) / 2e-4,
                "axis " + std::to_string(i));
  }
}

ViewingChain turned_chain(const NominalChain& nominal, const Eigen::Vector3d& turn) {
  const auto parameters = chain_parameters(nominal, with_turn());
  Eigen::VectorXd theta = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
  const Eigen::Index first = index_of(parameters, "axis_turn_x");
  theta.segment<3>(first) = turn / with_turn().axis_turn;
  return {nominal, parameters, theta};
}

OutlineSeen seen_by(const ViewingChain& chain, const RobotPlace& place) {
  OutlineSeen seen;
  seen.ellipse = ellipse_from(*shown_ellipse(chain, place));
  seen.covariance = EllipseCovariance::Identity() * 0.05 * 0.05;
  seen.covariance(4, 4) = 1e-5;
  seen.axis_sigma = 0.035;
  return seen;
}

TEST(ChainTurn, IsOneOfTheAxisThatALookBelieves) {
  EXPECT_EQ(chain_parameters(nominal_chain(), {}).size() + 3,
            chain_parameters(nominal_chain(), with_turn()).size());
  const Eigen::Vector3d turn(0.01, -0.05, 0.03);
  const ViewingChain chain = turned_chain(plates(), turn);
  const RobotPlace believed = places()[1];
  const Eigen::Vector3d true_axis =
      Eigen::AngleAxisd(turn.norm(), turn.normalized()) * believed.axis;
  EXPECT_LT((chain.turned(believed.axis) - true_axis).norm(), 2e-3) << "to second order";
  EXPECT_LT((chain_at_zero(plates()).turned(believed.axis) - believed.axis).norm(), 1e-15);
  RobotPlace place = believed;
  place.axis = chain.turned(believed.axis);
  const OutlineSeen seen = seen_by(chain, place);
  // Located by the believed axis.
  const auto found = locate_in_chain(chain, seen, believed.axis);
  ASSERT_TRUE(found);
  EXPECT_LT((*found - place.position).norm(), 1e-7);
  const auto led_astray = locate_in_chain(chain_at_zero(plates()), seen, believed.axis);
  EXPECT_GT((*led_astray - place.position).norm(), 3e-6) << "the same without the turn";
  // A look that is turned as all are has used none of its own doubt.
  ChainLook look;
  look.seen = seen;
  look.axis = believed.axis;
  const Eigen::Vector2d own = directions_across(believed.axis).transpose() *
                              (place.axis / place.axis.dot(believed.axis) - believed.axis);
  const auto block = block_of(chain, look, place.position, own, true);
  ASSERT_TRUE(block);
  EXPECT_LT(block->residuals.segment<2>(5).norm(), 0.01);
  EXPECT_LT(block->residuals.head<5>().norm(), 1e-3);
}

TEST(ChainTurn, MovesAPlaceAsItsDoubtSays) {
  const NominalChain nominal = plates();
  const ViewingChain chain = turned_chain(nominal, {0.01, -0.02, 0.03});
  const RobotPlace believed = places()[1];
  RobotPlace place = believed;
  place.axis = chain.turned(believed.axis);
  const OutlineSeen seen = seen_by(chain, place);
  const auto size = chain.size();
  const ChainBelief belief{chain, Eigen::MatrixXd::Identity(size, size)};
  RobotPlace at = believed;
  at.near_px = seen.ellipse.head<2>();
  const auto doubt = position_doubt(belief, at, seen, PositionFit::weighted);
  ASSERT_TRUE(doubt);
  EXPECT_LT(doubt->chi2, 1e-3) << "with the axis as it is turned nothing is left over";
  // What is believed of the turn moves the place the other way than what the turn truly is.
  for (const char* name : {"axis_turn_y", "axis_turn_z"}) {
    const Eigen::Index i = index_of(chain.parameters(), name);
    const Eigen::VectorXd step = 0.02 * Eigen::VectorXd::Unit(size, i);
    const auto located = [&](const Eigen::VectorXd& theta) {
      return *locate_in_chain(ViewingChain(nominal, chain.parameters(), theta), seen, believed.axis,
                              place.position);
    };
    const Eigen::Vector3d moved =
        (located(chain.theta() + step) - located(chain.theta() - step)) / 0.04;
    EXPECT_LT((doubt->by_theta.col(i) + moved).norm(), 0.05 * moved.norm() + 1e-7) << name;
    EXPECT_GT(moved.norm(), 3e-7) << name;
  }
}

TEST(ChainTurn, ItsDerivativeInALookIsTheDifference) {
  const NominalChain nominal = plates();
  const ViewingChain chain = turned_chain(nominal, {0.01, -0.05, 0.03});
  ChainLook look;
  look.axis = places()[1].axis;
  look.seen = seen_by(chain, places()[1]);
  const Eigen::Vector2d own(0.02, -0.01);
  const auto here = block_of(chain, look, places()[1].position, own, true);
  ASSERT_TRUE(here);
  for (const char* name : {"axis_turn_x", "axis_turn_y", "axis_turn_z"}) {
    const Eigen::Index i = index_of(chain.parameters(), name);
    const Eigen::VectorXd step = 1e-3 * Eigen::VectorXd::Unit(chain.size(), i);
    const auto residuals = [&](const Eigen::VectorXd& theta) {
      return block_of(ViewingChain(nominal, chain.parameters(), theta), look, places()[1].position,
                      own, false)
          ->residuals;
    };
    const Eigen::VectorXd slope =
        (residuals(chain.theta() + step) - residuals(chain.theta() - step)) / 2e-3;
    EXPECT_LT((here->by_theta.col(i) - slope).norm(), 1e-5) << name;
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
