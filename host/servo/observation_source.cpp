// SPDX-License-Identifier: Apache-2.0
#include "host/servo/observation_source.h"

#include "devices/roles/gray.h"
#include "host/rig/measured_chain.h"
#include "host/servo/servo_cameras.h"

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

/// Standard deviations between both cameras' places. Healthy drawn benches stay below 2.4 and reach
/// 6 for single frames of a fast robot (docs/reliability.md).
constexpr double kApart = 8;

/// m/s, standard deviation: what moves the robot beyond the model, 0.1 to 0.3 mm/s on the simulated
/// machines, and of a swimmer, whose speed the model of forces does not know.
constexpr double kUnexplained = 0.3e-3;
constexpr double kUnexplainedSwimmer = 1e-3;

/// s, of a camera whose frames leave time for an outline: three times what one takes (10 ms of
/// processor, docs/localization.md).
constexpr double kOutlinePeriod = 30e-3;

/// Pictures in a row that the gate refuses before the eye is to search anew.
constexpr int kRefusals = 3;

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

/// A model is for pictures of the size that it was trained on.
void check_model_size(const cv::Size& trained, const CameraInfo& camera) {
  if (trained.width != camera.width_px || trained.height != camera.height_px)
    throw std::invalid_argument(fmt::format(
        "model: must be for pictures of {} x {} px, as the top camera's; it is for {} x {}",
        camera.width_px, camera.height_px, trained.width, trained.height));
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
  require(!needs_background(feedback) || cameras.top,
          "a background of the empty scene, as rig:learn_background() gives it");
  require(!needs_colors(feedback) || !cameras.colors.empty(), "a color model of the robot");
  require(!rig.model.plain_view || feedback == Feedback::two_cameras,
          "a view through the eye: a plain one from above has no depth; two_cameras has");
  if (feedback == Feedback::two_cameras)
    require(cameras.side != nullptr, "the role side_camera, and a background learnt with it");
  if (needs_colors(feedback))
    check_model_size(cameras.colors.front().model.image_size, rig.top_camera->info());
}

/// The localizer's model with the calibration on the known retina (thesis 6.2): the image's scale,
/// where the eye is, or its numbers. Where the robot may go stays as the rig says.
RigModel corrected(RigModel model, const ViewCorrection& view) {
  if (view.corrects()) model = without_measured_chain(std::move(model));
  model.top_image.pixel *= view.image_scale;
  model.eye_in_world += view.offset;
  if (!view.eye) return model;
  model.eye = view.eye->system;
  model.projection = view.eye->projection;
  model.exact = view.eye->exact;
  model.robot.semi_axis *= view.eye->robot_length;
  model.robot.semi_radius *= view.eye->robot_width;
  return model;
}

ViewCalibration calibration_of(const ViewCorrection& view) {
  if (view.eye) return ViewCalibration::eye;
  return view.image_scale != 1 ? ViewCalibration::scale : ViewCalibration::none;
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
  if (by_pose_) {
    if (settings.by_pose && rig.top_camera != nullptr)
      rehearsed_.emplace(model, rig.top_camera->info(), settings.axis);
    return;
  }
  const auto add = [&](std::unique_ptr<RobotEye> eye, bool wants_ground) {
    eyes_.push_back(
        {std::make_unique<Localizer>(model, std::move(eye), settings.axis,
                                     settings.axis_uncertainty(), calibration_of(settings.view)),
         wants_ground});
    if (period() < kOutlinePeriod) eyes_.back().localizer->use_ellipse();
  };
  if (needs_colors(feedback_)) {
    add(color_eye(cameras.colors), false);
    gate_.emplace(settings.law == ControlLaw::rotating ? kUnexplainedSwimmer : kUnexplained);
  }
  if (!needs_background(feedback_)) return;
  view_.emplace(*cameras.top);
  add(background_eye(model, std::move(*cameras.top)), true);
}

double ObservationSource::period() const {
  return by_pose_ ? rig_.pose_sensor->period() : rig_.top_camera->info().frame_period;
}

void ObservationSource::expect_axis(const Eigen::Vector3d& axis) {
  for (Eye& eye : eyes_) eye.localizer->expect_axis(axis);
}

void ObservationSource::expect_motion(double acts, const Eigen::Vector3d& velocity) {
  if (gate_) gate_->driven(acts, velocity);
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
  const std::string other = other_view(found.frame.image);
  std::vector<Observation> seen;
  for (Eye& eye : eyes_) seen.push_back(look(eye, found.frame, other.empty()));
  found.observation = chosen(std::move(seen), to_seconds(found.frame.exposed));
  if (!found.observation.position) found.distrusted = other;
  if (found.observation.position) *found.observation.position += offset_;
  join(found);
  return found;
}

/// What the side camera adds, and a plain view's depth.
void ObservationSource::join(ObservedFrame& found) {
  bool joined = false;
  if (feedback_ == Feedback::two_cameras && found.observation.position) {
    // Its frame may come a little later; without it this observation has one camera.
    auto view = side_->at(found.frame.exposed, clock_.now() + from_seconds(period() / 2));
    if (view) {
      eyes_.front().localizer->straighten(*view);
      join_side(found.observation, *view);
      join_side_axis(found.observation, *view);
      found.observation.pair_skew = to_seconds(view->skew);
      reject_contradicted(found);
    }
    joined = view.has_value();
  }
  if (rig_.model.plain_view && !joined) found.observation.position.reset();  // without a depth
}

/// Both cameras see one robot. Where they see it farther apart than all that is unknown of either
/// allows, one of them was moved or turned, or sees something else, and which one is not known.
void ObservationSource::reject_contradicted(ObservedFrame& found) {
  const bool apart = found.observation.apart > kApart;
  if (apart) {
    found.observation.position.reset();
    found.distrusted = "both cameras see the robot in different places";
  }
  if (apart && !was_apart_)
    recorder_.event(clock_.now(), "degraded",
                    fmt::format("both cameras see the robot in different places, {:.0f} standard "
                                "deviations apart: neither is believed",
                                found.observation.apart));
  was_apart_ = apart;
}

/// One eye's own answer, held against all that can be known of it alone.
Observation ObservationSource::look(Eye& eye, const Frame& frame, bool ground_fits) {
  Observation observation = eye.localizer->look(frame.image);
  observation.position = validator_.finite(observation.position);
  reject_implausible(eye, observation);
  report_fallback(eye, observation);
  if (eye.wants_ground && !ground_fits) observation.position.reset();
  reject_misplaced(eye, to_seconds(frame.exposed), observation);
  return observation;
}

/// The one that steers. Without one the first that has an outline, for the record and the page.
Observation ObservationSource::chosen(std::vector<Observation> seen, double time) {
  const auto eye = choice_.choose(seen);
  if (choice_.contradicted() && !was_contradicted_)
    recorder_.event(clock_.now(), "degraded",
                    "the eyes see the robot in different places: neither is believed");
  was_contradicted_ = choice_.contradicted();
  if (!eye) {
    for (Observation& one : seen) one.position.reset();
    for (Observation& one : seen)
      if (one.ellipse) return std::move(one);
    return std::move(seen.front());
  }
  if (eyes_.size() > 1 && eye_ != eye)
    recorder_.event(clock_.now(), "eye",
                    fmt::format("the robot is seen by {}", eyes_[*eye].localizer->eye().name()));
  eye_ = eye;
  if (gate_) gate_->believed(time, *seen[*eye].position, seen[*eye].noise());
  return std::move(seen[*eye]);
}

/// An outline that no position of the robot explains, or of which a large part is hidden, is a
/// vessel, a speck, or the robot behind one (docs/safety.md).
/// The ellipse stays in the observation, so that the record and the page show what was taken for
/// the robot.
void ObservationSource::reject_implausible(Eye& eye, Observation& observation) {
  const bool implausible = observation.position && (observation.residual_px > kLargestResidual_px ||
                                                    observation.ellipse->inlier_fraction <
                                                        eye.localizer->eye().least_rim());
  if (implausible) observation.position.reset();
  if (implausible && !eye.was_implausible)
    recorder_.event(clock_.now(), "degraded",
                    "what is tracked does not look like the robot: it counts as not seen");
  eye.was_implausible = implausible;
}

/// Frames whose contour does not show the body are located by the ellipse that it is taken for,
/// with what that costs of the depth; which ones is in the stream (by_outline).
void ObservationSource::report_fallback(Eye& eye, const Observation& observation) {
  if (!eye.localizer->outlined() || !observation.position) return;
  if (!observation.by_outline && !eye.was_by_ellipse)
    recorder_.event(clock_.now(), "degraded",
                    "the robot's contour does not show its body: it is located by its ellipse");
  eye.was_by_ellipse = !observation.by_outline;
}

/// An eye that has taken something else for the robot follows it on; told so for some pictures, it
/// searches anew.
void ObservationSource::reject_misplaced(Eye& eye, double time, Observation& observation) {
  if (!gate_ || !observation.position) return;
  if (gate_->admits(time, *observation.position, observation.noise())) {
    eye.refused = 0;
    eye.was_refused = false;
    return;
  }
  observation.position.reset();
  if (!std::exchange(eye.was_refused, true))
    recorder_.event(clock_.now(), "degraded",
                    fmt::format("{}: what is tracked is where the currents cannot have taken the "
                                "robot: it counts as not seen",
                                eye.localizer->eye().name()));
  if (++eye.refused < kRefusals) return;
  eye.localizer->forget();
  eye.refused = 0;
}

/// A camera that was moved shows the robot where it is not. Why; empty where it was not, or where
/// no ground was learnt.
std::string ObservationSource::other_view(const cv::Mat& picture) {
  if (!view_) return {};
  std::string why = view_->fault(as_gray(picture));
  if (!why.empty() && !was_other_view_)
    recorder_.event(clock_.now(), "degraded", "top_camera: " + why);
  was_other_view_ = !why.empty();
  return why;
}

}  // namespace vitreo
