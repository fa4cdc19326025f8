// The optics' reports by the program: every prescription, and the results they promise.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace VITREO_TEST_FILE {

nlohmann::json results_of(const Workplace& place, const std::string& arguments) {
  const Spoken spoken = place.vitreo("run " + arguments + " --json");
  EXPECT_EQ(spoken.exit_code, 0) << arguments << "\n" << spoken.out << spoken.err;
  return spoken.exit_code == 0 ? nlohmann::json::parse(spoken.out)["results"]
                               : nlohmann::json::object();
}

TEST(OpticsReport, ItGivesThePublishedFiguresOfTable34) {
  const auto results = results_of(Workplace(), "optics_report");
  EXPECT_NEAR(results["magnification"], -0.76906, 5e-6);  // to half of the last digit
  EXPECT_NEAR(results["numerical_aperture"], 0.158998, 5e-7);
  EXPECT_NEAR(results["retina_image_distance"], 7.857e-3, 5e-7);
  EXPECT_NEAR(results["depth_of_focus"], 95e-6, 0.5e-6);
  EXPECT_NEAR(results["field_curvature_span"], 0.212e-3, 0.5e-6);
  EXPECT_LT(results["map_round_trip_max"], 5e-6);
}

TEST(OpticsReport, EveryEyeWithAnAerialImageGivesAllResults) {
  const Workplace place;
  for (const std::string name : {"navarro_vitrectomy", "navarro_condensing_conic", "model_eye_5_3",
                                 "porcine_condensing", "model_eye_in_air"}) {
    const auto results = results_of(place, "optics_report prescription=" + name);
    for (const char* wanted : {"magnification", "numerical_aperture", "retina_image_distance",
                               "depth_of_focus", "field_curvature_span", "map_round_trip_max"})
      EXPECT_TRUE(results.contains(wanted)) << name << ": " << wanted;
    EXPECT_LT(results.value("map_round_trip_max", 1.0), 5e-6) << name;
  }
}

TEST(OpticsReport, ABareEyeWhoseImageIsFarAwayHasNoMapAndSaysSo) {
  const auto results = results_of(Workplace(), "optics_report prescription=navarro");
  EXPECT_TRUE(results.contains("magnification"));
  EXPECT_FALSE(results.contains("map_round_trip_max"));
}

TEST(OpticsUncertainty, ItRanksWhatCostsMostAndDesignsAFlatterLens) {
  const auto results = results_of(Workplace(), "optics_uncertainty eyes=5");
  EXPECT_NEAR(results["worst_error_axis"], 4.18e-3, 0.01e-3);  // docs/optics.md
  EXPECT_NEAR(results["worst_error_field"], 3.78e-3, 0.01e-3);
  EXPECT_NEAR(results["design_span_before"], 0.21e-3, 0.01e-3);
  EXPECT_LT(results["design_span_after"], 10e-6);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
