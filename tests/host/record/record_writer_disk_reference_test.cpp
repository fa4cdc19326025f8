// The record's writer on a disk that is slow, silent or broken, against its header and
// docs/records.md.
// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_writer.h"
#include "tests/host/record/record_writer_reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <future>
#include <string>
#include <thread>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using reference::add_stream;
using reference::camera_of;
using reference::Folder;
using reference::gray;
using reference::HeldDisk;
using reference::Rows;
using reference::small_limits;
using reference::within;

const StreamInfo kStream{"s", "x", {{"v", "m"}}, "c"};
const std::vector<double> kValue{2.5};

RunData data_of(std::size_t samples) {
  RunData data;
  data.streams = {{kStream, {}, {}}};
  for (std::size_t i = 0; i < samples; ++i) {
    data.streams[0].times.push_back(Time(i));
    data.streams[0].values.push_back(kValue[0]);
  }
  return data;
}
std::string error_of(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}
/// Gives samples from `row` on, which are numbered and timed by their row.
void give(RecordWriter& writer, std::size_t row, std::size_t count) {
  for (std::size_t i = row; i < row + count; ++i) writer.sample(0, i, Time(i), kValue);
}

TEST(RecordWriterDiskReference, a_full_queue_holds_samples_up_and_says_for_how_long) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_rows = 3;
  RecordWriter writer(folder.path(), {}, limits);
  add_stream(writer, kStream);
  std::atomic<int> done{0};
  std::thread producer, poster;
  {
    HeldDisk held(writer);
    give(writer, 0, 3);  // do not wait
    EXPECT_EQ(writer.held(), 0);
    const auto offered = std::chrono::steady_clock::now();
    for (int i = 0; i < 10; ++i) writer.offer([](RecordFile&) { ADD_FAILURE(); });
    EXPECT_LT(std::chrono::steady_clock::now() - offered, 100ms);
    producer = std::thread([&] {
      give(writer, 3, 1);
      ++done;
    });
    poster = std::thread([&] {
      writer.post([&](RecordFile&) { ++done; }, false);
      ++done;
    });
    std::this_thread::sleep_for(60ms);
    EXPECT_EQ(done, 0);
    held.release();
  }
  producer.join();
  poster.join();
  give(writer, 4, 6);
  EXPECT_GE(writer.held(), 0.05);
  EXPECT_LT(writer.held(), 5);
  const auto alarms = writer.drain_alarms();
  ASSERT_FALSE(alarms.empty());
  const std::string words = "back pressure: the disk is behind and held up the run for ";
  EXPECT_EQ(alarms[0].substr(0, words.size()), words);
  EXPECT_GE(std::stod(alarms[0].substr(words.size())), 0.05);
  RunData data = data_of(10);
  data.links = {{Time(3), "stage", "tcp:a", "to", {1, 2}}, {Time(4), "stage", "tcp:a", "from", {}}};
  writer.stop();
  EXPECT_EQ(done, 3);
  writer.finish({}, data);
  EXPECT_EQ(folder.rows("select count(*), min(seq), max(seq) from sample_s"),
            (Rows{{"10", "1", "10"}}));
  // What was offered in vain is written at the end.
  EXPECT_EQ(folder.rows("select t_ns, event, bytes from link order by seq"),
            (Rows{{"3", "to", "0102"}, {"4", "from", ""}}));
}

TEST(RecordWriterDiskReference, under_the_virtual_clock_a_frame_without_room_waits) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_frame_bytes = 100;  // two of them
  RecordWriter writer(folder.path(), {}, limits);
  writer.add_camera(camera_of("top"));
  std::atomic<int> given{0};
  HeldDisk held(writer);
  std::thread producer([&] {
    for (std::uint64_t i = 0; i < 4; ++i, ++given) EXPECT_TRUE(writer.frame(0, gray(i)));
  });
  EXPECT_TRUE(within(2s, [&] { return given == 2; }));
  std::this_thread::sleep_for(60ms);
  EXPECT_EQ(given, 2);
  held.release();
  producer.join();
  EXPECT_EQ(writer.frames().size(), 4U);
  EXPECT_EQ(writer.dropped(), std::vector<std::uint64_t>{0});
  EXPECT_GE(writer.held(), 0.05);
}

TEST(RecordWriterDiskReference, a_disk_that_does_not_answer_has_failed_after_the_patience) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_rows = 2;
  limits.patience = 80ms;
  RecordWriter writer(folder.path(), {}, limits);
  writer.add_camera(camera_of("top"));
  add_stream(writer, kStream);
  std::atomic<int> calls{0};
  writer.on_fault([&] { ++calls; });
  HeldDisk held(writer);
  give(writer, 0, 2);
  EXPECT_EQ(writer.fault(), "");
  const auto begun = std::chrono::steady_clock::now();
  const std::string error = error_of([&] { give(writer, 2, 1); });
  EXPECT_GE(std::chrono::steady_clock::now() - begun, 80ms);
  EXPECT_NE(error.find("disk has not answered"), std::string::npos) << error;
  EXPECT_EQ(writer.fault(), error);
  EXPECT_EQ(error_of([&] { give(writer, 2, 1); }), error);
  EXPECT_EQ(error_of([&] { writer.frame(0, gray(1)); }), error);
  EXPECT_EQ(writer.frames().size(), 0U);  // without waiting for the disk
  held.release();
  EXPECT_TRUE(within(1s, [&] { return calls == 1; }));
  writer.stop();
  EXPECT_EQ(calls, 1);
  writer.finish({}, data_of(3));
  EXPECT_EQ(folder.rows("select count(*) from sample_s"), (Rows{{"3"}}));
}

TEST(RecordWriterDiskReference, what_a_failed_disk_did_not_take_is_written_at_the_end) {
  for (const bool told : {true, false}) {
    const Folder folder;
    RecordWriter writer(folder.path(), {}, small_limits());
    writer.add_camera(camera_of("top"));
    add_stream(writer, kStream);
    std::atomic<int> calls{0};
    std::thread::id caller;
    writer.on_fault([&] {
      caller = std::this_thread::get_id();
      ++calls;
    });
    if (!told) writer.on_fault({});
    give(writer, 0, 4);
    writer.post([](RecordFile&) { throw std::runtime_error("the disk burns"); }, true);
    ASSERT_TRUE(within(1s, [&] { return writer.fault() == "the disk burns"; }));
    EXPECT_EQ(error_of([&] { give(writer, 4, 1); }), "the disk burns");
    EXPECT_EQ(error_of([&] { writer.frame(0, gray(1)); }), "the disk burns");
    EXPECT_EQ(writer.frames().size(), 0U);
    const auto event = [](RecordFile& file) { file.event(0, {Time(1), "note", "refused"}); };
    EXPECT_EQ(error_of([&] { writer.post(event, true); }), "");  // left to finish()
    EXPECT_EQ(error_of([&] { writer.offer(event); }), "");
    writer.stop();
    EXPECT_EQ(calls, told ? 1 : 0);
    EXPECT_NE(caller, std::this_thread::get_id());
    RunData data = data_of(6);
    data.events = {{Time(1), "note", "of the data"}};
    writer.finish({Outcome::aborted, "the disk burns", 1, 2}, data);
    EXPECT_EQ(folder.rows("select seq, t_ns, v from sample_s"), (Rows{{"1", "0", "2.5"},
                                                                      {"2", "1", "2.5"},
                                                                      {"3", "2", "2.5"},
                                                                      {"4", "3", "2.5"},
                                                                      {"5", "4", "2.5"},
                                                                      {"6", "5", "2.5"}}));
    EXPECT_EQ(folder.rows("select text from event"), (Rows{{"of the data"}}));
    EXPECT_EQ(folder.rows("select exit_status, reason from stop"),
              (Rows{{"aborted", "the disk burns"}}));
  }
}

TEST(RecordWriterDiskReference, frames_and_samples_wait_for_room_of_their_own) {
  for (const bool frames_first : {true, false}) {
    const Folder folder;
    RecordLimits limits = small_limits();
    limits.queued_rows = 3;
    limits.queued_frame_bytes = 100;  // two of them
    RecordWriter writer(folder.path(), {}, limits);
    writer.add_camera(camera_of("top"));
    add_stream(writer, kStream);
    HeldDisk held(writer);
    std::atomic<bool> all_given{false};
    const auto give_frames = [&] {
      for (std::uint64_t i = 0; i < 2; ++i) EXPECT_TRUE(writer.frame(0, gray(i)));
    };
    std::thread producer([&] {
      if (frames_first) give_frames();
      give(writer, 0, 3);
      if (!frames_first) give_frames();
      all_given = true;
    });
    EXPECT_TRUE(within(2s, [&] { return all_given.load(); })) << frames_first;
    held.release();
    producer.join();
    EXPECT_EQ(writer.held(), 0);
  }
}

// In real time a frame that does not fit is dropped; samples before it take none of its room, and
// what was written gives it back.
TEST(RecordWriterDiskReference, samples_take_no_room_of_frames) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_frame_bytes = 100;  // two
  limits.drop_frames = true;
  RecordWriter writer(folder.path(), {}, limits);
  writer.add_camera(camera_of("top"));
  add_stream(writer, kStream);
  {
    HeldDisk held(writer);
    give(writer, 0, 5);
    EXPECT_TRUE(writer.frame(0, gray(1)));
    EXPECT_TRUE(writer.frame(0, gray(2)));
    EXPECT_FALSE(writer.frame(0, gray(3)));
  }
  EXPECT_EQ(writer.frames().size(), 2U);
  {
    HeldDisk held(writer);
    EXPECT_TRUE(writer.frame(0, gray(4)));
    EXPECT_TRUE(writer.frame(0, gray(5)));
  }
  EXPECT_EQ(writer.frames().size(), 4U);
  EXPECT_EQ(writer.dropped(), std::vector<std::uint64_t>{1});
}

TEST(RecordWriterDiskReference, a_frame_larger_than_the_queue_passes_through_an_empty_one) {
  for (const bool drop : {true, false}) {
    const Folder folder;
    RecordLimits limits = small_limits();
    limits.queued_frame_bytes = 40;  // less than one
    limits.drop_frames = drop;
    RecordWriter writer(folder.path(), {}, limits);
    writer.add_camera(camera_of("top"));
    add_stream(writer, kStream);
    HeldDisk held(writer);
    std::atomic<bool> all_given{false};
    std::thread producer([&] {
      EXPECT_TRUE(writer.frame(0, gray(1)));
      give(writer, 0, 4);  // these do not wait for it
      all_given = true;
    });
    EXPECT_TRUE(within(2s, [&] { return all_given.load(); })) << drop;
    held.release();
    producer.join();
    EXPECT_EQ(writer.held(), 0);
    EXPECT_EQ(writer.frames().size(), 1U);
  }
}

TEST(RecordWriterDiskReference, what_is_offered_takes_room_and_waits_for_none) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_rows = 3;
  RecordWriter writer(folder.path(), {}, limits);
  std::atomic<int> run{0};
  HeldDisk held(writer);
  for (int i = 0; i < 5; ++i) writer.offer([&](RecordFile&) { ++run; });
  held.release();
  writer.stop();
  EXPECT_EQ(run, 3);
}

// A job that is being written is not written yet.
TEST(RecordWriterDiskReference, the_frames_are_those_that_are_written) {
  const Folder folder;
  RecordWriter writer(folder.path(), {}, small_limits());
  std::atomic<bool> answered{false};
  HeldDisk held(writer);
  std::thread reader([&] {
    writer.frames();
    answered = true;
  });
  std::this_thread::sleep_for(60ms);
  EXPECT_FALSE(answered);
  held.release();
  reader.join();
}

// A caller waits for room in the queue, and not until the disk has taken what came before: the
// second job holds the writer when there is room again.
TEST(RecordWriterDiskReference, there_is_room_as_soon_as_the_writer_takes_the_queue) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.queued_rows = 1;
  RecordWriter writer(folder.path(), {}, limits);
  add_stream(writer, kStream);
  std::promise<void> second;
  const std::shared_future<void> opened = second.get_future().share();
  std::atomic<bool> given{false};
  HeldDisk held(writer);
  // The queue is full. The job may still wake up when the promise is gone.
  writer.post([opened](RecordFile&) { opened.wait(); }, false);
  std::thread producer([&] {
    give(writer, 0, 1);
    given = true;
  });
  std::this_thread::sleep_for(60ms);
  EXPECT_FALSE(given);
  held.release();
  EXPECT_TRUE(within(4s, [&] { return given.load(); }));
  second.set_value();
  producer.join();
}

// Else it waits for others: a writer that is not woken comes every 50 ms.
TEST(RecordWriterDiskReference, a_job_to_be_done_at_once_wakes_the_writer) {
  const Folder folder;
  RecordWriter writer(folder.path(), {}, small_limits());
  std::vector<double> waited;
  for (int i = 0; i < 31; ++i) {
    std::promise<void> done;
    const auto begun = std::chrono::steady_clock::now();
    writer.post([&](RecordFile&) { done.set_value(); }, true);
    done.get_future().wait();
    waited.push_back(
        std::chrono::duration<double>(std::chrono::steady_clock::now() - begun).count());
  }
  std::ranges::nth_element(waited, waited.begin() + 15);
  EXPECT_LT(waited[15], 0.025);  // the median: half a nap, on a machine that is busy too
}

TEST(RecordWriterDiskReference, a_disk_that_will_not_last_is_said_once) {
  const Folder folder;
  RecordLimits limits = small_limits();
  limits.disk.free_bytes = [](const std::filesystem::path&) { return std::uint64_t{5000000000}; };
  limits.disk.warn_seconds = 1e10;  // longer than a disk on which nothing is written lasts
  RecordWriter writer(folder.path(), {}, limits);
  std::vector<std::string> alarms;
  const auto drained = [&] {
    for (const std::string& alarm : writer.drain_alarms()) alarms.push_back(alarm);
    return !alarms.empty();
  };
  EXPECT_TRUE(within(5s, drained));
  std::this_thread::sleep_for(1200ms);  // it looks every second
  drained();
  ASSERT_EQ(alarms.size(), 1U);
  EXPECT_EQ(alarms[0].substr(0, 16), "the disk fills: ");
  EXPECT_EQ(writer.fault(), "");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
