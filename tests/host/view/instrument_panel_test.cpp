// Instruments that a person adjusts by hand: within the rig's limits, on the record, and never past
// the end of the run.
// SPDX-License-Identifier: Apache-2.0
#include "host/view/instrument_panel.h"

#include "devices/time/error.h"
#include "host/view/control_socket.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <stdexcept>
#include <string>

namespace vitreo::view {
namespace VITREO_TEST_FILE {

RigDescription rig_with_a_stage() {
  RigDescription description = whole_rig();
  description.table["stage"] = ConfigValue{
      ConfigTable{{"driver", {std::string("simulated")}}, {"carries", {std::string("sensor")}}}};
  return description;
}

/// Dims as it is told, until it is gone.
struct LampOfTest final : Lamp {
  std::string identity() const override { return "lamp"; }
  void set_level(double level) override {
    if (gone) throw DeviceError(DeviceErrorKind::lost, "lamp", "unplugged");
    now = level;
  }
  double level() const override { return now; }
  void ask() override {}
  void make_safe() override { now = 0; }
  double now = 0.4;
  bool gone = false;
};

struct InstrumentPanelTest : testing::Test {
  InstrumentPanelTest() {
    bench.roles().lamp = &lamp;
    panel = std::make_unique<InstrumentPanel>(*bench.clock, bench.roles(), *bench.recorder,
                                              bench.session->control);
    panel->begin();
  }
  ~InstrumentPanelTest() override {
    panel.reset();
    bench.roles().lamp = nullptr;
  }

  /// Why it was refused; empty: it was not.
  std::string adjust(const std::string& what, double value) {
    try {
      panel->adjust(what, value, "anna");
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  }
  /// What is shown of a quantity.
  nlohmann::json shown(const std::string& what) {
    for (const nlohmann::json& one : panel->status())
      if (one["name"] == what) return one;
    return nullptr;
  }
  void pass(double seconds) { bench.clock->sleep_for(from_seconds(seconds)); }
  /// Events of the panel.
  std::string events() const {
    std::string text;
    for (const Event& event : bench.recorder->events())
      if (event.kind == "adjust") text += event.text + "\n";
    return text;
  }

  LampOfTest lamp;
  TestBench bench{1, {}, rig_with_a_stage()};
  std::unique_ptr<InstrumentPanel> panel;
  Stage& stage = *bench.roles().stage;
  const StageAxis axis = stage.info().axes.front();
  const std::string name = "stage " + axis.name;
  const double far = 0.99 * axis.travel_max;  // m
};

TEST_F(InstrumentPanelTest, NothingIsReadOrMovedBeforeAPersonWantsIt) {
  const std::vector<double> before = stage.position();
  pass(1);
  EXPECT_TRUE(shown(name)["value"].is_null());
  EXPECT_EQ(shown(name)["max"], axis.travel_max) << "the limits are the rig's";
  EXPECT_EQ(stage.position(), before);
  EXPECT_EQ(bench.recorder->stream("panel_stage"), nullptr);
}

TEST_F(InstrumentPanelTest, AStageGoesWhereItIsSentAndTheRecordSaysByWhom) {
  panel->read();
  pass(0.5);
  EXPECT_NEAR(shown(name)["value"], stage.position().front(), 1e-9);
  const double there = 0.25 * axis.travel_min + 0.75 * axis.travel_max;
  ASSERT_EQ(adjust(name, there), "");
  EXPECT_EQ(shown(name)["busy"], true);
  pass(2 + (axis.travel_max - axis.travel_min) / axis.speed);
  const double step = axis.resolution + 1e-9;
  EXPECT_NEAR(stage.position().front(), there, step);
  EXPECT_NEAR(shown(name)["value"], there, step);
  EXPECT_EQ(shown(name)["busy"], false);
  EXPECT_EQ(shown(name)["by"], "anna");
  EXPECT_EQ(events().rfind(name + " to ", 0), 0U) << events();
  EXPECT_NE(events().find(", by anna\n"), std::string::npos) << events();
  ASSERT_NE(bench.recorder->stream("panel_stage"), nullptr) << "what is shown is recorded";
}

// By any face: the page, the control socket, a program.
TEST_F(InstrumentPanelTest, TheControlSocketMovesAStageOnceItIsOffered) {
  OperatorDesk& desk = bench.session->desk;
  const auto ask = [&desk](const nlohmann::json& request) {
    const nlohmann::json reply = answer_request(request.dump(), desk);
    return reply["ok"].get<bool>() ? "" : reply["error"].get<std::string>();
  };
  const double there = 0.25 * axis.travel_min + 0.75 * axis.travel_max;
  const nlohmann::json request = {
      {"do", "adjust"}, {"by", "otto"}, {"instrument", name}, {"to", there}};
  EXPECT_NE(ask(request).find("only in a run at the pace of the wall clock"), std::string::npos);
  EXPECT_FALSE(desk.status().contains("instruments"));
  desk.offer(panel.get());
  const unsigned long before = desk.changes();
  EXPECT_EQ(ask({{"do", "adjust"}, {"to", 1}}), "instrument: wants a text");
  EXPECT_EQ(ask({{"do", "adjust"}, {"instrument", name}}), "to: wants a number, in SI units");
  EXPECT_EQ(ask({{"do", "adjust"}}), "");
  EXPECT_EQ(ask(request), "");
  pass(2 + (axis.travel_max - axis.travel_min) / axis.speed);
  EXPECT_NEAR(stage.position().front(), there, axis.resolution + 1e-9);
  EXPECT_NE(events().find(", by otto\n"), std::string::npos) << events();
  EXPECT_GT(desk.changes(), before) << "who watches is told";
  EXPECT_EQ(desk.status()["instruments"], panel->status());
  desk.offer(nullptr);
  EXPECT_NE(ask(request), "");
}

TEST_F(InstrumentPanelTest, WhatIsOutsideOfTheRigsLimitsIsRefusedAndSaysThem) {
  const auto refused = [this](const std::string& what, double value, const std::string& why) {
    const std::string said = adjust(what, value);
    EXPECT_NE(said.find(why), std::string::npos) << what << " " << value << ": " << said;
  };
  refused(name, axis.travel_max + 1e-6, "is not within");
  refused(name, std::nan(""), "is not within");
  refused("lamp", 1.01, "lamp: 101");
  refused("lamp", -0.01, "is not within");
  refused("coils", 1, "'coils' is none of those that can be adjusted: ");
  pass(1);
  EXPECT_EQ(lamp.now, 0.4);
  EXPECT_EQ(events(), "") << "nothing was done";
}

TEST_F(InstrumentPanelTest, OfManyRequestsForOneInstrumentTheLastCounts) {
  for (int i = 0; i <= 50; ++i) ASSERT_EQ(adjust("lamp", 0.01 * i), "");
  pass(0.2);
  EXPECT_DOUBLE_EQ(lamp.now, 0.5);
  const std::string done = events();
  EXPECT_EQ(std::count(done.begin(), done.end(), '\n'), 1) << done;
}

TEST_F(InstrumentPanelTest, WhatIsAskedForIsDroppedWhenTheRunIsToldToEnd) {
  ASSERT_EQ(adjust("lamp", 0.9), "");
  bench.session->control.request(StopTier::stop, "by anna");
  pass(0.2);
  EXPECT_EQ(lamp.now, 0.4);
  EXPECT_EQ(shown("lamp")["refused"], "the run is ending");
  EXPECT_NE(adjust("lamp", 0.9).find("the run is ending"), std::string::npos);
}

TEST_F(InstrumentPanelTest, AMotionThatGoesOnIsBrokenOffAtTheEnd) {
  ASSERT_EQ(adjust(name, far), "");
  pass(0.1);
  ASSERT_TRUE(stage.moving());
  panel.reset();
  pass(0.5);
  EXPECT_FALSE(stage.moving());
  EXPECT_LT(stage.position().front(), far - 10 * axis.resolution);
}

TEST_F(InstrumentPanelTest, TheRigsSafeStateStopsAMotionAndNoneBeginsAfterIt) {
  ASSERT_EQ(adjust(name, far), "");
  pass(0.1);
  ASSERT_TRUE(stage.moving());
  ASSERT_EQ(adjust("top_camera gain", 6).substr(0, 10), "instrument") << "not asked yet";
  bench.session->control.set_phase(RunPhase::ended);
  EXPECT_TRUE(bench.rig->make_safe().empty());
  pass(1);
  EXPECT_FALSE(stage.moving());
  EXPECT_LT(stage.position().front(), far - 10 * axis.resolution);
  EXPECT_NE(shown(name)["refused"], "");
  EXPECT_NE(adjust(name, 0).find("the run is ending"), std::string::npos);
}

TEST_F(InstrumentPanelTest, AnInstrumentThatIsGoneSaysSoAndTheRunGoesOn) {
  lamp.gone = true;
  ASSERT_EQ(adjust("lamp", 0.9), "");
  pass(0.2);
  EXPECT_NE(shown("lamp")["refused"].get<std::string>().find("unplugged"), std::string::npos);
  EXPECT_EQ(shown("lamp")["busy"], false);
  EXPECT_EQ(bench.session->control.tier(), StopTier::none);
}

TEST_F(InstrumentPanelTest, ACamerasQuantitiesAreFoundWhenAPersonLooks) {
  EXPECT_TRUE(shown("top_camera gain").is_null());
  panel->read();
  pass(0.5);
  EXPECT_EQ(shown("top_camera gain")["value"], 0);
  ASSERT_EQ(adjust("top_camera gain", 6), "");
  pass(0.2);
  EXPECT_EQ(shown("top_camera gain")["value"], 6);
  EXPECT_DOUBLE_EQ(std::stod(bench.roles().top_camera->feature("Gain")), 6);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::view
