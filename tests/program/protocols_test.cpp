// Every protocol runs on the simulated rig.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

namespace vitreo {
namespace {

bool needs_arguments(const Workplace& place, const std::string& protocol) {
  const auto described = nlohmann::json::parse(place.vitreo("describe '" + protocol + "' --json").out);
  for (const auto& parameter : described["parameters"])
    if (parameter.value("required", false)) return true;
  return false;
}

TEST(Protocols, EachRunsWithItsDefaults) {
  const Workplace place;
  for (const auto& entry : std::filesystem::directory_iterator(VITREO_SOURCE_DIR "/protocols")) {
    if (needs_arguments(place, entry.path().string())) continue;  // those have tests of their own
    const Spoken spoken = place.vitreo("run '" + entry.path().string() + "' --json");
    ASSERT_EQ(spoken.exit_code, 0) << entry.path() << "\n" << spoken.out << spoken.err;
    EXPECT_EQ(nlohmann::json::parse(spoken.out)["outcome"], "completed") << entry.path();
  }
}

TEST(ServoSquare, ItStaysWithinTheFiguresForSeveralMachines) {
  const Workplace place;
  for (int seed = 1; seed <= 3; ++seed) {
    const Spoken spoken = place.vitreo("run servo_square --json --seed " + std::to_string(seed));
    ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
    const auto figures = nlohmann::json::parse(spoken.out)["figures"];
    // the goals of every seed: 300 um in 3-D, 150 um across (docs/figures.md has what 20 seeds gave)
    EXPECT_LT(figures["path_error_rms"], 300e-6) << seed;
    EXPECT_LT(figures["path_error_lateral_rms"], 150e-6) << seed;
    EXPECT_GT(figures["path_error_rms"], 10e-6) << "a figure this good is not the thesis' PD: look for the leak";
    EXPECT_LT(figures["localisation_error_mean"], 300e-6) << seed;
    EXPECT_GT(figures["localisation_error_max"], figures["localisation_error_mean"]) << seed;
    EXPECT_GT(figures["experiment_time"], 56) << "28 mm at 0.5 mm/s";
  }
}

TEST(ServoSquare, AnotherMicroscopeDoesToo) {
  const Workplace place;
  // a finite pupil, off the axis and tilted, with twice the aperture: other chief rays, three times the blur
  place.write("rig.lua",
              "return { top_camera = { microscope = { numerical_aperture = 0.02, focus = 11.5e-3,\n"
              "  pupil_distance = 0.15, decentre = { 0.3e-3, -0.2e-3 }, tilt = { 0.01, -0.005 } } },\n"
              "  side_camera = {}, coils = {}, sample = {} }");
  const Spoken spoken = place.vitreo("run servo_square --json --rig rig.lua");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  EXPECT_LT(nlohmann::json::parse(spoken.out)["figures"]["path_error_rms"], 300e-6);
}

TEST(ServoSquare, TheExactProjectionLocalisesBetterThanTheSingleViewpoint) {
  const Workplace place;
  const auto localisation = [&](const std::string& projection) {
    place.write("rig.lua", "return { top_camera = { projection = '" + projection + "' }, coils = {}, sample = {} }");
    const Spoken spoken = place.vitreo("run servo_square --json --rig rig.lua --seed 2");
    EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
    return nlohmann::json::parse(spoken.out)["figures"]["localisation_error_mean"].get<double>();
  };
  // The single viewpoint's 50 um are one of three causes; the pitch of the true field and the contour stay.
  EXPECT_LT(localisation("exact"), 0.9 * localisation("single_viewpoint"));
}

TEST(ServoSquare, TheSameSeedGivesTheSameFiguresToTheBit) {
  const Workplace place;
  const auto figures = [&](int seed) {
    auto all =
        nlohmann::json::parse(place.vitreo("run servo_square --json --seed " + std::to_string(seed)).out)["figures"];
    all.erase("wall_time");
    return all;
  };
  const auto first = figures(5);
  EXPECT_EQ(first, figures(5));
  EXPECT_NE(first, figures(6));
}

}  // namespace
}  // namespace vitreo
