// SPDX-License-Identifier: Apache-2.0
#include "host/servo/observation_source.h"

#include "devices/roles/gray.h"

#include <fmt/format.h>

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace vitreo {
namespace {

/// Of the pose against the ellipse: on the nominal eye a robot leaves at most 0.1 px, in nine eyes
/// off by table 5.1 0.43; a speck of the robot's width behind it 1 to 5, and then the place is
/// millimeters off (docs/safety.md).
constexpr double kLargestResidual_px = 1.5;

/// Of the rim, in line with the ellipse: 1 for a robot that nothing hides. Below this a speck at
/// its edge, as dark as it is, begins to bend the ellipse: the place is 0.2 mm off at most above,
/// up to 1.7 mm below.
constexpr double kLeastRim = 0.75;

/// rad: how well a pose sensor's axis is taken to be known, as it states no covariance of it.
constexpr double kPoseAxisSigma = 0.02;

/// A dry run has the sensor in the camera's place, whatever feedback it names.
bool uses_pose_sensor(const ServoSettings& settings) {
  return settings.by_pose || settings.feedback == Feedback::pose_sensor;
}

/// s; 0 where there is none, which check_cameras() refuses.
double usual_period(const Rig& rig, bool by_pose) {
  if (by_pose) return rig.pose_sensor != nullptr ? rig.pose_sensor->period() : 0;
  return rig.top_camera != nullptr ? rig.top_camera->info().frame_period : 0;
}

/// Whether rig and background have what the feedback needs.
/// Throws std::invalid_argument before any device is asked for a frame.
void check_cameras(const Rig& rig, const ServoCameras& cameras, const ServoSettings& settings) {
  const Feedback feedback = settings.feedback;
  const auto require = [feedback](bool good, const char* what) {
    if (!good)
      throw std::invalid_argument(std::string("feedback \"") + to_string(feedback) + "\" needs " +
                                  what);
  };
  if (uses_pose_sensor(settings)) {
    require(rig.pose_sensor != nullptr,
            "the role pose_sensor, which only a simulated rig can have");
    return;
  }
  require(rig.top_camera != nullptr, "the role top_camera");
  require(cameras.top.has_value(), "a background of the empty scene");
  require(!rig.model.plain_view || feedback == Feedback::two_cameras,
          "a view through the eye: a plain one from above has no depth; two_cameras has");
  if (feedback == Feedback::two_cameras)
    require(cameras.side != nullptr, "the role side_camera, and a background learnt with it");
}

/// The localizer's model with the calibration on the known retina (thesis 6.2): the image's scale
/// and where the eye is. Where the robot may go stays as the rig says.
RigModel corrected(RigModel model, const ViewCorrection& view) {
  model.top_image.pixel *= view.image_scale;
  model.eye_in_world += view.offset;
  return model;
}

}  // namespace

ObservationSource::ObservationSource(Clock& clock, Rig& rig, Recorder& recorder,
                                     ServoCameras cameras, const ServoSettings& settings)
    : clock_(clock),
      rig_(rig),
      recorder_(recorder),
      feedback_(settings.feedback),
      by_pose_(uses_pose_sensor(settings)),
      side_(cameras.side),
      validator_(clock, recorder, by_pose_ ? "pose_sensor" : "top_camera",
                 usual_period(rig, by_pose_)) {
  check_cameras(rig, cameras, settings);
  const RigModel model = corrected(rig.model, settings.view);
  if (!by_pose_) view_.emplace(*cameras.top);
  if (!by_pose_)
    localizer_.emplace(model, std::move(*cameras.top), settings.axis, settings.axis_uncertainty(),
                       settings.view.image_scale != 1);
  else if (settings.by_pose && rig.top_camera != nullptr)
    rehearsed_.emplace(model, rig.top_camera->info(), settings.axis);
}

double ObservationSource::period() const {
  return by_pose_ ? rig_.pose_sensor->period() : rig_.top_camera->info().frame_period;
}

void ObservationSource::expect_axis(const Eigen::Vector3d& axis) {
  if (localizer_) localizer_->expect_axis(axis);
}

/// Both kinds give nothing for a frame that is passed over, and then the next is waited for; an
/// endless wait is ended by the device's own timeout, or by the validator.
ObservationSource::ObservedFrame ObservationSource::next() {
  const Time patience = from_seconds(std::max(1.0, 5 * period()));
  for (;;)
    if (auto found = by_pose_ ? by_pose(patience) : by_camera(patience)) return std::move(*found);
}

/// A reading has no image, so its stamps alone make the frame that is validated.
std::optional<ObservationSource::ObservedFrame> ObservationSource::by_pose(Time patience) {
  const PoseReading reading = rig_.pose_sensor->read(patience);
  const Frame stamps{{}, reading.number, reading.exposed, reading.received};
  if (!validator_.plausible(stamps)) return std::nullopt;
  validator_.must_change(reading.position);
  ObservedFrame found{stamps, {}};
  found.observation.position = validator_.finite(reading.position);
  found.observation.covariance = reading.covariance;
  found.observation.axis = reading.axis;
  found.observation.axis_sigma = kPoseAxisSigma;
  if (rehearsed_ && found.observation.position)
    found.observation.ellipse = rehearsed_->ellipse_at(*found.observation.position);
  return found;
}

/// Order matters: what does not look like the robot is rejected before the side view is joined, so
/// that a good side view cannot hide a bad top view.
std::optional<ObservationSource::ObservedFrame> ObservationSource::by_camera(Time patience) {
  ObservedFrame found{rig_.top_camera->grab(patience), {}};
  if (!validator_.plausible(found.frame)) return std::nullopt;
  validator_.must_change(found.frame.image);
  const cv::Mat gray = as_gray(found.frame.image);
  found.observation = localizer_->look(gray);
  found.observation.position = validator_.finite(found.observation.position);
  reject_implausible(found.observation);
  reject_other_view(found, gray);
  if (found.observation.position) *found.observation.position += offset_;
  bool joined = false;
  if (feedback_ == Feedback::two_cameras && found.observation.position) {
    // Its frame may come a little later; without it this observation has one camera.
    auto view = side_->at(found.frame.exposed, clock_.now() + from_seconds(period() / 2));
    if (view) {
      localizer_->straighten(*view);
      join_side(found.observation, *view);
      join_side_axis(found.observation, *view);
      found.observation.pair_skew = to_seconds(view->skew);
    }
    joined = view.has_value();
  }
  if (rig_.model.plain_view && !joined) found.observation.position.reset();  // without a depth
  return found;
}

/// An outline that no position of the robot explains, or of which a quarter is hidden, is a vessel,
/// a speck, or the robot behind one (docs/safety.md).
/// The ellipse stays in the observation, so that the record and the page show what was taken for
/// the robot.
void ObservationSource::reject_implausible(Observation& observation) {
  const bool implausible =
      observation.position && (observation.residual_px > kLargestResidual_px ||
                               observation.ellipse->inlier_fraction < kLeastRim);
  if (implausible) observation.position.reset();
  if (implausible && !was_implausible_)
    recorder_.event(clock_.now(), "degraded",
                    "what is tracked does not look like the robot: it counts as not seen");
  was_implausible_ = implausible;
}

/// A camera that was moved shows the robot where it is not.
void ObservationSource::reject_other_view(ObservedFrame& found, const cv::Mat& gray) {
  found.distrusted = view_->fault(gray);
  if (!found.distrusted.empty()) found.observation.position.reset();
  if (!found.distrusted.empty() && !was_other_view_)
    recorder_.event(clock_.now(), "degraded", "top_camera: " + found.distrusted);
  was_other_view_ = !found.distrusted.empty();
}

}  // namespace vitreo
