// Preflight: the dry run on the rig's twin, its report on a script, and the right to override it.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/emulator.h"
#include "host/config/rights.h"
#include "host/engine/preparation.h"
#include "host/engine/rehearsal.h"
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/rig/registry.h"
#include "host/rig/rig_settings.h"
#include "host/terminal/line_editor.h"
#include "tests/devices/links/real_end.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <array>
#include <fstream>
#include <sstream>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kSimulated = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
constexpr const char* kLaboratory = VITREO_SOURCE_DIR "/scripts/rigs/octomag_lab.lua";

struct PreflightTest : testing::Test {
  std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(folder.path() / name) << text;
    return (folder.path() / name).string();
  }
  void script(const std::string& body, const std::string& parameters = "{}") {
    request.what.protocol_file =
        write("p.lua",
              "local units = require 'units'\nlocal s, mm, A = units.s, units.mm, units.A\n"
              "return { title = 'test', parameters = " +
                  parameters + ", run = function(rig, p, run)\n" + body + "\nend }");
    request.where.rig_file = request.where.rig_file.empty() ? kSimulated : request.where.rig_file;
    request.where.out = (folder.path() / "runs").string();
  }
  PreflightReport check(const std::string& body, double wall = 120) {
    script(body);
    return preflight(*engine, request, {wall, {}});
  }
  /// A laboratory of one real instrument: a teslameter's emulator at the far end of a real wire.
  void use_real_probe(const std::string& more = "") {
    request.where.rig_file = write(
        "lab.lua", "return { title = 'lab', field_probe = { driver = 'scpi_probe', address = '" +
                       end.address() + "' },\n" + more + " }");
  }
  std::string events_of_run() {
    std::ostringstream text;
    run_protocol(*engine, request, listener, [&](const Recorder& recorder, OpenRig&) {
      for (const Event& event : recorder.events()) text << event.kind << ":" << event.text << ";";
    });
    return text.str();
  }

  TemporaryFolder folder;
  SilentListener listener;
  RunRequest request;
  std::unique_ptr<BytePeer> emulator = scpi_probe::make_emulator({}, [](Time) {
    return std::vector<double>{0, 0, 0};
  });
  RealEnd end{*emulator, open_tcp_end()};
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
};

std::string all(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + ";";
  return text;
}

/// Its scripts never come back: as where a call into the host hangs.
struct StuckEngine : ScriptEngine {
  explicit StuckEngine(ScriptEngine& its_engine) : engine(its_engine) {}
  ProtocolDescription describe(const std::string& file) override { return engine.describe(file); }
  RigDescription load_rig(const std::string& file) override { return engine.load_rig(file); }
  RigDescription recorded_rig(const RigSource& rig, const std::vector<RigSource>& bases) override {
    return engine.recorded_rig(rig, bases);
  }
  void run(const ProtocolDescription&, const std::map<std::string, ArgumentValue>&,
           Session&) override {
    while (true) ::pause();
  }
  void prompt(Session&, LineEditor&, std::ostream&, std::ostream&) override {}
  void interrupt() noexcept override {}
  ScriptEngine& engine;
};

TEST_F(PreflightTest, AScriptThatIsStuckInACallEndsTheProcessAndSaysSo) {
  GTEST_FLAG_SET(death_test_style, "threadsafe");
  script("");
  StuckEngine stuck(*engine);
  EXPECT_EXIT(preflight(stuck, request, {0.2, {}}),
              testing::ExitedWithCode(static_cast<int>(ExitCode::preflight_failed)),
              "the script is stuck in a call that nothing can interrupt");
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "runs"));
}

TEST_F(PreflightTest, SaysWhatWouldBeMovedAndEnergizedAndHowLongAtLeast) {
  const PreflightReport report = check(
      "rig.coils:set_currents { 2, -2, 2, 2, 2, 2, 2, 3 }\nrun:wait(4*s)\n"
      "rig.coils:set_currents { 0, 0, 0, 0, 0, 0, 0, 0 "
      "}\nrig.lens_mover:move_to(1*mm)\nrig.lens_mover:move_to(-2*mm)");
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_TRUE(report.simulated);
  EXPECT_EQ(report.coils.peak.at(7), 3);
  EXPECT_EQ(report.coils.peak.at(1), 2);
  EXPECT_EQ(report.coils.peak_total, 17);
  EXPECT_NEAR(report.coils.energized, 4, 0.1) << "s";
  ASSERT_EQ(report.moves.size(), 1u);
  EXPECT_EQ(report.moves[0].role, "lens_mover");
  EXPECT_EQ(report.moves[0].moves, 2);
  EXPECT_EQ(report.moves[0].min, -2e-3);
  EXPECT_EQ(report.moves[0].max, 1e-3);
  EXPECT_GT(report.duration, 4.2) << "s: the wait and the moves";
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "runs")) << "it leaves nothing behind";
}

TEST_F(PreflightTest, FailsWhereTheScriptRunsIntoALimit) {
  const PreflightReport report = check("rig.coils:set_currents { 13, 0, 0, 0, 0, 0, 0, 0 }");
  EXPECT_FALSE(report.passed());
  EXPECT_NE(all(report.problems).find("13 A is beyond the limit of 12 A"), std::string::npos)
      << all(report.problems);
  EXPECT_NE(all(check("rig.lens_mover:move_to(90*mm)").problems).find("lens_mover"),
            std::string::npos);
}

TEST_F(PreflightTest, FailsWithTheScriptsLineWhereTheScriptFails) {
  const PreflightReport report = check("run:wait(1*s)\nerror('no')");
  EXPECT_NE(all(report.problems).find("p.lua:5: no"), std::string::npos) << all(report.problems);
}

TEST_F(PreflightTest, WarnsOnlyWhenItsWallTimeIsUp) {
#ifdef __SANITIZE_THREAD__
  GTEST_SKIP()
      << "the thread sanitizer keeps signals back until a call that blocks; this loop has none";
#endif
  const PreflightReport report =
      check("while true do pcall(function() while true do end end) end", 0.1);
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_FALSE(report.simulated);
  EXPECT_NE(all(report.warnings).find("not fully simulated"), std::string::npos)
      << all(report.warnings);
}

TEST_F(PreflightTest, TakesAnswersInAdvanceAndSaysWhichItAssumed) {
  request.what.answers = {"depth=3"};
  const PreflightReport report = check(
      "assert(run:ask('How deep?', { name = 'depth' }) == 3)\nassert(run:confirm('Is it in?'))\n"
      "assert(run:ask('Which?', { choices = { 'a', 'b' } }) == 'a')\nrun:pause() "
      "run:checkpoint('here')");
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_EQ(all(report.warnings).find("How deep?"), std::string::npos);
  EXPECT_NE(all(report.warnings).find("Is it in? (yes or no): yes"), std::string::npos)
      << all(report.warnings);
  EXPECT_NE(all(report.warnings).find("paused at the checkpoint 'here'"), std::string::npos)
      << all(report.warnings);
}

TEST_F(PreflightTest, PosesStandInForImagesOnTheTwinOfALaboratory) {
  request.where.rig_file = kLaboratory;
  const PreflightReport report = check(
      "local background = rig:learn_background { frames = 3 }\n"
      "local servo <close> = rig:servo { background = background }\nservo:hold({ 0, 0, 0 })\n"
      "rig.sample:insert_robot { 0, 0, 0 }\n"
      "servo:wait_until_tracked()\nservo:go_to({ 1*mm, 0, 0 }, { within = 1*mm })\n"
      "assert(rig.simulation == nil, 'a laboratory cannot be redrawn')");
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_TRUE(report.simulated);
  EXPECT_GT(report.coils.peak_total, 1) << "A";
  EXPECT_NE(all(check("rig:servo { feedback = 'pose_sensor' }").problems).find("pose_sensor"),
            std::string::npos)
      << "the rig itself has none";
  EXPECT_NE(all(check("rig:servo {}").problems).find("needs a background"), std::string::npos)
      << "poses would do without, the run would not";
}

// Supplies on eight ports, or on the network, in the place of octomag_lab's USB-3103.
struct LoopPreflightTest : PreflightTest {
  PreflightReport check_bops(int frame_rate, const std::string& port, const std::string& more) {
    std::string address;
    for (char i = '0'; i < '8'; ++i) address += (i == '0' ? "" : ", ") + port + i;
    request.where.rig_file = write(
        "bops.lua",
        "return { base = 'octomag_lab', top_camera = { frame_rate = " + std::to_string(frame_rate) +
            " * require('units').Hz },\ncoils = { driver = 'kepco_bop', address = '" + address +
            "', " + more + " } }");
    return check(
        "local background = rig:learn_background { frames = 3 }\n"
        "rig.sample:insert_robot { 0, 0, 0 }\n"
        "local servo <close> = rig:servo { background = background }\nservo:hold({ 0, 0, 0 })\n"
        "servo:wait_until_tracked()\nrun:wait(1*s)");
  }
};

TEST_F(LoopPreflightTest, RefusesALoopThatTheCoilsLinkCannotHoldAndNamesTheLink) {
  for (const int rate : {15, 30}) {
    const PreflightReport report = check_bops(rate, "serial:/dev/ttyS", "baud_rate = 9600");
    EXPECT_FALSE(report.passed());
    ASSERT_FALSE(report.problems.empty());
    const std::string& first = report.problems.front();
    EXPECT_EQ(first.find("coils: their link cannot hold a servo loop of " + std::to_string(rate)),
              0U)
        << all(report.problems);
    EXPECT_NE(first.find("9600 baud"), std::string::npos) << first;
    EXPECT_EQ(report.loop.limit, "coils");
    EXPECT_NE(all(report.warnings).find("not at max_slope"), std::string::npos)
        << all(report.warnings);
  }
}

TEST_F(LoopPreflightTest, LetsTheSameLoopPassAt115200BaudAndOnTheNetwork) {
  for (const int rate : {15, 30}) {
    const PreflightReport serial = check_bops(rate, "serial:/dev/ttyS", "baud_rate = 115200");
    EXPECT_TRUE(serial.passed()) << all(serial.problems);
    EXPECT_TRUE(serial.simulated);
    EXPECT_EQ(serial.loop.asked, rate);
    EXPECT_EQ(all(serial.warnings).find("not at max_slope"), std::string::npos)
        << all(serial.warnings);
    const PreflightReport network = check_bops(rate, "tcp:10.0.0.1:502", "");
    EXPECT_TRUE(network.passed()) << all(network.problems);
    EXPECT_TRUE(network.simulated);
  }
}

TEST_F(LoopPreflightTest, ASlowLinkWithoutALoopIsNoReason) {
  request.where.rig_file =
      write("slow.lua",
            "return { base = 'simulated', coils = { driver = 'kepco_bop', baud_rate = 9600 } }");
  const PreflightReport report = check("rig.coils:set_currents { 2, 0, 0, 0, 0, 0, 0, 0 }");
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_NE(to_text(report).find("servo loop: the links hold 14"), std::string::npos)
      << to_text(report);
}

TEST_F(LoopPreflightTest, APoseSensorOf200HzIsBeyondAUsb3103) {
  const std::string body = "local servo <close> = rig:servo { feedback = 'pose_sensor' }";
  request.where.rig_file =
      write("fast.lua", "return { base = 'fast', coils = { transfer_interval = false } }");
  EXPECT_NE(all(check(body).problems).find("coils: their link cannot hold a servo loop of 200 Hz"),
            std::string::npos);
  request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/fast.lua";
  const PreflightReport ideal = check(body);
  EXPECT_TRUE(ideal.passed()) << all(ideal.problems);
}

TEST_F(PreflightTest, AnOperatorsEyeIsRehearsedByPosesTooAndLetsGoAsItWill) {
  request.where.rig_file = kLaboratory;
  const PreflightReport report = check(
      "local background = rig:learn_background { frames = 2 }\n"
      "local servo <close> = rig:servo { background = background, feedback = 'none' "
      "}\nservo:hold({ 0, 0, 0 })\n"
      "rig.sample:insert_robot { 0, 0, 0 }\n"
      "servo:wait_until_tracked()\nrun:wait(1*s)\nservo:release()\nrun:wait(0.5*s)\n"
      "local before = rig.coils:currents()\nrun:wait(1*s)\n"
      "for i, current in ipairs(rig.coils:currents()) do assert(current == before[i], 'released: "
      "constant currents') "
      "end\n"
      "local seen = run:samples('servo', { 'x', 'y', 'z', 'u_px', 'v_px', 'semi_major_px', "
      "'semi_minor_px' })\n"
      "local function last(name) return seen[name][#seen[name]] end\n"
      "local place = vector(last 'x', last 'y', last 'z') - rig:model().eye_in_world\n"
      "local shown = assert(rig:view():ellipse { body = rig:model().robot, position = place, axis "
      "= "
      "{ 1, 0, 0 } })\n"
      "for name, value in pairs { u = last 'u_px', v = last 'v_px', semi_major = last "
      "'semi_major_px', semi_minor = last 'semi_minor_px' } do\n"
      "  assert(math.abs(value - shown[name]) < 0.5, name .. ' of the believed outline')\n"
      "end");
  EXPECT_TRUE(report.passed()) << all(report.problems);
  EXPECT_TRUE(report.simulated);
}

TEST_F(PreflightTest, TheTwinOfALaboratoryHasNoRealInstrument) {
  const RigDescription rig = engine->load_rig(kLaboratory);
  ASSERT_TRUE(has_real_instruments(rig));
  EXPECT_FALSE(has_real_instruments(twin_of(rig)));
  EXPECT_EQ(check_rig(twin_of(rig)).size(), check_rig(rig).size() + 1)
      << "every role, and a pose sensor";
}

TEST_F(PreflightTest, CountsTheDiskThatFramesAndSamplesWant) {
  const PreflightReport report =
      check("run:record_frames('top_camera', { every = 2 })\nrun:wait(10*s)");
  EXPECT_EQ(report.frame_bytes_per_second, 1384 * 1036 * 15 / 2.0);
  EXPECT_NEAR(report.disk_bytes, report.frame_bytes_per_second * report.duration,
              0.1 * report.frame_bytes_per_second * report.duration);
  EXPECT_NE(all(check("run:record_frames('no_camera')").problems).find("no_camera"),
            std::string::npos);
}

TEST_F(PreflightTest, OnASimulatedRigARunOnlyChecksArgumentsAndLimits) {
  script("error('no')");
  EXPECT_EQ(run_protocol(*engine, request, listener).outcome, Outcome::failed) << "it ran";
  request.what.arguments = {"speed=3"};
  EXPECT_THROW(run_protocol(*engine, request, listener), ConfigError);
}

TEST_F(PreflightTest, ARunOnALaboratoryRigIsRefusedBeforeAnythingIsOpenedWhenItFails) {
  request.where.rig_file =
      kLaboratory;  // none of its instruments is here: opening one would be a DeviceError
  script("rig.coils:set_currents { 13, 0, 0, 0, 0, 0, 0, 0 }");
  EXPECT_THROW(run_protocol(*engine, request, listener), PreflightError);
  EXPECT_FALSE(std::filesystem::exists(folder.path() / "runs"));
}

TEST_F(PreflightTest, TwoRolesOnOnePortAreRefused) {
  request.where.rig_file =
      write("twice.lua",
            "return { joystick = { driver = 'spacemouse', address = 'hid:256f:c635' },\n"
            "pedal = { driver = 'foot_pedal', address = 'hid:256f:c635' } }");
  script("");
  try {
    check_request(*engine, request);
    FAIL();
  } catch (const ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find("pedal.address is that of joystick already"),
              std::string::npos)
        << error.what();
  }
}

TEST_F(PreflightTest, AResearcherMayOverrideItAndThatIsRecorded) {
  use_real_probe("rights = { anna = 'researcher', others = 'technician' }");
  script("error('no')");
  request.how.operator_name = "anna";
  EXPECT_THROW(run_protocol(*engine, request, listener), PreflightError);
  request.how.override_reason = "the script is being written";
  const std::string events = events_of_run();
  EXPECT_NE(events.find("override:the preflight failed: "), std::string::npos) << events;
  EXPECT_NE(events.find("by anna (the script is being written)"), std::string::npos) << events;
  request.how.operator_name = "ben";
  EXPECT_THROW(run_protocol(*engine, request, listener), RightError);
}

TEST_F(PreflightTest, WhatItFoundIsInTheRecordOfARunThatGoesOn) {
  use_real_probe();
  script("run:confirm('Is it in?')");
  request.what.answers = {"yes"};
  const std::string events = events_of_run();
  EXPECT_NE(events.find("preflight:{"), std::string::npos) << events;
  EXPECT_NE(events.find("\"fully_simulated\":true"), std::string::npos) << events;
}

TEST_F(PreflightTest, ATechnicianHasNoPrompt) {
  use_real_probe("rights = { anna = 'researcher' }");
  request.where.out = (folder.path() / "runs").string();
  request.how.operator_name = "ben";
  std::istringstream in;
  std::ostringstream out;
  EXPECT_THROW(run_prompt(*engine, request, listener, *stream_lines(in, out, false), out, out),
               RightError);
  request.how.operator_name = "anna";
  EXPECT_EQ(run_prompt(*engine, request, listener, *stream_lines(in, out, false), out, out).outcome,
            Outcome::completed);
}

TEST_F(PreflightTest, AStaleCalibrationIsWarnedAboutOrRefusedAsTheRigSays) {
  const std::string old = "calibrations = { field = { date = '2001-01-01' }, when_stale = ";
  script("run:note('ran')");
  use_real_probe(old + "'warn' }");
  const std::string events = events_of_run();
  EXPECT_NE(events.find("alarm:low: calibration: the calibration 'field' is of 2001-01-01"),
            std::string::npos)
      << events;
  use_real_probe(old + "'refuse' }");
  EXPECT_THROW(run_protocol(*engine, request, listener), PreflightError);
  use_real_probe(
      "calibrations = { when_stale = 'refuse', field = { date = '2001-01-01', valid_days = 36500, "
      "devices = { "
      "field_probe = 'SN-7' } } }");
  EXPECT_THROW(run_protocol(*engine, request, listener), PreflightError)
      << "made with another probe";
  request.how.override_reason = "the probe was only repaired";
  EXPECT_NE(
      events_of_run().find("override:the calibration 'field' was made with field_probe = 'SN-7'"),
      std::string::npos);
}

// Which frames are kept.

/// 64x48 at 10 Hz, with a clock of its own that began at another time.
class SmallCamera : public Camera {
 public:
  explicit SmallCamera(Clock& clock) : clock_(clock) {}
  const CameraInfo& info() const override { return info_; }
  Frame grab(Time) override {
    clock_.sleep_for(from_seconds(info_.frame_period));
    cv::Mat image(info_.height_px, info_.width_px, CV_8UC1, cv::Scalar(9));
    return {image, ++number_, clock_.now(), clock_.now(), clock_.now() - from_seconds(7)};
  }

 private:
  Clock& clock_;
  CameraInfo info_{"small camera", 64, 48, 0.1, 1e-5};
  std::uint64_t number_ = 0;
};

struct KeptFrames : testing::Test {
  static Rig rig_with(Camera& camera) {
    Rig rig;
    rig.top_camera = &camera;
    return rig;
  }
  void grab(int count) {
    for (int i = 0; i < count; ++i) rig.top_camera->grab(from_seconds(1));
  }
  std::vector<std::uint64_t> kept(const std::string& of) {
    std::vector<std::uint64_t> numbers;
    for (const FrameRow& row : recorder.frames())
      if (row.camera == of) numbers.push_back(row.number);
    return numbers;
  }
  TemporaryFolder folder;
  std::unique_ptr<Clock> clock = virtual_clock();
  SmallCamera camera{*clock};
  Rig rig = rig_with(camera);
  Recorder recorder{folder.path(), start_of_test(1)};
  FrameRecording frames{*clock, rig, recorder};
};

TEST_F(KeptFrames, AroundEventsAreThoseBeforeAndAfterAndNoOthers) {
  frames.start({"top_camera", 1, 0, 1.0});
  grab(50);
  recorder.event(clock->now(), "note", "nothing that matters");
  grab(10);
  recorder.event(clock->now(), "keep", "something happened");  // after frame 60
  grab(50);
  const auto numbers = kept("top_camera");
  ASSERT_FALSE(numbers.empty());
  EXPECT_EQ(numbers.front(), 50u) << "1 s before";
  EXPECT_EQ(numbers.back(), 71u) << "1 s after";
  EXPECT_EQ(numbers.size(), 22u) << "each of them";
}

TEST_F(KeptFrames, AWindowFollowsTheRobotAndAWholeFrameComesEachSecond) {
  const int servo = recorder.add_stream({"servo", "test", {{"u_px", ""}, {"v_px", ""}}});
  frames.start({"top_camera", 1, 16, 0});
  recorder.sample(servo, clock->now(), std::array{30.0, 20.0});
  grab(10);
  recorder.sample(servo, clock->now(), std::array{1.0, 47.0});  // in a corner
  grab(10);
  EXPECT_EQ(kept("top_camera").size(), 2u);
  EXPECT_EQ(kept("top_camera_window").size(), 20u);
  for (const FrameRow& row : recorder.frames())
    EXPECT_EQ(row.width_px * row.height_px, row.camera == "top_camera_window" ? 16 * 16 : 64 * 48);
  const Stream& corners = *recorder.stream("top_camera_window");
  EXPECT_EQ(corners.at(0, 1), 22);
  EXPECT_EQ(corners.at(0, 2), 12);
  EXPECT_EQ(corners.at(19, 1), 0);
  EXPECT_EQ(corners.at(19, 2), 32);
  EXPECT_THROW(frames.check({"side_camera"}), std::invalid_argument);
}

TEST_F(KeptFrames, TheInstrumentsClockIsMappedToTheHosts) {
  grab(35);
  const Stream* const offsets = recorder.stream("top_camera_clock");
  ASSERT_NE(offsets, nullptr);
  EXPECT_GE(offsets->times.size(), 2u);
  EXPECT_NEAR(offsets->at(offsets->times.size() - 1, 0), 7, 1e-6) << "s";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
