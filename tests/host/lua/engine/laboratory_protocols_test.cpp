// Every protocol on the shipped laboratory's rig files: each passes its dry run, or says that it is
// for simulated rigs only.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/config.h"
#include "host/engine/rehearsal.h"
#include "host/lua/engine/engine.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <set>
#include <string>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

/// The laboratory as it is set up for a protocol: by the rig on which that runs by default.
std::string laboratory_for(const ProtocolDescription& protocol) {
  static const std::map<std::string, std::string> kSetUps{{"bare_sensor", "octomag_lab_focus"},
                                                          {"fundus_scanner", "octomag_lab_fundus"},
                                                          {"calibration", "octomag_lab_bench"}};
  const auto found = kSetUps.find(protocol.rig);
  return found == kSetUps.end() ? "octomag_lab" : found->second;
}

// track_sequence wants images, and select_colors a folder to train with; localize_spiral judges the
// ellipses in the images, which a dry run by poses has not.
const std::set<std::string> kWithoutDryRun{"track_sequence", "select_colors", "localize_spiral"};
const std::set<std::string> kSimulatedOnly{"gel_step", "push_discs", "track_in_eye",
                                           "track_occluded"};

std::vector<std::string> shipped_protocols() {
  std::vector<std::string> names;
  for (const auto& entry : fs::directory_iterator(VITREO_SOURCE_DIR "/protocols"))
    if (entry.path().extension() == ".lua") names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

class LaboratoryProtocols : public testing::TestWithParam<std::string> {};

TEST_P(LaboratoryProtocols, PassTheDryRunOrSayThatTheyAreForSimulatedRigs) {
  const auto engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
  const TemporaryFolder folder;
  RunRequest request;
  request.what.protocol_file = std::string(VITREO_SOURCE_DIR "/protocols/") + GetParam() + ".lua";
  const ProtocolDescription protocol = engine->describe(request.what.protocol_file);
  request.where.rig_file =
      std::string(VITREO_SOURCE_DIR "/scripts/rigs/") + laboratory_for(protocol) + ".lua";
  request.where.out = (folder.path() / "runs").string();
  EXPECT_EQ(protocol.simulated_only, kSimulatedOnly.contains(GetParam()));
  if (protocol.simulated_only) {
    EXPECT_THROW(preflight(*engine, request), ConfigError);
    return;
  }
  if (kWithoutDryRun.contains(GetParam())) return;
  PreflightLimits limits;
  limits.wall = 2;  // s: what is wrong with roles, travel and targets shows at the beginning
  const PreflightReport report = preflight(*engine, request, limits);
  EXPECT_TRUE(report.passed()) << (report.problems.empty() ? "" : report.problems.front());
}

INSTANTIATE_TEST_SUITE_P(Shipped, LaboratoryProtocols, testing::ValuesIn(shipped_protocols()),
                         [](const auto& made) { return made.param; });

}  // namespace
}  // namespace vitreo
