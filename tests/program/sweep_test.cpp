// `vitreo sweep` and `vitreo compare` as their users run them.
// SPDX-License-Identifier: Apache-2.0
#include "tests/program/program.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <chrono>
#include <csignal>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using namespace std::chrono_literals;

/// A protocol without optics: what it states depends on its parameters and on its seed.
constexpr const char* kQuick = R"(
-- Chance over a speed: a sweep's test.
local units = require "units"
local mm, s = units.mm, units.s
return {
  title = "Chance",
  needs = { "coils" },
  parameters = {
    speed = { unit = "mm/s", default = 1 * mm / s, min = 0.1 * mm / s, max = 2 * mm / s },
    law = { choices = { "pd", "estimator" }, default = "pd" },
    pause = { unit = "s", default = 0.1 * s, min = 0, max = 3600 * s },
    place = { unit = "mm", default = vector(0, 0, -1 * mm), min = -5 * mm, max = 5 * mm },
    band = { unit = "mm", range = true, default = { 0, 1 * mm } },
    gains = { default = { 1, 2 }, min = 0 },
    fails = { default = false },
  },
  run = function(rig, p, run)
    run:wait(p.pause)
    if p.fails and p.speed > 1 * mm / s then error("too quick, as it was asked", 0) end
    run:result("error", p.speed * (1 + math.random()), "m")
    run:result("height", p.place.z + p.band.max + p.gains[#p.gains] * mm, "m")
  end,
}
)";

class SweepProgram : public testing::Test {
 protected:
  SweepProgram() { place_.write("chance.lua", kQuick); }
  /// The table of a sweep's folder.
  std::string table(const std::string& folder) const { return place_.read(folder + "/sweep.csv"); }
  /// As the table has it: the shortest that reads back.
  static std::string number_text(double value) { return nlohmann::json(value).dump(); }
  static std::size_t lines(const std::string& text) {
    return static_cast<std::size_t>(std::count(text.begin(), text.end(), '\n'));
  }
  Workplace place_;
};

TEST_F(SweepProgram, APointIsTheRunThatTheSameWordsMakeByHand) {
  const Spoken swept =
      place_.vitreo("sweep chance.lua speed=0.3,1mm/s --rig fast --seed 5 --out swept --json");
  ASSERT_EQ(swept.exit_code, 0) << swept.out << swept.err;
  EXPECT_EQ(nlohmann::json::parse(swept.out)["outcomes"]["completed"], 2);
  const Spoken run = place_.vitreo("run chance.lua speed=1mm/s --rig fast --seed 6 --json");
  const double error = nlohmann::json::parse(run.out)["results"]["error"];
  EXPECT_NE(table("swept").find(",0.001,completed,0,," + number_text(error)), std::string::npos)
      << table("swept") << error;
  EXPECT_TRUE(fs::exists(place_.folder() / "swept/report.html"));
  const Spoken listed = place_.vitreo("runs --runs swept/runs --json");
  EXPECT_EQ(nlohmann::json::parse(listed.out).size(), 2U) << "each point is a normal run";
}

TEST_F(SweepProgram, FailedPointsAreRowsAndMakeTheExitCodeOne) {
  const Spoken swept = place_.vitreo(
      "sweep chance.lua speed=0.5..2mm/s:4 fails=true --repeat 2 --rig fast --out swept");
  EXPECT_EQ(swept.exit_code, 1) << swept.err;
  EXPECT_NE(swept.out.find("8 points: 4 completed, 4 failed"), std::string::npos) << swept.out;
  EXPECT_NE(table("swept").find("failed,1,\"too quick, as it was asked\""), std::string::npos)
      << table("swept");
  EXPECT_NE(place_.read("swept/report.html").find("too quick"), std::string::npos);
}

TEST_F(SweepProgram, ListsVectorsAndRangesCanBeSwept) {
  const Spoken swept = place_.vitreo(
      "sweep chance.lua place=0,0,-3mm..0,0,-1mm:2 band=0..1mm band=0..2mm gains=1,2 "
      "gains=1,2,5 --rig fast --out swept");
  ASSERT_EQ(swept.exit_code, 0) << swept.err;
  const std::string csv = table("swept");
  EXPECT_NE(csv.find("place_x (m),place_y (m),place_z (m),band_min (m),band_max (m),gains,"),
            std::string::npos)
      << csv;
  EXPECT_NE(csv.find(",0,0,-0.001,0,0.002,1 2 5,completed,"), std::string::npos) << csv;
  EXPECT_NE(csv.find("0.006"), std::string::npos) << "-1 mm + 2 mm + 5 mm\n" << csv;
}

TEST_F(SweepProgram, AParameterOfSeveralNumbersIsBoundedAndRecorded) {
  const Spoken run =
      place_.vitreo("run chance.lua place=1,0,-1mm band=0.5..2mm gains=3 --rig fast");
  ASSERT_EQ(run.exit_code, 0) << run.err;
  const Spoken shown = place_.vitreo("show last");
  EXPECT_NE(shown.out.find("1 mm, 0 mm, -1 mm"), std::string::npos) << shown.out;
  const auto refused = [this](const std::string& words) {
    return place_.vitreo("run chance.lua --rig fast " + words).err;
  };
  EXPECT_NE(refused("place=1,2mm").find("three numbers"), std::string::npos);
  EXPECT_NE(refused("place=0,0,9mm").find("got 9mm"), std::string::npos);
  EXPECT_NE(refused("place=1,2,3").find("has no unit: write"), std::string::npos);
  EXPECT_NE(refused("band=2..1mm").find("least first"), std::string::npos);
  EXPECT_NE(refused("band=1mm").find("wants a range, such as"), std::string::npos);
  EXPECT_NE(refused("gains=1,-2").find("at least 0"), std::string::npos);
}

TEST_F(SweepProgram, ADeclarationOfSeveralNumbersIsChecked) {
  const auto said = [this](const std::string& parameter) {
    place_.write("p.lua", "return { title = 'p', parameters = { a = " + parameter +
                              " }, run = function() end }");
    return place_.vitreo("describe ./p.lua").err;
  };
  EXPECT_EQ(said("{ default = { 1, 2 }, min = 0 }"), "");
  EXPECT_NE(said("{ default = {} }").find("a.default wants a number, several"), std::string::npos);
  EXPECT_NE(said("{ default = { 1, 'b' } }").find("a.default wants"), std::string::npos);
  EXPECT_NE(said("{ default = { 2, 1 }, range = true }").find("{least, most}"), std::string::npos);
  EXPECT_NE(said("{ default = 2, range = true }").find("a.range is only for"), std::string::npos);
  EXPECT_NE(said("{ default = { 1, 2 }, integer = true }").find("a.integer is only for numbers"),
            std::string::npos);
  EXPECT_NE(said("{ default = { 1, 5 }, max = 4 }").find("outside of its own range"),
            std::string::npos);
}

TEST_F(SweepProgram, WhatIsWrongIsSaidBeforeAnythingIsMade) {
  const auto refused = [this](const std::string& words) {
    const Spoken said = place_.vitreo("sweep " + words);
    EXPECT_EQ(said.exit_code, 2) << words << said.out;
    return said.err;
  };
  EXPECT_NE(refused("chance.lua speed=0.1..3mm/s:5").find("got 3mm/s"), std::string::npos);
  EXPECT_NE(refused("chance.lua speed=0.1..2mm/s:1000 --repeat 1000").find("1000000 points"),
            std::string::npos);
  EXPECT_NE(refused("chance.lua --random 3 --latin 3").find("two ways"), std::string::npos);
  EXPECT_NE(refused("--resume nothing").find("is no sweep"), std::string::npos);
  EXPECT_NE(refused("chance.lua speed=1mm/s --slurm --out s").find("--slurm"), std::string::npos);
  EXPECT_NE(refused("chance.lua --rig octomag_lab --jobs 2 --out r").find("real instruments"),
            std::string::npos);
  EXPECT_FALSE(fs::exists(place_.folder() / "r"));
}

TEST_F(SweepProgram, AProtocolThatHasChangedIsNotGoneOnWith) {
  ASSERT_EQ(place_.vitreo("sweep chance.lua --rig fast --out swept").exit_code, 0);
  EXPECT_EQ(place_.vitreo("sweep --resume swept").exit_code, 0) << "nothing is left to do";
  place_.write("chance.lua", std::string(kQuick) + "\n");
  const Spoken said = place_.vitreo("sweep --resume swept");
  EXPECT_EQ(said.exit_code, 2);
  EXPECT_NE(said.err.find("has changed since the sweep began"), std::string::npos) << said.err;
}

TEST_F(SweepProgram, ComparePutsRunsOfASweepSideBySide) {
  ASSERT_EQ(place_.vitreo("sweep chance.lua speed=0.3,1mm/s --rig fast --out swept").exit_code, 0);
  std::string names;
  for (const auto& entry : fs::directory_iterator(place_.folder() / "swept/runs"))
    names += " " + entry.path().filename().string();
  const Spoken said = place_.vitreo("compare" + names + " --runs swept/runs");
  ASSERT_EQ(said.exit_code, 0) << said.err;
  EXPECT_NE(said.out.find("speed"), std::string::npos) << said.out;
  EXPECT_NE(said.out.find("error (mm)"), std::string::npos) << said.out;
  EXPECT_NE(place_.read("comparison.html").find("What differs"), std::string::npos);
  const Spoken json = place_.vitreo("compare" + names + " --runs swept/runs --json");
  EXPECT_TRUE(nlohmann::json::parse(json.out)["differing"].contains("speed")) << json.out;
  EXPECT_EQ(place_.vitreo("compare last --runs swept/runs").exit_code, 2);
}

/// Programs of Slurm's names: jobs that never begin, and a scheduler that does not answer.
std::string deaf_scheduler(const Workplace& place) {
  const fs::path folder = place.folder() / "bin";
  fs::create_directory(folder);
  place.write("bin/sbatch", "#!/bin/sh\necho 4711\n");
  place.write("bin/squeue", "#!/bin/sh\nexec sleep 600\n");
  for (const char* const name : {"sbatch", "squeue"})
    fs::permissions(folder / name, fs::perms::owner_all);
  return "cd '" + place.folder().string() + "' && PATH='" + folder.string() +
         "':\"$PATH\" XDG_RUNTIME_DIR='" + place.folder().string() + "' ";
}

TEST_F(SweepProgram, HandedToASchedulerItEndsWellAndSaysHowToCollect) {
  const std::string command = deaf_scheduler(place_) +
                              "'" VITREO_PROGRAM
                              "' sweep chance.lua --rig fast --slurm --detach --out swept >out";
  EXPECT_EQ(WEXITSTATUS(std::system(command.c_str())), 0);
  EXPECT_NE(place_.read("out").find("1 are with Slurm, and collected by: vitreo sweep --resume"),
            std::string::npos)
      << place_.read("out");
}

TEST_F(SweepProgram, AStopIsFeltWhileTheSchedulerDoesNotAnswer) {
  // Asked after three seconds, squeue never answers; the stop comes after five.
  const std::string command = deaf_scheduler(place_) +
                              "timeout -k 20 -s INT 5 '" VITREO_PROGRAM
                              "' sweep chance.lua --rig fast --slurm --out swept >out 2>err; "
                              "echo $? >code";
  const auto began = std::chrono::steady_clock::now();
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_LT(std::chrono::steady_clock::now() - began, 15s);
  // timeout(1) answers 124 for a program that it had to stop, whatever its own code was.
  EXPECT_EQ(place_.read("code"), "124\n");
  EXPECT_NE(place_.read("err").find("the job goes on without this program; scancel 4711"),
            std::string::npos)
      << place_.read("err");
}

TEST_F(SweepProgram, OnAFullDiskItSaysSoAndLosesNothing) {
  if (std::system("unshare -rm true 2>/dev/null") != 0)
    GTEST_SKIP() << "this machine lets no user mount a small disk";
  // A disk of 500 MB, of which 220 MB are left: less than the recorder begins with.
  place_.write("steps.sh",
               "set -u\nmkdir disk && mount -t tmpfs -o size=500m tmpfs disk || exit 9\n"
               "dd if=/dev/zero of=disk/filler bs=1M count=280 2>/dev/null\n"
               "sweep='sweep chance.lua speed=0.1..2mm/s:4 --rig fast --out disk/swept'\n"
               "'" VITREO_PROGRAM
               "' $sweep >full.out 2>full.err; echo $? >full.code\n"
               "rm disk/filler\n"
               "'" VITREO_PROGRAM
               "' sweep --resume disk/swept >/dev/null 2>later.err\n"
               "echo $? >later.code; cp disk/swept/sweep.csv later.csv\n");
  const std::string command = "cd '" + place_.folder().string() +
                              "' && VITREO_LOG=host.log XDG_RUNTIME_DIR=. unshare -rm sh steps.sh";
  ASSERT_EQ(std::system(command.c_str()), 0);
  EXPECT_EQ(place_.read("full.code"), "5\n");
  EXPECT_NE(place_.read("full.err").find("the disk is full"), std::string::npos)
      << place_.read("full.err");
  EXPECT_NE(place_.read("full.err").find("--resume goes on"), std::string::npos);
  EXPECT_EQ(place_.read("later.code"), "0\n") << place_.read("later.err");
  EXPECT_EQ(lines(place_.read("later.csv")), 5U);
}

/// The program in the background, in a process of its own.
pid_t start(const fs::path& folder, const std::string& words) {
  const pid_t process = fork();
  if (process != 0) return process;
  const std::string command = "cd '" + folder.string() + "' && XDG_RUNTIME_DIR='" +
                              folder.string() + "' VITREO_LOG=host.log exec '" VITREO_PROGRAM "' " +
                              words + " >out2 2>err2";
  execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
  _exit(127);
}

std::size_t marks_in(const fs::path& folder) {
  std::size_t count = 0;
  std::error_code none;
  for (const auto& entry : fs::recursive_directory_iterator(folder / "done", none))
    count += entry.path().extension() == ".json";
  return count;
}

TEST_F(SweepProgram, KilledAgainAndAgainItsTableIsThatOfASweepThatWasLeftAlone) {
  const std::string words = "sweep chance.lua speed=0.1..2mm/s:10 law=pd,estimator --rig fast ";
  ASSERT_EQ(place_.vitreo(words + "--jobs 1 --out alone").exit_code, 0);
  std::size_t done = 0;
  for (int kill_number = 0; kill_number < 3; ++kill_number) {
    const pid_t process =
        start(place_.folder(), kill_number == 0 ? words + "--jobs 2 --out killed"
                                                : "sweep --resume killed --jobs 2");
    const auto until = std::chrono::steady_clock::now() + 60s;
    while (marks_in(place_.folder() / "killed") < done + 4 &&
           std::chrono::steady_clock::now() < until)
      std::this_thread::sleep_for(5ms);
    ::kill(process, SIGKILL);
    waitpid(process, nullptr, 0);
    done = marks_in(place_.folder() / "killed");
    EXPECT_LT(done, 20U) << "it must be killed half-way";
  }
  const Spoken resumed = place_.vitreo("sweep --resume killed");
  EXPECT_EQ(resumed.exit_code, 0) << resumed.err;
  EXPECT_EQ(table("killed"), table("alone"));
  EXPECT_EQ(place_.read("killed/sweep.sqlite"), place_.read("alone/sweep.sqlite"));
  EXPECT_EQ(lines(table("killed")), 21U);
}

TEST_F(SweepProgram, StoppedItEndsItsRunsInOrderAndGoesOnLater) {
  const pid_t process = start(place_.folder(),
                              "sweep chance.lua speed=0.1..2mm/s:4 pause=3000s --rig fast --jobs 2 "
                              "--out swept");
  for (int i = 0; i < 2000 && !fs::exists(place_.folder() / "swept/claims"); ++i)
    std::this_thread::sleep_for(5ms);
  ::kill(process, SIGINT);
  int status = 0;
  waitpid(process, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_TRUE(WEXITSTATUS(status) == 3 || WEXITSTATUS(status) == 0) << place_.read("err2");
  EXPECT_EQ(place_.vitreo("sweep --resume swept").exit_code, 0);
  EXPECT_EQ(lines(table("swept")), 5U);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
