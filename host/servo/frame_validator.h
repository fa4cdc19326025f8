// Validation of what a camera or a pose sensor delivers to the loop: time stamps that are in order
// and of now, images that change, positions that are finite.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/servo/stamp_watch.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <deque>
#include <optional>
#include <string>
#include <utility>

namespace vitreo {

/// How much longer than usual a camera's images take to arrive, by its own clock: least delay of
/// the last 10 to 20 s, for the two clocks drift apart. A camera that was late from the beginning
/// does not show.
class ArrivalDelay {
 public:
  /// `delay`: from the exposure on the camera's clock to what the host, by the arrival, takes for
  /// it. Above 0: by how much it is longer than the least.
  Time excess(Time delay, Time now);

 private:
  std::optional<Time> before_, least_;  // of the ten seconds before, and of these
  Time since_{};
};

/// A frozen, late or reordered source is a fault of the device, not of the robot: without this
/// check the loop would steer by it.
class FrameValidator {
 public:
  /// `role`: as errors call it. `period`: s, between its exposures; 0: unknown.
  FrameValidator(Clock& clock, Recorder& recorder, std::string role, double period = 0);

  /// False for a frame whose time stamp is out of order, in the future, older than 0.2 s (by the
  /// camera's own clock, where it has one), or not that of its number and arrival (StampWatch): it
  /// is to be passed over, and the loop's heartbeat does not come for it. The first is an event;
  /// all are counted. Throws DeviceError{protocol} after 0.2 s without a plausible one.
  bool plausible(const Frame& frame);
  /// Nothing for a position (m, world) that is not finite; the first is an event.
  std::optional<Eigen::Vector3d> finite(const std::optional<Eigen::Vector3d>& position);
  /// No sensor is without noise: what is the same to the bit three times running, or what was there
  /// before, to the bit, six times running, is not what is there now. Both throw
  /// DeviceError{protocol} then.
  void must_change(const cv::Mat& picture);
  void must_change(const std::optional<Eigen::Vector3d>& position);
  /// An event with the number of frames passed over, at the end.
  void report_count();

 private:
  void count(bool same, std::optional<std::size_t> digest, const char* what);
  std::string stamp_fault(const Frame& frame, Time now);

  Clock& clock_;
  Recorder& recorder_;
  const std::string role_;
  std::optional<std::pair<Time, std::uint64_t>> last_stamps_;  // exposure and number
  Time believed_at_;                                           // when a frame was last plausible
  cv::Mat last_picture_;
  std::optional<Eigen::Vector3d> last_position_;
  ArrivalDelay delay_;
  StampWatch stamps_;
  int equal_ = 0;                    // pictures or positions in a row, the last one included
  int repeated_ = 0;                 // in a row that are among the last ones
  std::deque<std::size_t> digests_;  // of the last ones, the newest at the end
  int passed_over_ = 0;
  bool reported_not_finite_ = false;
};

}  // namespace vitreo
