// SPDX-License-Identifier: Apache-2.0
#include "host/servo/servo_record.h"

#include "host/record/meaning.h"
#include "vision/draw.h"

#include <array>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <optional>
#include <vector>

namespace vitreo {
namespace {

constexpr std::size_t kTrail = 150;  // frames: 10 s at 15 fps

/// What a row of the stream "servo" is made of.
/// Borrowed for the one call in which the row is made.
struct ServoTurn {
  const Observation& observation;
  const control::Reference& target;
  const ControlStep& step;
  const RigModel& model;
  std::optional<Eigen::Vector2d> target_px;
};

Eigen::Vector3d position_of(const ServoTurn& turn) {
  return turn.observation.position.value_or(Eigen::Vector3d::Constant(std::nan("")));
}

/// In the top image; NaN where the robot was not seen by a camera.
double of_ellipse(const ServoTurn& turn, double (*value)(const vision::Ellipse&)) {
  return turn.observation.ellipse ? value(turn.observation.ellipse->ellipse) : std::nan("");
}

double covariance_of(const ServoTurn& turn, int row, int column) {
  return turn.observation.position ? turn.observation.covariance(row, column) : std::nan("");
}

/// A channel with its value: name, unit, meaning and calculation stand in one place.
struct ServoChannel {
  Channel info;
  double (*value)(const ServoTurn&);
};

// The channels of a position with its uncertainty.
const ServoChannel kPositionChannels[] = {
    {{"x", "m", "measured position of the robot", kWorld},
     [](const ServoTurn& t) { return position_of(t).x(); }},
    {{"y", "m", "measured position of the robot", kWorld},
     [](const ServoTurn& t) { return position_of(t).y(); }},
    {{"z", "m", "measured position of the robot", kWorld},
     [](const ServoTurn& t) { return position_of(t).z(); }},
    {{"target_x", "m", "where the robot was to be at that moment", kWorld},
     [](const ServoTurn& t) { return t.target.position.x(); }},
    {{"target_y", "m", "where the robot was to be at that moment", kWorld},
     [](const ServoTurn& t) { return t.target.position.y(); }},
    {{"target_z", "m", "where the robot was to be at that moment", kWorld},
     [](const ServoTurn& t) { return t.target.position.z(); }},
};

// Of the image as it came: which place in the eye a pixel shows depends on the depth.
const ServoChannel kImageChannels[] = {
    {{"u_px", "px", "center of the robot's ellipse", kTopImage},
     [](const ServoTurn& t) {
       return of_ellipse(t, [](const vision::Ellipse& e) { return e.center_px.x(); });
     }},
    {{"v_px", "px", "center of the robot's ellipse", kTopImage},
     [](const ServoTurn& t) {
       return of_ellipse(t, [](const vision::Ellipse& e) { return e.center_px.y(); });
     }},
    {{"semi_major_px", "px", "longer semi-axis of the robot's ellipse", kTopImage},
     [](const ServoTurn& t) {
       return of_ellipse(t, [](const vision::Ellipse& e) { return e.semi_major_px; });
     }},
    {{"semi_minor_px", "px", "shorter semi-axis of the robot's ellipse", kTopImage},
     [](const ServoTurn& t) {
       return of_ellipse(t, [](const vision::Ellipse& e) { return e.semi_minor_px; });
     }},
    {{"angle", "rad", "direction of the longer semi-axis, from u towards v", kTopImage},
     [](const ServoTurn& t) {
       return of_ellipse(t, [](const vision::Ellipse& e) { return e.angle; });
     }},
    {{"residual_px", "px",
      "how far the position's image is from the ellipse of the robot that it was computed from",
      kTopImage},
     [](const ServoTurn& t) { return t.observation.residual_px; }},
};

// The sigmas repeat the covariance's diagonal for readers that draw a band and nothing else.
const ServoChannel kStateChannels[] = {
    {{"sigma_x", "m", "standard deviation of x: the root of cov_xx", kWorld},
     [](const ServoTurn& t) { return std::sqrt(covariance_of(t, 0, 0)); }},
    {{"sigma_y", "m", "standard deviation of y: the root of cov_yy", kWorld},
     [](const ServoTurn& t) { return std::sqrt(covariance_of(t, 1, 1)); }},
    {{"sigma_z", "m", "standard deviation of z: the root of cov_zz", kWorld},
     [](const ServoTurn& t) { return std::sqrt(covariance_of(t, 2, 2)); }},
    {{"headroom", "1",
      "1 less the largest current as a part of its limit, over the coils in use: 0 is at the "
      "limit"},
     [](const ServoTurn& t) { return t.step.headroom; }},
    {{"limited", "1",
      "1: a current limit cost something of the field or the force that was wanted"},
     [](const ServoTurn& t) { return t.step.limited ? 1.0 : 0.0; }},
    {{"rim_seen", "1", "part of the ellipse's outline on which an edge was found in the image"},
     [](const ServoTurn& t) {
       return t.observation.ellipse ? t.observation.ellipse->inlier_fraction : 0;
     }},
    {{"pair_skew", "s", "exposure of the side camera's frame less that of the top camera's"},
     [](const ServoTurn& t) { return t.observation.pair_skew.value_or(std::nan("")); }},
    {{"pair_apart", "1",
      "how far apart both cameras see the robot, in standard deviations of that; 0: alone"},
     [](const ServoTurn& t) { return t.observation.apart; }},
    {{"cov_xx", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 0, 0); }},
    {{"cov_xy", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 0, 1); }},
    {{"cov_xz", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 0, 2); }},
    {{"cov_yy", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 1, 1); }},
    {{"cov_yz", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 1, 2); }},
    {{"cov_zz", "m^2", "covariance of the measured position", kWorld},
     [](const ServoTurn& t) { return covariance_of(t, 2, 2); }},
};

// What the live view draws beside the position. Clearances of the body's surface belong here.
const ServoChannel kDrawnChannels[] = {
    {{"retina_distance", "m",
      "of the measured position from the retina's sphere, along its normal"},
     [](const ServoTurn& t) {
       return t.observation.position ? retina_distance(t.model, position_of(t)) : std::nan("");
     }},
    {{"target_u_px", "px", "image of the target", kTopImage},
     [](const ServoTurn& t) { return t.target_px ? t.target_px->x() : std::nan(""); }},
    {{"target_v_px", "px", "image of the target", kTopImage},
     [](const ServoTurn& t) { return t.target_px ? t.target_px->y() : std::nan(""); }},
    {{"by_outline", "1",
      "1: located by the outline of the robot's body, 0: by the ellipse that it shows"},
     [](const ServoTurn& t) { return t.observation.by_outline ? 1.0 : 0.0; }},
};

/// Names and order of the columns are a part of the record's format; readers and reports look for
/// them. New ones come last.
const std::vector<ServoChannel>& servo_channels() {
  static const std::vector<ServoChannel> kAll = [] {
    std::vector<ServoChannel> all;
    const auto add = [&all](const auto& some) {
      all.insert(all.end(), std::begin(some), std::end(some));
    };
    add(kPositionChannels);
    add(kImageChannels);
    add(kStateChannels);
    add(kDrawnChannels);
    return all;
  }();
  return kAll;
}

StreamInfo servo_stream(const std::string& source) {
  StreamInfo info{"servo", source + ", and the loop's own numbers", {}, kExposure};
  for (const ServoChannel& one : servo_channels()) info.channels.push_back(one.info);
  return info;
}

StreamInfo estimate_stream() {
  const char* const kPlace = "position as the filter knows it at that moment";
  const char* const kPushes = "velocity that the model does not explain";
  const char* const kSigma =
      "standard deviation of the position, with what stays of the view's errors";
  const char* const kCommanded =
      "velocity of the commanded currents as it is believed, beyond levitation";
  return {"estimate",
          "the loop's estimator: place now, and the velocity that the model does not know of",
          {{"x", "m", kPlace, kWorld},
           {"y", "m", kPlace, kWorld},
           {"z", "m", kPlace, kWorld},
           {"disturbance_x", "m/s", kPushes, kWorld},
           {"disturbance_y", "m/s", kPushes, kWorld},
           {"disturbance_z", "m/s", kPushes, kWorld},
           {"sigma_x", "m", kSigma, kWorld},
           {"sigma_y", "m", kSigma, kWorld},
           {"sigma_z", "m", kSigma, kWorld},
           {"commanded_x", "m/s", kCommanded, kWorld},
           {"commanded_y", "m/s", kCommanded, kWorld},
           {"commanded_z", "m/s", kCommanded, kWorld}},
          kSetPoint};
}

/// The page and its targets read attitude and view from it, too.
StreamInfo clearance_stream() {
  return {"clearance",
          "distance of the robot's surface from the nearest wall, less the half width of its 99 % "
          "interval: its bound",
          {{"bound", "m", "lower end of the interval of the nearest wall"},
           {"distance", "m", "from the nearest wall"},
           {"uncertainty", "m", "half width of the 95 % interval"},
           {"retina", "m", "from the retina"},
           {"lens", "m", "from the lens"},
           {"at_lens", "1", "1 where the lens is the nearest wall"},
           {"margin", "m", "keep-out margin of the rig"},
           {"kept_out", "1", "1 where the margin changed the command"},
           {"axis_x", "1", "the robot's axis as it is believed", kWorld},
           {"axis_y", "1", "the robot's axis as it is believed", kWorld},
           {"axis_z", "1", "the robot's axis as it is believed", kWorld},
           {"axis_sigma", "rad", "standard deviation of its direction"},
           {"through_eye", "1", "1 where the camera looks through the eye"},
           {"calibrated", "1", "1 where the eye was calibrated"}},
          kExposure};
}

StreamInfo current_stream(int coils) {
  StreamInfo info{"currents", "set-points of the coil amplifiers", {}, kSetPoint};
  for (int coil = 1; coil <= coils; ++coil)
    info.channels.push_back({"i" + std::to_string(coil), "A", "current that was commanded"});
  return info;
}

StreamInfo command_stream() {
  const char* const kField =
      "field at the robot's last measured position for the commanded currents, by the rig's model; "
      "nothing outside of the model's region";
  const char* const kAxis = "unit vector of the orientation that is commanded to the robot";
  return {"command",
          "field and orientation that the loop commands",
          {{"field_x", "T", kField, kWorld},
           {"field_y", "T", kField, kWorld},
           {"field_z", "T", kField, kWorld},
           {"axis_x", "1", kAxis, kWorld},
           {"axis_y", "1", kAxis, kWorld},
           {"axis_z", "1", kAxis, kWorld},
           {"field_wanted", "T", "magnitude of the field for which the currents were computed"}},
          kSetPoint};
}

/// Image of a world position in the top camera: the nominal optics, (5.2) to (5.11), then K of
/// (5.12).
std::optional<Eigen::Vector2d> top_pixel(const RigModel& model, const Eigen::Vector3d& position) {
  if (!position.allFinite()) return std::nullopt;
  // The projection is in the eye's frame, whose origin is the retina's vertex; its result is in m
  // of the aerial image, and nothing for a position that has none.
  const auto m = model.projection.project(position - model.eye_in_world);
  if (!m) return std::nullopt;
  return model.top_image.pixel_from_m(*m);
}

/// The model's field for these currents, T; NaN where the model does not hold.
Eigen::Vector3d field_at(const RigModel& model, const Eigen::Vector3d& position,
                         const std::vector<double>& currents) {
  const auto count = static_cast<Eigen::Index>(currents.size());
  if (!position.allFinite() || !model.field.valid_at(position) || model.field.coils() != count)
    return Eigen::Vector3d::Constant(std::nan(""));
  // The model is linear in the currents; its first three rows are the field.
  const Eigen::VectorXd amperes = Eigen::Map<const Eigen::VectorXd>(currents.data(), count);
  return (model.field.matrix(position) * amperes + model.field.background(position)).head<3>();
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

// The retina is a sphere through the eye's origin, with its center a radius above it (thesis table
// 3.1).
double retina_distance(const RigModel& model, const Eigen::Vector3d& position) {
  const double radius = model.eye.surfaces.front().radius;
  return radius - (position - model.eye_in_world - Eigen::Vector3d(0, 0, radius)).norm();
}

ServoRecord::ServoRecord(Recorder& recorder, const Rig& rig, const Eigen::Vector3d& axis,
                         const std::string& source, bool estimates)
    : recorder_(recorder),
      rig_(rig),
      axis_(axis.normalized()),
      samples_(stream_of(recorder, servo_stream(source))),
      currents_(stream_of(recorder, current_stream(rig.coils->channels()))),
      clearances_(stream_of(recorder, clearance_stream())),
      commands_(stream_of(recorder, command_stream())) {
  if (estimates) estimates_ = stream_of(recorder, estimate_stream());
}

/// Three times: the observation's row has that of its exposure, the estimate's that of the
/// decision, for which it is; currents and field have now, when the amplifiers have them (eleven
/// reports of a USB-3103 later). What was not observed is NaN, in the tables NULL.
void ServoRecord::sample(Time exposed, Time decided, Time now, const Observation& observation,
                         const control::Reference& target, const ControlStep& step) {
  const ServoTurn turn{observation, target, step, rig_.model,
                       top_pixel(rig_.model, target.position)};
  row_.clear();
  for (const ServoChannel& one : servo_channels()) row_.push_back(one.value(turn));
  recorder_.sample(samples_, exposed, row_);
  const std::vector<double> currents = rig_.coils->currents();
  recorder_.sample(currents_, now, currents);
  if (observation.position) position_ = *observation.position;
  const Eigen::Vector3d field = field_at(rig_.model, position_, currents);
  recorder_.sample(commands_, now,
                   std::array{field.x(), field.y(), field.z(), axis_.x(), axis_.y(), axis_.z(),
                              step.currents.size() > 0 ? step.field : std::nan("")});
  if (estimates_ >= 0 && step.estimate)
    recorder_.sample(estimates_, decided, estimate_row(step, observation));
  if (!observation.ellipse) return;
  trail_.push_back(observation.ellipse->ellipse.center_px);
  if (trail_.size() > kTrail) trail_.pop_front();
}

void ServoRecord::clearance(Time exposed, const std::optional<control::Clearance>& clearance,
                            const RobotClearance& surface, const ControlStep& step) {
  const double unknown = std::nan("");
  const ClearanceBelief& belief = surface.belief();
  // In the order of clearance_stream(); a row each turn, what is not known in it NaN.
  std::array<double, 14> row{unknown,
                             unknown,
                             unknown,
                             unknown,
                             unknown,
                             unknown,
                             surface.margin(),
                             step.kept_out ? 1.0 : 0.0,
                             belief.axis.x(),
                             belief.axis.y(),
                             belief.axis.z(),
                             belief.axis_sigma,
                             belief.through_eye ? 1.0 : 0.0,
                             belief.calibrated ? 1.0 : 0.0};
  if (clearance) {
    const control::WallClearance& wall = clearance->nearest();
    row[0] = wall.bound();
    row[1] = wall.distance;
    row[2] = wall.uncertainty;
    row[3] = clearance->retina.distance;
    row[4] = clearance->lens.distance;
    row[5] = clearance->at_lens() ? 1 : 0;
  }
  recorder_.sample(clearances_, exposed, row);
}

/// Drawn on a copy; its name has the camera's own count.
void ServoRecord::picture(const Frame& frame, const Observation& observation,
                          const control::Reference& target, const std::string& caption) {
  vision::Overlay overlay;
  if (observation.ellipse) overlay.tracked = observation.ellipse->ellipse;
  overlay.trail_px.assign(trail_.begin(), trail_.end());
  if (const auto pixel = top_pixel(rig_.model, target.position)) overlay.target_px = *pixel;
  // The pixel's width is of the aerial image: the scale in the eye varies with depth.
  overlay.scale_bar_px = 1e-3 / rig_.model.top_image.pixel;
  overlay.scale_bar_label = "1 mm of aerial image";
  recorder_.picture("frame_" + std::to_string(frame.number), caption,
                    vision::draw_overlay(frame.image, overlay));
}

}  // namespace vitreo
