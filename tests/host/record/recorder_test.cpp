// SPDX-License-Identifier: Apache-2.0
#include "host/record/recorder.h"

#include "host/files/digest.h"
#include "host/files/manifest.h"
#include "host/files/run_folder.h"
#include "host/files/sqlite.h"
#include "host/runs/run_reader.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <array>
#include <cctype>
#include <csignal>
#include <limits>
#include <optional>
#include <stdexcept>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using test::servo_start;
using test::TemporaryFolder;

const std::vector<Channel> kPlace = {{"x", "m"}, {"y", "m"}, {"z", "m"}};

std::int64_t count_of(const std::filesystem::path& folder, const std::string& query) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement statement = database.prepare(query);
  return statement.step() ? statement.integer(0) : -1;
}

std::string text_of(const std::filesystem::path& folder, const std::string& query) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement statement = database.prepare(query);
  return statement.step() ? statement.text(0) : "nothing";
}

TEST(Recorder, TheFolderIsNamedByTimeAndProtocolAndIsAlwaysNew) {
  TemporaryFolder parent;
  Recorder first(parent.path() / "deep" / "runs", servo_start()),
      second(parent.path() / "deep" / "runs", servo_start());
  EXPECT_NE(first.folder(), second.folder());
  std::string shape = first.folder().filename().string();
  for (char& c : shape) c = std::isdigit(static_cast<unsigned char>(c)) ? '9' : c;
  EXPECT_TRUE(shape.starts_with("9999-99-99T999999_servo_square_")) << shape;
  EXPECT_EQ(shape.find_last_not_of("9abcdef"), shape.size() - 5)
      << shape;  // four hexadecimal digits
}

TEST(Recorder, TakesTheBytesOfLinksAndReadsThemBackToTheBit) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  std::vector<std::uint8_t> every(256);
  for (std::size_t i = 0; i < every.size(); ++i) every[i] = static_cast<std::uint8_t>(i);
  recorder.link({Time{1000}, "stage", "serial:/dev/ttyUSB0", "opened", {}});
  recorder.link({Time{2000}, "stage", "serial:/dev/ttyUSB0", "to", every});
  recorder.finish({Outcome::completed, "", 1, 1});
  const RunData read = read_run(recorder.folder());
  ASSERT_EQ(read.links.size(), 2U);
  EXPECT_EQ(read.links[1].time, Time{2000});
  EXPECT_EQ(read.links[1].role, "stage");
  EXPECT_EQ(read.links[1].address, "serial:/dev/ttyUSB0");
  EXPECT_EQ(read.links[1].event, "to");
  EXPECT_EQ(read.links[1].bytes, every);
  EXPECT_TRUE(read.links[0].bytes.empty());
  EXPECT_EQ(canonical_export(read), canonical_export(recorder));
  EXPECT_NE(canonical_export(read).find("link 2000 \"stage\" \"serial:/dev/ttyUSB0\" to 000102"),
            std::string::npos);
}

TEST(Recorder, HasNoTableOfLinksWhereNoneIsTraced) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM sqlite_master WHERE name='link'"), 0);
  EXPECT_TRUE(read_run(recorder.folder()).links.empty());
}

TEST(Recorder, TheStartIsOnTheDiskBeforeAnythingElse) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM run"), 1);
  EXPECT_EQ(text_of(recorder.folder(), "SELECT seed FROM run"), "18446744073709551615");
  EXPECT_EQ(text_of(recorder.folder(), "SELECT script_hash FROM run"),
            sha256(servo_start().protocol_text));
  EXPECT_EQ(test::read_file(recorder.folder() / "script" / "servo_square.lua"),
            servo_start().protocol_text);
  EXPECT_EQ(test::read_file(recorder.folder() / "script" / "simulated.lua"),
            servo_start().rig["text"]);
}

TEST(Recorder, EverySampleIsReadBackFromTheOneFileThatRemains) {
  TemporaryFolder parent;
  std::filesystem::path folder;
  {
    test::ReportedRecorder recorder(parent.path(), servo_start());
    folder = recorder.folder();
    const int stream = recorder.add_stream({"pose", "test", kPlace});
    for (int i = 0; i < 5000; ++i) {
      const double z = i == 17 ? std::numeric_limits<double>::quiet_NaN() : i / 3.0;
      recorder.sample(stream, Time{i * 1000}, std::array{i * 0.1, -1.0 * i, z});
    }
    recorder.finish({Outcome::completed, "", 5, 1});
  }
  EXPECT_FALSE(std::filesystem::exists(folder / "run.sqlite-wal"));
  EXPECT_EQ(text_of(folder, "PRAGMA journal_mode"), "delete");
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement rows = database.prepare("SELECT seq, t_ns, x, y, z FROM sample_pose ORDER BY seq");
  for (int i = 0; i < 5000; ++i) {
    ASSERT_TRUE(rows.step());
    ASSERT_EQ(rows.integer(0), i + 1);
    ASSERT_EQ(rows.integer(1), i * 1000);
    ASSERT_EQ(rows.real(2), i * 0.1);
    ASSERT_EQ(rows.is_null(4), i == 17);
    ASSERT_EQ(rows.real(4), i == 17 ? 0 : i / 3.0);  // NULL reads as 0
  }
  EXPECT_FALSE(rows.step());
  EXPECT_EQ(text_of(folder, "SELECT exit_status FROM stop"), "completed");
  EXPECT_EQ(text_of(folder, "SELECT counts FROM stop"), "{\"pose\":5000}");
}

TEST(Recorder, AWholeServoRunIsThere) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  test::record_servo_run(recorder);
  recorder.finish({Outcome::completed, "", 60.4, 8.3});
  const auto& folder = recorder.folder();
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM sample_truth"), 900);
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM channel"), 17);
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM event"), 4);
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM result"), 5);
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM picture"), 3);
  EXPECT_EQ(text_of(folder, "PRAGMA integrity_check"), "ok");
  const std::string picture =
      text_of(folder, "SELECT file FROM picture WHERE name = 'first corner'");
  EXPECT_TRUE(test::read_file(folder / picture).starts_with("\x89PNG"));
  EXPECT_TRUE(std::filesystem::exists(folder / "plots" / "01_Seen_from_the_side.svg"));
  const auto read = nlohmann::json::parse(test::read_file(folder / "summary.json"));
  EXPECT_EQ(read["outcome"], "completed");
  EXPECT_EQ(read["run"], folder.filename().string());
  EXPECT_EQ(read["results"]["path_error_rms"], 187e-6);
}

TEST(Recorder, WithoutFinishTheEndRecordSaysSo) {
  TemporaryFolder parent;
  std::filesystem::path folder;
  {
    test::ReportedRecorder recorder(parent.path(), servo_start());
    folder = recorder.folder();
    const int stream = recorder.add_stream({"pose", "test", kPlace});
    recorder.sample(stream, Time{1}, std::array{1.0, 2.0, 3.0});
  }
  EXPECT_EQ(text_of(folder, "SELECT exit_status FROM stop"), "failed");
  EXPECT_EQ(text_of(folder, "SELECT reason FROM stop"), "never finished");
  EXPECT_EQ(count_of(folder, "SELECT count(*) FROM sample_pose"), 1);
  EXPECT_TRUE(std::filesystem::exists(folder / "report.html"));
}

TEST(Recorder, FinishIsIdempotentAndNothingFollowsIt) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  EXPECT_EQ(recorder.end(), nullptr);
  const int stream = recorder.add_stream({"pose", "test", kPlace});
  recorder.finish({Outcome::stopped, "by hand", 1, 1});
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(recorder.end()->outcome, Outcome::stopped);
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM stop"), 1);
  EXPECT_THROW(recorder.sample(stream, Time{1}, std::array{1.0, 2.0, 3.0}), std::logic_error);
  EXPECT_THROW(recorder.event(Time{1}, "note", "late"), std::logic_error);
}

TEST(Recorder, WrongNamesAndSizesAreRefused) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  const int stream = recorder.add_stream({"pose", "test", kPlace});
  EXPECT_THROW(recorder.add_stream({"pose", "", kPlace}), std::invalid_argument);
  EXPECT_THROW(recorder.add_stream({"POSE", "", kPlace}),
               std::invalid_argument);  // SQLite's tables do not know case
  EXPECT_THROW(recorder.add_stream({"", "", kPlace}), std::invalid_argument);
  EXPECT_THROW(recorder.add_stream({"none", "", {}}), std::invalid_argument);
  EXPECT_THROW(recorder.add_stream({"twice", "", {{"x", "m"}, {"X", "m"}}}), std::invalid_argument);
  EXPECT_THROW(recorder.add_stream({"own", "", {{"t_ns", "s"}}}), std::invalid_argument);
  EXPECT_THROW(recorder.add_stream({std::string("nul\0", 4), "", kPlace}), std::invalid_argument);
  EXPECT_THROW(recorder.sample(stream, Time{0}, std::array{1.0}), std::invalid_argument);
  EXPECT_THROW(recorder.sample(stream + 1, Time{0}, std::array{1.0}), std::invalid_argument);
  EXPECT_THROW(recorder.sample(-1, Time{0}, std::array{1.0}), std::invalid_argument);
  EXPECT_THROW(recorder.picture("empty", "", cv::Mat()), std::invalid_argument);
  EXPECT_THROW(recorder.picture("floats", "", cv::Mat(4, 4, CV_32F)), std::invalid_argument);
  Plot plot;
  plot.x.unit = "furlong";
  EXPECT_THROW(recorder.plot(plot), std::invalid_argument);
  EXPECT_EQ(recorder.stream("nobody"), nullptr);
  EXPECT_EQ(recorder.streams().size(), 1u);
}

TEST(Recorder, NamesFromScriptsAreDataAndNeverSql) {
  TemporaryFolder parent;
  const std::string evil = "x\"; DROP TABLE run; --";
  RunStart start = servo_start();
  start.protocol_file = "../../" + evil + "/..";
  start.operator_name = evil;
  test::ReportedRecorder recorder(parent.path(), start);
  const int stream = recorder.add_stream({evil, evil, {{evil, evil}}});
  recorder.sample(stream, Time{0}, std::array{4.5});
  recorder.result({evil, 1, ""});
  recorder.event(Time{0}, evil, evil);
  recorder.picture("../../" + evil, evil, cv::Mat::zeros(4, 4, CV_8U));
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(recorder.folder().parent_path(), parent.path());
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM run"), 1);
  EXPECT_EQ(
      count_of(recorder.folder(), "SELECT count(*) FROM " + quoted_identifier("sample_" + evil)),
      1);
}

TEST(Recorder, AResultStatedAgainReplacesTheFirst) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  recorder.result({"a", 1, "m"});
  recorder.result({"b", 2, "m"});
  recorder.result({"a", std::numeric_limits<double>::quiet_NaN(), "s"});
  ASSERT_EQ(recorder.results().size(), 2u);
  EXPECT_EQ(recorder.results()[0].unit, "s");
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM result"), 2);
  EXPECT_TRUE(
      nlohmann::json::parse(test::read_file(recorder.folder() / "summary.json"))["results"]["a"]
          .is_null());
}

TEST(Recorder, WhereNothingCanBeWrittenTheErrorNamesThePlaceAndNoFolderIsLeft) {
  TemporaryFolder parent;
  write_file(parent.path() / "file", "in the way");
  try {
    test::ReportedRecorder recorder(parent.path() / "file" / "runs", servo_start());
    FAIL() << "it was made";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("file/runs"), std::string::npos) << error.what();
  }
}

TEST(Recorder, AReportThatCannotBeWrittenIsAnEventAndTheEndRecordStands) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  std::filesystem::create_directories(recorder.folder() / "report.html" / "in the way");
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(text_of(recorder.folder(), "SELECT exit_status FROM stop"), "completed");
  EXPECT_EQ(count_of(recorder.folder(), "SELECT count(*) FROM event WHERE kind = 'error'"), 1);
}

TEST(Recorder, AReaderThatHoldsTheFileOpenDoesNotStopTheEnd) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  recorder.event(Time{1}, "note", "one");
  Database reader((recorder.folder() / "run.sqlite").string(), Database::Mode::read_only);
  std::optional<Statement> open = reader.prepare("SELECT * FROM run");
  ASSERT_TRUE(open->step());
  EXPECT_NO_THROW(recorder.finish({Outcome::completed, "", 1, 1}));
  EXPECT_EQ(text_of(recorder.folder(), "SELECT exit_status FROM stop"), "completed");
  // Nor does what it leaves behind, or a further reader, look like a change of the record.
  EXPECT_EQ(check_manifest(recorder.folder()), std::vector<std::string>{});
  open.reset();
  reader.close();
  EXPECT_EQ(text_of(recorder.folder(), "SELECT exit_status FROM stop"), "completed");
  EXPECT_EQ(check_manifest(recorder.folder()), std::vector<std::string>{});
}

/// In a process of its own: the limit on file sizes plays the full disk, and is lifted when space
/// is made.
[[noreturn]] void record_onto_a_full_disk(const std::filesystem::path& parent) {
  std::signal(SIGXFSZ, SIG_IGN);
  RecordLimits few;
  few.queued_rows = 500;  // so that the error is back before all is given
  test::ReportedRecorder recorder(parent, servo_start(), few);
  const int stream = recorder.add_stream({"pose", "test", kPlace});
  rlimit limit{};
  getrlimit(RLIMIT_FSIZE, &limit);
  const rlimit before = limit;
  limit.rlim_cur = 300000;
  setrlimit(RLIMIT_FSIZE, &limit);
  bool named = false;
  for (int i = 0; i < 20000 && !named; ++i) {
    try {
      recorder.sample(stream, Time{i}, std::array{1.0 * i, 2.0, 3.0});
    } catch (const std::runtime_error& error) {
      named = std::string(error.what()).find("run.sqlite") != std::string::npos;
    }
  }
  const auto held = recorder.stream("pose")->times.size();
  setrlimit(RLIMIT_FSIZE, &before);
  recorder.finish({Outcome::failed, "disk full", 1, 1});
  const auto kept =
      static_cast<std::size_t>(count_of(recorder.folder(), "SELECT max(seq) FROM sample_pose"));
  const auto rows =
      static_cast<std::size_t>(count_of(recorder.folder(), "SELECT count(*) FROM sample_pose"));
  const bool ended = text_of(recorder.folder(), "SELECT reason FROM stop") == "disk full";
  _exit(named && held < 20000 && kept == held && rows == held && ended ? 0 : 1);
}

TEST(Recorder, AFullDiskIsNamedAndNothingIsLostOnceThereIsRoom) {
  TemporaryFolder parent;
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) record_onto_a_full_disk(parent.path());
  int status = 0;
  waitpid(child, &status, 0);
  EXPECT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 0);
}

TEST(Recorder, TheCanonicalExportKnowsNeitherRunNorWallClock) {
  TemporaryFolder parent;
  Recorder first(parent.path(), servo_start()), second(parent.path(), servo_start());
  test::record_servo_run(first);
  test::record_servo_run(second);
  second.result({"wall_time", 99, "s"});
  EXPECT_EQ(canonical_export(first), canonical_export(second));
  EXPECT_EQ(canonical_export(first).find(first.folder().filename().string()), std::string::npos);
  second.event(Time{1}, "note", "another");
  EXPECT_NE(canonical_export(first), canonical_export(second));
}

TEST(Recorder, TheCanonicalExportLeavesOutTheAlarmsOfTheDiskAndNoOthers) {
  TemporaryFolder parent;
  Recorder first(parent.path(), servo_start()), second(parent.path(), servo_start());
  second.alarm(Time{1}, "disk", AlarmPriority::medium, "the disk fills: 2 GB are left on the disk");
  second.alarm(Time{2}, "recording", AlarmPriority::low,
               "top_camera: frame 12 is not recorded: the disk is behind");
  second.alarm(Time{3}, "recording", AlarmPriority::low,
               "back pressure: the disk is behind and held up the run for 0.100 s");
  EXPECT_EQ(canonical_export(first), canonical_export(second));
  second.alarm(Time{4}, "robot lost", AlarmPriority::medium, "recording: back pressure: and so on");
  EXPECT_NE(canonical_export(first), canonical_export(second));
}

TEST(Sha256, AgreesWithThePublishedVectors) {
  EXPECT_EQ(sha256(""), "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855");
  EXPECT_EQ(sha256("abc"), "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad");
  EXPECT_EQ(sha256("abcdbcdecdefdefgefghfghighijhijkijkljklmklmnlmnomnopnopq"),
            "248d6a61d20638b8e5c026930c3e6039a33ce45964ff2167f6ecedd419db06c1");
  EXPECT_EQ(sha256(std::string(1000000, 'a')),
            "cdc76e5c9914fb9281a1c7e284d73e67f1809a48a497200e046d39ccc7112cd0");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
