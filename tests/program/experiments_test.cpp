// The thesis' experiments as protocols: each runs in its short form and leaves its numbers beside the thesis'.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <fstream>
#include <set>
#include <sstream>

namespace vitreo {
namespace {

std::string rig(const std::string& name) { return "--rig '" VITREO_SOURCE_DIR "/scripts/rigs/" + name + ".lua'"; }

TEST(Reproduce, EveryExperimentRunsInItsShortFormAndLeavesItsNumbers) {
  const Workplace place;
  const Spoken spoken = place.vitreo("reproduce --brief --json --out runs --processes 2");
  // 1: some numbers of the short forms are missed, as they may be
  ASSERT_TRUE(spoken.exit_code == 0 || spoken.exit_code == 1) << spoken.err;
  EXPECT_EQ(spoken.err.find("failed"), std::string::npos) << spoken.err;
  EXPECT_EQ(spoken.err.find("aborted"), std::string::npos) << spoken.err;
  const auto rows = nlohmann::json::parse(spoken.out);
  std::set<std::string> protocols, ids;
  for (const auto& row : rows) {
    for (const char* key : {"id", "thesis", "ours", "unit", "tolerance", "verdict", "why", "run"})
      EXPECT_TRUE(row.contains(key)) << key << " in " << row;
    protocols.insert(row["protocol"]);
    ids.insert(row["id"]);
  }
  EXPECT_EQ(ids.size(), rows.size()) << "each number has an id of its own";
  EXPECT_GE(protocols.size(), 14U) << spoken.err;
  const std::string page = place.read("runs/reproduction.html");
  EXPECT_NE(page.find("the run's report"), std::string::npos);
  EXPECT_NE(page.find("table 5.2"), std::string::npos);
}

TEST(Reproduce, APartOfThePlanWritesNoPageUnlessAskedAndUnknownNamesAreRefused) {
  const Workplace place;
  const Spoken some =
      place.vitreo("reproduce compare_ophthalmoscopes sensitivity_focus --json --docs pages --out runs");
  ASSERT_EQ(some.exit_code, 0) << some.err;
  const std::string text = place.read("pages/reproduction.md");
  EXPECT_NE(text.find("| figure 4.2 |"), std::string::npos) << text;
  EXPECT_NE(text.find("0 do not"), std::string::npos) << text;
  const Spoken unknown = place.vitreo("reproduce compare_ophthalmoscope");
  EXPECT_EQ(unknown.exit_code, 2);
  EXPECT_NE(unknown.err.find("did you mean compare_ophthalmoscopes"), std::string::npos) << unknown.err;
}

TEST(Reproduce, AProtocolThatFailsIsToldAndTheRestGoesOn) {
  const Workplace place;
  place.write("plan.lua",
              "return { a = { protocol = 'compare_ophthalmoscopes', arguments = 'nearest=20mm' },\n"
              "  b = { protocol = 'sensitivity_focus' } }");
  const Spoken spoken = place.vitreo("reproduce --plan plan.lua --json");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_NE(spoken.err.find("failed"), std::string::npos) << spoken.err;
  EXPECT_GE(nlohmann::json::parse(spoken.out).size(), 8U);
  place.write("plan.lua", "return { a = { protocol = 'compare_ophthalmoscopes', argument = '' } }");
  const Spoken wrong = place.vitreo("reproduce --plan plan.lua");
  EXPECT_EQ(wrong.exit_code, 2);
  EXPECT_NE(wrong.err.find("did you mean arguments"), std::string::npos) << wrong.err;
}

// The bench with a bare sensor, but with a small one: its image is traced anew for each place of the stage.
std::string small_bench(const Workplace& place) {
  std::ostringstream text;
  text << std::ifstream(VITREO_SOURCE_DIR "/scripts/rigs/bare_sensor.lua").rdbuf();
  std::string rig = text.str();
  const std::string width = "width_px = 1760";
  rig.replace(rig.find(width), width.size(), "width_px = 260");
  place.write("bench.lua", rig);
  return " --rig bench.lua";
}

TEST(DepthFromFocus, TargetsAreLocalisedAndTheRetinaCalibratesAnEyeThatNobodyKnows) {
  const Workplace place;
  const std::string bench = small_bench(place);
  const Spoken places =
      place.vitreo("run localise_by_focus angles=2 field=2deg surfaces=1 repetitions=1 eyes=0 --json" + bench);
  ASSERT_EQ(places.exit_code, 0) << places.out << places.err;
  EXPECT_EQ(nlohmann::json::parse(places.out)["figures"]["localised"], 2) << places.err;
  const Spoken law = place.vitreo("run calibrate_biometric points=3 deepest=3mm reach=2.2mm --json" + bench);
  ASSERT_EQ(law.exit_code, 0) << law.out << law.err;
  const auto figures = nlohmann::json::parse(law.out)["figures"];
  EXPECT_EQ(figures["expectations_missed"], 0) << law.err;
  EXPECT_LT(figures["calibrated_error"], 0.5e-3);
}

TEST(Simulation, WhatItIsToldIsCheckedAndNamed) {
  const Workplace place;
  place.write(
      "told.lua",
      "return { title = 'x', needs = { 'sample' }, run = function(rig, p, run)\n"
      "  local s, eye = rig.simulation, rig:eye()\n"
      "  local function says(what, f, ...) local ok, e = pcall(f, ...) run:note(what .. ': ' .. tostring(e)) end\n"
      "  says('eye', s.set_eye, s, optics.prescription 'navarro')\n"
      "  says('body', s.move_body, s, 'ball', { 0, 0, 0 })\n"
      "  says('robot', s.change, s, { robot = 'coni_3mm' })\n"
      "  says('gel', s.change, s, { robot = 'coni_2mm', gel = 'gel_12' })\n"
      "  local other = eye:drawn(3)\n"
      "  run:figure('index', other:parameter 'lens.index')\n"
      "  run:figure('again', eye:drawn(3):parameter 'lens.index')\n"
      "  run:figure('number_4', eye:drawn(4):parameter 'lens.index')\n"
      "  s:set_eye(other)\n"
      "  run:figure('pixel', rig:model().pixel, 'm')\n"
      "  local image = rig.top_camera:grab().image\n"
      "  local mask = image:ellipse_mask { x_px = 100, y_px = 90, major_px = 40, minor_px = 20, angle = 0 }\n"
      "  run:figure('area', mask:mean() / 255 * 1384 * 1036)\n"
      "end }");
  const Spoken spoken = place.vitreo("run told.lua --json");
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  for (const char* said : {"eye: ", "wants one of 7 surfaces, got 5", "none called 'ball'", "coni_3mm", "gel_12"})
    EXPECT_NE(spoken.err.find(said), std::string::npos) << said << "\n" << spoken.err;
  const auto figures = nlohmann::json::parse(spoken.out)["figures"];
  EXPECT_EQ(figures["index"], figures["again"]);
  EXPECT_NE(figures["index"], figures["number_4"]);
  EXPECT_NEAR(figures["index"], 1.492, 5 * 0.04 * 1.492);
  EXPECT_NEAR(figures["pixel"], 14.3e-6, 1e-9);
  EXPECT_NEAR(figures["area"], 3.14159 * 20 * 10, 60) << "half a pixel of its rim";
}

TEST(Calibrations, CamerasAndLatencyAreAcceptedOnTheSimulatedRig) {
  const Workplace place;
  for (const std::string words :
       {"calibrate_cameras count=3", "calibrate_latency coils=1 frames=5", "calibrate_coils"}) {
    const Spoken spoken = place.vitreo("run " + words + " --json " + rig("calibration"));
    ASSERT_EQ(spoken.exit_code, 0) << words << spoken.out << spoken.err;
    const auto figures = nlohmann::json::parse(spoken.out)["figures"];
    EXPECT_EQ(figures["calibrations_refused"], 0) << words;
    if (figures.contains("top_camera_pixel")) {
      EXPECT_NEAR(figures["top_camera_pixel"], 20.7e-6, 0.2e-6);
    }
    if (figures.contains("residual_relative")) {
      EXPECT_LT(figures["residual_relative"], 3e-3);
    }
    if (figures.contains("loop_latency")) {
      EXPECT_NEAR(figures["loop_latency"], 130e-3, 15e-3);
    }
  }
}

TEST(PorcineSession, ItAsksForEverythingInOrderAndStopsWhereTheEyeIsNotFresh) {
  const Workplace place;
  const std::string yes =
      " --answer eye_fresh=yes --answer photo_eye=none --answer eye_clear=yes --answer opened=yes --answer fixed=yes "
      "--answer photo_holder=none --answer light=yes --answer biom_in=yes --answer field_of_view=no "
      "--answer photo_retina=camera --answer clear=yes --answer photo_robot=camera --answer 'notes=well preserved' "
      "--answer cleared_up=yes";
  const Spoken spoken = place.vitreo("run porcine_session trials=1 tracked=3 --json" + yes);
  ASSERT_EQ(spoken.exit_code, 0) << spoken.out << spoken.err;
  const auto told = nlohmann::json::parse(spoken.out);
  EXPECT_EQ(told["figures"]["checklist_not_done"], 1) << "the field of view";
  EXPECT_GT(told["figures"]["time_left"], 2.5 * 3600);
  const std::string report = place.read(told["run"].get<std::string>() + "/report.html");
  EXPECT_NE(report.find("well preserved"), std::string::npos);
  const Spoken stale = place.vitreo(
      "run porcine_session --json --answer no --answer no --answer no --answer no --answer no --answer no");
  EXPECT_EQ(stale.exit_code, 1);
  EXPECT_NE(stale.out.find("not done"), std::string::npos) << stale.out;
}

}  // namespace
}  // namespace vitreo
