// SPDX-License-Identifier: Apache-2.0
#include "host/servo/frame_validator.h"

#include "devices/time/error.h"
#include "host/text/units.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstring>
#include <functional>
#include <string_view>
#include <utility>

namespace vitreo {
namespace {

// Since the exposure: what is older is not steered by. With a clock that is 100 ms behind, 180 ms
// in all, a loop is 0.2 mm off; with 150 ms 0.4 (docs/reliability.md).
constexpr Time kOldest = std::chrono::milliseconds(200);
// Of the camera's delays: with two clocks 100 ppm apart the least is wrong by 2 ms.
constexpr Time kRemembered = std::chrono::seconds(10);
// With nothing but frames that cannot be believed; then the device has failed. Before the dead-man
// acts, so that the cause is told.
constexpr Time kPatience = std::chrono::milliseconds(200);
// Images or positions in a row that are the same to the bit; the last of them throws.
constexpr int kEqual = 3;
// The same, of those that are equal to one of the last kDigests.
constexpr int kRepeated = 6;
constexpr std::size_t kDigests = 16;

/// Row by row, for a picture may be a part of a larger one.
bool same_picture(const cv::Mat& a, const cv::Mat& b) {
  if (a.empty() || a.size() != b.size() || a.type() != b.type()) return false;
  for (int row = 0; row < a.rows; ++row)
    if (std::memcmp(a.ptr(row), b.ptr(row), static_cast<std::size_t>(a.cols) * a.elemSize()) != 0)
      return false;
  return true;
}

std::size_t digest_of(const cv::Mat& picture) {
  std::size_t digest = 0;
  for (int row = 0; row < picture.rows; ++row) {
    const std::string_view bytes(reinterpret_cast<const char*>(picture.ptr(row)),
                                 static_cast<std::size_t>(picture.cols) * picture.elemSize());
    // Of what was there and the new row: boost's hash_combine.
    digest ^= std::hash<std::string_view>{}(bytes) + 0x9e3779b97f4a7c15U + (digest << 6U) +
              (digest >> 2U);
  }
  return digest;
}

}  // namespace

FrameValidator::FrameValidator(Clock& clock, Recorder& recorder, std::string role, double period)
    : clock_(clock),
      recorder_(recorder),
      role_(std::move(role)),
      believed_at_(clock.now()),
      stamps_(period) {}

Time ArrivalDelay::excess(Time delay, Time now) {
  if (!least_ || now - since_ > kRemembered) {
    before_ = std::exchange(least_, delay);
    since_ = now;
  }
  least_ = std::min(*least_, delay);
  return delay - (before_ ? std::min(*before_, *least_) : *least_);
}

/// Accepted: t_exposed and number strictly increasing, 0 <= now - t_exposed <= kOldest, and what
/// StampWatch believes. Empty for such a frame.
std::string FrameValidator::stamp_fault(const Frame& frame, Time now) {
  Time age = now - frame.exposed;
  if (frame.device) age += delay_.excess(frame.exposed - *frame.device, now);
  const std::string leapt = stamps_.fault(frame, now);
  if (!leapt.empty()) return leapt;
  if (last_stamps_ &&
      (frame.exposed <= last_stamps_->first || frame.number <= last_stamps_->second))
    return "its time stamps are out of order";
  if (age > kOldest)
    return "its time stamps are " + format_quantity(to_seconds(age), "s") +
           " old: its clock is wrong, or its images come too late";
  return {};
}

/// Patience counts from the last frame that was believed, or from the start: a camera that begins
/// with rubbish gets as long as one that fails later.
bool FrameValidator::plausible(const Frame& frame) {
  const Time now = clock_.now();
  const std::string fault = stamp_fault(frame, now);
  if (fault.empty()) {
    last_stamps_ = {frame.exposed, frame.number};
    believed_at_ = now;
    return true;
  }
  // Said once; the count is in the record at the end.
  if (passed_over_++ == 0)
    recorder_.event(now, "degraded", role_ + ": a frame is passed over: " + fault);
  if (now - believed_at_ > kPatience)
    throw DeviceError(DeviceErrorKind::protocol, role_,
                      "its time stamps cannot be believed: " + fault);
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
  count(same_picture(last_picture_, picture), digest_of(picture), "picture");
  last_picture_ = picture;
}

/// Two readings without a position are no standstill: nothing was measured.
void FrameValidator::must_change(const std::optional<Eigen::Vector3d>& position) {
  std::optional<std::size_t> digest;  // what is not a number counts as not seen
  if (position && position->allFinite())
    digest = std::hash<std::string_view>{}(
        std::string_view(reinterpret_cast<const char*>(position->data()), 3 * sizeof(double)));
  count(position && last_position_ == position, digest, "place");
  last_position_ = position;
}

void FrameValidator::count(bool same, std::optional<std::size_t> digest, const char* what) {
  equal_ = same ? equal_ + 1 : 1;
  const bool known =
      digest && std::find(digests_.begin(), digests_.end(), *digest) != digests_.end();
  repeated_ = known ? repeated_ + 1 : 0;
  if (digest) digests_.push_back(*digest);
  if (digests_.size() > kDigests) digests_.pop_front();
  if (equal_ >= kEqual)
    throw DeviceError(DeviceErrorKind::protocol, role_,
                      fmt::format("its {} stands still, to the bit", what));
  if (repeated_ >= kRepeated)
    throw DeviceError(DeviceErrorKind::protocol, role_,
                      fmt::format("its {}s repeat, to the bit", what));
}

void FrameValidator::report_count() {
  if (passed_over_ > 0)
    recorder_.event(
        clock_.now(), "note",
        fmt::format("{}: {} frames were passed over for their time stamps", role_, passed_over_));
}

}  // namespace vitreo
