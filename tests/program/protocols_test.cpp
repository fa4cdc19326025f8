// Every protocol runs on the simulated rig.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>

namespace vitreo {
namespace VITREO_TEST_FILE {

bool needs_arguments(const Workplace& place, const std::string& protocol) {
  const auto described =
      nlohmann::json::parse(place.vitreo("describe '" + protocol + "' --json").out);
  for (const auto& parameter : described["parameters"])
    if (parameter.value("required", false)) return true;
  return false;
}

// What makes a long protocol short; the others run with their defaults.
std::string shortened(const std::string& protocol) {
  if (protocol == "drift_test")
    return " feedback=one_camera machines=1 repetitions=1 hold=0.5s settle=1s";
  if (protocol == "hold") return " compare=false settle=2s hold=2s width=0.5mm depth=0.5mm";
  if (protocol == "steer") return " duration=2s";
  return "";
}

// The experiments of the thesis run in their short forms in experiments_test.cpp, as do those that
// ask or need other rigs.
bool tested_elsewhere(const std::string& protocol) {
  std::ostringstream plan;
  plan << std::ifstream(VITREO_SOURCE_DIR "/scripts/reproduction.lua").rdbuf();
  return plan.str().find("protocol = \"" + protocol + "\"") != std::string::npos ||
         protocol.starts_with("calibrate_") || protocol == "porcine_session";
}

TEST(Protocols, EachRunsWithItsDefaultsOrShortened) {
  const Workplace place;
  for (const auto& entry : std::filesystem::directory_iterator(VITREO_SOURCE_DIR "/protocols")) {
    if (needs_arguments(place, entry.path().string()) ||
        tested_elsewhere(entry.path().stem().string()))
      continue;
    const std::string words =
        "run '" + entry.path().string() + "' --json" + shortened(entry.path().stem().string());
    const Spoken spoken = place.vitreo(words);
    ASSERT_EQ(spoken.exit_code, 0) << entry.path() << "\n" << spoken.out << spoken.err;
    EXPECT_EQ(nlohmann::json::parse(spoken.out)["outcome"], "completed") << entry.path();
  }
}

TEST(ServoSquare, ItStaysWithinItsGoalsForSeveralMachines) {
  const Workplace place;
  // The robot's size as believed: one camera takes a hundredth of it for 0.2 mm of depth, which no
  // control mends (docs/control_margins.md).
  place.write("sized.lua", "return { base = \"simulated\", truth = { size_sigma = 0 } }");
  const int seeds = long_or_short(10, 1);
  int within = 0;
  for (int seed = 1; seed <= seeds; ++seed) {
    const Spoken spoken =
        place.vitreo("run servo_square --json --rig sized.lua --seed " + std::to_string(seed));
    ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
    const auto results = nlohmann::json::parse(spoken.out)["results"];
    // the goals: 300 um in 3-D, 150 um across (docs/figures.md has what 20 seeds gave)
    within += results["path_error_rms"] < 300e-6;
    EXPECT_LT(results["path_error_rms"], seed <= 3 ? 300e-6 : 350e-6) << seed;
    EXPECT_LT(results["path_error_lateral_rms"], 150e-6) << seed;
    EXPECT_GT(results["path_error_rms"], 10e-6)
        << "a result this good is not the thesis' PD: look for the leak";
    EXPECT_LT(results["localization_error_mean"], 300e-6) << seed;
    EXPECT_GT(results["localization_error_max"], results["localization_error_mean"]) << seed;
    EXPECT_GT(results["experiment_time"], 56) << "28 mm at 0.5 mm/s";
  }
  EXPECT_GE(within, 0.9 * seeds) << "one of ten: seed 5 has 310 um";
}

TEST(ServoSquare, AnotherMicroscopeDoesToo) {
  const Workplace place;
  // a finite pupil, off the axis and tilted, with twice the aperture: other chief rays, three times
  // the blur
  place.write(
      "rig.lua",
      "return { top_camera = { microscope = { numerical_aperture = 0.02, focus = 11.5e-3,\n"
      "  pupil_distance = 0.15, decenter = { 0.3e-3, -0.2e-3 }, tilt = { 0.01, -0.005 } } },\n"
      "  side_camera = {}, coils = {}, sample = {} }");
  const Spoken spoken = place.vitreo("run servo_square --json --rig rig.lua");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.err;
  EXPECT_LT(nlohmann::json::parse(spoken.out)["results"]["path_error_rms"], 300e-6);
}

TEST(ServoSquare, TheExactProjectionLocalizesBetterThanTheSingleViewpoint) {
  const Workplace place;
  const auto localization = [&](const std::string& projection) {
    place.write("rig.lua", "return { top_camera = { projection = '" + projection +
                               "' }, coils = {}, sample = {},"
                               " truth = { drawn_as = 'ellipsoid', size_sigma = 0 } }");
    const Spoken spoken = place.vitreo("run servo_square --json --rig rig.lua --seed 2");
    EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
    return nlohmann::json::parse(spoken.out)["results"]["localization_error_mean"].get<double>();
  };
  // The single viewpoint's 50 um are one of three causes; the pitch of the true field and the
  // contour stay. As crossed plates the robot's outline is no ellipse, and that error is larger
  // than either.
  EXPECT_LT(localization("exact"), 0.9 * localization("single_viewpoint"));
}

TEST(ServoSquare, TheSameSeedGivesTheSameResultsToTheBit) {
  const Workplace place;
  const auto results = [&](int seed) {
    auto all = nlohmann::json::parse(
        place
            .vitreo("run servo_square width=1mm depth=1mm speed=1mm/s --json --seed " +
                    std::to_string(seed))
            .out)["results"];
    all.erase("wall_time");
    return all;
  };
  const auto first = results(5);
  EXPECT_EQ(first, results(5));
  EXPECT_NE(first, results(6));
}

nlohmann::json results_of(const Workplace& place, const std::string& words) {
  const Spoken spoken = place.vitreo("run " + words + " --json");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  return spoken.exit_code == 0 ? nlohmann::json::parse(spoken.out)["results"]
                               : nlohmann::json::object();
}

TEST(Hold, TheEstimatorMeetsItsGoalsOnThePoseSensorAndTheReportNamesIt) {
  const Workplace place;
  for (int seed = 1; seed <= long_or_short(10, 2); ++seed) {
    const auto results =
        results_of(place, "hold feedback=pose_sensor --seed " + std::to_string(seed));
    EXPECT_LT(results["hold_error_rms"], 6e-6) << seed;
    EXPECT_LT(results["square_error_rms"], 15e-6) << seed;
    EXPECT_GT(results["hold_error_rms"], 1e-6)
        << "four micrometers of noise go in: look for the leak";
    EXPECT_GT(results["hold_error_rms_pd"], results["hold_error_rms"]) << seed;
  }
  std::string report;
  for (const auto& entry : std::filesystem::directory_iterator(place.folder() / "runs"))
    report = place.read((entry.path() / "report.html").lexically_relative(place.folder()).string());
  EXPECT_NE(report.find("simulator&#39;s truth"), std::string::npos);
  EXPECT_NE(report.find("pose_sensor"), std::string::npos);
}

TEST(Hold, AFastLoopHoldsWithinAMicrometre) {
  const Workplace place;
  const auto results =
      results_of(place,
                 "hold feedback=pose_sensor compare=false hold=5s settle=3s width=1mm depth=1mm "
                 "--rig '" VITREO_SOURCE_DIR "/scripts/rigs/fast.lua'");
  EXPECT_LT(results["hold_error_rms"], 1e-6);
}

/// An OctoMag as ETH's software would have measured it (facts/magnetics 1.2): one source a coil,
/// `gain` of the nominal strength, the coils numbered from another one on.
std::string calibration(double gain, int first) {
  std::string text = "System_Name: measured\nCoil_List: [C0, C1, C2, C3, C4, C5, C6, C7]\n";
  for (int k = 0; k < 8; ++k) {
    const int coil = (k + first) % 8;
    const bool lower = coil % 2 == 0;
    const double radian = M_PI / 180, azimuth = 45 * coil * radian;
    const auto vector = [&](double length, double elevation) {
      const double flat = length * std::cos(elevation * radian);
      return "[" + std::to_string(flat * std::cos(azimuth)) + ", " +
             std::to_string(flat * std::sin(azimuth)) + ", " +
             std::to_string(length * std::sin(elevation * radian)) + "]";
    };
    text += "C" + std::to_string(k) +
            ":\n  Source_List: [Src_0]\n  Src_0:\n    A_Coeff: ~\n    B_Coeff: [" +
            std::to_string(gain * (lower ? 9.35 : 19.64)) +
            "e-7]\n    Source_Position: " + (lower ? vector(0.0942, -56.3) : vector(0.1089, -7.8)) +
            "\n    Source_Direction: " + (lower ? vector(1, -83.1) : vector(1, -37.9)) + "\n";
  }
  return text + "Workspace_Dimensions:\n  - [-0.01, 0.01]\n  - [-0.01, 0.01]\n  - [-0.01, 0.01]\n";
}

TEST(Calibration, AMeasuredMachineInThePlantIsHeldThoughItIsWeakerAndNumbersItsCoilsOtherwise) {
  const Workplace place;
  place.write("machine.yaml", calibration(0.85, 2));
  const auto results = results_of(
      place, "hold feedback=pose_sensor compare=false settle=5s hold=5s calibration=machine.yaml");
  EXPECT_LT(results["hold_error_rms"], 6e-6);
  EXPECT_LT(results["square_error_rms"], 15e-6);
  std::string report;
  for (const auto& entry : std::filesystem::directory_iterator(place.folder() / "runs"))
    report = place.read((entry.path() / "report.html").lexically_relative(place.folder()).string());
  EXPECT_NE(report.find("measured machine of machine.yaml (measured)"), std::string::npos);
  EXPECT_NE(report.find("coil 8: sign +, gain 0.850, angle 0.0\u00b0"), std::string::npos);
  EXPECT_NE(report.find("wired to the channels 3, 4, 5, 6, 7, 8, 1, 2"), std::string::npos);
}

TEST(Calibration, AFileThatIsMissingOrMalformedIsNamedBeforeAnythingMoves) {
  const Workplace place;
  place.write("broken.yaml", "Coil_List: [C0]\nC0:\n  Source_List: [Src_0]\n");
  for (const char* protocol : {"hold feedback=pose_sensor", "drift_test"}) {
    const Spoken missing = place.vitreo(std::string("run ") + protocol + " calibration=none.yaml");
    EXPECT_NE(missing.exit_code, 0);
    EXPECT_NE(missing.out.find("none.yaml: there is no such file"), std::string::npos)
        << missing.out;
    const Spoken broken = place.vitreo(std::string("run ") + protocol + " calibration=broken.yaml");
    EXPECT_NE(broken.exit_code, 0);
    EXPECT_NE(broken.out.find("broken.yaml: line "), std::string::npos) << broken.out;
    EXPECT_NE(broken.out.find("Src_0"), std::string::npos) << broken.out;
  }
}

// The discs take of the robot's motion what a dead coil would: it touches them on purpose.
TEST(PushDiscs, NoCoilIsAccusedOfWhatTheDiscsTake) {
  const Workplace place;
  const Spoken spoken = place.vitreo("run push_discs way=1mm");
  EXPECT_EQ(spoken.exit_code, 0) << spoken.err;
  EXPECT_EQ((spoken.out + spoken.err).find("weak coil"), std::string::npos) << spoken.err;
}

// A reading comes each 31 ms there, 11 of them the set-point's own on its link: what is asked later
// has to be asked later than that.
TEST(CalibrateLatency, SeesTheStepWhateverTheSeed) {
  const Workplace place;
  for (int seed = 1; seed <= long_or_short(20, 3); ++seed) {
    const Spoken spoken =
        place.vitreo("run calibrate_latency --quiet --seed " + std::to_string(seed));
    EXPECT_EQ(spoken.exit_code, 0) << seed << ": " << spoken.err;
  }
}

TEST(GelStep, ThePidTunedInOilLimitCyclesInVitreousAndVelocityControlDoesNotOvershoot) {
  const Workplace place;
  const auto gel =
      results_of(place, "gel_step watch=40s --rig '" VITREO_SOURCE_DIR "/scripts/rigs/gel.lua'");
  EXPECT_GT(gel["pid_overshoot"], 1) << "more than the step itself";
  EXPECT_GT(gel["pid_reversals"], 40) << "one a second and more, without end";
  EXPECT_LT(gel["velocity_overshoot"], 0.05) << "noise and creep";
  EXPECT_NEAR(gel["velocity_last"].get<double>(), 1, 0.05);
  // In oil the same PID rings and arrives, at its margin: in the end it goes to and fro by a
  // fiftieth of the step.
  place.write("oil.lua",
              "return { model = { robot = 'ndfeb_cylinder_1mm' }, coils = {}, sample = {}, "
              "pose_sensor = {}, truth = { coil_delay = 0.04 } }");  // and 10 ms of USB frames
  const auto oil = results_of(place, "gel_step watch=40s --rig oil.lua");
  EXPECT_LT(oil["pid_reversals"].get<double>(), 0.25 * gel["pid_reversals"].get<double>());
  EXPECT_LT(oil["pid_overshoot"].get<double>(), 1) << "the step itself";
  EXPECT_NEAR(oil["pid_last"].get<double>(), 1, 0.05);
}

// Machines on which that PID threw the robot from retina to lens at 100 mm/s, for 90 s: found by
// vitreo soak, seeds 4 to 36.
TEST(GelStep, AnUnstableLoopKeepsTheRobotOffTheWalls) {
  const Workplace place;
  for (const char* seed : {"562723", "50523", "457631", "648878", "212518", "421141", "547202"}) {
    const Spoken spoken = place.vitreo(std::string("run gel_step watch=30s --seed ") + seed);
    EXPECT_EQ(spoken.exit_code, 0) << seed << spoken.err;
    EXPECT_EQ(spoken.err.find("keep-out margin:"), std::string::npos) << seed << spoken.err;
    EXPECT_EQ(spoken.err.find("robot lost"), std::string::npos) << seed << spoken.err;
  }
}

// Under velocity control, which has no plant watch.
TEST(GelStep, ARobotThatLiesOnTheRetinaAndIsNotBroughtAwayIsLetGo) {
  const Workplace place;
  const Spoken spoken =
      place.vitreo("run gel_step --seed 1125 --fault coils:reversed:channel=8,after=2.3s");
  EXPECT_NE(spoken.err.find("it has long touched the retina"), std::string::npos) << spoken.err;
}

TEST(Views, APlainViewFromAboveServesTwoCamerasAndNotOneAlone) {
  const Workplace place;
  place.write("rig.lua",
              "return { top_camera = { view = 'plain', effective_pixel = 14.3e-6, width_px = 900, "
              "height_px = 700 },\n"
              "  side_camera = {}, coils = {}, sample = {}, truth = { machine = 'nominal' } }");
  const std::string hold =
      "hold compare=false settle=2s hold=2s width=0.2mm depth=0.2mm --rig rig.lua ";
  EXPECT_LT(results_of(place, hold + "feedback=two_cameras")["hold_error_rms"], 10e-6);
  const Spoken alone = place.vitreo("run " + hold + "feedback=one_camera");
  EXPECT_NE(alone.exit_code, 0);
  EXPECT_NE(alone.out.find("a plain one from above has no depth"), std::string::npos) << alone.out;
}

// What a bench that was set up by hand leaves open of its retina is kept from it; what a look would
// tell is in the record.
TEST(Hold, WhereTheRobotWasNotSeenOnTheRetinaItsSquareIsSmaller) {
  const Workplace place;
  const std::string hold =
      "run hold settle=0.5s hold=1s speed=2mm/s compare=false --rig sampled_bench --seed 3";
  const auto part = [&](const std::string& words) {
    const Spoken spoken = place.vitreo(hold + words);
    EXPECT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
    const std::string said = spoken.out + spoken.err;
    const std::size_t told = said.find("the square is ");
    return std::pair(told == std::string::npos ? 100 : std::stoi(said.substr(told + 14)), said);
  };
  const auto [not_looked, why] = part(" calibrate=no");
  EXPECT_LT(not_looked, part("").first);
  EXPECT_GE(not_looked, 75);
  EXPECT_NE(why.find("is out of reach"), std::string::npos) << why;
  EXPECT_NE(why.find("a look at the robot that lies on the retina"), std::string::npos) << why;
}

TEST(Hold, OnARigWithOneRealInstrumentThereIsNoPoseSensor) {
  const Workplace place;
  place.write("rig.lua",
              "return { coils = {}, sample = {}, pose_sensor = {},\n"
              "  stage = { address = 'serial:/dev/ttyUSB0', x = {} } }");
  const Spoken spoken = place.vitreo("run hold feedback=pose_sensor --rig rig.lua");
  EXPECT_EQ(spoken.exit_code, 2);
  EXPECT_NE(spoken.err.find("pose_sensor: it knows the truth"), std::string::npos) << spoken.err;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
