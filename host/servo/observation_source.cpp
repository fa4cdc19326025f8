// SPDX-License-Identifier: Apache-2.0
#include "host/servo/observation_source.h"

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

bool looks_by_pose(const ServoSettings& settings) {
  return settings.by_pose || settings.feedback == Feedback::pose_sensor;
}

void check_eyes(const Rig& rig, const ServoCameras& eyes, const ServoSettings& settings) {
  const Feedback feedback = settings.feedback;
  const auto require = [feedback](bool good, const char* what) {
    if (!good)
      throw std::invalid_argument(std::string("feedback \"") + to_string(feedback) + "\" needs " +
                                  what);
  };
  if (looks_by_pose(settings)) {
    require(rig.pose_sensor != nullptr,
            "the role pose_sensor, which only a simulated rig can have");
    return;
  }
  require(rig.top_camera != nullptr, "the role top_camera");
  require(eyes.top.has_value(), "a background of the empty scene");
  require(!rig.model.plain_view || feedback == Feedback::two_cameras,
          "a view through the eye: a plain one from above has no depth; two_cameras has");
  if (feedback == Feedback::two_cameras)
    require(eyes.side != nullptr, "the role side_camera, and a background learnt with it");
}

/// What the localizer believes; where the robot may go stays as the rig says.
RigModel corrected(RigModel model, const ViewCorrection& view) {
  model.top_image.pixel *= view.image_scale;
  model.eye_in_world += view.offset;
  return model;
}

}  // namespace

ObservationSource::ObservationSource(Clock& clock, Rig& rig, Recorder& recorder, ServoCameras eyes,
                                     const ServoSettings& settings)
    : clock_(clock),
      rig_(rig),
      recorder_(recorder),
      feedback_(settings.feedback),
      by_pose_(looks_by_pose(settings)),
      side_(eyes.side),
      guard_(clock, recorder, by_pose_ ? "pose_sensor" : "top_camera") {
  check_eyes(rig, eyes, settings);
  if (!by_pose_)
    localizer_.emplace(corrected(rig.model, settings.view), std::move(*eyes.top), settings.axis,
                       settings.axis_uncertainty());
}

double ObservationSource::period() const {
  return by_pose_ ? rig_.pose_sensor->period() : rig_.top_camera->info().frame_period;
}

ObservationSource::Look ObservationSource::look() {
  const Time patience = from_seconds(std::max(1.0, 5 * period()));
  for (;;)
    if (auto found = by_pose_ ? by_pose(patience) : by_camera(patience)) return std::move(*found);
}

std::optional<ObservationSource::Look> ObservationSource::by_pose(Time patience) {
  const PoseReading reading = rig_.pose_sensor->read(patience);
  const Frame stamps{{}, reading.number, reading.exposed, reading.received};
  if (!guard_.plausible(stamps)) return std::nullopt;
  guard_.must_change(reading.position);
  return Look{stamps, {{}, guard_.finite(reading.position), reading.covariance, 0}};
}

std::optional<ObservationSource::Look> ObservationSource::by_camera(Time patience) {
  Look found{rig_.top_camera->grab(patience), {}};
  if (!guard_.plausible(found.frame)) return std::nullopt;
  guard_.must_change(found.frame.image);
  found.observation = localizer_->look(found.frame.image);
  found.observation.position = guard_.finite(found.observation.position);
  refuse_strangers(found.observation);
  if (found.observation.position) *found.observation.position += offset_;
  bool joined = false;
  if (feedback_ == Feedback::two_cameras && found.observation.position) {
    // Its frame may come a little later; without it this look has one camera.
    const auto view = side_->at(found.frame.exposed, clock_.now() + from_seconds(period() / 2));
    if (view) join_side(found.observation, *view);
    joined = view.has_value();
  }
  if (rig_.model.plain_view && !joined) found.observation.position.reset();  // without a depth
  return found;
}

/// An outline that no place of the robot explains, or of which half is hidden, is a vessel, a
/// speck, or the robot behind one.
void ObservationSource::refuse_strangers(Observation& observation) {
  const bool strange = observation.position && (observation.residual_px > kLargestResidual_px ||
                                                observation.ellipse->inlier_fraction < kLeastRim);
  if (strange) observation.position.reset();
  if (strange && !was_strange_)
    recorder_.event(clock_.now(), "degraded",
                    "what is tracked does not look like the robot: it counts as not seen");
  was_strange_ = strange;
}

}  // namespace vitreo
