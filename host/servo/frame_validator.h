// What a loop may believe of a camera, or of a pose sensor: stamps that are in order and of now,
// pictures that change, places that are numbers.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"
#include "host/record/recorder.h"

#include <Eigen/Core>

#include <cstdint>
#include <optional>
#include <string>
#include <utility>

namespace vitreo {

class FrameValidator {
 public:
  /// `role`: as errors call it.
  FrameValidator(Clock& clock, Recorder& recorder, std::string role);

  /// False for a frame whose time stamp is out of order, in the future, or older than 0.6 s: it is
  /// to be passed over, and no heart beats for it. The first is an event; all are counted.
  bool plausible(const Frame& frame);
  /// Nothing in the place of what is not a number; the first is an event.
  std::optional<Eigen::Vector3d> finite(const std::optional<Eigen::Vector3d>& place);
  /// No sensor is without noise: what is the same to the bit three times running is not what is
  /// there now. Both throw DeviceError{protocol}.
  void must_change(const cv::Mat& picture);
  void must_change(const std::optional<Eigen::Vector3d>& place);
  /// For the record, at the end.
  void tell();

 private:
  void count(bool same, const char* what);

  Clock& clock_;
  Recorder& recorder_;
  const std::string role_;
  std::optional<std::pair<Time, std::uint64_t>> last_stamps_;  // exposure and number
  Time believed_at_;                                           // when a frame was last believed
  cv::Mat last_picture_;
  std::optional<Eigen::Vector3d> last_place_;
  int unchanged_ = 0, passed_over_ = 0;
  bool told_not_finite_ = false;
};

}  // namespace vitreo
