// Rigs with a real instrument: opened and run on a loopback address, without any simulator in
// reach of the script.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/scpi_probe/emulator.h"
#include "host/engine/rehearsal.h"
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/runs/run_reader.h"
#include "tests/devices/links/real_end.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <fstream>

namespace vitreo {
namespace {

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
  RealEnd wire{*meter, open_tcp_end()};
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

}  // namespace
}  // namespace vitreo
