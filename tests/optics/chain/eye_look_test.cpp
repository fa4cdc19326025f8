// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/eye_look.h"

#include "optics/calibration/camera_calibration.h"
#include "optics/pose/pose.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

const Eigen::Vector3d kAxis(1, 0, 0);
constexpr double kRest = 0.5e-3;  // m, of the robot's center as it lies

NominalChain nominal_chain() {
  NominalChain nominal;
  nominal.prescription = prescription("model_eye_5_3");
  nominal.microscope.numerical_aperture = 0.01;
  nominal.microscope.focus = 12.3e-3;
  nominal.robot = {1e-3, 0.5e-3};
  return nominal;
}

PoseSettings seen_through(const NominalChain& nominal, const System& eye) {
  PoseSettings settings;
  settings.exact.emplace(eye, nominal.microscope, 8e-3);
  settings.image = nominal.image;
  settings.robot = nominal.robot;
  return settings;
}

/// px, of center and axes.
OutlineSeen seen_as(const EllipseVector& ellipse, double sigma, double axis_sigma) {
  OutlineSeen seen{ellipse, sigma * sigma * EllipseCovariance::Identity(), 0, axis_sigma};
  seen.covariance(4, 4) = std::pow(sigma / (ellipse[2] - ellipse[3]), 2);
  return seen;
}

double median(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

/// Eyes of table 5.1, each looked at once on the retina and then at places of the workspace.
struct Looks {
  std::vector<double> scale, eye;  // m, mean error of the depth in each eye
  int places = 0, within = 0;      // of the second, in the 95 % interval
};

Looks looks_at(int first, int count) {
  const NominalChain nominal = nominal_chain();
  const PoseSettings believed = seen_through(nominal, nominal.prescription.system);
  ChainSigmas sigmas = ChainSigmas::none();
  sigmas.eye = table_5_1();
  Looks looks;
  for (int number = first; number < first + count; ++number) {
    std::mt19937_64 random(static_cast<std::uint64_t>(number));
    const auto table = applicable(table_5_1(), nominal.prescription);
    const System truth =
        monte_carlo(nominal.prescription, table, 1, random).front().prescription.system;
    const PoseSettings real = seen_through(nominal, truth);
    const auto look = project_spheroid(real, {0, 0, kRest}, kAxis);
    if (!look) continue;
    const PoseSettings scaled = calibrate_pose(believed, *look, kAxis, kRest).applied(believed);
    const EyeLook one{seen_as(*look, 0.03, 1e-3), kAxis, kRest};
    NominalChain made = nominal;
    made.prescription = most_probable_eye(nominal, one);
    const PoseSettings through = seen_through(nominal, made.prescription.system);
    const ChainBelief prior = prior_belief(made, sigmas);
    const auto belief = eye_calibrated(prior, one, Eigen::VectorXd::Ones(prior.chain.size()));
    EXPECT_TRUE(belief);
    double by_scale = 0, by_eye = 0;
    for (int i = 0; i < 12; ++i) {
      const double turn = 2.4 * i, far = 3.5e-3 * std::sqrt((i + 0.5) / 12);
      const Eigen::Vector3d at(far * std::cos(turn), far * std::sin(turn), 2.5e-3 + 0.4e-3 * i);
      const auto shown = project_spheroid(real, at, kAxis);
      if (!shown) continue;
      const OutlineSeen seen = seen_as(*shown, 0.03, 1e-3);
      const auto a = locate(scaled, *shown, seen.covariance, kAxis, at);
      const auto b = locate(through, *shown, seen.covariance, kAxis, at);
      if (!a || !b) continue;
      by_scale += std::abs(a->position_in_eye.z() - at.z()) / 12;
      const double off = std::abs(b->position_in_eye.z() - at.z());
      by_eye += off / 12;
      const auto doubt = position_doubt(*belief, {b->position_in_eye, kAxis, shown->head<2>()},
                                        seen, PositionFit::thesis);
      EXPECT_TRUE(doubt);
      ++looks.places;
      looks.within += off < 1.96 * std::sqrt(doubt->covariance(2, 2));
    }
    looks.scale.push_back(by_scale);
    looks.eye.push_back(by_eye);
  }
  return looks;
}

// Which numbers of the eye made its magnification, the prior tells in part: 70 um by the scale, 36
// by the eye in the median of twenty.
TEST(EyeLook, AnEyeIsBetterThanAScaleWhereTheRobotIsNot) {
  const Looks looks = looks_at(3000, 24);
  ASSERT_GT(looks.eye.size(), 20u);
  EXPECT_LT(median(looks.eye), 0.75 * median(looks.scale));
  EXPECT_LT(median(looks.eye), 57e-6);
  // Errors within an eye are common: 24 eyes, of which 85 % is two deviations below 95.
  EXPECT_GT(looks.within, 0.85 * looks.places);
}

TEST(EyeLook, TheRobotIsWhereItWasKnownToBe) {
  const NominalChain nominal = nominal_chain();
  NominalChain other = nominal;
  other.prescription = perturbed(nominal.prescription, table_5_1().front(), 1.5);
  const PoseSettings real = seen_through(nominal, other.prescription.system);
  const auto look = project_spheroid(real, {0, 0, kRest}, kAxis);
  ASSERT_TRUE(look);
  const EyeLook one{seen_as(*look, 0.03, 1e-3), kAxis, kRest};
  const PoseSettings through = seen_through(nominal, most_probable_eye(nominal, one).system);
  const auto found = locate(through, *look, one.seen.covariance, kAxis, {0, 0, kRest});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->position_in_eye.z(), kRest, 20e-6);  // what the prior keeps of it
  // An eye that is as believed stays so.
  const PoseSettings believed = seen_through(nominal, nominal.prescription.system);
  const auto same = project_spheroid(believed, {0, 0, kRest}, kAxis);
  const Prescription kept = most_probable_eye(nominal, {seen_as(*same, 0.03, 1e-3), kAxis, kRest});
  for (std::size_t i = 0; i < kept.system.surfaces.size(); ++i)
    EXPECT_NEAR(kept.system.surfaces[i].radius / nominal.prescription.system.surfaces[i].radius, 1,
                1e-3);
}

// A look's size comes from eye, pixel and robot together: each takes the part that its variance has
// of the whole, so that a doubt of the bench leaves less to the eye.
TEST(EyeLook, TheBenchTakesItsPartOfWhatTheLookShows) {
  const NominalChain nominal = nominal_chain();
  NominalChain other = nominal;
  other.prescription = perturbed(nominal.prescription, table_5_1().front(), 1.5);
  const PoseSettings real = seen_through(nominal, other.prescription.system);
  const auto look = project_spheroid(real, {0, 0, kRest}, kAxis);
  ASSERT_TRUE(look);
  const EyeLook one{seen_as(*look, 0.03, 1e-3), kAxis, kRest};
  const ProbableView held = most_probable_view(nominal, one, {});
  EXPECT_EQ(held.pixel, 1);
  EXPECT_EQ(held.robot_length, 1);
  const ProbableView free = most_probable_view(nominal, one, {0.005, 0.01});
  const double larger =
      std::log((*look)[2] / (*project_spheroid(seen_through(nominal, nominal.prescription.system),
                                               {0, 0, kRest}, kAxis))[2]);
  EXPECT_GT(std::log(free.robot_length) / larger, 0) << "a larger outline, a larger robot";
  EXPECT_LT(std::log(free.pixel) / larger, 0) << "or smaller pixels";
  // Their parts are as their variances, 4 to 1; half of what is common to length and width.
  EXPECT_NEAR(-std::log(free.robot_length * free.robot_width) / std::log(free.pixel), 4, 0.4);
  // What is left of it all at the place of the look is nothing.
  NominalChain made = nominal;
  made.prescription = free.eye;
  made.image.pixel *= free.pixel;
  made.robot = {nominal.robot.semi_axis * free.robot_length,
                nominal.robot.semi_radius * free.robot_width};
  const PoseSettings through = seen_through(made, made.prescription.system);
  const auto found = locate(through, *look, one.seen.covariance, kAxis, {0, 0, kRest});
  ASSERT_TRUE(found);
  EXPECT_NEAR(found->position_in_eye.z(), kRest, 20e-6);
}

TEST(EyeLook, BadLooksAreNamed) {
  const NominalChain nominal = nominal_chain();
  EyeLook one{seen_as({0, 0, 60, 30, 0}, 0.03, 1e-3), kAxis, kRest, 0};
  EXPECT_THROW((void)most_probable_eye(nominal, one), std::invalid_argument);
  one.known_z_sigma = 1e-5;
  one.seen.axis_sigma = 0;
  EXPECT_THROW((void)most_probable_eye(nominal, one), std::invalid_argument);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
