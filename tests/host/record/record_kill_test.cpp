// A recording process is killed with SIGKILL at random moments: what is older than a second is
// there, and it opens.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/digest.h"
#include "host/files/ndtiff.h"
#include "host/files/sqlite.h"
#include "host/record/recorder.h"
#include "host/record/run_lock.h"
#include "tests/host/record/run_fixture.h"
#include "tests/long_form.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <random>
#include <sys/mman.h>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Steady = std::chrono::steady_clock;

/// 10 in `make test`, 200 in `make test-long`.
int kills() { return long_or_short(200, 10); }
constexpr int kAtOnce = 10;

cv::Mat picture(std::int64_t number) {
  cv::Mat image(48, 64, CV_8UC1);
  for (int i = 0; i < image.rows * image.cols; ++i)
    image.data[i] = static_cast<uchar>(number * 7 + i);
  return image;
}

/// Records 1 kHz of samples and 100 frames a second until it is killed. A sample's time is the
/// steady clock's.
[[noreturn]] void record_until_killed(const std::filesystem::path& parent,
                                      std::atomic<std::int64_t>& began) {
  test::ReportedRecorder recorder(parent, test::servo_start());
  const int stream = recorder.add_stream({"pose", "test", {{"x", "m"}, {"y", "m"}, {"z", "m"}}});
  const int camera = recorder.add_camera({"top_camera", "test camera", 1, 0.01, 1e-6});
  for (std::int64_t i = 0;; ++i) {
    const Time now = Steady::now().time_since_epoch();
    recorder.sample(stream, now, std::array{static_cast<double>(i), -1.0, 1.0});
    if (i % 10 == 0)
      recorder.frame(camera, Frame{picture(i / 10), static_cast<std::uint64_t>(i / 10), now, now});
    if (i == 0) began = now.count();
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

/// Shared with the child: the time of its first sample, ns; 0 before.
std::atomic<std::int64_t>* shared_time() {
  void* const page = mmap(nullptr, sizeof(std::atomic<std::int64_t>), PROT_READ | PROT_WRITE,
                          MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  return new (page) std::atomic<std::int64_t>(0);
}

struct Killed {
  ~Killed() { munmap(began, sizeof *began); }
  test::TemporaryFolder parent;
  std::atomic<std::int64_t>* began = shared_time();
  pid_t pid = -1;
  Time at{};
};

/// How old the youngest row was, s.
double check_samples(const std::filesystem::path& folder, Time killed, Time began) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  Statement check = database.prepare("PRAGMA integrity_check");
  EXPECT_TRUE(check.step());
  EXPECT_EQ(check.text(0), "ok");
  Statement rows = database.prepare("SELECT seq, t_ns, x FROM sample_pose ORDER BY seq");
  std::int64_t count = 0, last = began.count();
  while (rows.step()) {
    EXPECT_EQ(rows.integer(0), ++count) << "a row in the middle is missing";
    EXPECT_EQ(rows.real(2), static_cast<double>(count - 1));
    last = rows.integer(1);
  }
  // The next sample, which is not there, came after `last`: it was younger than a second when the
  // kill came.
  const double age = to_seconds(killed - Time(last));
  EXPECT_LT(age, 1.0) << count << " rows";
  return age;
}

void check_frames(const std::filesystem::path& folder) {
  Database database((folder / "run.sqlite").string(), Database::Mode::read_only);
  const auto stack = folder / "frames" / "top_camera";
  if (!std::filesystem::exists(stack / "NDTiff.index")) return;
  const auto entries = read_ndtiff_index(stack);
  Statement rows = database.prepare("SELECT number, offset, crc32 FROM frame ORDER BY seq");
  std::size_t named = 0;
  while (rows.step()) {
    ASSERT_LT(named, entries.size()) << "a row names a frame that the index does not know";
    const NdtiffEntry& entry = entries[named++];
    EXPECT_EQ(static_cast<std::int64_t>(entry.pixels_at), rows.integer(1));
    const cv::Mat image = read_ndtiff_image(stack, entry);
    EXPECT_EQ(crc32(image.data, entry.pixel_bytes()), static_cast<std::uint32_t>(rows.integer(2)));
    EXPECT_EQ(cv::norm(image, picture(rows.integer(0)), cv::NORM_L1), 0);
  }
  for (const NdtiffEntry& entry : entries)
    read_ndtiff_image(stack, entry);  // throws where a page is not whole
}

void check(Killed& one, std::vector<double>& ages) {
  int status = 0;
  ASSERT_EQ(waitpid(one.pid, &status, 0), one.pid);
  ASSERT_TRUE(WIFSIGNALED(status)) << "it ended by itself: " << status;
  const auto folder = std::filesystem::directory_iterator(one.parent.path())->path();
  EXPECT_FALSE(RunLock::is_held(folder));
  ages.push_back(check_samples(folder, one.at, Time(one.began->load())));
  check_frames(folder);
}

TEST(RecordKill, LosesNothingOlderThanASecond) {
  std::mt19937 random(20261121);
  std::vector<double> ages;  // s
  for (int done = 0; done < kills(); done += kAtOnce) {
    std::array<Killed, kAtOnce> children;
    std::multimap<double, Killed*> order;
    for (Killed& one : children) {
      one.pid = fork();
      ASSERT_GE(one.pid, 0);
      if (one.pid == 0) record_until_killed(one.parent.path(), *one.began);
      order.emplace(std::uniform_real_distribution(0.01, 1.5)(random), &one);
    }
    for (const Killed& one : children)
      while (!*one.began) std::this_thread::sleep_for(std::chrono::milliseconds(2));
    const auto all_record = Steady::now();
    for (const auto& [after, one] : order) {
      std::this_thread::sleep_until(all_record + std::chrono::duration<double>(after));
      one->at = Steady::now().time_since_epoch();
      kill(one->pid, SIGKILL);
    }
    for (Killed& one : children) check(one, ages);
  }
  std::sort(ages.begin(), ages.end());
  std::printf("%zu kills; age of the youngest row: median %.0f ms, p99 %.0f ms, largest %.0f ms\n",
              ages.size(), 1e3 * ages[ages.size() / 2], 1e3 * ages[ages.size() * 99 / 100],
              1e3 * ages.back());
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
