// Alarms, rights, the age of calibrations, and the space on the disk.
// SPDX-License-Identifier: Apache-2.0
#include "host/config/rights.h"
#include "host/engine/disk_need.h"
#include "host/engine/installed_calibration.h"
#include "host/files/log.h"
#include "host/rig/calibrations.h"
#include "host/session/alarms.h"
#include "host/session/clock_map.h"
#include "host/session/remaining_time.h"
#include "host/terminal/line_editor.h"
#include "host/terminal/progress_line.h"
#include "host/text/terminal_text.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <latch>
#include <optional>
#include <sstream>
#include <stdlib.h>
#include <thread>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

RigDescription rig_with(const std::string& key, ConfigTable table) {
  RigDescription rig;
  rig.file = "rig.lua";
  rig.table["coils"].value = ConfigTable{};
  rig.table[key].value = std::move(table);
  return rig;
}
ConfigValue text(const std::string& value) { return {value}; }

TEST(Rights, AreEverybodysWhereTheRigSaysNothing) {
  EXPECT_EQ(Rights::of(RigDescription{}).of("anybody"), Right::researcher);
}

TEST(Rights, AreATechniciansForWhoIsNotNamed) {
  const Rights rights = Rights::of(rig_with("rights", {{"anna", text("researcher")}}));
  EXPECT_EQ(rights.of("anna"), Right::researcher);
  EXPECT_EQ(rights.of("ben"), Right::technician);
  EXPECT_NO_THROW(rights.require_researcher("anna", "the prompt"));
  try {
    rights.require_researcher("ben", "the prompt");
    FAIL();
  } catch (const RightError& error) {
    EXPECT_STREQ(
        error.what(),
        "ben is a technician here: the prompt wants a researcher's right (the rig file's rights)");
  }
}

TEST(Rights, OfAnUnknownKindAreAnErrorOfTheRigFile) {
  EXPECT_THROW(Rights::of(rig_with("rights", {{"anna", text("reasearcher")}})), ConfigError);
}

ConfigTable calibration(const std::string& date, double days) {
  return {{"date", text(date)},
          {"valid_days", ConfigValue{days}},
          {"devices", ConfigValue{ConfigTable{{"coils", text("1A2B")}}}}};
}

TEST(CalibrationsTest, AreOutOfDateOnTheDayAfterTheirLast) {
  const auto rig = rig_with(
      "calibrations", {{"when_stale", text("refuse")}, {"field", {calibration("2026-02-01", 28)}}});
  const Calibrations calibrations = Calibrations::of(rig);
  EXPECT_TRUE(calibrations.refuse_stale);
  EXPECT_TRUE(calibrations.out_of_date("2026-03-01").empty());
  ASSERT_EQ(calibrations.out_of_date("2026-03-02").size(), 1u);
  EXPECT_EQ(calibrations.out_of_date("2026-03-02")[0],
            "the calibration 'field' is of 2026-02-01: 29 days old, and valid for 28");
}

TEST(CalibrationsTest, OfAnotherInstrumentAreNamed) {
  const Calibrations calibrations =
      Calibrations::of(rig_with("calibrations", {{"field", {calibration("2026-02-01", 28)}}}));
  EXPECT_TRUE(calibrations.of_others({{"coils", "USB-3103 1A2B"}}).empty());
  EXPECT_EQ(calibrations.of_others({{"coils", "USB-3103 77"}}).at(0),
            "the calibration 'field' was made with coils = '1A2B', and there is 'USB-3103 77'");
}

TEST(CalibrationsTest, WithADateThatIsNoneOrInTheFutureOrForAnUnknownRoleAreErrorsOfTheRigFile) {
  for (const char* date : {"", "yesterday", "2026-02-30", "2026-2-1x", "9999-01-01"})
    EXPECT_THROW(Calibrations::of(rig_with("calibrations", {{"field", {calibration(date, 28)}}})),
                 ConfigError)
        << date;
  ConfigTable stranger = calibration("2026-02-01", 28);
  stranger["devices"].value = ConfigTable{{"coilz", text("1")}};
  EXPECT_THROW(Calibrations::of(rig_with("calibrations", {{"field", {stranger}}})), ConfigError);
}

TEST(CalibrationsTest, OfARecordAreInForceInItsReplay) {
  RigDescription rig = rig_with("top_camera", {{"effective_pixel", ConfigValue{20.7e-6}}});
  take_recorded_calibration(
      rig, {{"top_camera", {{"effective_pixel", 20.4e-6}}},
            {"side_camera", {{"effective_pixel", 20.1e-6}}},
            {"calibrations", {{"top_camera.effective_pixel", {{"date", "2026-02-01"}}}}}});
  ConfigReader reader(rig);
  EXPECT_EQ(reader.table("top_camera").number("effective_pixel", 0, {0, 1, "m"}), 20.4e-6);
  EXPECT_FALSE(reader.has("side_camera")) << "it was not calibrated";
}

TEST(CalibrationsTest, TheInstalledFileIsNamedAndHasNoDateOfItsOwn) {
  const auto rig = rig_with(
      "calibrations", {{"installed", ConfigValue{ConfigTable{{"file", text("octomag.json")}}}}});
  const Calibrations calibrations = Calibrations::of(rig);
  EXPECT_EQ(calibrations.installed.value().file, "octomag.json");
  EXPECT_TRUE(calibrations.list.empty());
  EXPECT_THROW(
      Calibrations::of(rig_with("calibrations", {{"installed", ConfigValue{ConfigTable{}}}})),
      ConfigError);
}

TEST(ProgressLineTest, AScriptCannotSteerTheTerminal) {
  std::ostringstream out;
  ProgressLine line(out, false);
  line.message("\x1b[2J\x07 done\tat last");
  line.progress(0.5, "a\rb");
  EXPECT_EQ(out.str().find('\x1b'), std::string::npos) << out.str();
  EXPECT_EQ(out.str().find('\r'), std::string::npos);
  EXPECT_NE(out.str().find("\\x1b[2J\\x07 done\tat last"), std::string::npos) << out.str();
  EXPECT_EQ(harmless("5 \u00b5m \u2013 gr\u00fcn"), "5 \u00b5m \u2013 gr\u00fcn");
  EXPECT_EQ(harmless("\xc2\x9b"
                     "31m"),
            "\\u009b31m")
      << "a control sequence of one character";
}

// At the prompt a run begins when it begins, and not when the prompt or the run before did.
TEST(RemainingTimeTest, IsReckonedFromTheBeginOfTheRunThatIsTold) {
  using namespace std::chrono_literals;
  RemainingTime remaining;
  const auto prompt = std::chrono::steady_clock::now();
  EXPECT_FALSE(remaining.told(0, prompt + 100s));
  EXPECT_FALSE(remaining.told(0.005, prompt + 101s));
  EXPECT_NEAR(remaining.told(0.25, prompt + 110s).value(), 30, 1e-9);
  EXPECT_NEAR(remaining.told(0.5, prompt + 120s).value(), 20, 1e-9);
  EXPECT_FALSE(remaining.told(0.1, prompt + 200s)) << "another, of which a tenth is done";
  EXPECT_NEAR(remaining.told(0.2, prompt + 210s).value(), 80, 1e-9);
  EXPECT_EQ(remaining.told(1, prompt + 300s), 0);
  EXPECT_FALSE(remaining.told(0, prompt + 400s));
  EXPECT_NEAR(remaining.told(0.5, prompt + 407s).value(), 7, 1e-9);
}

TEST(ProgressLineTest, IsNoLongerThanTheTerminalWhateverTheWidthOfItsCharacters) {
  const auto drawn = [](const std::string& each) {
    std::string label;
    for (int i = 0; i < 100; ++i) label += each;
    std::ostringstream out;
    ProgressLine line(out, true);
    line.progress(0.005, label);  // so early no time is estimated
    return (out.str().size() - std::string("\r  0 %  ").size()) / each.size();
  };
  // 80 columns where there is no terminal: one stays free, and 7 are those of "  0 %  ".
  EXPECT_EQ(drawn("x"), 72u);
  EXPECT_EQ(drawn("\u00b5"), 72u);
  EXPECT_EQ(drawn("\u773c"), 36u) << "the eye of a Chinese label is two columns wide";
  EXPECT_EQ(drawn("e\u0301"), 72u) << "an accent has no column of its own";
}

TEST(TerminalTextTest, IsCutBetweenCharactersAndSaysHowManyBytesThereWere) {
  EXPECT_EQ(for_terminal("\u00b5\u00b5\u00b5", 6), "\u00b5\u00b5\u00b5");
  EXPECT_EQ(for_terminal("\u00b5\u00b5\u00b5", 3), "\u00b5 ... (6 bytes)");
}

TEST(ClockMapTest, FindsOffsetAndDriftThroughDelaysThatAreNeverNegative) {
  ClockMap map;
  EXPECT_FALSE(map.now());
  const double offset = 1000.25, drift = 50e-6;
  for (int i = 0; i < 60 * 60; ++i) {
    const double device = i / 60.0, late = 2e-3 * std::abs(std::sin(12.9898 * i));
    map.add(from_seconds(device), from_seconds(device + offset + drift * device + late));
  }
  ASSERT_TRUE(map.now());
  EXPECT_NEAR(map.now()->offset, offset + drift * 60, 0.2e-3) << "s: a tenth of the delays";
  EXPECT_NEAR(map.now()->drift, drift, 5e-6);
  map.add(from_seconds(0), from_seconds(5000));
  EXPECT_FALSE(map.now()) << "the instrument was started again: nothing of before counts";
}

struct LogTest : testing::Test {
  LogTest() {
    std::string name = (std::filesystem::temp_directory_path() / "vitreo_log_XXXXXX").string();
    folder = mkdtemp(name.data());
  }
  ~LogTest() override {
    close_log();
    std::filesystem::remove_all(folder);
  }
  std::string read(const std::string& name) const {
    std::ostringstream text;
    text << std::ifstream(folder / name).rdbuf();
    return text.str();
  }
  std::filesystem::path folder;
};

TEST_F(LogTest, IsTurnedOverWhenItIsFullAndTheOldestFileGoes) {
  open_log(folder / "sub" / "host.log", {300, 2});
  for (int i = 0; i < 100; ++i)
    write_log("line " + std::to_string(i) + " of the log, which is long enough\nto turn");
  std::size_t files = 0;
  for (const auto& entry : std::filesystem::directory_iterator(folder / "sub")) {
    if (entry.path().extension() == ".lock") continue;
    ++files;
    EXPECT_LE(std::filesystem::file_size(entry.path()), 300u);
  }
  EXPECT_EQ(files, 3u);
  EXPECT_NE(read("sub/host.log").find("line 99 of the log, which is long enough to turn\n"),
            std::string::npos)
      << "one line each";
}

TEST_F(LogTest, MayBeNamedWithoutAFolderAndStaysThere) {
  const std::filesystem::path before = std::filesystem::current_path();
  std::filesystem::current_path(folder);
  EXPECT_NO_THROW(open_log("host.log"));
  std::filesystem::current_path(before);
  write_log("from another folder");
  EXPECT_NE(read("host.log").find("from another folder"), std::string::npos);
}

TEST_F(LogTest, ComplainsOnceHoweverManyThreadsCannotWrite) {
  for (int round = 0; round < 200; ++round) {
    open_log(folder / "sub" / "host.log");
    std::filesystem::remove_all(folder / "sub");
    testing::internal::CaptureStderr();
    {
      std::latch start(8);
      std::vector<std::jthread> threads;
      for (int i = 0; i < 8; ++i)
        threads.emplace_back([&start] {
          start.arrive_and_wait();
          write_log("lost");
        });
    }
    const std::string said = testing::internal::GetCapturedStderr();
    EXPECT_EQ(std::count(said.begin(), said.end(), '\n'), 1) << said;
  }
}

/// A variable of the environment, as it was when this goes.
class Variable {
 public:
  Variable(const char* name, const char* value) : name_(name) {
    if (const char* const before = std::getenv(name)) before_ = before;
    value ? setenv(name, value, 1) : unsetenv(name);
  }
  ~Variable() { before_ ? setenv(name_, before_->c_str(), 1) : unsetenv(name_); }
  Variable(const Variable&) = delete;
  Variable& operator=(const Variable&) = delete;

 private:
  const char* name_;
  std::optional<std::string> before_;
};

TEST_F(LogTest, IsBelowTheFolderOfStateWhichARelativePathIsNot) {
  const Variable log("VITREO_LOG", nullptr), home("HOME", "/home/anna");
  const std::filesystem::path usual = "/home/anna/.local/state/vitreo";
  {
    const Variable state("XDG_STATE_HOME", "/var/anna");
    EXPECT_EQ(default_log(), "/var/anna/vitreo/host.log");
    EXPECT_EQ(history_file(), "/var/anna/vitreo/history");
  }
  for (const char* none : {"state", "", static_cast<const char*>(nullptr)}) {
    const Variable state("XDG_STATE_HOME", none);
    EXPECT_EQ(default_log(), usual / "host.log");
    EXPECT_EQ(history_file(), usual / "history");
    const Variable nowhere("HOME", "home");
    EXPECT_EQ(default_log(), "");
    EXPECT_EQ(history_file(), "");
  }
}

TEST_F(LogTest, IsNotMissedWhereThereIsNone) {
  write_log("nobody hears this");
  EXPECT_THROW(open_log("/proc/nowhere/host.log"), std::exception);
}

TEST(FramePolicyTest, IsReadFromOneWordAndWhatIsNoneIsNamed) {
  const FramePolicy policy = parse_frame_policy("side_camera/5@96~2.5");
  EXPECT_EQ(policy.camera, "side_camera");
  EXPECT_EQ(policy.every, 5);
  EXPECT_EQ(policy.window, 96);
  EXPECT_EQ(policy.around, 2.5);
  EXPECT_EQ(parse_frame_policy("top_camera~10").around, 10);
  for (const char* word : {"top_camera/", "top_camera/0", "top_camera/x", "top_camera@4",
                           "top_camera~-1", "top_camera~1e9", "top_camera/5junk", "top_camera/5/"})
    EXPECT_THROW(parse_frame_policy(word), ConfigError) << word;
}

TEST(DiskNeed, RefusesWhatTheDiskWouldNotHoldAndNamesBoth) {
  EXPECT_EQ(disk_problem("runs/that/are/not/there", 1e3, false), "");
  const std::string problem = disk_problem("runs", 1e18, false);
  EXPECT_NE(problem.find("would need"), std::string::npos) << problem;
  EXPECT_NE(problem.find("free"), std::string::npos) << problem;
}

// 256 MB and 64 MB (DiskLimits): half of what no run begins without is in doubt here, so that what
// others write meanwhile does not matter.
TEST(DiskNeed, RefusesWhatTheRecorderWouldNotBeginWith) {
  const DiskLimits limits;
  const double room = free_bytes_for("runs") - static_cast<double>(limits.reserve_bytes);
  const double stop = static_cast<double>(limits.stop_bytes);
  const double with_frames = static_cast<double>(limits.stop_bytes_with_frames);
  ASSERT_GT(room, 2 * with_frames);
  EXPECT_EQ(disk_problem("runs", (room - 1.5 * stop) / 1.2, false), "");
  EXPECT_NE(disk_problem("runs", (room - 0.5 * stop) / 1.2, false), "");
  EXPECT_EQ(disk_problem("runs", (room - 1.5 * with_frames) / 1.2, true), "");
  EXPECT_NE(disk_problem("runs", (room - 0.5 * with_frames) / 1.2, true), "");
}

TEST(DiskNeed, WarnsOfFramesThatFillTheDiskWithinTenMinutes) {
  EXPECT_EQ(disk_warning("runs", 0), "");
  EXPECT_EQ(disk_warning("runs", 1), "");
  EXPECT_NE(disk_warning("runs", free_bytes_for("runs") / 100).find("of recording"),
            std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
