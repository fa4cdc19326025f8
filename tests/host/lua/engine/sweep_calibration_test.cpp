// A sweep's plan in a laboratory whose calibration lies beside its runs and not beside the sweep's.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/engine/engine.h"
#include "host/trials/sweep_plan.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;

struct SweepCalibration : testing::Test {
  SweepCalibration() {
    write("rig.lua",
          "return { base = 'simulated', title = 'calibrated', "
          "calibrations = { installed = { file = 'it.json' } } }");
    write("believed.lua",
          "return { title = 'What is believed', needs = { 'coils' }, run = function(rig, _, run) "
          "run:result('delay', rig:model().command_delay, 's') end }");
    request.run.what.protocol_file = (folder.path() / "believed.lua").string();
    request.run.where.rig_file = (folder.path() / "rig.lua").string();
    request.run.where.out = (folder.path() / "swept").string();
    request.run.where.calibrated_in = (folder.path() / "runs").string();
  }
  void write(const fs::path& name, const std::string& text) const {
    fs::create_directories((folder.path() / name).parent_path());
    std::ofstream(folder.path() / name) << text;
  }
  void install(const std::string& delay) const {
    write("runs/calibrations/it.json",
          R"({"rig": "rig.lua", "values": {"model.coil_delay": {"value": )" + delay +
              R"(, "date": "2026-01-01", "devices": {}}}})");
  }
  /// What the only point of a plan states, run in a folder of the sweep's own.
  double believed(const PointPlan& plan) const {
    const nlohmann::json result =
        run_sweep_point(*engine, plan.head, plan.points.at(0).what, folder.path() / "swept/runs");
    EXPECT_EQ(result.at("outcome"), "completed") << result;
    return result.at("results").at(0).at("value");
  }

  TemporaryFolder folder;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  SweepRequest request;
};

TEST_F(SweepCalibration, IsInForceInItsRunsAndPartOfTheirKeys) {
  const PointPlan without = plan_sweep(*engine, request);
  install("0.123");
  const PointPlan with = plan_sweep(*engine, request);
  EXPECT_NE(without.points.at(0).key, with.points.at(0).key);
  EXPECT_NEAR(believed(with) - believed(without), 0, 1e-9)
      << "a plan without it finds what is installed when its run begins";
  request.run.where.calibrated_in.clear();
  EXPECT_GT(std::abs(believed(plan_sweep(*engine, request)) - believed(with)), 0.01);
}

TEST_F(SweepCalibration, ThatIsInstalledMeanwhileEndsTheSweep) {
  install("0.123");
  const PointPlan plan = plan_sweep(*engine, request);
  EXPECT_NO_THROW(check_unchanged(*engine, plan.head));
  install("0.124");
  try {
    check_unchanged(*engine, plan.head);
    FAIL() << "it would mix two calibrations in one table";
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()).find("a calibration was installed since"),
              std::string::npos)
        << error.what();
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
