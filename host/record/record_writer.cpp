// SPDX-License-Identifier: Apache-2.0
#include "host/record/record_writer.h"

#include "devices/time/quiet_thread.h"
#include "host/files/digest.h"
#include "host/record/frame_store.h"

#include <fmt/format.h>

#include <atomic>
#include <condition_variable>
#include <deque>
#include <mutex>
#include <stdexcept>
#include <thread>
#include <utility>
#include <variant>

namespace vitreo {
namespace {

using namespace std::chrono_literals;
using Instant = std::chrono::steady_clock::time_point;

// A single row does not wake the writer: it waits at most so long for others.
constexpr auto kNap = 50ms;
constexpr auto kLookAtDisk = 1s;
// Rows that do wake it: about half of what makes a commit (record_file.cpp).
constexpr std::size_t kWakeRows = 512;

// A job owns what it writes: the caller's span is gone when the thread comes to it. `row` is the
// number that the sample already has in memory, so that the same row can be written twice without
// harm. A frame's pixels are shared with the camera's image and not copied.
struct SampleJob {
  std::size_t stream;
  std::size_t row;
  Time time;
  std::vector<double> values;
};
struct FrameJob {
  std::size_t camera;
  Frame frame;
  MissingFrames missing;
};
struct OtherJob {
  std::function<void(RecordFile&)> run;
};
using Job = std::variant<SampleJob, FrameJob, OtherJob>;

// What a frame holds in memory; what the TIFF takes differs only by its directory.
std::size_t image_bytes(const Frame& frame) { return frame.image.total() * frame.image.elemSize(); }

}  // namespace

struct RecordWriter::State {
  State(const std::filesystem::path& folder, const RunStart& start, const RecordLimits& given)
      : limits(given),
        disk(folder, given.disk),
        file(folder / "run.sqlite", start),
        store(folder, given.largest_stack) {
    // Before the thread: from now on `file` and `store` belong to it, until stop() has joined it.
    disk.make_reserve();
    thread = quiet_thread([this] { run(); });
  }
  ~State() {
    stop();
    disk.give_up_reserve();
  }

  void stop() {
    {
      const std::lock_guard lock(mutex);
      stopping = true;
    }
    work.notify_all();
    if (thread.joinable()) thread.join();
  }

  // The callers' side: the run's threads, which record.

  // An atomic and not the lock: it is asked at every sample.
  void must_be_well() {
    if (has_failed) throw std::runtime_error(fault_text());
  }
  std::string fault_text() {
    const std::lock_guard lock(mutex);
    return fault;
  }

  /// Waits for room in a queue; the time counts as back pressure, with an alarm each time. Throws
  /// std::runtime_error where the disk has failed, or does not answer in time.
  template <class Room>
  void wait_for_room(std::unique_lock<std::mutex>& lock, Room room) {
    if (room()) return;
    const Instant began = std::chrono::steady_clock::now();
    work.notify_one();
    // Waits on the real clock, also under the virtual one: the disk is real, and the run's time
    // stands still meanwhile, so that the record stays the same.
    const bool got =
        space.wait_for(lock, limits.patience, [&] { return room() || !fault.empty(); });
    const double waited =
        std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
    held += waited;
    if (!got)
      set_fault(lock, fmt::format("the recorder's disk has not answered for {:.0f} s", waited));
    if (!fault.empty()) throw std::runtime_error(fault);
    alarms.push_back(
        fmt::format("back pressure: the disk is behind and held up the run for {:.3f} s", waited));
    has_alarms = true;
  }

  /// Rows and image bytes are bounded apart: a queue full of frames does not hold up samples.
  /// The writer is not woken for a single row: it takes what has gathered at its next nap, and a
  /// commit holds many rows.
  void push(Job job, std::size_t rows, std::size_t bytes, bool urgent) {
    std::unique_lock lock(mutex);
    if (rows > 0) wait_for_room(lock, [&] { return queued_rows < limits.queued_rows; });
    if (bytes > 0)
      // A frame larger than the whole queue passes through an empty one.
      wait_for_room(lock, [&] {
        return queued_bytes == 0 || queued_bytes + bytes <= limits.queued_frame_bytes;
      });
    queue.push_back(std::move(job));
    queued_rows += rows;
    queued_bytes += bytes;
    wake = wake || urgent || queued_rows >= kWakeRows || bytes > 0;
    const bool now = wake;
    lock.unlock();
    if (now) work.notify_one();
  }

  /// What does not fit is in the caller's memory, and written from there at the end.
  void push_or_leave(Job job) {
    {
      const std::lock_guard lock(mutex);
      if (queued_rows >= limits.queued_rows) {
        left_out = true;
        return;
      }
      queue.push_back(std::move(job));
      ++queued_rows;
      if (queued_rows < kWakeRows) return;
      wake = true;
    }
    work.notify_one();
  }

  /// False: dropped and counted. The next frame that is recorded states how many were lost before
  /// it.
  bool push_frame(std::size_t camera, const Frame& frame, std::uint64_t lost_before) {
    const std::size_t bytes = image_bytes(frame);
    if (bytes == 0) throw std::invalid_argument("frame: its image is empty");
    MissingFrames missing;
    {
      const std::lock_guard lock(mutex);
      if (camera >= names.size())
        throw std::invalid_argument(fmt::format("frame: camera {} was not added", camera));
      pending[camera].lost += lost_before;
      lost[camera] += lost_before;
      const bool full = queued_bytes > 0 && queued_bytes + bytes > limits.queued_frame_bytes;
      if (full && limits.drop_frames) {
        if (pending[camera].dropped++ == 0) {
          alarms.push_back(fmt::format("{}: frame {} is not recorded: the disk is behind",
                                       names[camera], frame.number));
          has_alarms = true;
        }
        ++dropped[camera];
        return false;
      }
      // Taken before the push: this frame will be recorded, and bears the count.
      missing = std::exchange(pending[camera], {});
    }
    push(FrameJob{camera, frame, missing}, 0, bytes, false);
    return true;
  }

  /// Returns when all that was given is written, or the disk has failed.
  /// A fault ends the wait too: what has not been written then will not be.
  void drain() {
    std::unique_lock lock(mutex);
    wake = true;
    work.notify_one();
    space.wait(lock, [&] { return (queue.empty() && !busy) || !fault.empty(); });
  }

  // The writer's own thread.

  /// The first fault stays. The callback runs without the lock, so that it may call the record.
  void set_fault(std::unique_lock<std::mutex>& lock, const std::string& what) {
    if (!fault.empty()) return;
    fault = what;
    has_failed = true;
    const std::function<void()> call = notify_fault;
    space.notify_all();
    if (!call) return;
    lock.unlock();
    call();
    lock.lock();
  }

  /// Takes the whole queue at each turn and writes it without the lock, so that callers only wait
  /// for the disk where a queue is full. A last turn follows the request to stop.
  void run() {
    Instant looked = std::chrono::steady_clock::now();
    std::unique_lock lock(mutex);
    while (true) {
      work.wait_for(lock, kNap, [&] { return wake || stopping; });
      const bool last = stopping;
      wake = false;
      std::deque<Job> jobs;
      // Rows leave the count at once, image bytes only when each is written (freed()): rows are
      // small, while frames must not fill the memory twice.
      jobs.swap(queue);
      queued_rows = 0;
      busy = true;
      lock.unlock();
      space.notify_all();
      const std::string failed = attempt([&] { work_off(jobs, last, looked); });
      jobs.clear();
      lock.lock();
      busy = false;
      space.notify_all();
      if (!failed.empty()) set_fault(lock, failed);
      // Nothing is lost by it: stop() comes after the run's last record.
      if (last) return;
    }
  }

  /// The error's text; empty: it went well.
  template <class Action>
  static std::string attempt(Action action) {
    try {
      action();
      return "";
    } catch (const std::exception& error) {
      const std::string what = error.what();
      return what.empty() ? "the record cannot be written" : what;
    }
  }

  void work_off(std::deque<Job>& jobs, bool last, Instant& looked) {
    // What is not written now is written again at the end, from memory (RecordFile::end).
    if (has_failed) return give_back(jobs);
    while (!jobs.empty()) {
      const std::string failed =
          attempt([&] { std::visit([this](auto& one) { write(one); }, jobs.front()); });
      jobs.pop_front();
      if (failed.empty()) continue;
      // One failed job ends the turn: the disk is not asked again and again while the run is being
      // stopped.
      give_back(jobs);
      throw std::runtime_error(failed);
    }
    file.commit_if_due();
    // After commit_if_due(): rows of frames wait for their pixels, samples do not.
    store.write_rows(file, last);
    if (last) file.commit();  // so that a reader sees what was left before stop() returns
    if (std::chrono::steady_clock::now() - looked < kLookAtDisk) return;
    looked = std::chrono::steady_clock::now();
    const DiskWatch::Verdict verdict =
        disk.look(file.bytes() + store.bytes(), store.bytes() > 0, looked);
    if (!verdict.stop.empty()) throw std::runtime_error(verdict.stop);
    if (verdict.warning.empty()) return;
    const std::lock_guard lock(mutex);
    alarms.push_back(verdict.warning);
    has_alarms = true;
  }

  /// Frees the room of frames that will not be written, and counts them as dropped.
  void give_back(std::deque<Job>& jobs) {
    for (const Job& job : jobs)
      if (const auto* one = std::get_if<FrameJob>(&job))
        freed(image_bytes(one->frame), one->camera);
  }

  void write(SampleJob& job) { file.sample(job.stream, job.row, job.time, job.values); }
  void write(OtherJob& job) { job.run(file); }
  void write(FrameJob& job) {
    const std::size_t bytes = image_bytes(job.frame);
    try {
      store.write(job.camera, job.frame, job.missing);
    } catch (const std::exception&) {
      freed(bytes, job.camera);
      throw;
    }
    freed(bytes);
  }
  void freed(std::size_t bytes, std::optional<std::size_t> lost_camera = {}) {
    {
      const std::lock_guard lock(mutex);
      queued_bytes -= bytes;
      if (lost_camera) ++dropped[*lost_camera];
    }
    space.notify_all();
  }

  const RecordLimits limits;
  DiskWatch disk;
  RecordFile file;   // the thread's, until it has ended
  FrameStore store;  // likewise

  mutable std::mutex mutex;
  std::condition_variable work;   // for the writer
  std::condition_variable space;  // for the callers
  std::deque<Job> queue;
  std::size_t queued_rows = 0;
  std::size_t queued_bytes = 0;
  bool wake = false;
  bool busy = false;  // jobs are being written
  bool stopping = false;
  std::string fault;
  std::function<void()> notify_fault;
  std::vector<std::string> alarms;
  std::vector<std::string> names;      // of the cameras
  std::vector<MissingFrames> pending;  // since the camera's last recorded frame
  std::vector<std::uint64_t> dropped;  // in all
  std::vector<std::uint64_t> lost;
  double held = 0;
  bool left_out = false;  // rows that the queue had no room for
  // For callers, without the lock.
  std::atomic<bool> has_failed{false};
  std::atomic<bool> has_alarms{false};
  std::thread thread;  // last: it uses all of the above
};

RecordWriter::RecordWriter(const std::filesystem::path& folder, const RunStart& start,
                           const RecordLimits& limits)
    : state_(std::make_unique<State>(folder, start, limits)) {}
RecordWriter::~RecordWriter() = default;

void RecordWriter::sample(std::size_t stream, std::size_t row, Time time,
                          std::span<const double> values) {
  state_->must_be_well();
  state_->push(SampleJob{stream, row, time, {values.begin(), values.end()}}, 1, 0, false);
}

// Events, results and the like are in the caller's memory already (RunData), which finish() writes
// again after a fault: nothing is lost by leaving it.
void RecordWriter::post(std::function<void(RecordFile&)> job, bool at_once) {
  if (state_->has_failed) return;
  try {
    state_->push(OtherJob{std::move(job)}, 1, 0, at_once);
  } catch (const std::runtime_error&) {  // fault came while it waited
    if (!state_->has_failed) throw;
  }
}

void RecordWriter::offer(std::function<void(RecordFile&)> job) {
  if (state_->has_failed) return;
  state_->push_or_leave(OtherJob{std::move(job)});
}

void RecordWriter::add_camera(const RecordedCameraInfo& info) {
  {
    const std::lock_guard lock(state_->mutex);
    state_->pending.emplace_back();
    state_->dropped.push_back(0);
    state_->lost.push_back(0);
    state_->names.push_back(info.camera);
  }
  // In the queue and not at once: `store` is the thread's. Its cameras then have the same order as
  // `names`, and come before their first frame.
  const auto add = [state = state_.get(), info](RecordFile& file) {
    state->store.add(info);
    file.camera(info);
  };
  post(add, true);
}

bool RecordWriter::frame(std::size_t camera, const Frame& frame, std::uint64_t lost_before) {
  state_->must_be_well();
  return state_->push_frame(camera, frame, lost_before);
}

void RecordWriter::on_fault(std::function<void()> call) {
  const std::lock_guard lock(state_->mutex);
  state_->notify_fault = std::move(call);
}

std::string RecordWriter::fault() const { return state_->fault_text(); }

// Asked after every sample: without an alarm it costs one atomic read.
std::vector<std::string> RecordWriter::drain_alarms() {
  if (!state_->has_alarms) return {};
  const std::lock_guard lock(state_->mutex);
  state_->has_alarms = false;
  return std::exchange(state_->alarms, {});
}

double RecordWriter::held() const {
  const std::lock_guard lock(state_->mutex);
  return state_->held;
}

std::vector<std::uint64_t> RecordWriter::dropped() const {
  const std::lock_guard lock(state_->mutex);
  return state_->dropped;
}

std::vector<std::uint64_t> RecordWriter::lost() const {
  const std::lock_guard lock(state_->mutex);
  return state_->lost;
}

std::vector<FrameRow> RecordWriter::frames() const {
  if (state_->thread.joinable()) state_->drain();
  return state_->store.rows();
}

void RecordWriter::stop() { state_->stop(); }

void RecordWriter::late_event(std::size_t number, const Event& event) noexcept {
  try {
    state_->file.event(number, event);
  } catch (const std::exception&) {
    // The report has it, and the end record is on the disk already or comes next.
  }
}

void RecordWriter::finish(const RunEnd& end, const RunData& data) {
  state_->disk.give_up_reserve();  // now there is room for what a full disk kept out
  const bool whole = !state_->has_failed && !state_->left_out;
  state_->file.end(end, data, whole ? std::vector<FrameRow>{} : state_->store.rows(), whole);
}

void RecordWriter::close() { state_->file.close(); }

}  // namespace vitreo
