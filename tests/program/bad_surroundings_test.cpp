// The program in bad surroundings: odd words, closed streams, no home, small limits, other locales.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr const char* kIdle =
    "return { title = 'idle', run = function(rig, p, run) run:wait(1) print(1.5) "
    "run:result('half', 0.5) end }";
constexpr const char* kBareRig = "return { title = 'bare' }";

struct Surroundings : testing::Test {
  Surroundings() {
    place.write("idle.lua", kIdle);
    place.write("bare.lua", kBareRig);
  }
  /// A shell's line; PROGRAM stands for the program, RUN for a run that is in order.
  int shell(std::string line) const {
    const auto replace = [&](const std::string& what, const std::string& with) {
      for (std::size_t at; (at = line.find(what)) != std::string::npos;)
        line.replace(at, what.size(), with);
    };
    replace("RUN", "PROGRAM run idle.lua --rig bare.lua");
    replace("PROGRAM", "'" VITREO_PROGRAM "'");
    const int status = std::system(("cd '" + place.folder().string() + "' && " + line).c_str());
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  Workplace place;
};

TEST_F(Surroundings, WordsThatAreNotUnderstoodAreExitCode2) {
  EXPECT_EQ(place.vitreo("run idle.lua --rig bare.lua --no-such-flag").exit_code, 2);
  EXPECT_EQ(place.vitreo("run idle.lua --rig").exit_code, 2);
  EXPECT_EQ(place.vitreo("run idle.lua --rig bare.lua --seed").exit_code, 2);
  EXPECT_EQ(place.vitreo("run idle.lua --rig bare.lua --seed twelve").exit_code, 2);
  EXPECT_EQ(place.vitreo("run").exit_code, 2);
  std::string many = "run idle.lua --rig bare.lua";
  for (int i = 0; i < 1000; ++i) many += " --flag" + std::to_string(i);
  EXPECT_EQ(place.vitreo(many).exit_code, 2);
  EXPECT_EQ(place.vitreo("run --rig bare.lua -- idle.lua").exit_code, 0);
}

TEST_F(Surroundings, ClosedStreamsChangeNothingButWhatIsSeen) {
  EXPECT_EQ(shell("RUN <&- >/dev/null 2>/dev/null"), 0);
  EXPECT_EQ(shell("RUN >&- 2>/dev/null"), 0);
  EXPECT_EQ(shell("RUN 2>&- >/dev/null"), 0);
  EXPECT_EQ(shell("(RUN; echo $? > code) 2>/dev/null | true; grep -qx '0' code"), 0)
      << "a reader that is gone";
}

TEST_F(Surroundings, WithoutAHomeOrWithOneThatCannotBeWrittenItRunsAndSaysWhatIsMissing) {
  EXPECT_EQ(shell("env -u HOME -u XDG_STATE_HOME -u VITREO_LOG RUN >/dev/null 2>&1"), 0);
  EXPECT_EQ(shell("VITREO_LOG=/proc/nowhere/host.log RUN >/dev/null 2>err"), 0);
  EXPECT_NE(place.read("err").find("no log"), std::string::npos) << place.read("err");
}

TEST_F(Surroundings, OtherLocalesZonesMasksAndNarrowTerminalsDoNotMatter) {
  EXPECT_EQ(shell("LANG=tr_TR.UTF-8 LC_ALL=de_DE.UTF-8 TZ=Pacific/Chatham COLUMNS=20 RUN --json "
                  ">out 2>/dev/null"),
            0);
  EXPECT_NE(place.read("out").find("\"half\":0.5"), std::string::npos) << place.read("out");
  EXPECT_EQ(shell("TZ=Nowhere/At_all RUN >/dev/null 2>&1"), 0);
  EXPECT_EQ(shell("(umask 0; RUN >/dev/null 2>&1)"), 0);
}

TEST_F(Surroundings, TooFewFilesAreSaidInAWordNotInACrash) {
  const int code = shell("(ulimit -n 16; RUN >/dev/null 2>err)");
  EXPECT_TRUE(code >= 0 && code < 8) << code;
  const bool explained = code == 0 || place.read("err").find("vitreo: ") != std::string::npos;
  EXPECT_TRUE(explained) << place.read("err");
}

TEST_F(Surroundings, TheHostLogKeepsWhatMattersOnOneLineEach) {
  EXPECT_EQ(shell("VITREO_LOG=here/host.log RUN >/dev/null 2>&1"), 0);
  EXPECT_EQ(shell("VITREO_LOG=here/host.log PROGRAM run nowhere.lua >/dev/null 2>&1"), 2);
  const std::string log = place.read("here/host.log");
  EXPECT_NE(log.find("begun by"), std::string::npos) << log;
  EXPECT_NE(log.find("completed"), std::string::npos) << log;
  EXPECT_NE(log.find("nowhere.lua"), std::string::npos) << log;
}

TEST_F(Surroundings, CheckSaysByItsExitCodeWhetherARunWouldBeLet) {
  const Spoken passed = place.vitreo("check idle.lua --rig bare.lua");
  EXPECT_EQ(passed.exit_code, 0);
  EXPECT_EQ(passed.out.find("not looked at"), std::string::npos) << "all of it is simulated";
  place.write("lab.lua",
              "return { stage = { driver = 'sutter_mp285', address = 'serial:/dev/x' } }");
  const Spoken lab = place.vitreo("check idle.lua --rig lab.lua");
  EXPECT_EQ(lab.exit_code, 0);
  EXPECT_NE(lab.out.find("not looked at: whether stage is there and answers (vitreo devices --rig "
                         "lab.lua)\npassed\n"),
            std::string::npos)
      << lab.out;
  EXPECT_EQ(place.vitreo("check idle.lua --rig bare.lua speed=3").exit_code, 2);
  place.write("fails.lua", "return { title = 'f', run = function() error('no') end }");
  const Spoken failed = place.vitreo("check fails.lua --rig bare.lua --json");
  EXPECT_EQ(failed.exit_code, 8);
  EXPECT_NE(failed.out.find("\"passed\":false"), std::string::npos) << failed.out;
  EXPECT_NE(failed.out.find("fails.lua:1: no"), std::string::npos) << failed.out;
#ifndef __SANITIZE_THREAD__  // it keeps signals back until a call that blocks; this loop has none
  place.write("long.lua", "return { title = 'l', run = function() while true do end end }");
  const Spoken late = place.vitreo("check long.lua --rig bare.lua --limit 0.2 --json");
  EXPECT_EQ(late.exit_code, 0) << "it warns";
  EXPECT_NE(late.out.find("not fully simulated"), std::string::npos) << late.out;
#endif
  EXPECT_EQ(place.runs(), 0);
}

TEST_F(Surroundings, AnErrorOfMegabytesOrForTheTerminalIsShownShortAndHarmless) {
  place.write(
      "huge.lua",
      "return { title = 'h', run = function() error('\\27[31mred' .. ('x'):rep(3000000), 0) end }");
  const Spoken spoken = place.vitreo("run huge.lua --rig bare.lua");
  EXPECT_EQ(spoken.exit_code, 1);
  EXPECT_LT(spoken.out.size() + spoken.err.size(), 5000U);
  EXPECT_NE(spoken.out.find("failed: \\x1b[31mredxxx"), std::string::npos) << spoken.out;
  EXPECT_NE(spoken.out.find("(3000008 bytes)"), std::string::npos) << spoken.out;
  EXPECT_LT(place.vitreo("runs").out.size() + place.vitreo("show last").out.size(), 5000U);
}

TEST_F(Surroundings, APortInUseIsAWrongRequestAndLeavesNoFolder) {
  const int taken = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address = {};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(bind(taken, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  ASSERT_EQ(listen(taken, 1), 0);
  socklen_t size = sizeof address;
  getsockname(taken, reinterpret_cast<sockaddr*>(&address), &size);
  const std::string port = std::to_string(ntohs(address.sin_port));
  const Spoken said = place.vitreo("run hello_rig --view --view-port " + port);
  close(taken);
  EXPECT_EQ(said.exit_code, 2) << said.err;
  EXPECT_NE(said.err.find("cannot listen at 127.0.0.1:" + port), std::string::npos) << said.err;
  EXPECT_FALSE(std::filesystem::exists(place.folder() / "runs"));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
