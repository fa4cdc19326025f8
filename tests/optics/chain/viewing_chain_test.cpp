// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/viewing_chain.h"

#include "optics/chain/chain_ellipse.h"
#include "optics/pose/pose.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include "chain_support.h"
#include <cmath>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

/// The line of the product's tracer, through surfaces that the chain moved as a whole: a reference
/// that shares the refraction formulas but no derivative, no layout and no line coordinates.
TEST(ViewingChain, ShowsTheIsopixelLinesOfTheTracerInTheNominalChain) {
  const NominalChain nominal = nominal_chain();
  const ViewingChain chain = chain_at_zero(nominal);
  for (const Eigen::Vector2d& pixel : {Eigen::Vector2d(0, 0), Eigen::Vector2d(200, -120),
                                       Eigen::Vector2d(-310, 40), Eigen::Vector2d(33, 290)}) {
    const auto ours = chain.line(pixel);
    ASSERT_TRUE(ours);
    const auto theirs = isopixel_line(nominal.prescription.system, nominal.microscope,
                                      nominal.image.m_from_pixel(pixel));
    ASSERT_TRUE(theirs);
    const Eigen::Vector2d slope = theirs->direction.head<2>() / theirs->direction.z();
    const Eigen::Vector2d at_zero = theirs->origin.head<2>() - slope * theirs->origin.z();
    EXPECT_LT((ours->head<2>() - at_zero).norm(), 1e-14);
    EXPECT_LT((ours->tail<2>() - slope).norm(), 1e-12);
  }
}

TEST(ViewingChain, HasThePerturbedEyesLinesAtItsParameters) {
  const NominalChain nominal = nominal_chain();
  const auto parameters = chain_parameters(nominal, {});
  Eigen::VectorXd theta = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
  theta[index_of(parameters, "lens.index")] = 0.5;
  theta[index_of(parameters, "aqueous.thickness")] = -1;
  theta[index_of(parameters, "cornea.anterior.radius")] = 1;
  theta[index_of(parameters, "pupil_power")] = 1.5;
  theta[index_of(parameters, "microscope_tilt_y")] = 1;
  theta[index_of(parameters, "object_plane")] = -0.7;
  const ViewingChain chain(nominal, parameters, theta);
  Prescription eye = nominal.prescription;
  const std::vector<Override> off{
      {"lens.index", parameter(eye, "lens.index") * (1 + 0.5 * 0.04)},
      {"aqueous.thickness", parameter(eye, "aqueous.thickness") * 0.9},
      {"cornea.anterior.radius", parameter(eye, "cornea.anterior.radius") * 1.03}};
  eye = with_parameters(eye, off);
  Microscope microscope = nominal.microscope;
  microscope.pupil_distance = 1 / 3.0;
  microscope.tilt.y() = 8.7e-3;
  microscope.focus -= 0.35e-3;
  const Eigen::Vector2d pixel(150, -220);
  const auto ours = chain.line(pixel);
  const auto theirs = isopixel_line(eye.system, microscope, nominal.image.m_from_pixel(pixel));
  ASSERT_TRUE(ours && theirs);
  const Eigen::Vector2d slope = theirs->direction.head<2>() / theirs->direction.z();
  EXPECT_LT((ours->tail<2>() - slope).norm(), 1e-12);
  EXPECT_LT((ours->head<2>() - theirs->origin.head<2>() + slope * theirs->origin.z()).norm(),
            1e-13);
}

/// A chain that turns and shifts as one body about nothing but itself shows the turned lines: what
/// moves a group is a rigid motion.
TEST(ViewingChain, TurningAllGroupsAsOneBodyTurnsTheLines) {
  const NominalChain nominal = nominal_chain();
  const auto parameters = chain_parameters(nominal, {});
  Eigen::VectorXd theta = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(parameters.size()));
  // About y by 0.01 rad, about the retina's center of curvature c: a point at height z on the axis
  // moves aside by (z - c) sin and along by (z - c)(cos - 1).
  const double turn = 0.01;
  const System& system = nominal.prescription.system;
  const double c = system.surfaces[0].radius;
  const auto set = [&](const char* name, double value) {
    const Eigen::Index i = index_of(parameters, name);
    theta[i] = value / parameters[static_cast<std::size_t>(i)].sigma;
  };
  const double lens = system.vertex(6) - c;
  const double plane = system.vertex(7) + nominal.microscope.focus - c;
  set("eye_rotation_y", turn);
  set("lens_tilt_y", turn);
  set("lens_aside_x", lens * std::sin(turn));
  set("lens_axial", lens * (std::cos(turn) - 1));
  set("microscope_tilt_y", turn);
  set("object_plane", plane * (std::cos(turn) - 1));
  set("center_x", plane * std::sin(turn));
  const ViewingChain turned(nominal, parameters, theta);
  const auto seen = turned.line({120, -80});
  const auto straight = chain_at_zero(nominal).line({120, -80});
  ASSERT_TRUE(seen && straight);
  const Eigen::Matrix3d about_y =
      Eigen::AngleAxisd(turn, Eigen::Vector3d::UnitY()).toRotationMatrix();
  const Eigen::Vector3d center(0, 0, c);
  const Eigen::Vector3d point =
      center + about_y * (Eigen::Vector3d((*straight)[0], (*straight)[1], 0) - center);
  const Eigen::Vector3d direction = about_y * Eigen::Vector3d((*straight)[2], (*straight)[3], 1);
  const Eigen::Vector2d slope = direction.head<2>() / direction.z();
  EXPECT_LT((seen->tail<2>() - slope).norm(), 1e-12);
  EXPECT_LT((seen->head<2>() - point.head<2>() + slope * point.z()).norm(), 1e-13);
}

TEST(ViewingChain, DerivativesOfLinesAreTheirDifferences) {
  const NominalChain nominal = nominal_chain();
  const auto parameters = chain_parameters(nominal, {});
  const Eigen::VectorXd theta = drawn_theta(parameters, 7, 0.5);
  const ViewingChain chain(nominal, parameters, theta);
  const Eigen::Vector2d pixel(140, 90);
  const auto here = chain.differentiated_line(pixel);
  ASSERT_TRUE(here);
  const Eigen::Matrix4d all = Eigen::Matrix4d::Identity();
  const auto at_zero = chain.by_theta(*here, all.topRows<2>());
  const auto slopes = chain.by_theta(*here, all.bottomRows<2>());
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const double step = 1e-3;
    Eigen::VectorXd more = theta;
    Eigen::VectorXd less = theta;
    more[i] += step;
    less[i] -= step;
    const Eigen::Vector4d slope = (*ViewingChain(nominal, parameters, more).line(pixel) -
                                   *ViewingChain(nominal, parameters, less).line(pixel)) /
                                  (2 * step);
    Eigen::Vector4d derivative;
    derivative << at_zero.col(i), slopes.col(i);
    EXPECT_LT((derivative - slope).norm(), 1e-5 * slope.norm() + 1e-12)
        << parameters[static_cast<std::size_t>(i)].name;
  }
}

TEST(ChainEllipse, IsThatOfTheExactProjectionInTheNominalChain) {
  const NominalChain nominal = nominal_chain();
  const ViewingChain chain = chain_at_zero(nominal);
  PoseSettings settings;
  settings.image = nominal.image;
  settings.robot = nominal.robot;
  settings.exact.emplace(nominal.prescription.system, nominal.microscope, 8 * 1e-3);
  for (const RobotPlace& place : places()) {
    const auto theirs = project_spheroid(settings, place.position, place.axis);
    ASSERT_TRUE(theirs);
    const auto ours = shown_ellipse(chain, place);
    ASSERT_TRUE(ours);
    // Sixteen points of the outline against 24.
    EXPECT_LT((*ours - smooth_from(*theirs)).cwiseAbs().maxCoeff(), 2e-3);
  }
}

TEST(ChainEllipse, DerivativesAreDifferencesToTwoPercentOfTheLargest) {
  const NominalChain nominal = nominal_chain();
  const auto parameters = chain_parameters(nominal, {});
  const Eigen::VectorXd theta = drawn_theta(parameters, 3, 0.3);
  const ViewingChain chain(nominal, parameters, theta);
  const RobotPlace place = places()[1];
  const auto shown = differentiated_ellipse(chain, place);
  ASSERT_TRUE(shown);
  const auto expect_near = [](const Eigen::VectorXd& derivative, const Eigen::VectorXd& difference,
                              const std::string& name) {
    EXPECT_LT((derivative - difference).norm(), 0.02 * difference.norm() + 1e-4) << name;
  };
  for (Eigen::Index i = 0; i < chain.size(); ++i) {
    const double step = 0.01;
    Eigen::VectorXd more = theta;
    Eigen::VectorXd less = theta;
    more[i] += step;
    less[i] -= step;
    const auto after = shown_ellipse(ViewingChain(nominal, parameters, more), place);
    const auto before = shown_ellipse(ViewingChain(nominal, parameters, less), place);
    ASSERT_TRUE(after && before);
    expect_near(shown->by_theta.col(i), (*after - *before) / (2 * step),
                parameters[static_cast<std::size_t>(i)].name);
  }
  for (int i = 0; i < 3; ++i) {
    const double step = 5e-6;
    RobotPlace more = place;
    RobotPlace less = place;
    more.position[i] += step;
    less.position[i] -= step;
    expect_near(shown->by_position.col(i) * 1e-3,
                (*shown_ellipse(chain, more) - *shown_ellipse(chain, less)) / (2 * step) * 1e-3,
                "position");
  }
  for (int i = 0; i < 2; ++i) {
    const double step = 1e-3;
    RobotPlace more = place;
    RobotPlace less = place;
    more.axis = (place.axis + step * shown->across.col(i)).normalized();
    less.axis = (place.axis - step * shown->across.col(i)).normalized();
    expect_near(shown->by_axis.col(i),
                (*shown_ellipse(chain, more) - *shown_ellipse(chain, less)) / (2 * step), "axis");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
