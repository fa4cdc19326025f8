// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_writer.h"

#include "host/files/digest.h"
#include "host/files/manifest.h"
#include "host/files/ndtiff.h"
#include "host/files/run_folder.h"
#include "host/files/sqlite.h"
#include "host/record/disk_watch.h"
#include "host/record/recorder.h"
#include "host/record/run_lock.h"
#include "host/runs/run_reader.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <array>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <cstring>
#include <future>
#include <iterator>
#include <sys/resource.h>
#include <unistd.h>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using test::servo_start;
using test::TemporaryFolder;

const std::vector<Channel> kOne = {{"x", "m"}};

std::int64_t number_in(const std::filesystem::path& folder, const std::string& query) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement statement = database.prepare(query);
  return statement.step() ? statement.integer(0) : -1;
}

cv::Mat noise(int rows, int columns, int type, int seed) {
  cv::Mat image(rows, columns, type);
  cv::RNG random(static_cast<std::uint64_t>(seed));
  random.fill(image, cv::RNG::UNIFORM, 0, 255);
  return image;
}

Frame frame_of(const cv::Mat& image, std::uint64_t number) {
  return {image, number, Time(number * 1000), Time(number * 1000 + 5)};
}

/// Another process's transaction holds the database: the writer cannot get on, as with a slow disk.
class Brake {
 public:
  explicit Brake(const std::filesystem::path& folder) {
    sqlite3_open((folder / "run.sqlite").c_str(), &database_);
    sqlite3_exec(database_, "BEGIN IMMEDIATE", nullptr, nullptr, nullptr);
  }
  ~Brake() {
    sqlite3_exec(database_, "ROLLBACK", nullptr, nullptr, nullptr);
    sqlite3_close(database_);
  }
  Brake(const Brake&) = delete;
  Brake& operator=(const Brake&) = delete;

 private:
  sqlite3* database_ = nullptr;
};

TEST(RecordWriter, HoldsUpTheSamplesWhenTheQueueIsFullAndSaysSoAndDropsNone) {
  TemporaryFolder parent;
  RecordLimits few;
  few.queued_rows = 10;
  test::ReportedRecorder recorder(parent.path(), servo_start(), few);
  const int stream = recorder.add_stream({"pose", "test", kOne});
  constexpr int kRows = 20000;
  for (int i = 0; i < kRows; ++i) recorder.sample(stream, Time{i}, std::array{1.0 * i});
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM sample_pose"), kRows);
  EXPECT_GT(recorder.data().held, 0);
  EXPECT_GT(
      number_in(recorder.folder(),
                "SELECT count(*) FROM event WHERE kind='alarm' AND text LIKE '%back pressure%'"),
      0);
  EXPECT_EQ(number_in(recorder.folder(), "SELECT held > 0 FROM stop"), 1);
}

// The zeros of the coils are among these: a slow disk must not hold them up.
TEST(RecordWriter, NeverHoldsUpALinkAndWritesAtTheEndWhatTheQueueHadNoRoomFor) {
  TemporaryFolder parent;
  RecordLimits few;
  few.queued_rows = 10;
  test::ReportedRecorder recorder(parent.path(), servo_start(), few);
  constexpr int kRows = 2000;
  {
    const Brake brake(recorder.folder());
    for (int i = 0; i < kRows; ++i)
      recorder.link({Time{i}, "stage", "emulated", "to", {static_cast<std::uint8_t>(i)}});
    EXPECT_EQ(recorder.data().links.size(), kRows);
  }
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(recorder.data().held, 0);
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM link"), kRows);
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM link WHERE seq = t_ns + 1"), kRows);
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM event WHERE kind='alarm'"), 0);
}

TEST(RecordWriter, GivesItsLastAlarmsNameAndPriorityToo) {
  TemporaryFolder parent;
  RecordLimits few;
  few.queued_rows = 1;
  test::ReportedRecorder recorder(parent.path(), servo_start(), few);
  // Results take no alarms out of the writer: finish() finds them there.
  for (int i = 0; i < 20; ++i) recorder.result({"result " + std::to_string(i), 1.0, "m"});
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_GT(
      number_in(recorder.folder(),
                "SELECT count(*) FROM event WHERE text LIKE 'low: recording: back pressure%'"),
      0);
  EXPECT_EQ(
      number_in(recorder.folder(), "SELECT count(*) FROM event WHERE text LIKE 'back pressure%'"),
      0);
}

TEST(RecordWriter, GivesItsRowsWhileADiskThatWasGivenUpStillWrites) {
  TemporaryFolder parent;
  RecordLimits limits;
  limits.queued_rows = 8;
  limits.patience = std::chrono::milliseconds(200);
  RecordWriter writer(parent.path(), servo_start(), limits);
  const std::size_t count = 4000;
  std::promise<void> taken, first, second;
  const auto wait_for = [](std::promise<void>& gate) {
    return [open = gate.get_future().share()](RecordFile&) { open.wait(); };
  };
  writer.add_camera({"top_camera", "test", 1, 0.01, 1e-6});
  writer.post([&](RecordFile&) { taken.set_value(); }, true);
  writer.post(wait_for(first), true);
  taken.get_future().wait();
  // All in the writer's next turn, which begins with a disk that does not answer.
  writer.post(wait_for(second), true);
  const cv::Mat image = noise(8, 8, CV_8UC1, 1);
  for (std::uint64_t i = 0; i < count; ++i) writer.frame(0, frame_of(image, i));
  first.set_value();
  while (writer.fault().empty()) writer.post([](RecordFile&) {}, false);
  EXPECT_NE(writer.fault().find("has not answered"), std::string::npos) << writer.fault();
  EXPECT_TRUE(writer.frames().empty());
  second.set_value();  // it answers after all
  for (std::size_t seen = 0; seen < count;) {
    const std::vector<FrameRow> rows = writer.frames();
    ASSERT_GE(rows.size(), seen);
    seen = rows.size();
    for (std::size_t i = 0; i < seen; ++i) ASSERT_EQ(rows[i].number, i);
  }
}

TEST(RecordWriter, KeepsAllBitsOfAFrameThatHasMoreThanEight) {
  TemporaryFolder parent;
  Recorder recorder(parent.path(), servo_start());
  RecordedCameraInfo info{"top_camera", "test", 1, 0.01, 1e-6};
  info.bits = 12;
  info.offset_x_px = 301;
  const int camera = recorder.add_camera(info);
  Frame frame = frame_of(noise(8, 8, CV_8UC1, 1), 0);
  frame.deep = noise(8, 8, CV_16UC1, 2) * 16;
  frame.bits = 12;
  recorder.frame(camera, frame);
  recorder.finish({Outcome::completed, "", 1, 1});
  const RunData data = read_run(recorder.folder());
  ASSERT_EQ(data.frames.size(), 1U);
  EXPECT_EQ(data.cameras.at(0).bits, 12);
  EXPECT_EQ(data.cameras.at(0).offset_x_px, 301);
  const cv::Mat kept = read_frame(data, data.frames[0]);
  ASSERT_EQ(kept.type(), CV_16UC1);
  EXPECT_EQ(cv::norm(kept, frame.deep, cv::NORM_INF), 0);
  const auto stack = recorder.folder() / "frames/top_camera";
  const auto entries = read_ndtiff_index(stack);
  ASSERT_EQ(entries.size(), 1U);
  EXPECT_EQ(entries[0].bits, 12);
  EXPECT_EQ(read_ndtiff_metadata(stack, entries[0])["BitDepth"], 12);
}

// The numbers are NDStorage's own (IndexEntryData): its readers, and so Micro-Manager, take the
// range of gray from them.
TEST(Ndtiff, TellsInItsIndexHowManyOfSixteenBitsCount) {
  TemporaryFolder parent;
  const auto folder = parent.path() / "stack";
  NdtiffWriter writer(folder, "cam", {});
  const std::vector<std::pair<int, std::uint32_t>> bits_and_numbers = {
      {10, 3}, {12, 4}, {14, 5}, {16, 1}, {11, 1}};
  for (const auto& [bits, number] : bits_and_numbers) {
    writer.write({{"time", 0}}, noise(8, 8, CV_16UC1, 1), {}, bits);
    const std::string index = test::read_file(folder / "NDTiff.index");
    std::uint32_t told = 0;  // the fourth of the eight numbers at the end of an entry
    std::memcpy(&told, index.data() + index.size() - 20, sizeof told);
    EXPECT_EQ(told, number) << bits << " bits";
  }
  writer.write({{"time", 0}}, noise(8, 8, CV_8UC1, 1), {}, 12);
  EXPECT_EQ(read_ndtiff_index(folder).back().pixel_type, 0) << "8 bits have no others";
  const auto entries = read_ndtiff_index(folder);
  for (std::size_t i = 0; i < bits_and_numbers.size(); ++i) {
    EXPECT_EQ(entries[i].pixel_type, 1);
    EXPECT_EQ(entries[i].bits, bits_and_numbers[i].second == 1 ? 0 : bits_and_numbers[i].first);
    EXPECT_EQ(cv::norm(read_ndtiff_image(folder, entries[i]), noise(8, 8, CV_16UC1, 1)), 0);
  }
}

TEST(RecordWriter, DropsFramesInRealTimeCountsThemAndRaisesAnAlarm) {
  TemporaryFolder parent;
  RecordLimits limits;
  limits.drop_frames = true;
  limits.queued_frame_bytes = 3 * 64 * 48;
  test::ReportedRecorder recorder(parent.path(), servo_start(), limits);
  const int camera = recorder.add_camera({"top_camera", "test", 1, 0.01, 1e-6});
  const int stream = recorder.add_stream({"pose", "test", kOne});
  constexpr std::uint64_t kFrames = 200;
  {
    const Brake brake(recorder.folder());  // at once, far faster than any disk
    recorder.event(Time{}, "note", "the writer waits for this row");
    for (std::uint64_t i = 0; i < kFrames; ++i)
      recorder.frame(camera, frame_of(noise(48, 64, CV_8UC1, 1), i));
  }
  recorder.sample(stream, Time{1}, std::array{0.0});
  // The next frame that finds room says how many were lost before it.
  static_cast<void>(recorder.frames());  // waits until the queue is empty
  recorder.frame(camera, frame_of(noise(48, 64, CV_8UC1, 1), kFrames));
  recorder.finish({Outcome::completed, "", 1, 1});
  const std::int64_t there = number_in(recorder.folder(), "SELECT count(*) FROM frame");
  ASSERT_EQ(recorder.data().dropped.size(), 1u);
  EXPECT_GT(recorder.data().dropped[0], 0u);
  EXPECT_EQ(there + static_cast<std::int64_t>(recorder.data().dropped[0]),
            static_cast<std::int64_t>(kFrames) + 1);
  EXPECT_EQ(number_in(recorder.folder(), "SELECT sum(dropped_before) FROM frame"),
            static_cast<std::int64_t>(recorder.data().dropped[0]));
  EXPECT_GT(
      number_in(recorder.folder(),
                "SELECT count(*) FROM event WHERE kind='alarm' AND text LIKE '%not recorded%'"),
      0);
  EXPECT_EQ(summary(recorder.data())["frames"]["top_camera"]["dropped"],
            recorder.data().dropped[0]);
}

TEST(RecordWriter, TakesEveryFrameUnderTheVirtualClock) {
  TemporaryFolder parent;
  RecordLimits limits;
  limits.queued_frame_bytes = 2 * 64 * 48;
  test::ReportedRecorder recorder(parent.path(), servo_start(), limits);
  const int camera = recorder.add_camera({"top_camera", "test", 1, 0.01, 1e-6});
  for (std::uint64_t i = 0; i < 300; ++i)
    recorder.frame(camera, frame_of(noise(48, 64, CV_8UC1, 1), i));
  recorder.finish({Outcome::completed, "", 1, 1});
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM frame"), 300);
  EXPECT_EQ(recorder.data().dropped[0], 0u);
}

TEST(RecordWriter, EndsTheRunBeforeTheDiskIsFull) {
  TemporaryFolder parent;
  std::atomic<std::uint64_t> left{10ull << 30};
  std::atomic<int> told{0};
  RecordLimits limits;
  limits.disk.free_bytes = [&](const std::filesystem::path&) { return left.load(); };
  test::ReportedRecorder recorder(parent.path(), servo_start(), limits);
  recorder.on_fault([&] { ++told; });
  const int stream = recorder.add_stream({"pose", "test", kOne});
  recorder.sample(stream, Time{0}, std::array{0.0});
  left = 100 << 20;
  std::int64_t given = 1;
  EXPECT_THROW(
      for (; given < 100000; ++given) {
        recorder.sample(stream, Time{given}, std::array{0.0});
        usleep(1000);
      },
      std::runtime_error);
  EXPECT_EQ(told, 1);
  EXPECT_NE(recorder.fault().find("nearly full"), std::string::npos) << recorder.fault();
  recorder.finish({Outcome::aborted, recorder.fault(), 1, 1});
  EXPECT_EQ(number_in(recorder.folder(), "SELECT count(*) FROM sample_pose"),
            static_cast<std::int64_t>(recorder.stream("pose")->times.size()));
  EXPECT_TRUE(check_manifest(recorder.folder()).empty());
}

TEST(RecordWriter, DoesNotBeginOnADiskThatIsFullAlready) {
  TemporaryFolder parent;
  RecordLimits limits;
  limits.disk.free_bytes = [](const std::filesystem::path&) { return std::uint64_t{50} << 20; };
  try {
    test::ReportedRecorder recorder(parent.path(), servo_start(), limits);
    FAIL() << "it began";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("52 MB are free"), std::string::npos) << error.what();
  }
  EXPECT_TRUE(std::filesystem::is_empty(parent.path()));
}

TEST(DiskWatch, WarnsOnceTenMinutesAheadAndStopsTwoMinutesAhead) {
  using namespace std::chrono_literals;
  DiskLimits limits;
  std::uint64_t left = 100ull << 30;
  limits.free_bytes = [&](const std::filesystem::path&) { return left; };
  DiskWatch watch("runs", limits);
  const DiskWatch::Instant t0{};
  constexpr std::uint64_t kRate = 20'000'000;  // bytes/s
  EXPECT_EQ(watch.look(0, true, t0).stop, "");
  EXPECT_EQ(watch.look(5 * kRate, true, t0 + 5s).warning, "");
  left = 599 * kRate;
  EXPECT_NE(watch.look(6 * kRate, true, t0 + 6s).warning, "");
  EXPECT_EQ(watch.look(7 * kRate, true, t0 + 7s).warning, "");  // said already
  left = 119 * kRate;
  EXPECT_NE(watch.look(8 * kRate, true, t0 + 8s).stop, "");
}

TEST(RunLock, IsHeldWhileItIsRecordedAndGoneWithIt) {
  TemporaryFolder parent;
  std::filesystem::path folder;
  {
    test::ReportedRecorder recorder(parent.path(), servo_start());
    folder = recorder.folder();
    EXPECT_TRUE(RunLock::is_held(folder));
    EXPECT_THROW(RunLock other(folder), std::runtime_error);
  }
  EXPECT_FALSE(RunLock::is_held(folder));
  for (const char* leftover :
       {"recording.lock", "reserve.room", "run.sqlite-wal", "run.sqlite-shm"})
    EXPECT_FALSE(std::filesystem::exists(folder / leftover)) << leftover;
}

TEST(Manifest, AgreesWithSha256sumAndNamesWhatHasChanged) {
  TemporaryFolder parent;
  test::ReportedRecorder recorder(parent.path(), servo_start());
  test::record_servo_run(recorder);
  recorder.finish({Outcome::completed, "", 60, 8});
  const auto& folder = recorder.folder();
  EXPECT_EQ(
      std::system(
          ("cd '" + folder.string() + "' && sha256sum --quiet --strict -c SHA256SUMS").c_str()),
      0);
  EXPECT_TRUE(check_manifest(folder).empty());
  write_file(folder / "summary.json", "{}");
  write_file(folder / "extra.txt", "hello");
  std::filesystem::remove(folder / "report.html");
  const auto problems = check_manifest(folder);
  ASSERT_EQ(problems.size(), 3u);
  EXPECT_NE(problems[0].find("extra.txt"), std::string::npos);
  EXPECT_NE(problems[1].find("summary.json: has changed"), std::string::npos);
  EXPECT_NE(problems[2].find("report.html: is missing"), std::string::npos);
}

TEST(Ndtiff, IsReadBackPixelByPixelByLibtiffThroughOpenCv) {
  TemporaryFolder parent;
  const auto folder = parent.path() / "stack";
  std::vector<cv::Mat> images = {noise(31, 17, CV_8UC1, 1), noise(48, 64, CV_16UC1, 2),
                                 noise(20, 33, CV_8UC3, 3)};
  NdtiffWriter writer(folder, "cam", {{"Camera", "cam"}});
  for (std::size_t i = 0; i < images.size(); ++i) {
    writer.write({{"time", i}}, images[i], {{"Number", i}});
    // Readable while it grows: all pages so far, no more.
    std::vector<cv::Mat> pages;
    ASSERT_TRUE(
        cv::imreadmulti((folder / "cam_NDTiffStack.tif").string(), pages, cv::IMREAD_UNCHANGED));
    ASSERT_EQ(pages.size(), i + 1);
    ASSERT_EQ(pages[i].type(), images[i].type());
    EXPECT_EQ(cv::norm(pages[i], images[i], cv::NORM_L1), 0) << i;
    const auto entries = read_ndtiff_index(folder);
    ASSERT_EQ(entries.size(), i + 1);
    EXPECT_EQ(entries[i].axes, nlohmann::json({{"time", i}}));
    EXPECT_EQ(cv::norm(read_ndtiff_image(folder, entries[i]), images[i], cv::NORM_L1), 0);
  }
  EXPECT_THROW(writer.write({}, cv::Mat(2, 2, CV_32F), {}), std::invalid_argument);
  EXPECT_THROW(writer.write({}, cv::Mat(), {}), std::invalid_argument);
  EXPECT_THROW(NdtiffWriter(folder, "cam", {}),
               std::runtime_error);  // never into a stack that is there
}

TEST(Ndtiff, BeginsANewFileWhereTiffEnds) {
  TemporaryFolder parent;
  const auto folder = parent.path() / "stack";
  NdtiffWriter writer(folder, "cam", {}, 20000);
  for (int i = 0; i < 12; ++i) writer.write({{"time", i}}, noise(48, 64, CV_8UC1, i), {});
  const auto entries = read_ndtiff_index(folder);
  ASSERT_EQ(entries.size(), 12u);
  EXPECT_EQ(entries.front().file, "cam_NDTiffStack.tif");
  EXPECT_NE(entries.back().file, entries.front().file);
  for (int i = 0; i < 12; ++i)
    EXPECT_EQ(
        cv::norm(read_ndtiff_image(folder, entries[i]), noise(48, 64, CV_8UC1, i), cv::NORM_L1), 0);
  for (const auto& file : std::filesystem::directory_iterator(folder))
    EXPECT_LE(std::filesystem::file_size(file.path()), 20000u);
}

TEST(Ndtiff, IsMendedAfterACrashAtAnyByte) {
  TemporaryFolder parent;
  const auto whole = parent.path() / "whole";
  {
    NdtiffWriter writer(whole, "cam", {});
    for (int i = 0; i < 4; ++i) writer.write({{"time", i}}, noise(9, 7, CV_8UC1, i), {});
  }
  const auto index_size = std::filesystem::file_size(whole / "NDTiff.index");
  const auto stack_size = std::filesystem::file_size(whole / "cam_NDTiffStack.tif");
  for (std::uint64_t cut = 0; cut < 200; cut += 7) {
    const auto folder = parent.path() / ("cut" + std::to_string(cut));
    std::filesystem::copy(whole, folder);
    const bool index = cut % 2 == 0;
    std::filesystem::resize_file(folder / (index ? "NDTiff.index" : "cam_NDTiffStack.tif"),
                                 (index ? index_size : stack_size) - cut);
    const auto kept = mend_ndtiff(folder);
    ASSERT_GE(kept.size(), 1u);
    std::vector<cv::Mat> pages;
    ASSERT_TRUE(
        cv::imreadmulti((folder / "cam_NDTiffStack.tif").string(), pages, cv::IMREAD_UNCHANGED))
        << cut;
    EXPECT_EQ(pages.size(), kept.size()) << cut;
    EXPECT_EQ(read_ndtiff_index(folder).size(), kept.size());
    for (std::size_t i = 0; i < kept.size(); ++i)
      EXPECT_EQ(cv::norm(pages[i], noise(9, 7, CV_8UC1, static_cast<int>(i)), cv::NORM_L1), 0);
  }
}

TEST(Ndtiff, MendedHasOnlyThePagesOfItsIndexInEveryFile) {
  TemporaryFolder parent;
  const auto whole = parent.path() / "whole";
  const nlohmann::json summary = {{"Camera", "camera"}};
  {
    NdtiffWriter writer(whole, "cam", summary, 20000);
    for (int i = 0; i < 12; ++i) writer.write({{"time", i}}, noise(48, 64, CV_8UC1, i), {});
  }
  NdtiffWriter(parent.path() / "empty", "cam", summary);
  const std::string head = test::read_file(parent.path() / "empty/cam_NDTiffStack.tif");
  const auto entries = read_ndtiff_index(whole);
  std::uint64_t kept_bytes = 0;
  for (std::size_t kept = 0; kept < entries.size(); ++kept) {
    const auto folder = parent.path() / ("kept" + std::to_string(kept));
    std::filesystem::copy(whole, folder);
    std::filesystem::resize_file(folder / "NDTiff.index", kept_bytes + 3);  // and half an entry
    kept_bytes = entries[kept].index_end;
    ASSERT_EQ(mend_ndtiff(folder).size(), kept);
    for (const char* file :
         {"cam_NDTiffStack.tif", "cam_NDTiffStack_1.tif", "cam_NDTiffStack_2.tif"}) {
      const auto named =
          std::count_if(entries.begin(), entries.begin() + kept,
                        [&](const NdtiffEntry& entry) { return entry.file == file; });
      std::vector<cv::Mat> pages;
      cv::imreadmulti((folder / file).string(), pages, cv::IMREAD_UNCHANGED);
      EXPECT_EQ(pages.size(), static_cast<std::size_t>(named)) << kept << " " << file;
      if (named == 0) {
        EXPECT_TRUE(test::read_file(folder / file) == head) << kept << " " << file;
      }
    }
  }
}

/// No file grows beyond `bytes` meanwhile: a full disk.
class FullDisk {
 public:
  explicit FullDisk(rlim_t bytes) : signal_(std::signal(SIGXFSZ, SIG_IGN)) {
    getrlimit(RLIMIT_FSIZE, &before_);
    const rlimit now{bytes, before_.rlim_max};
    setrlimit(RLIMIT_FSIZE, &now);
  }
  ~FullDisk() {
    setrlimit(RLIMIT_FSIZE, &before_);
    std::signal(SIGXFSZ, signal_);
  }
  FullDisk(const FullDisk&) = delete;
  FullDisk& operator=(const FullDisk&) = delete;

 private:
  void (*signal_)(int);
  rlimit before_{};
};

const nlohmann::json kLongSummary = {{"Note", std::string(3000, 'x')}};

TEST(Ndtiff, GoesOnInTheOldFileWhereTheDiskHasNoRoomForANewOnesHead) {
  TemporaryFolder parent;
  const auto folder = parent.path() / "stack";
  NdtiffWriter writer(folder, "cam", kLongSummary, 12000);
  std::vector<cv::Mat> images;
  for (int i = 0; i < 12; ++i) {
    // Each second one is small: it fits into a file that is too full for the one before.
    const cv::Mat image = i % 2 == 0 ? noise(48, 64, CV_8UC1, i) : noise(9, 7, CV_8UC1, i);
    {
      const FullDisk full(100);
      EXPECT_THROW(writer.write({{"time", i}}, image, {}), std::runtime_error);
    }
    if (i % 4 == 2) continue;  // given up
    writer.write({{"time", i}}, image, {});
    images.push_back(image);
  }
  const auto entries = read_ndtiff_index(folder);
  ASSERT_EQ(entries.size(), images.size());
  EXPECT_NE(entries.back().file, entries.front().file);
  std::vector<cv::Mat> pages;
  for (const NdtiffEntry& entry : entries)
    if (pages.empty() || entry.file != entries[pages.size() - 1].file) {
      std::vector<cv::Mat> more;
      ASSERT_TRUE(cv::imreadmulti((folder / entry.file).string(), more, cv::IMREAD_UNCHANGED))
          << entry.file;
      pages.insert(pages.end(), more.begin(), more.end());
    }
  ASSERT_EQ(pages.size(), images.size());
  for (std::size_t i = 0; i < images.size(); ++i)
    EXPECT_EQ(cv::norm(pages[i], images[i], cv::NORM_L1), 0) << i;
}

TEST(Ndtiff, KeepsNothingOpenWhereItsFirstHeadCannotBeWritten) {
  TemporaryFolder parent;
  const auto open_files = [] {
    return std::distance(std::filesystem::directory_iterator("/proc/self/fd"), {});
  };
  const auto before = open_files();
  {
    const FullDisk full(100);
    EXPECT_THROW(NdtiffWriter(parent.path() / "stack", "cam", kLongSummary), std::runtime_error);
  }
  EXPECT_EQ(open_files(), before);
}

TEST(Crc32, AgreesWithThePublishedCheckValue) {
  const std::string digits = "123456789";
  EXPECT_EQ(crc32(digits.data(), digits.size()), 0xCBF43926u);
  EXPECT_EQ(crc32(digits.data() + 2, 7, crc32(digits.data(), 2)), 0xCBF43926u);
  EXPECT_EQ(crc32("", 0), 0u);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
