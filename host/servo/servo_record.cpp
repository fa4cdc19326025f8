// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_record.h"

#include "vision/draw.h"

#include <array>
#include <cmath>
#include <cstddef>

namespace vitreo {
namespace {

constexpr std::size_t kTrail = 150;  // frames: 10 s at 15 fps

/// Names of streams and columns are a part of the record's format; readers and reports look for
/// them.
StreamInfo servo_stream(const std::string& source) {
  return {"servo",
          source + ", and the loop's own numbers",
          {{"x", "m"},
           {"y", "m"},
           {"z", "m"},
           {"target_x", "m"},
           {"target_y", "m"},
           {"target_z", "m"},
           {"u_px", ""},
           {"v_px", ""},
           {"semi_major_px", ""},
           {"semi_minor_px", ""},
           {"angle", "rad"},
           {"residual_px", ""},
           {"sigma_x", "m"},
           {"sigma_y", "m"},
           {"sigma_z", "m"},
           {"headroom", ""},
           {"limited", ""},
           {"rim_seen", ""},
           {"pair_skew", "s"}}};
}

StreamInfo estimate_stream() {
  return {"estimate",
          "the loop's estimator: place now, and the velocity that the model does not know of",
          {{"x", "m"},
           {"y", "m"},
           {"z", "m"},
           {"disturbance_x", "m/s"},
           {"disturbance_y", "m/s"},
           {"disturbance_z", "m/s"},
           {"sigma_x", "m"},
           {"sigma_y", "m"},
           {"sigma_z", "m"},
           {"commanded_x", "m/s"},
           {"commanded_y", "m/s"},
           {"commanded_z", "m/s"}}};
}

StreamInfo current_stream(int coils) {
  StreamInfo info{"currents", "set-points of the coil amplifiers", {}};
  for (int coil = 1; coil <= coils; ++coil)
    info.channels.push_back({"i" + std::to_string(coil), "A"});
  return info;
}

/// In the order of estimate_stream(). The sigmas are with the localization's errors that stay,
/// which the filter does not know of.
std::array<double, 12> estimate_row(const ControlStep& step, const Observation& observation) {
  const control::PositionEstimate& known = *step.estimate;
  const Eigen::Vector3d& p = known.position;
  const Eigen::Vector3d pushed = known.unexplained();
  const Eigen::Vector3d s =
      (known.covariance.diagonal().head<3>() + observation.systematic.diagonal()).cwiseSqrt();
  const Eigen::Vector3d& u = step.commanded;
  return {p.x(), p.y(), p.z(), pushed.x(), pushed.y(), pushed.z(),
          s.x(), s.y(), s.z(), u.x(),      u.y(),      u.z()};
}

/// The stream of that name, which a second loop of the same run shares.
/// Streams are found by name, as a loop has no other trace of the one before it.
int stream_of(Recorder& recorder, const StreamInfo& info) {
  for (std::size_t i = 0; i < recorder.streams().size(); ++i)
    if (recorder.streams()[i].info.name == info.name) return static_cast<int>(i);
  return recorder.add_stream(info);
}

}  // namespace

ServoRecord::ServoRecord(Recorder& recorder, const Rig& rig, const std::string& source,
                         bool estimates)
    : recorder_(recorder),
      rig_(rig),
      samples_(stream_of(recorder, servo_stream(source))),
      currents_(stream_of(recorder, current_stream(rig.coils->channels()))) {
  if (estimates) estimates_ = stream_of(recorder, estimate_stream());
}

/// Two times: the observation's row has that of its exposure, currents and estimate have now. What
/// was not observed is NaN, in the tables NULL.
void ServoRecord::sample(Time exposed, Time now, const Observation& observation,
                         const control::Reference& target, const ControlStep& step) {
  const Eigen::Vector3d nowhere = Eigen::Vector3d::Constant(std::nan(""));
  const Eigen::Vector3d p = observation.position.value_or(nowhere);
  const Eigen::Vector3d t = target.position;
  const vision::Ellipse e = observation.ellipse ? observation.ellipse->ellipse
                                                : vision::Ellipse{nowhere.head<2>(), nowhere.x(),
                                                                  nowhere.x(), nowhere.x()};
  const Eigen::Vector3d sigma =
      observation.position ? observation.covariance.diagonal().cwiseSqrt().eval() : nowhere;
  // In the order of servo_stream().
  const std::array<double, 19> row{p.x(),
                                   p.y(),
                                   p.z(),
                                   t.x(),
                                   t.y(),
                                   t.z(),
                                   e.center_px.x(),
                                   e.center_px.y(),
                                   e.semi_major_px,
                                   e.semi_minor_px,
                                   e.angle,
                                   observation.residual_px,
                                   sigma.x(),
                                   sigma.y(),
                                   sigma.z(),
                                   step.headroom,
                                   step.limited ? 1.0 : 0.0,
                                   observation.ellipse ? observation.ellipse->inlier_fraction : 0,
                                   observation.pair_skew.value_or(std::nan(""))};
  recorder_.sample(samples_, exposed, row);
  recorder_.sample(currents_, now, rig_.coils->currents());
  if (estimates_ >= 0 && step.estimate)
    recorder_.sample(estimates_, now, estimate_row(step, observation));
  if (!observation.ellipse) return;
  trail_.push_back(e.center_px);
  if (trail_.size() > kTrail) trail_.pop_front();
}

/// Drawn on a copy; its name has the camera's own count.
void ServoRecord::picture(const Frame& frame, const Observation& observation,
                          const control::Reference& target, const std::string& caption) {
  vision::Overlay overlay;
  if (observation.ellipse) overlay.tracked = observation.ellipse->ellipse;
  overlay.trail_px.assign(trail_.begin(), trail_.end());
  // The target through the nominal optics: (5.2) to (5.11), then K of (5.12).
  const Eigen::Vector3d target_in_eye = target.position - rig_.model.eye_in_world;
  if (const auto m = rig_.model.projection.project(target_in_eye))
    overlay.target_px = rig_.model.top_image.pixel_from_m(*m);
  overlay.scale_bar_px = 1e-3 / rig_.model.top_image.pixel;
  overlay.scale_bar_label = "1 mm of aerial image";
  recorder_.picture("frame_" + std::to_string(frame.number), caption,
                    vision::draw_overlay(frame.image, overlay));
}

}  // namespace vitreo
