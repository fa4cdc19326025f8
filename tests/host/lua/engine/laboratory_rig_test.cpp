// Rigs with a real instrument: opened and run on a loopback address, without any simulator in
// reach of the script.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/time/error.h"
#include "host/engine/rehearsal.h"
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/runs/run_reader.h"
#include "tests/devices/links/real_end.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <atomic>
#include <fstream>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

/// A laboratory whose only real instrument is a teslameter on the loopback; `others` are lines of
/// the rig file.
struct LaboratoryRigTest : testing::Test {
  void write_rig(const std::string& others) {
    const std::string file = (folder.path() / "rig.lua").string();
    std::ofstream(file) << "return { title = 'one real instrument', field_probe = { driver = "
                           "'scpi_probe', address = '"
                        << wire.address() << "', question = 'MEAS?', axes = 3 }," << others << "}";
    request.where.rig_file = file;
  }
  void write_protocol(const std::string& body) {
    const std::string file = (folder.path() / "protocol.lua").string();
    std::ofstream(file) << "return { title = 'test', needs = { 'field_probe' }, run = "
                           "function(rig, p, run)\n"
                        << body << "\nend }";
    request.what.protocol_file = file;
    request.where.out = (folder.path() / "runs").string();
  }
  RunResult run(bool has_laboratory = false) {
    return run_protocol(*engine, request, listener, [&](const Recorder& recorder, OpenRig& rig) {
      EXPECT_EQ(rig.laboratory() != nullptr, has_laboratory);
      EXPECT_EQ(rig.rig().simulation != nullptr, has_laboratory);
      for (const Event& event : recorder.events()) events += event.kind + ":" + event.text + ";";
    });
  }

  TemporaryFolder folder;
  std::shared_ptr<BytePeer> meter = scpi_probe::make_emulator({.question = "MEAS?"}, [](Time) {
    return std::vector<double>{1e-3, 2e-3, 3e-3};
  });  // T
  /// Passes everything on, and notes it.
  struct Overheard final : BytePeer {
    explicit Overheard(BytePeer& its) : peer(its) {}
    void receive(std::span<const std::uint8_t> bytes, Time now) override {
      heard.append(bytes.begin(), bytes.end());
      peer.receive(bytes, now);
    }
    std::vector<TimedBytes> say(Time now) override {
      std::vector<TimedBytes> all = peer.say(now);
      if (stranger)
        for (TimedBytes& one : all) one.bytes = {'?', '\n'};
      for (const TimedBytes& one : all) said.append(one.bytes.begin(), one.bytes.end());
      return all;
    }
    Time next() const override { return peer.next(); }
    BytePeer& peer;
    std::string heard, said;
    std::atomic<bool> stranger{false};
  };
  Overheard overheard{*meter};
  RealEnd wire{overheard, open_tcp_end()};
  SilentListener listener;
  RunRequest request;
  std::string events;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
};

TEST_F(LaboratoryRigTest, HasNoSimulatorForAScript) {
  write_rig("");
  write_protocol(
      "assert(rig.simulation == nil, 'a laboratory cannot be redrawn')\n"
      "run:result('field', rig.field_probe:measure()[3], 'T')");
  const RunResult result = run();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  ASSERT_FALSE(result.results.empty());
  EXPECT_NEAR(result.results.front().value, 3e-3, 1e-4);
}

// Emulated coils beside it act on a world of their own, which is nobody's truth.
TEST_F(LaboratoryRigTest, RecordsNoTruthWhereOnlySomeInstrumentsAreSimulated) {
  write_rig("coils = {}, top_camera = { width_px = 64, height_px = 64 }, sample = {}");
  write_protocol(
      "assert(rig.simulation == nil)\n"
      "rig.sample:insert_robot { 0, 0, 0 }\n"
      "rig.top_camera:grab()\n");
  const RunResult result = run();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  const RunData data = read_run(result.folder);
  for (const Stream& stream : data.streams) EXPECT_NE(stream.info.name, "truth");
}

/// The rows of one role and event, as the text that passed.
std::string passed(const RunData& data, const std::string& role, const std::string& event) {
  std::string text;
  for (const LinkRow& row : data.links)
    if (row.role == role && row.event == event) text.append(row.bytes.begin(), row.bytes.end());
  return text;
}

TEST_F(LaboratoryRigTest, TracesTheBytesThatTheInstrumentItselfSaw) {
  write_rig("");
  write_protocol("for _ = 1, 3 do rig.field_probe:measure() end");
  request.how.trace_links = true;
  const RunResult result = run();
  ASSERT_EQ(result.outcome, Outcome::completed) << result.reason;
  const RunData data = read_run(result.folder);
  const auto seen = wire.look([&] { return std::pair(overheard.heard, overheard.said); });
  EXPECT_EQ(passed(data, "field_probe", "to"), seen.first);
  EXPECT_EQ(passed(data, "field_probe", "from"), seen.second);
  EXPECT_TRUE(seen.first.starts_with("*IDN?\n")) << "from the opening on, before the record began";
  EXPECT_EQ(data.links.front().event, "opened");
  EXPECT_EQ(data.links.front().address, wire.address());
  for (std::size_t i = 1; i < data.links.size(); ++i)
    EXPECT_LE(data.links[i - 1].time, data.links[i].time);
}

TEST_F(LaboratoryRigTest, TracesNothingUnlessItIsAskedTo) {
  write_rig("");
  write_protocol("rig.field_probe:measure()");
  const RunResult result = run();
  ASSERT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_TRUE(read_run(result.folder).links.empty());
}

/// Keeps the messages.
struct Messages final : ProgressListener {
  void progress(double, const std::string&) override {}
  void message(const std::string& line) override { lines.push_back(line); }
  std::vector<std::string> lines;
};

TEST_F(LaboratoryRigTest, ShowsTheTraceOfAnOpeningThatFailsForThereIsNoRecord) {
  overheard.stranger = true;
  write_rig("");
  write_protocol("");
  request.how.trace_links = true;
  Messages messages;
  EXPECT_THROW(run_protocol(*engine, request, messages, {}), DeviceError);
  std::string all;
  for (const std::string& line : messages.lines) all += line + "\n";
  EXPECT_NE(all.find("to      *IDN?\\x0A  2A 49 44 4E 3F 0A"), std::string::npos) << all;
}

TEST_F(LaboratoryRigTest, ACheckSaysThatItHasNotLookedWhetherTheInstrumentsAreThere) {
  write_rig(
      "calibrations = { field = { date = '2026-01-01', valid_days = 36500, devices = { "
      "field_probe = 'P001' } } }");
  write_protocol("");
  const PreflightReport report = preflight(*engine, request);
  const std::vector<std::string> gaps{
      "whether field_probe is there and answers (vitreo devices --rig " + request.where.rig_file +
          ")",
      "whether the calibrations are of these instruments"};
  EXPECT_EQ(report.not_looked_at, gaps);
  EXPECT_NE(to_text(report).find("not looked at: whether field_probe is there"), std::string::npos);
  EXPECT_EQ(to_json(report)["not_looked_at"].size(), 2U);
}

TEST_F(LaboratoryRigTest, RefusesSimulatedFaultsBeforeAnythingOpens) {
  write_rig("coils = {}");
  write_protocol("");
  request.how.faults = {"coils:silent"};
  try {
    run();
    FAIL() << "a fault of a real laboratory";
  } catch (const ConfigError& error) {
    EXPECT_NE(std::string(error.what()).find("field_probe"), std::string::npos) << error.what();
  }
}

TEST_F(LaboratoryRigTest, RehearsesTheBranchThatRuns) {
  write_rig("coils = {}");
  write_protocol(
      "run:note(rig.simulation and 'simulated' or 'real')\n"
      "assert(not rig.simulation, 'another branch')");
  const PreflightReport report = preflight(*engine, request);
  EXPECT_TRUE(report.passed()) << (report.problems.empty() ? "" : report.problems.front());
  EXPECT_TRUE(report.simulated);
  const RunResult result = run();
  EXPECT_EQ(result.outcome, Outcome::completed) << result.reason;
  EXPECT_NE(events.find("real"), std::string::npos) << events;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
