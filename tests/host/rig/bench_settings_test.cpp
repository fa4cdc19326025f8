// What a rig knows of its bench follows from its camera and its plant, unless it says it.
// SPDX-License-Identifier: Apache-2.0
#include "host/rig/bench_settings.h"

#include "host/rig/rig_settings.h"
#include "host/rig/twin.h"

#include <gtest/gtest.h>

#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

RigSettings read(const RigDescription& description) {
  ConfigReader reader(description);
  return read_rig_settings(reader);
}

BenchUncertainty bench_of(const RigDescription& description) {
  return read(description).model.uncertainty.bench;
}

ConfigValue table(ConfigTable values) { return {std::move(values)}; }

RigDescription simulated(ConfigTable optics = {}, ConfigTable bench = {}) {
  RigDescription rig;
  rig.file = "test rig";
  rig.table["top_camera"] = table({});
  rig.table["truth"] = table({{"optics", table(std::move(optics))}});
  rig.table["model"] = table({{"uncertainty", table({{"bench", table(std::move(bench))}})}});
  return rig;
}

TEST(BenchSettings, ABenchThatIsDrawnAsBelievedIsKnownAndEveryOtherEyeIsNot) {
  EXPECT_FALSE(bench_of(simulated()).by_hand);
  EXPECT_EQ(bench_of(simulated()).retina_depth, 0);
  EXPECT_TRUE(bench_of(simulated({{"bench", {std::string("sampled")}}})).by_hand);
  const BenchUncertainty one_drawn = bench_of(simulated({{"lens_tilt_sigma", {0.01}}}));
  EXPECT_TRUE(one_drawn.by_hand);
  EXPECT_EQ(one_drawn.retina_depth, BenchUncertainty{}.retina_depth);
  EXPECT_FALSE(bench_of(simulated({{"stage_noise", {1e-6}}})).by_hand)
      << "the stage moves the focus and no line of sight";
}

/// A camera of which nothing is opened here.
RigDescription real(const std::string& view) {
  RigDescription rig = simulated();
  rig.table["top_camera"] = table({{"driver", {std::string("genicam")}},
                                   {"address", {std::string("genicam:127.0.0.1")}},
                                   {"view", {view}},
                                   {"width_px", {640.0}},
                                   {"height_px", {480.0}},
                                   {"effective_pixel", {20e-6}}});
  return rig;
}

TEST(BenchSettings, ARealEyeIsSetUpByHandAndSoIsItsTwin) {
  EXPECT_TRUE(bench_of(real("microscope")).by_hand);
  EXPECT_TRUE(bench_of(real("bare_sensor")).by_hand);
  EXPECT_FALSE(bench_of(real("plain")).by_hand) << "without an eye";
  EXPECT_TRUE(bench_of(twin_of(real("microscope"))).by_hand) << "though its pictures are drawn";
  EXPECT_FALSE(bench_of(twin_of(real("plain"))).by_hand);
  RigDescription measured = real("microscope");
  measured.table["model"] = simulated({}, {{"places", {std::string("known")}}}).table["model"];
  EXPECT_FALSE(bench_of(twin_of(measured)).by_hand) << "what the file says stands";
}

TEST(BenchSettings, WhatTheFileSaysStandsAndTheRestIsByTheRule) {
  const BenchUncertainty bench =
      bench_of(simulated({{"bench", {std::string("sampled")}}}, {{"lens_axial", {50e-6}}}));
  EXPECT_EQ(bench.lens_axial, 50e-6);
  EXPECT_EQ(bench.lens_tilt, BenchUncertainty{}.lens_tilt);
  EXPECT_THROW(bench_of(simulated({}, {{"lens_axail", {50e-6}}})), ConfigError);
  EXPECT_THROW(bench_of(simulated({}, {{"lens_axial", {50.0}}})), ConfigError);
}

TEST(BenchSettings, ADrawnPlaceThatCountsAsKnownIsWarnedOfByName) {
  const auto warned = [](ConfigTable bench) {
    return read(
               simulated({{"lens_tilt_sigma", {0.01}}, {"center_sigma", {1e-4}}}, std::move(bench)))
        .warnings;
  };
  EXPECT_TRUE(warned({}).empty());
  const auto known = warned({{"places", {std::string("known")}}});
  ASSERT_EQ(known.size(), 1U);
  EXPECT_NE(known[0].find("center, lens_tilt are drawn by truth.optics"), std::string::npos)
      << known[0];
  const auto one = warned({{"places", {std::string("known")}}, {"center", {1e-4}}});
  ASSERT_EQ(one.size(), 1U);
  EXPECT_NE(one[0].find(": lens_tilt is drawn"), std::string::npos) << one[0];
}

TEST(BenchSettings, AKeyThatNothingReadsIsWarnedOf) {
  RigDescription plain = simulated({}, {{"lens_tilt", {0.01}}, {"center", {1e-4}}});
  std::get<ConfigTable>(plain.table["top_camera"].value)["view"] =
      ConfigValue{std::string("plain")};
  const auto warnings = read(plain).warnings;
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_EQ(warnings[0],
            "model.uncertainty.bench.lens_tilt: nothing reads it, for the top camera's view shows "
            "no eye");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
