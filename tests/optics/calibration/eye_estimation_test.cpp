// Eyes estimated from their images: what the data support comes back, what they do not stays, and
// the sigmas are honest.
// SPDX-License-Identifier: Apache-2.0
#include "optics/calibration/eye_estimation.h"

#include "optics/system/first_order.h"
#include "tests/optics/support.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

const std::vector<double> kDepths{0, 2e-3, 4e-3, 6e-3, 8e-3};
constexpr double kFocusSigma = 20e-6;  // m, of an autofocus

Eigen::VectorXd sigmas() {
  return Eigen::VectorXd::Constant(static_cast<Eigen::Index>(kDepths.size()), kFocusSigma);
}

TEST(EyeEstimation, ALensIndexThatAloneIsOffIsFoundWhenItAloneIsUncertain) {
  const Prescription eye = prescription("navarro_condensing");
  const std::vector<Uncertainty> priors{{"lens.index", 0.04, ""}};
  const Prescription truth = perturbed(eye, priors[0], 0.75);
  const EyeModel model = on_axis_model(kDepths);
  const EyeEstimate found = estimate_eye(eye, priors, model, model(truth.system), sigmas());
  ASSERT_EQ(found.parameters.size(), 1u);
  EXPECT_NEAR(found.parameters[0].value, parameter(truth, "lens.index"), found.parameters[0].sigma);
  EXPECT_GT(found.parameters[0].learned, 0.99);
  EXPECT_LT(found.chi2, 0.1);
}

TEST(EyeEstimation, OfAllElevenParametersOnlyAFewCombinationsAreLearned) {
  const Prescription eye = prescription("navarro_condensing");
  const auto priors = table_5_1();
  const EyeModel model = on_axis_model(kDepths);
  const EyeEstimate found = estimate_eye(eye, priors, model, model(eye.system), sigmas());
  double learned = 0;
  for (const EstimatedParameter& one : found.parameters) {
    EXPECT_GE(one.learned, -1e-9) << one.name;
    EXPECT_LE(one.sigma, one.prior_sigma * (1 + 1e-9)) << one.name;
    learned += one.learned;
    if (one.name == "lens.index") {
      EXPECT_GT(one.learned, 0.3);
    }
    if (one.name == "cornea.thickness") {
      EXPECT_LT(one.learned, 0.01);
    }
  }
  EXPECT_GT(learned, 0.9);
  EXPECT_LT(learned, 3.0);  // the on-axis law has three parameters; no number of depths gives more
  EXPECT_EQ(found.correlation.rows(), 11);
}

TEST(EyeEstimation, SigmasAreHonestOverEyesDrawnFromTheTable) {
  const Prescription eye = prescription("navarro_condensing");
  const auto priors = table_5_1();
  const EyeModel model = on_axis_model(kDepths);
  std::mt19937_64 random(5);
  constexpr int kEyes = 60;
  double squares = 0, before = 0, after = 0;
  int count = 0;
  for (const PerturbedEye& truth : monte_carlo(eye, priors, kEyes, random)) {
    Eigen::VectorXd measured = model(truth.prescription.system);
    if (measured.size() == 0) continue;
    std::normal_distribution<double> normal(0, kFocusSigma);
    for (double& one : measured) one += normal(random);
    const EyeEstimate found = estimate_eye(eye, priors, model, measured, sigmas());
    for (const EstimatedParameter& one : found.parameters) {
      squares += std::pow((one.value - parameter(truth.prescription, one.name)) / one.sigma, 2);
      ++count;
    }
    const double depth = 8e-3;
    before += std::pow(axial_image(eye.system, depth)->distance -
                           axial_image(truth.prescription.system, depth)->distance,
                       2);
    after += std::pow(axial_image(found.eye.system, depth)->distance -
                          axial_image(truth.prescription.system, depth)->distance,
                      2);
  }
  ASSERT_GT(count, 500);
  EXPECT_NEAR(squares / count, 1,
              0.15);  // 660 numbers, partly dependent, and a model that is not quite linear
  EXPECT_LT(std::sqrt(after / before), 0.05);
}

TEST(EyeEstimation, BadArgumentsAreRefused) {
  const Prescription eye = prescription("navarro_condensing");
  const EyeModel model = on_axis_model(kDepths);
  const Eigen::VectorXd good = model(eye.system);
  const auto refused = [&](const char* name, std::vector<Uncertainty> priors,
                           Eigen::VectorXd measured, Eigen::VectorXd s) {
    expect_refused(name, [&] { (void)estimate_eye(eye, priors, model, measured, s); });
  };
  const std::vector<Uncertainty> priors{{"lens.index", 0.04, ""}};
  Eigen::VectorXd bad = good;
  bad[1] = std::nan("");
  refused("priors", {}, good, sigmas());
  refused("priors", {{"lens.index", 0, ""}}, good, sigmas());
  refused("priors", {{"cornea.posterior.conic", 0.1, ""}}, good, sigmas());
  refused("parameter", {{"lens.color", 0.1, ""}}, good, sigmas());
  refused("measured", priors, bad, sigmas());
  refused("sigmas", priors, good, -sigmas());
  refused("sigmas", priors, good, sigmas().head(2));
  refused("measured", priors, good.head(2), sigmas().head(2));  // not what the model gives
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
