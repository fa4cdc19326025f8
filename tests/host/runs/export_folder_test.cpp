// Export folder and the run's clock: all files or none, never another's; time stamps read exactly.
// SPDX-License-Identifier: Apache-2.0
#include "host/runs/export_folder.h"

#include "host/record/recorder.h"
#include "host/runs/ahead.h"
#include "host/runs/run_clock.h"
#include "host/runs/run_reader.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>

#include <fstream>
#include <stdexcept>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

using test::read_file;
using test::servo_start;
using test::TemporaryFolder;

void write(const std::filesystem::path& file, const std::string& text) {
  std::ofstream(file) << text;
}

TEST(ExportFolder, NamesItsFilesOnlyWhenAllAreWhole) {
  const TemporaryFolder parent;
  const auto target = parent.path() / "a/b";
  {
    ExportFolder folder(target);
    write(folder.add("one", ".csv"), "1");
    EXPECT_FALSE(std::filesystem::exists(target / "one.csv"));
  }
  EXPECT_FALSE(std::filesystem::exists(target)) << "it was not there before";
  ExportFolder folder(target);
  write(folder.add("one", ".csv"), "1");
  write(folder.add("one", ".csv"), "2");
  EXPECT_EQ(folder.publish(), (Files{target / "one.csv", target / "one_2.csv"}));
  EXPECT_EQ(read_file(target / "one_2.csv"), "2");
}

TEST(ExportFolder, LeavesWhatIsThereAloneUnlessItIsTold) {
  const TemporaryFolder parent;
  write(parent.path() / "run.h5", "mine");
  {
    ExportFolder folder(parent.path());
    EXPECT_THROW(folder.add("run", ".h5"), std::runtime_error);
    write(folder.add("late", ".csv"), "theirs");
    write(parent.path() / "late.csv", "mine");  // came between
    EXPECT_THROW(folder.publish(), std::runtime_error);
  }
  EXPECT_EQ(read_file(parent.path() / "late.csv"), "mine");
  {
    ExportFolder folder(parent.path(), true);
    write(folder.add("run", ".h5"), "new");
    folder.publish();
  }
  EXPECT_EQ(read_file(parent.path() / "run.h5"), "new");
  EXPECT_THROW(ExportFolder(parent.path() / "run.h5"), std::runtime_error);
}

TEST(RunClock, ReadsTimeStampsToTheNanosecond) {
  EXPECT_EQ(parse_time_stamp("1970-01-01T00:00:00Z"), 0);
  EXPECT_EQ(parse_time_stamp("2026-11-24T15:32:34+0000"), 1795534354000000000);
  EXPECT_EQ(parse_time_stamp("2026-11-24T16:32:34+0100"), 1795534354000000000);
  EXPECT_EQ(parse_time_stamp("2026-11-24T11:02:34-0430"), 1795534354000000000);
  EXPECT_EQ(parse_time_stamp("2026-11-24T15:32:34.123456Z"), 1795534354123456000);
  for (const char* other : {"", "yesterday", "2026-11-24T15:32:34", "2026-11-24T15:32:34.Z",
                            "2026-11-24T15:32:34.1234567890Z", "2026-11-24T15:32:34 0100"})
    EXPECT_EQ(parse_time_stamp(other), std::nullopt) << other;
}

TEST(RunClock, KnowsTheZeroOfARunOnInstrumentsBetterThanTheBeginOfItsRecord) {
  const TemporaryFolder parent;
  Recorder recorder(parent.path(), servo_start());
  recorder.event(Time{0}, "clock", "0 s is 2026-11-24T15:32:34.123456Z, and 17.5 s of the clock");
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(t0_utc_ns(read_run(recorder.folder())), 1795534354123456000);
  Recorder other(parent.path(), servo_start());
  other.finish({Outcome::completed, "", 1, 1});
  const double now =
      std::chrono::duration<double>(std::chrono::system_clock::now().time_since_epoch()).count();
  EXPECT_NEAR(static_cast<double>(t0_utc_ns(read_run(other.folder()))) / 1e9, now, 60);
}

TEST(Ahead, GivesTheResultsInOrderAndTheErrorsInTheirPlaces) {
  Ahead ahead(1000, [](std::size_t number) {
    if (number == 500) throw std::runtime_error("the five hundredth");
    return std::to_string(number);
  });
  for (std::size_t i = 0; i < 1000; ++i)
    if (i == 500)
      EXPECT_THROW(ahead.take(), std::runtime_error);
    else
      ASSERT_EQ(ahead.take(), std::to_string(i));
  // One that is left in the middle ends its threads.
  Ahead left(1000000, [](std::size_t) { return std::string("x"); });
  EXPECT_EQ(left.take(), "x");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
