// An amplifier whose driver is a Lua file: the guardian has the bytes of its rescue alone.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/safety/guardian/guardian_bench.h"

#include <csignal>
#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kFile = R"lua(
return {
  title = "An amplifier", kind = "coils", channels = 1, current_limit = 2, unit = "A",
  link = { baud_rate = 9600, terminator = "\n", timeout = 0.5 }, identity = "*IDN?",
  setup = { "SYST:REM 1", "FUNC:MODE CURR", "CURR 0", "OUTP ON" },
  make_safe = { "CURR 0", "OUTP OFF" },
  set_currents = function(io, currents) io:send(("CURR %.4f;:OUTP ON"):format(currents[1])) end,
  measured_currents = function(io) return { tonumber(io:ask("MEAS:CURR?")) } end,
  rescue = { identify = { "*IDN?", "KEPCO" }, send = { "CURR 0", "OUTP OFF" }, check = { "OUTP?", "0" } },
}
)lua";

/// A BOP by such a file, which stands beside the rig's.
struct Scripted : Kepco {
  explicit Scripted(const std::filesystem::path& folder) {
    std::ofstream(folder / "bench_amplifier.lua") << kFile;
  }
  std::string rig() const override {
    return "coils = { driver = \"bench_amplifier\", address = \"" + end.address() + "\" }";
  }
};

TEST_F(GuardianTest, ZeroesAnAmplifierOfALuaFileWhenTheHostIsKilled) {
  Scripted amplifier(folder);
  trials_of(amplifier, "Lua file", SIGKILL);
}

TEST_F(GuardianTest, ZeroesAnAmplifierOfALuaFileWhenTheHostIsFrozenAndThenThawed) {
  Scripted amplifier(folder);
  trials_of(amplifier, "Lua file", SIGSTOP);
}

TEST_F(GuardianTest, IsMissedWhileACurrentOfALuaFileIsHeld) {
  Scripted amplifier(folder);
  const std::unique_ptr<Host> host = energize(amplifier, kHeld);
  ASSERT_NE(host, nullptr);
  host->signal_guardian(SIGKILL);
  const auto zero = time_until(20s, [&] { return amplifier.output() < 1e-3; });
  ASSERT_TRUE(zero) << log();
  std::printf("at zero after %.0f ms\n", zero->count());
  EXPECT_TRUE(guardian_says("the process that guards the outputs is gone")) << log();
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
