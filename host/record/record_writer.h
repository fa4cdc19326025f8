// Record writer: the recorder's own thread, which takes rows and frames from bounded queues and is
// the only one that writes them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "host/record/disk_watch.h"
#include "host/record/record_file.h"
#include "host/record/run_data.h"

#include <chrono>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

struct RecordLimits {
  std::size_t queued_rows = 65536;  // then the next sample waits: samples are never dropped
  std::size_t queued_frame_bytes = 256u << 20;  // then the next frame is dropped or waits
  bool drop_frames = false;  // real time: dropped, counted, alarmed. Else the caller waits
  /// For a disk that does not answer; then recording has failed.
  std::chrono::milliseconds patience{10000};
  std::uint64_t largest_stack = 0xFFFFFFFF;  // bytes of one TIFF file
  DiskLimits disk;
};

/// What is given is on the disk within a second; samples, rows and frames in the order in which
/// they came. Once the disk has failed, or is nearly full, every call throws std::runtime_error
/// saying so: the run is to be ended.
class RecordWriter {
 public:
  /// The start record is on the disk when this returns.
  RecordWriter(const std::filesystem::path& folder, const RunStart& start,
               const RecordLimits& limits);
  ~RecordWriter();

  void sample(std::size_t stream, std::size_t row, Time time, std::span<const double> values);
  /// Anything else that goes into run.sqlite, such as an event; after a fault it is left to
  /// finish(). `at_once`: the writer is woken for it.
  void post(std::function<void(RecordFile&)> job, bool at_once);
  /// As post(), but where the queue is full it does not wait: the row is left to finish().
  void offer(std::function<void(RecordFile&)> job);
  /// A camera whose frames follow; they count from 0 in the order of these calls.
  void add_camera(const RecordedCameraInfo& info);
  /// False: dropped, because the disk is behind. `lost_before`: exposures since the frame before
  /// that never came.
  bool frame(std::size_t camera, const Frame& frame, std::uint64_t lost_before = 0);

  /// Called once, from the writer's thread, when the disk fails or is nearly full. Set it before it
  /// can; an empty one unsets.
  void on_fault(std::function<void()> call);
  std::string fault() const;  // empty: none
  /// What is to be said in the record, in order; each is handed out once.
  std::vector<std::string> drain_alarms();
  double held() const;                         // s for which callers had to wait
  std::vector<std::uint64_t> dropped() const;  // frames, a camera
  std::vector<std::uint64_t> lost() const;     // exposures that never came, a camera
  /// Waits until all that was given is written, or the disk has failed; then those that are.
  std::vector<FrameRow> frames() const;
  /// Writes what is left and ends the thread. What follows is called after it, and writes at once.
  void stop();
  /// What the disk refuses is left out.
  void late_event(std::size_t number, const Event& event) noexcept;
  /// The end record, and again what a failed disk did not take; an error is thrown when all that
  /// could be saved was.
  void finish(const RunEnd& end, const RunData& data);
  void close();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
