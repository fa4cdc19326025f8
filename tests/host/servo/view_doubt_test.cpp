// SPDX-License-Identifier: Apache-2.0
#include "host/servo/view_doubt.h"

#include "control/robots.h"

#include <gtest/gtest.h>

#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kUm = 1e-6;

RigModel rig_model(bool eye_uncertain) {
  RigModel model;
  model.eye = optics::model_eye_5_3();
  model.robot = control::robot_named("coni_2mm");
  model.keep_out.eye_uncertain = eye_uncertain;
  model.uncertainty.bench = BenchUncertainty::none();
  return model;
}

/// Of a bench that was set up by hand.
RigModel by_hand() {
  RigModel model = rig_model(false);
  model.uncertainty = {};
  return model;
}

/// What the top camera would see of it by the believed chain, to a tenth of a pixel.
vision::EllipseMeasurement seen_at(const RigModel& model, const Eigen::Vector3d& position) {
  optics::NominalChain nominal;
  nominal.prescription = optics::prescription(model.eye_name);
  nominal.microscope = model.microscope;
  nominal.image = model.top_image;
  nominal.robot = {model.robot.semi_axis, model.robot.semi_radius};
  const auto belief = optics::prior_belief(nominal, optics::ChainSigmas::none());
  const auto shown = optics::shown_ellipse(belief.chain, {position, {1, 0, 0}, {0, 0}});
  EXPECT_TRUE(shown);
  const optics::EllipseVector ellipse = optics::ellipse_from(*shown);
  vision::EllipseMeasurement seen{};
  seen.ellipse = {ellipse.head<2>(), ellipse[2], ellipse[3], ellipse[4]};
  seen.covariance = 0.01 * optics::EllipseCovariance::Identity();
  seen.covariance(4, 4) = 1e-6;
  return seen;
}

double depth_sigma(const RigModel& model, bool calibrated, double z) {
  const Eigen::Vector3d position(1e-3, 0, z);
  const ViewDoubt doubt(model, {1, 0, 0},
                        calibrated ? ViewCalibration::scale : ViewCalibration::none);
  const auto stays = doubt.systematic(position, {1, 0, 0}, seen_at(model, position), false, 0);
  EXPECT_TRUE(stays);
  return std::sqrt(stays->whole(2, 2));
}

TEST(ViewDoubt, AHundredthOfTheSizeIsATenthOfAMillimeterAndMoreOfDepth) {
  const double sigma = depth_sigma(rig_model(false), false, 5e-3);
  EXPECT_GT(sigma, 100 * kUm);  // 869 um for 5 % by the review of the localizer: 174 for one
  EXPECT_LT(sigma, 300 * kUm);
}

TEST(ViewDoubt, ALookOnTheRetinaTakesTheSizeAwayWhereItLay) {
  const RigModel model = rig_model(false);
  EXPECT_LT(depth_sigma(model, true, 0.6e-3), 0.6 * depth_sigma(model, false, 0.6e-3));
  EXPECT_LT(depth_sigma(model, true, 8e-3), 0.6 * depth_sigma(model, false, 8e-3));
}

TEST(ViewDoubt, AnEyeKnownByTable51AloneIsHalfAMillimeterOfDepth) {
  const RigModel model = rig_model(true);
  const double before = depth_sigma(model, false, 5e-3);
  EXPECT_GT(before, 400 * kUm);  // 588 um rms in 40 eyes
  EXPECT_LT(before, 900 * kUm);
  const double after = depth_sigma(model, true, 5e-3);
  EXPECT_LT(after, 0.7 * before);
  EXPECT_GT(after, 200 * kUm) << "the retina's own 0.3 mm stay in the absolute depth";
}

// What one sigma of each part does to a place 5 mm over the retina; the lens' place alone is more
// than camera and robot are.
TEST(ViewDoubt, ABenchSetUpByHandIsInTheDepthAndAside) {
  const double known = depth_sigma(rig_model(false), false, 5e-3);
  const double bench = depth_sigma(by_hand(), false, 5e-3);
  EXPECT_GT(bench, 1.2 * known);
  EXPECT_LT(bench, 1.5e-3);
  const Eigen::Vector3d position(1e-3, 0, 5e-3);
  const RigModel model = by_hand();
  const auto stays = ViewDoubt(model, {1, 0, 0}, ViewCalibration::none)
                         .systematic(position, {1, 0, 0}, seen_at(model, position), false, 0);
  ASSERT_TRUE(stays);
  EXPECT_GT(std::sqrt(stays->whole(0, 0)), 150 * kUm) << "lens, eye and image stand aside";
  EXPECT_GT(std::sqrt(stays->whole(1, 1)), 150 * kUm);
}

// A telecentric microscope's picture does not show where its plane in focus is.
TEST(ViewDoubt, EachPartOfTheBenchMakesItLarger) {
  RigModel model = rig_model(false);
  const double known = depth_sigma(model, false, 5e-3);
  for (double BenchUncertainty::*part :
       {&BenchUncertainty::pupil_power, &BenchUncertainty::lens_axial,
        &BenchUncertainty::axial_length, &BenchUncertainty::pixel}) {
    model.uncertainty.bench = BenchUncertainty::none();
    model.uncertainty.bench.*part = BenchUncertainty().*part;
    EXPECT_GT(depth_sigma(model, false, 5e-3), 1.001 * known);
  }
}

// The look reckoned with the eye, the pixel and the robot; what it did not reckon with is in the
// eye that it made, and stays in the depth.
TEST(ViewDoubt, ALookThatPutsTheEyeRightLeavesTheBench) {
  RigModel model = by_hand();
  model.keep_out.eye_uncertain = true;
  const Eigen::Vector3d position(1e-3, 0, 5e-3);
  const auto sigma = [&](ViewCalibration how) {
    const auto stays = ViewDoubt(model, {1, 0, 0}, how)
                           .systematic(position, {1, 0, 0}, seen_at(model, position), false, 0);
    EXPECT_TRUE(stays);
    return std::sqrt(stays->whole(2, 2));
  };
  const double before = sigma(ViewCalibration::none), after = sigma(ViewCalibration::eye);
  EXPECT_LT(after, before);
  model.uncertainty.bench = BenchUncertainty::none();
  EXPECT_GT(after, sigma(ViewCalibration::eye));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
