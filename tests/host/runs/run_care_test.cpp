// Runs read back, verified, recovered and listed; broken and foreign records are errors that say
// so.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/run_care.h"

#include "host/cli/commands.h"
#include "host/files/ndtiff.h"
#include "host/files/posix_file.h"
#include "host/files/run_folder.h"
#include "host/files/sqlite.h"
#include "host/record/recorder.h"
#include "host/runs/comparison.h"
#include "host/runs/report.h"
#include "host/runs/run_outline.h"
#include "host/runs/run_reader.h"
#include "tests/host/record/run_fixture.h"
#include "tests/long_form.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <array>
#include <csignal>
#include <cstdlib>
#include <random>
#include <sstream>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;
using test::servo_start;
using test::TemporaryFolder;

cv::Mat picture(int number) {
  cv::Mat image(24, 32, CV_8UC1);
  for (int i = 0; i < image.rows * image.cols; ++i) image.data[i] = static_cast<uchar>(number + i);
  return image;
}

void add_frames(Recorder& recorder, int count) {
  const int camera = recorder.add_camera({"top_camera", "test camera", 1, 0.1, 1e-6});
  for (int i = 0; i < count; ++i) {
    Frame frame{picture(i), static_cast<std::uint64_t>(i), from_seconds(0.1 * i),
                from_seconds(0.1 * i + 0.05)};
    frame.device = Time(i * 100);
    recorder.frame(camera, frame);
  }
}

/// A closed run with everything in it.
fs::path whole_run(const fs::path& parent) {
  test::ReportedRecorder recorder(parent, servo_start());
  test::record_servo_run(recorder);
  add_frames(recorder, 5);
  recorder.module({"judge", "scripts/analysis/path_accuracy.lua", "return {}"});
  recorder.finish({Outcome::failed, "protocols/servo_square.lua:12: on purpose", 60.4, 8.3});
  return recorder.folder();
}

TEST(RunReader, AnOutlineComparesAsTheWholeRunDoesAndHasNoSamples) {
  const TemporaryFolder folder;
  const fs::path run = whole_run(folder.path());
  const RunData whole = read_run(run), outline = read_outline(run);
  EXPECT_FALSE(whole.streams.empty());
  EXPECT_TRUE(outline.streams.empty() && outline.frames.empty() && outline.events.empty());
  EXPECT_EQ(outline.dropped, whole.dropped);
  EXPECT_EQ(comparison_text({outline, outline}), comparison_text({whole, whole}));
}

/// A run whose program was killed in the middle.
fs::path lost_run(const fs::path& parent) {
  const pid_t child = fork();
  if (child == 0) {
    test::ReportedRecorder recorder(parent, servo_start());
    test::record_servo_run(recorder);
    add_frames(recorder, 7);
    static_cast<void>(recorder.frames());  // until all is written
    usleep(400'000);  // and committed; the frames' rows come only after a second
    kill(getpid(), SIGKILL);
  }
  waitpid(child, nullptr, 0);
  return run_folders(parent).at(0);
}

TEST(RunReader, GivesBackWhatWasRecorded) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  test::record_servo_run(recorder);
  add_frames(recorder, 5);
  recorder.finish({Outcome::completed, "", 60.4, 8.3});
  const RunData read = read_run(recorder.folder());
  EXPECT_EQ(canonical_export(read), canonical_export(recorder));
  EXPECT_EQ(report_html(read), report_html(recorder));
  EXPECT_EQ(summary(read), summary(recorder.data()));
  EXPECT_EQ(read.start.seed, servo_start().seed);
  ASSERT_EQ(read.frames.size(), 5u);
  EXPECT_EQ(read.frames[3].device, Time(300));
  EXPECT_EQ(cv::norm(read_frame(read, read.frames[3]), picture(3), cv::NORM_L1), 0);
}

TEST(RunReader, KnowsTheScriptsLineOfAFailure) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement stop = database.prepare("SELECT exit_status, script_line FROM stop");
  ASSERT_TRUE(stop.step());
  EXPECT_EQ(stop.text(0), "failed");
  EXPECT_EQ(stop.text(1), "protocols/servo_square.lua:12");
  EXPECT_EQ(script_line("a device: failed"), "");
  Statement module = database.prepare("SELECT hash FROM module WHERE name='judge'");
  EXPECT_TRUE(module.step());
}

TEST(RunReader, KnowsWhereTheScriptWasWhenTheReasonDoesNotSay) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  const std::string location = "protocols/servo_square.lua:40";
  recorder.finish({Outcome::aborted, "the camera was lost", 60.4, 8.3, location});
  EXPECT_EQ(read_run(recorder.folder()).end->location, location);
  const std::string written = test::read_file(recorder.folder() / "summary.json");
  report_run(recorder.folder());
  EXPECT_EQ(test::read_file(recorder.folder() / "summary.json"), written);
}

TEST(RunReader, FindsARunByFolderNameBeginningAndLast) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  const std::string name = folder.filename().string();
  for (const std::string& word : {folder.string(), name, name.substr(0, 18), std::string("last")})
    EXPECT_EQ(find_run(word, parent.path()), folder) << word;
  EXPECT_THROW(find_run("1999", parent.path()), RecordError);
  fs::copy(folder, parent.path() / (name + "x"), fs::copy_options::recursive);
  try {
    find_run(name.substr(0, 12), parent.path());
    FAIL() << "it chose one of two";
  } catch (const RecordError& error) {
    EXPECT_NE(std::string(error.what()).find("could be 2 runs"), std::string::npos) << error.what();
  }
}

// Names tell times to the second only, and go on with the protocol's name.
TEST(RunReader, TheLastOfRunsOfOneSecondIsTheOneThatBeganLast) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  const std::string second = folder.filename().string().substr(0, 17);
  for (const char* const rest : {"_zeta_0001", "_alpha_0002"}) {  // in this order
    fs::copy(folder, parent.path() / (second + rest), fs::copy_options::recursive);
    fs::last_write_time(parent.path() / (second + rest) / "script",
                        fs::last_write_time(folder / "script") +
                            (rest[1] == 'a' ? std::chrono::seconds(2) : std::chrono::seconds(1)));
  }
  EXPECT_EQ(find_run("last", parent.path()).filename(), second + "_alpha_0002");
}

TEST(RunCare, FindsAWholeRunWholeAndNamesEachDamage) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  const RunCheck good = verify_run(folder);
  EXPECT_TRUE(good.problems.empty()) << good.problems.at(0);
  EXPECT_EQ(good.frames, 5u);
  EXPECT_EQ(good.samples, 1800u);

  const fs::path stack = folder / "frames/top_camera/top_camera_NDTiffStack.tif";
  std::string bytes = test::read_file(stack);
  bytes[static_cast<std::size_t>(read_run(folder).frames[2].offset) + 5] ^= 1;
  write_file(stack, bytes);
  const RunCheck bad = verify_run(folder);
  ASSERT_EQ(bad.problems.size(), 2u);
  EXPECT_NE(bad.problems[0].find("top_camera_NDTiffStack.tif: has changed"), std::string::npos);
  EXPECT_NE(bad.problems[1].find("frame 2: its pixels have changed"), std::string::npos);
  EXPECT_FALSE(verify_run(parent.path() / "nothing").problems.empty());
}

TEST(RunCare, EndsAKilledRunAsLostWithItsFramesAndItsReport) {
  TemporaryFolder parent;
  const fs::path folder = lost_run(parent.path());
  EXPECT_EQ(read_head(folder).state, "lost");
  EXPECT_FALSE(verify_run(folder).problems.empty());
  const Recovery recovery = recover_run(folder);
  EXPECT_FALSE(recovery.was_closed);
  EXPECT_LE(recovery.frames_named, 7u);  // all of them, unless the machine was slow
  const RunData data = read_run(folder);
  EXPECT_EQ(data.end->outcome, Outcome::lost);
  EXPECT_EQ(data.stream("truth")->times.size(), 900u);
  ASSERT_EQ(data.frames.size(), 7u);
  EXPECT_EQ(data.frames[6].device, Time(600));
  EXPECT_TRUE(fs::exists(folder / "report.html"));
  EXPECT_FALSE(fs::exists(folder / "run.sqlite-wal"));
  const RunCheck after = verify_run(folder);
  EXPECT_TRUE(after.problems.empty()) << after.problems.at(0);
  EXPECT_TRUE(recover_run(folder).was_closed);  // twice does no harm
  EXPECT_TRUE(verify_run(folder).problems.empty());
}

TEST(RunCare, LeavesARunThatIsBeingRecordedAlone) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  EXPECT_EQ(read_head(recorder.folder()).state, "running");
  EXPECT_THROW(recover_run(recorder.folder()), std::runtime_error);
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(read_head(recorder.folder()).state, "completed");
}

/// Whatever the bytes, each call ends, with a result or with an error that says something.
void must_not_crash(const fs::path& folder) {
  read_head(folder);
  verify_run(folder);
  try {
    const RunData data = read_run(folder);
    for (const FrameRow& row : data.frames) read_frame(data, row);
    report_html(data);
  } catch (const std::exception& error) {
    EXPECT_NE(std::string(error.what()), "");
  }
}

TEST(RunReader, SurvivesRecordsThatAreCutMixedUpOrSomebodyElses) {
  TemporaryFolder parent;
  const fs::path whole = whole_run(parent.path());
  const std::string bytes = test::read_file(whole / "run.sqlite");
  const std::string index = test::read_file(whole / "frames/top_camera/NDTiff.index");
  std::mt19937 random(7);
  const auto below = [&](std::size_t size) {
    return std::uniform_int_distribution<std::size_t>(0, size - 1)(random);
  };
  const int rounds = long_or_short(2000, 60);
  for (int i = 0; i < rounds; ++i) {
    std::string broken = bytes, mixed = index;
    if (i % 3 == 0) broken.resize(below(bytes.size()));
    for (int j = 0; j < 30; ++j) {
      if (!broken.empty()) broken[below(broken.size())] = static_cast<char>(random());
      mixed[below(mixed.size())] = static_cast<char>(random());
    }
    write_file(whole / "run.sqlite", broken);
    write_file(whole / "frames/top_camera/NDTiff.index", mixed);
    must_not_crash(whole);
    try {
      read_ndtiff_index(whole / "frames/top_camera");
    } catch (const std::runtime_error&) {  // it says so
    }
  }
  for (const std::string& text : {std::string(), std::string("hello"), std::string(100000, '\0')}) {
    write_file(whole / "run.sqlite", text);
    must_not_crash(whole);
    EXPECT_EQ(read_head(whole).state, "unreadable");
    EXPECT_THROW(read_run(whole), RecordError);
  }
}

TEST(RunReader, DoesNotFollowPathsOutOfTheRun) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  {
    Database database((folder / "run.sqlite").string(), Database::Mode::read_write);
    database.execute("UPDATE picture SET file='../../../etc/passwd'");
  }
  EXPECT_THROW(read_run(folder), RecordError);
}

TEST(RunReader, DoesNotFollowLinksOutOfTheRun) {
  TemporaryFolder parent;
  const fs::path folder = whole_run(parent.path());
  const RunData data = read_run(folder);
  ASSERT_FALSE(data.pictures.empty());
  const fs::path picture = folder / data.pictures[0].file;
  fs::rename(picture, parent.path() / "elsewhere");
  fs::create_symlink(parent.path() / "elsewhere", picture);
  try {
    read_run(folder);
    FAIL() << "it read a file that is not of the record";
  } catch (const RecordError& error) {
    EXPECT_NE(std::string(error.what()).find("is a link to a file outside the folder"),
              std::string::npos)
        << error.what();
  }
  // Within the folder a link is as good as a file, and so is one to the folder itself.
  fs::remove(picture);
  fs::rename(parent.path() / "elsewhere", folder / "moved.png");
  fs::create_symlink(folder / "moved.png", picture);
  fs::create_symlink(folder, parent.path() / "link");
  EXPECT_EQ(read_run(parent.path() / "link").pictures.size(), data.pictures.size());
}

TEST(RunCommands, ListFilterAndShowSpeakJson) {
  TemporaryFolder parent;
  const TemporaryFolder cache;
  setenv("XDG_CACHE_HOME", cache.path().c_str(), 1);  // not the index of who runs the tests
  const fs::path folder = whole_run(parent.path());
  fs::create_directory(parent.path() / "not a run");
  const auto listed = [&](const RunFilter& filter) {
    std::ostringstream out;
    EXPECT_EQ(list_runs(parent.path(), filter, ListFormat::json, out), 0);
    return nlohmann::json::parse(out.str());
  };
  ASSERT_EQ(listed({}).size(), 1u);
  EXPECT_EQ(listed({})[0]["outcome"], "failed");
  RunFilter filter;
  filter.state = "completed";
  EXPECT_EQ(listed(filter).size(), 0u);
  filter = {};
  filter.protocol = "servo_square";
  EXPECT_EQ(listed(filter).size(), 1u);
  filter.since = "2999";
  EXPECT_EQ(listed(filter).size(), 0u);
  std::ostringstream out;
  EXPECT_EQ(show_run(folder, true, out), 0);
  const auto shown = nlohmann::json::parse(out.str());
  EXPECT_EQ(shown["results"]["path_error_rms"], 187e-6);
  EXPECT_EQ(shown["frames"]["top_camera"]["recorded"], 5);
  EXPECT_EQ(shown["modules"].size(), 1u);
  std::ostringstream words;
  EXPECT_EQ(show_run(folder, false, words), 0);
  EXPECT_NE(words.str().find("187"), std::string::npos) << words.str();
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
