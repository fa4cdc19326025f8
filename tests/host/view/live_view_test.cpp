// Control of the live view: one viewer has it, the others look on; a viewer that leaves loses it,
// and the run goes on.
// SPDX-License-Identifier: Apache-2.0
#include "host/view/live_view.h"

#include "host/view/instrument_panel.h"
#include "tests/host/rig/fake_rig.h"
#include "tests/host/view/web_client.h"

#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <string>
#include <vector>

namespace vitreo::view {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// A run on a rig without instruments, shown to every viewer.
struct LiveViewTest : testing::Test {
  LiveViewTest() {
    session.targets.take();  // the script wants targets
    view.begin(session);
  }
  ~LiveViewTest() override { view.end("completed"); }

  static RigDescription bare() {
    RigDescription description;
    description.file = "test rig";
    description.table["pose_sensor"] = ConfigValue{ConfigTable{}};
    return description;
  }
  static std::string after(const std::string& text, const std::string& word,
                           const std::string& until) {
    const std::size_t begin = text.find(word);
    if (begin == std::string::npos) return "";
    return text.substr(begin + word.size(),
                       text.find(until, begin + word.size()) - begin - word.size());
  }
  /// A browser that was invited, with the page's socket open.
  std::unique_ptr<Wire> join() {
    const std::string address = view.invitation(), host = after(address, "http://", "/");
    const auto port = static_cast<unsigned short>(std::stoi(after(host, ":", "/")));
    Wire visit(port);
    visit.say("GET /?token=" + after(address, "token=", "&") + " HTTP/1.1\r\nHost: " + host +
              "\r\nConnection: close\r\n\r\n");
    const std::string cookie = after(visit.hear(), "vitreo=", ";");
    auto wire = std::make_unique<Wire>(port);
    wire->say(upgrade_request(host, "http://" + host, "Cookie: vitreo=" + cookie + "\r\n"));
    EXPECT_NE(wire->hear("\r\n\r\n").find(" 101 "), std::string::npos);
    return wire;
  }
  /// What the view answers, up to and with `until`; empty when that never comes.
  static std::string ask(Wire& wire, const std::string& message, const std::string& until) {
    wire.say(frame(1, message));
    const std::string heard = wire.hear(until);
    return heard.find(until) == std::string::npos ? "" : heard;
  }

  TemporaryFolder folder;
  SilentListener listener;
  std::unique_ptr<Clock> clock = virtual_clock();
  std::unique_ptr<OpenRig> rig = open_rig(bare(), *clock, 1, {});
  Recorder recorder{folder.path(), start_of_test(1)};
  LiveView view{{.on = true}, listener};
  Session session{*clock, rig->rig(), recorder, listener, 1};
};

constexpr const char* kTarget = R"({"do": "target", "place": [0.001, 0, 0]})";

TEST_F(LiveViewTest, OfTwoOperatorsOneHasControlAndTheOtherIsTold) {
  const auto first = join(), second = join();
  EXPECT_NE(ask(*first, kTarget, "take control first"), "") << "nobody has it yet";
  EXPECT_NE(ask(*first, R"({"do": "take"})", R"({"done":"take"})"), "");
  EXPECT_NE(ask(*second, R"({"do": "take"})", "another viewer has control"), "");
  EXPECT_NE(ask(*second, kTarget, "take control first"), "");
  EXPECT_NE(ask(*second, R"({"do": "pause"})", "take control first"), "");
  EXPECT_FALSE(session.targets.take()) << "a target of somebody who looks on";
  EXPECT_NE(ask(*first, kTarget, R"("target")"), "");
  const auto given = session.targets.take();
  ASSERT_TRUE(given);
  EXPECT_EQ(given->back(), Eigen::Vector3d(1e-3, 0, 0));
  EXPECT_NE(ask(*first, R"({"do": "release"})", R"({"done":"release"})"), "");
  EXPECT_NE(ask(*second, R"({"do": "take"})", R"({"done":"take"})"), "");
}

constexpr const char* kLens = R"({"do": "adjust", "instrument": "lens_mover", "to": 0.001})";

TEST_F(LiveViewTest, InstrumentsAreAdjustedByTheOneWhoHasControlAlone) {
  const auto first = join(), second = join();
  EXPECT_NE(ask(*first, kLens, "take control first"), "");
  EXPECT_NE(ask(*first, R"({"do": "take"})", R"({"done":"take"})"), "");
  EXPECT_NE(ask(*second, kLens, "take control first"), "");
  EXPECT_NE(ask(*first, kLens, "only in a run at the pace of the wall clock"), "");
  session.real_time = true;
  PanelFace panel;
  panel.begin(session);
  EXPECT_NE(ask(*first, kLens, "'lens_mover' is none of those that can be adjusted"), "")
      << "this rig has none";
  EXPECT_NE(ask(*first, R"({"do": "adjust", "instrument": 1, "to": 2})", "wants a text"), "");
  EXPECT_NE(ask(*first, R"({"do": "adjust", "instrument": "lamp", "to": "up"})", "wants a number"),
            "");
  EXPECT_NE(ask(*first, R"({"do": "adjust"})", R"({"done":"adjust"})"), "");
  panel.end("completed");
  EXPECT_NE(ask(*first, kLens, "only in a run at the pace of the wall clock"), "");
}

// By the attitude and view of the loop that wrote the stream; before there is one, for any
// attitude.
TEST_F(LiveViewTest, ATargetWhoseBodyWouldBeInsideOfTheMarginIsRefusedInMillimeters) {
  const auto viewer = join();
  EXPECT_NE(ask(*viewer, R"({"do": "take"})", R"({"done":"take"})"), "");
  (void)session.targets.take();
  const std::string inside = ask(*viewer, R"({"do": "target", "place": [0, 0, -0.0049]})",
                                 "mm must be left (keep_out.margin)");
  EXPECT_NE(inside.find("inside the retina"), std::string::npos) << inside;
  EXPECT_NE(ask(*viewer, R"({"do": "target", "place": [0, 0, -0.0041]})", "must be left"), "")
      << "upright it would be there";
  const int stream = recorder.add_stream({"clearance",
                                          "",
                                          {{"bound", "m"},
                                           {"distance", "m"},
                                           {"uncertainty", "m"},
                                           {"retina", "m"},
                                           {"lens", "m"},
                                           {"at_lens", ""},
                                           {"margin", "m"},
                                           {"kept_out", ""},
                                           {"axis_x", ""},
                                           {"axis_y", ""},
                                           {"axis_z", ""},
                                           {"axis_sigma", "rad"},
                                           {"through_eye", ""},
                                           {"calibrated", ""}}});
  recorder.sample(
      stream, 1s,
      std::vector<double>{4e-3, 4.2e-3, 0.2e-3, 4.2e-3, 10e-3, 0, 0.2e-3, 0, 1, 0, 0, 0.08, 0, 0});
  EXPECT_NE(ask(*viewer, R"({"do": "target", "place": [0, 0, -0.0041]})", R"("target")"), "")
      << "it lies, by a sensor that needs no eye";
}

TEST_F(LiveViewTest, AnOperatorWhoseBrowserIsGoneLosesControlAndNothingElseHappens) {
  auto gone = join();
  const auto other = join();
  EXPECT_NE(ask(*gone, R"({"do": "take"})", R"({"done":"take"})"), "");
  EXPECT_NE(ask(*other, R"({"do": "take"})", "another viewer has control"), "");
  gone.reset();
  EXPECT_NE(other->hear(R"("control":"free")").find(R"("control":"free")"), std::string::npos)
      << "the others see it";
  EXPECT_EQ(session.control.status().phase, RunPhase::running);
  EXPECT_EQ(session.control.tier(), StopTier::none);
  EXPECT_FALSE(session.targets.take());
  EXPECT_NE(ask(*other, R"({"do": "take"})", R"({"done":"take"})"), "");
}

// Else the page would go on showing the last set-points of a run that was stopped.
TEST_F(LiveViewTest, WhatWasReadBackAfterAStopIsShownAndStaysAtTheEnd) {
  const auto viewer = join();
  const int currents = recorder.add_stream({"currents", "set-points", {{"i1", "A"}, {"i2", "A"}}});
  recorder.sample(currents, 1s, std::vector<double>{1.27, -1.27});
  EXPECT_NE(viewer->hear(R"("rest":null)").find(R"("rest":null)"), std::string::npos);
  const int back = recorder.add_stream({kCoilReadBack, "read back", {{"i1", "A"}, {"i2", "A"}}});
  recorder.sample(back, 2s, std::vector<double>{0.01, std::nan("")});
  recorder.event(2s, kCoilRest, "coils 0.01 A, read back at 12:03:11.250");
  const std::string rest =
      R"("rest":{"amperes":[0.01,null],"t":2.0,"text":"coils 0.01 A, read back at 12:03:11.250"})";
  EXPECT_NE(viewer->hear(rest).find(rest), std::string::npos);
  view.end("stopped");
  const std::string last = viewer->hear(rest);
  EXPECT_NE(last.find(R"("ended":"stopped")"), std::string::npos) << last;
}

// The page's cursor, ruler and scale bar: by the model, and for who only looks on, too.
TEST_F(LiveViewTest, PositionsUnderPixelsAreToldToEveryViewerAndAreNullWhereNothingShows) {
  const auto viewer = join();
  const std::string told = ask(*viewer,
                               R"({"do": "where", "id": 7, "camera": "top_camera", "z": 0, )"
                               R"("points": [[691.5, 517.5], [1e7, 0]]})",
                               R"("where":[)");
  EXPECT_NE(told.find(R"("id":7)"), std::string::npos) << told;
  EXPECT_NE(told.find("null]"), std::string::npos) << told;
  EXPECT_NE(ask(*viewer, R"({"do": "where", "camera": "side_camera", "points": []})", "refused"),
            "");
  EXPECT_FALSE(session.targets.take()) << "to ask is not to aim";
}

TEST_F(LiveViewTest, WhoeverSeesItMayStopIt) {
  const auto first = join(), second = join();
  EXPECT_NE(ask(*first, R"({"do": "take"})", R"({"done":"take"})"), "");
  EXPECT_NE(ask(*second, R"({"do": "stop"})", R"({"done":"stop"})"), "");
  EXPECT_EQ(session.control.tier(), StopTier::stop);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::view
