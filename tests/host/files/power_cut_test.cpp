// A power cut, by its model: what was written since a file was last synchronized may be on the disk
// or not, write by write, in any order, and in parts; what was synchronized is there. The record
// opens, and lacks nothing older than a second. What this process writes is written down by
// standing before the C library's calls.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"
#include "host/files/ndtiff.h"
#include "host/files/sqlite.h"
#include "host/record/recorder.h"
#include "tests/host/record/run_fixture.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <array>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <fstream>
#include <map>
#include <mutex>
#include <random>
#include <string>
#include <sys/syscall.h>
#include <thread>
#include <unistd.h>
#include <vector>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using Steady = std::chrono::steady_clock;

struct Act {
  enum class Kind { write, truncate, sync, remove } kind;
  std::string file;
  std::uint64_t at = 0;  // of a write; of a truncation: the new size
  std::string bytes{};
  Time time = Steady::now().time_since_epoch();
};

/// What was done to the files below a folder, in order.
struct Journal {
  std::mutex mutex;
  std::string below;
  std::vector<Act> acts;
};
/// The journal that is kept now: the C library's calls have no argument for it.
std::atomic<Journal*>& kept() {
  static std::atomic<Journal*> journal{nullptr};
  return journal;
}

bool note(int descriptor, Act act) {
  Journal* const journal = kept();
  if (journal == nullptr) return false;
  std::array<char, 4096> path{};
  const std::string link = "/proc/self/fd/" + std::to_string(descriptor);
  if (::readlink(link.c_str(), path.data(), path.size() - 1) <= 0) return false;
  act.file = path.data();
  if (act.file.rfind(journal->below, 0) != 0) return false;
  act.file.erase(0, journal->below.size() + 1);
  const std::lock_guard lock(journal->mutex);
  journal->acts.push_back(std::move(act));
  return true;
}

ssize_t write_and_note(int descriptor, const void* bytes, std::size_t count, off64_t at) {
  const ssize_t done = ::syscall(SYS_pwrite64, descriptor, bytes, count, at);
  if (done > 0)
    note(descriptor,
         {Act::Kind::write, "", static_cast<std::uint64_t>(at),
          std::string(static_cast<const char*>(bytes), static_cast<std::size_t>(done))});
  return done;
}

int truncate_and_note(int descriptor, off64_t size) {
  const auto done = static_cast<int>(::syscall(SYS_ftruncate, descriptor, size));
  if (done == 0) note(descriptor, {Act::Kind::truncate, "", static_cast<std::uint64_t>(size)});
  return done;
}

/// A removal counts as on the disk: who relies on one (SQLite, of its rollback journal)
/// synchronizes the folder at once.
int remove_and_note(const char* path) {
  const auto done = static_cast<int>(::syscall(SYS_unlink, path));
  Journal* const journal = kept();
  if (done != 0 || journal == nullptr || std::string(path).rfind(journal->below, 0) != 0)
    return done;
  const std::lock_guard lock(journal->mutex);
  journal->acts.push_back({Act::Kind::remove, path + journal->below.size() + 1});
  return done;
}

/// Of the journal's files the disk need not do it: the model says what is there.
int sync_and_note(int descriptor, long call) {
  if (note(descriptor, {Act::Kind::sync, ""})) return 0;
  return static_cast<int>(::syscall(call, descriptor));
}

}  // namespace
}  // namespace vitreo

extern "C" {
ssize_t pwrite(int descriptor, const void* bytes, size_t count, off_t at) {
  return vitreo::write_and_note(descriptor, bytes, count, at);
}
ssize_t pwrite64(int descriptor, const void* bytes, size_t count, off64_t at) {
  return vitreo::write_and_note(descriptor, bytes, count, at);
}
int ftruncate(int descriptor, off_t size) noexcept {
  return vitreo::truncate_and_note(descriptor, size);
}
int ftruncate64(int descriptor, off64_t size) noexcept {
  return vitreo::truncate_and_note(descriptor, size);
}
int unlink(const char* path) noexcept { return vitreo::remove_and_note(path); }
int fsync(int descriptor) { return vitreo::sync_and_note(descriptor, SYS_fsync); }
int fdatasync(int descriptor) { return vitreo::sync_and_note(descriptor, SYS_fdatasync); }
}

namespace vitreo {
namespace {

cv::Mat picture(std::int64_t number) {
  cv::Mat image(48, 64, CV_8UC1);
  for (int i = 0; i < image.rows * image.cols; ++i)
    image.data[i] = static_cast<uchar>(number * 7 + i);
  return image;
}

/// A sample each 2 ms and a frame each 20 ms, their times the steady clock's; returns those of the
/// samples.
std::vector<Time> record(const fs::path& parent, std::chrono::milliseconds span) {
  test::ReportedRecorder recorder(parent, test::servo_start());
  const int stream = recorder.add_stream({"pose", "test", {{"x", "m"}}});
  const int camera = recorder.add_camera({"top_camera", "test camera", 1, 0.02, 1e-6});
  std::vector<Time> times;
  const auto begin = Steady::now();
  for (std::int64_t i = 0; Steady::now() - begin < span; ++i) {
    times.push_back(Steady::now().time_since_epoch());
    recorder.sample(stream, times.back(), std::array{static_cast<double>(i)});
    if (i % 10 == 0)
      recorder.frame(camera, Frame{picture(i / 10), static_cast<std::uint64_t>(i / 10),
                                   times.back(), times.back()});
    std::this_thread::sleep_for(std::chrono::milliseconds(2));
  }
  kept() = nullptr;  // the end of the run is none of the cut's business
  recorder.finish({Outcome::completed, "", 1, 1});
  return times;
}

void apply(std::string& content, const Act& act, std::size_t bytes) {
  if (act.kind == Act::Kind::truncate) return content.resize(act.at);
  if (content.size() < act.at + bytes) content.resize(act.at + bytes);
  content.replace(act.at, bytes, act.bytes, 0, bytes);
}

/// The files as they may be after a cut before act `cut`.
std::map<std::string, std::string> after_cut(const Journal& journal, std::size_t cut,
                                             std::mt19937& random) {
  std::map<std::string, std::size_t> synced;  // acts before this are on the disk
  for (std::size_t i = 0; i < cut; ++i)
    if (journal.acts[i].kind == Act::Kind::sync) synced[journal.acts[i].file] = i;
  std::map<std::string, std::string> files;
  for (std::size_t i = 0; i < cut; ++i) {
    const Act& act = journal.acts[i];
    if (act.kind == Act::Kind::remove) files.erase(act.file);
    if (act.kind == Act::Kind::remove || act.kind == Act::Kind::sync) continue;
    std::string& content = files[act.file];
    const auto until = synced.find(act.file);
    std::size_t bytes = act.bytes.size();
    if (until == synced.end() || i > until->second) {
      if (random() % 2 == 0) continue;  // never written
      if (bytes > 512 && random() % 3 == 0)
        bytes = random() % (bytes / 512) * 512;  // torn between two sectors
    }
    apply(content, act, bytes);
  }
  return files;
}

/// How many rows there are: the first ones, without a gap.
std::int64_t count_samples(const fs::path& folder) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_write);
  Statement check = database.prepare("PRAGMA integrity_check");
  EXPECT_TRUE(check.step());
  EXPECT_EQ(check.text(0), "ok");
  // In its first moments the record may not know of its stream yet.
  Statement known = database.prepare("SELECT 1 FROM sqlite_master WHERE name='sample_pose'");
  if (!known.step()) return 0;
  while (known.step()) continue;
  Statement rows = database.prepare("SELECT seq, x FROM sample_pose ORDER BY seq");
  std::int64_t count = 0;
  while (rows.step()) {
    EXPECT_EQ(rows.integer(0), ++count) << "a row in the middle is missing";
    EXPECT_EQ(rows.real(1), static_cast<double>(count - 1));
  }
  const auto stack = folder / "frames" / "top_camera";
  std::vector<NdtiffEntry> entries;
  if (fs::exists(stack / "NDTiff.index")) entries = mend_ndtiff(stack);
  Statement frames = database.prepare("SELECT number, crc32 FROM frame ORDER BY seq");
  for (std::size_t i = 0; frames.step(); ++i) {
    if (i >= entries.size()) {
      ADD_FAILURE() << "row " << i << " names a frame that is not there";
      break;
    }
    const cv::Mat image = read_ndtiff_image(stack, entries[i]);
    EXPECT_EQ(crc32(image.data, entries[i].pixel_bytes()),
              static_cast<std::uint32_t>(frames.integer(1)));
  }
  return count;
}

TEST(PowerCut, TakesNothingThatIsOlderThanASecond) {
  const test::TemporaryFolder parent;
  Journal journal;
  journal.below = fs::canonical(parent.path()).string();
  kept() = &journal;
  const std::vector<Time> times = record(parent.path(), std::chrono::milliseconds(2500));
  std::mt19937 random(20261122);
  std::size_t begun =
      0;  // from here on the record promises something: its first row could be there
  while (begun < journal.acts.size() && journal.acts[begun].time < times.front()) ++begun;
  ASSERT_LT(begun + 20, journal.acts.size());
  double oldest = 0;  // s, of what was lost
  for (int i = 0; i < 60; ++i) {
    const std::size_t cut = begun + random() % (journal.acts.size() - begun);
    const test::TemporaryFolder found;
    for (const auto& [name, content] : after_cut(journal, cut, random)) {
      const fs::path file =
          found.path() / fs::path(name).lexically_relative(*fs::path(name).begin());
      fs::create_directories(file.parent_path());
      std::ofstream(file, std::ios::binary) << content;
    }
    SCOPED_TRACE("cut before act " + std::to_string(cut) + " of " +
                 std::to_string(journal.acts.size()));
    const auto count = static_cast<std::size_t>(count_samples(found.path()));
    ASSERT_LE(count, times.size());
    if (count == times.size() || times[count] > journal.acts[cut].time) continue;
    oldest = std::max(oldest, to_seconds(journal.acts[cut].time - times[count]));
  }
  EXPECT_LT(oldest, 1.0) << "the first row that was lost was so old, s";
  std::printf("60 cuts: the oldest row that was lost was %.0f ms old\n", 1e3 * oldest);
}

}  // namespace
}  // namespace vitreo
