// The scripts with which the soak misbehaves: each does what its name says beside the protocol's
// own work, in the words that scripts have today. One that falls over its own words tests nothing.
// SPDX-License-Identifier: Apache-2.0
#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/trials/soak_script.h"
#include "tests/host/lua/engine/written_run.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>

namespace vitreo {
namespace VITREO_TEST_FILE {

// The reason of those that do not complete.
const std::map<std::string, std::string> kEndings{
    {"fails in a task", "nil"},
    {"defers what fails and waits", "late"},
    {"asks beyond the limits beside the loop", "interlock: coil 1: 99 A is beyond the limit"}};

struct MisbehavingScript : testing::TestWithParam<std::string> {};

TEST_P(MisbehavingScript, DoesItsWorkBesideWhatItDoesAmiss) {
  const TemporaryFolder folder;
  RunRequest request = written_run(folder.path(), VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua",
                                   "run:wait(0.5 * s) run:result('way', 1 * mm, 'mm')");
  std::ifstream file(request.what.protocol_file);
  const std::string text(std::istreambuf_iterator<char>(file), {});
  std::ofstream(request.what.protocol_file) << misbehaving(text, GetParam());
  SilentListener listener;
  const RunResult result =
      run_protocol(*make_lua_engine({VITREO_SOURCE_DIR "/scripts"}), request, listener, nullptr);
  EXPECT_EQ(std::count_if(result.results.begin(), result.results.end(),
                          [](const StatedResult& one) { return one.name == "way"; }),
            1)
      << result.reason;
  const auto amiss = kEndings.find(GetParam());
  EXPECT_EQ(result.outcome == Outcome::completed, amiss == kEndings.end()) << result.reason;
  if (amiss != kEndings.end()) {
    EXPECT_NE(result.reason.find(amiss->second), std::string::npos) << result.reason;
  }
}

std::string as_words(const testing::TestParamInfo<std::string>& one) {
  std::string name = one.param;
  for (char& letter : name)
    if (letter == ' ') letter = '_';
  return name;
}

INSTANTIATE_TEST_SUITE_P(OfTheSoak, MisbehavingScript, testing::ValuesIn(misbehaviors()), as_words);

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
