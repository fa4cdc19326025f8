// SPDX-License-Identifier: Apache-2.0
#include "host/servo/frame_validator.h"

#include "devices/time/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <utility>

namespace vitreo {
namespace {

// Since the exposure: what is older is not steered by.
constexpr Time kOldest = std::chrono::milliseconds(600);
// By which the mapping of a camera's clock may err.
constexpr Time kAhead = std::chrono::milliseconds(20);
// Of the camera's delays: with two clocks 100 ppm apart the least is wrong by 2 ms.
constexpr Time kRemembered = std::chrono::seconds(10);
// With nothing but frames that cannot be believed; then the device has failed.
constexpr Time kPatience = std::chrono::seconds(1);
// Images or positions in a row that are the same to the bit; the last of them throws.
constexpr int kEqual = 3;

/// Row by row, for a picture may be a part of a larger one.
bool same_picture(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() || a.size() != b.size() || a.type() != b.type()) return false;
  for (int row = 0; row < a.rows; ++row)
    if (std::memcmp(a.ptr(row), b.ptr(row), static_cast<std::size_t>(a.cols) * a.elemSize()) != 0)
      return false;
  return true;
}

}  // namespace

FrameValidator::FrameValidator(Clock& clock, Recorder& recorder, std::string role)
    : clock_(clock), recorder_(recorder), role_(std::move(role)), believed_at_(clock.now()) {}

Time ArrivalDelay::excess(Time delay, Time now) {
  if (!least_ || now - since_ > kRemembered) {
    before_ = std::exchange(least_, delay);
    since_ = now;
  }
  least_ = std::min(*least_, delay);
  return delay - (before_ ? std::min(*before_, *least_) : *least_);
}

/// Patience counts from the last frame that was believed, or from the start: a camera that begins
/// with rubbish gets as long as one that fails later.
bool FrameValidator::plausible(const Frame& frame) {
  // Accepted: t_exposed and number strictly increasing, -kAhead <= now - t_exposed <= kOldest.
  const Time now = clock_.now();
  Time age = now - frame.exposed;
  if (frame.device) age += delay_.excess(frame.exposed - *frame.device, now);
  const bool in_order =
      !last_stamps_ || (frame.exposed > last_stamps_->first && frame.number > last_stamps_->second);
  const bool good = in_order && age <= kOldest && age >= -kAhead;
  if (good) {
    last_stamps_ = {frame.exposed, frame.number};
    believed_at_ = now;
    return true;
  }
  // Said once; the count is in the record at the end.
  if (passed_over_++ == 0)
    recorder_.event(
        clock_.now(), "degraded",
        role_ +
            ": a frame is passed over: its time stamp is out of order, in the future, or too old");
  if (clock_.now() - believed_at_ > kPatience)
    throw DeviceError(DeviceErrorKind::protocol, role_, "its time stamps cannot be believed");
  return false;
}

/// A NaN must not reach a filter, which would keep it for ever.
std::optional<Eigen::Vector3d> FrameValidator::finite(
    const std::optional<Eigen::Vector3d>& position) {
  if (!position || position->allFinite()) return position;
  if (!std::exchange(reported_not_finite_, true))
    recorder_.event(clock_.now(), "degraded",
                    role_ + ": a place is not a number: it counts as not seen");
  return std::nullopt;
}

void FrameValidator::must_change(const cv::Mat& picture) {
  count(same_picture(last_picture_, picture), "picture");
  last_picture_ = picture;
}

/// Two readings without a position are no standstill: nothing was measured.
void FrameValidator::must_change(const std::optional<Eigen::Vector3d>& position) {
  count(position && last_position_ == position, "place");
  last_position_ = position;
}

void FrameValidator::count(bool same, const char* what) {
  equal_ = same ? equal_ + 1 : 1;
  if (equal_ >= kEqual)
    throw DeviceError(DeviceErrorKind::protocol, role_,
                      fmt::format("its {} stands still, to the bit", what));
}

void FrameValidator::report_count() {
  if (passed_over_ > 0)
    recorder_.event(
        clock_.now(), "note",
        fmt::format("{}: {} frames were passed over for their time stamps", role_, passed_over_));
}

}  // namespace vitreo
