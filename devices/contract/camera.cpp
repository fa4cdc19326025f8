// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/camera.h"

#include "devices/contract/examination.h"
#include "devices/time/error.h"

#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>

namespace vitreo::contract {
namespace {

/// One function a duty.
/// A duty that throws is a finding, and the next ones are examined all the same
/// (Examination::duty).
struct Examiner : Examination<Examiner> {
  Camera& camera;
  Clock& clock;
  const CameraCheck& how;
  Examiner(Camera& its, Clock& time, const CameraCheck& check)
      : camera(its), clock(time), how(check) {}
  void leave_safe() {}  // it moves nothing

  /// Generous: a duty is to deliver, not to be fast.
  Time patience() const { return from_seconds(std::max(2.0, 20 * camera.info().frame_period)); }

  void describes_itself() {
    const CameraInfo& info = camera.info();
    expect(!info.identity.empty(), "identity is empty");
    expect(info.width_px > 0 && info.height_px > 0, "its images have no size");
    expect(std::isfinite(info.frame_period) && info.frame_period > 0,
           "frame_period is not positive");
    expect(std::isfinite(info.effective_pixel) && info.effective_pixel > 0,
           "effective_pixel is not positive");
  }
  /// Depth, size and times of one frame; the exposure lies before the arrival, and the arrival
  /// before now.
  void examine(const Frame& frame) {
    const CameraInfo& info = camera.info();
    expect(frame.image.type() == CV_8UC1 || frame.image.type() == CV_8UC3,
           "a frame is neither 8-bit gray nor 8-bit color");
    expect(frame.image.cols == info.width_px && frame.image.rows == info.height_px,
           "a frame has another size");
    expect(frame.exposed <= frame.received, "a frame was received before it was exposed");
    expect(frame.received <= clock.now(), "a frame was received in the future");
    if (how.content) {
      const std::string wrong = how.content(frame);
      expect(wrong.empty(), "a frame shows what it should not: " + wrong);
    }
  }
  // A frame is compared with the one before, which is kept alive meanwhile: a driver that reuses
  // its memory changes both at once.
  void delivers_frames_in_order() {
    Frame last;
    for (int i = 0; i < how.frames; ++i) {
      Frame frame = camera.grab(patience());
      examine(frame);
      if (i > 0) {
        expect(frame.number > last.number, "numbers do not grow");
        expect(how.may_drop || frame.number == last.number + 1, "numbers have gaps");
        expect(frame.exposed > last.exposed, "times of exposure do not grow");
        // A frame belongs to its receiver: the driver may not reuse its memory.
        expect(frame.image.data != last.image.data,
               "a frame that was delivered is written to again");
        const bool alike = frame.image.type() == last.image.type();
        expect(alike, "some frames are gray and some are color");
        if (!how.may_repeat && alike && frame.image.size() == last.image.size())
          expect(cv::norm(frame.image, last.image, cv::NORM_INF) > 0, "the image is frozen");
      }
      last = std::move(frame);
    }
  }
  /// Asked for more frames than can come, it must throw at the deadline. Repeated, since one frame
  /// or a few may already wait in its buffers.
  void keeps_the_deadline() {
    for (int i = 0; i < 50; ++i) {
      const Time start = clock.now();
      try {
        camera.grab(Time::zero());
      } catch (const DeviceError& error) {
        expect(error.kind == DeviceErrorKind::timeout,
               "no frame in time is another error than a timeout");
        expect(clock.now() - start <= from_seconds(0.5),
               "a grab without time takes longer than 0.5 s");
        return;
      }
    }
    findings.emplace_back("it always has a frame at once");
  }
  // A driver that gives up its acquisition at a timeout shows here.
  void goes_on_after_a_timeout() { examine(camera.grab(patience())); }
  // Only that the count grows: what was delivered and not grabbed counts as well.
  void counts_frames() {
    const CameraStatistics before = camera.statistics();
    if (before.delivered == 0) return;  // a camera that cannot lose any does not count
    camera.grab(patience());
    expect(camera.statistics().delivered > before.delivered, "delivered frames are not counted");
  }
};

}  // namespace

// The first duty decides whether there are others: their deadlines are made from the frame period
// that the camera states.
std::vector<std::string> check(Camera& camera, Clock& clock, const CameraCheck& how) {
  Examiner examiner(camera, clock, how);
  examiner.duty("describe itself", &Examiner::describes_itself);
  if (!examiner.findings.empty()) return examiner.findings;  // nothing else can be asked of it
  examiner.duty("deliver frames in order", &Examiner::delivers_frames_in_order);
  examiner.duty("keep the deadline", &Examiner::keeps_the_deadline);
  examiner.duty("go on after a timeout", &Examiner::goes_on_after_a_timeout);
  examiner.duty("count frames", &Examiner::counts_frames);
  return examiner.findings;
}

}  // namespace vitreo::contract
