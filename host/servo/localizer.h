// Localizer: position of the robot from images, by the tracked ellipse, the pose behind it, and
// what a second camera adds. No clock, no device.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/rig/rig.h"
#include "host/servo/robot_eye.h"
#include "host/servo/robot_outline.h"
#include "host/servo/side_observation.h"
#include "host/servo/view_doubt.h"
#include "optics/pose/object_pose.h"
#include "vision/background.h"
#include "vision/ellipse.h"

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>

#include <memory>
#include <optional>

namespace vitreo {

/// One frame's measurement of the robot.
struct Observation {
  std::optional<vision::EllipseMeasurement> ellipse;  // in the top camera's image
  std::optional<Eigen::Vector3d> position;  // m, world; nothing when not seen or not localized
  /// m^2: of all that is uncertain. `systematic` is the part of it that stays from frame to frame:
  /// no filter averages it away, and a loop reckons with the rest alone (noise()).
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d systematic = Eigen::Matrix3d::Zero();
  /// m^2: of `systematic`, what stays only while the robot does not turn.
  Eigen::Matrix3d by_attitude = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d noise() const { return covariance - systematic; }
  double residual_px = 0;           // of the pose against the ellipse
  std::optional<double> pair_skew;  // s: the side camera's exposure less this one; nothing: alone
  /// How far apart both cameras see it, in standard deviations of that; 0: alone.
  double apart = 0;
  std::optional<Eigen::Vector3d> axis{};  // the robot's, unit, world; nothing where not estimated
  /// Of the axis, along directions across it (singular along it): near level the top camera knows
  /// the azimuth to half a degree and of the pitch little beyond what was expected.
  Eigen::Matrix3d axis_covariance = Eigen::Matrix3d::Zero();
  double axis_sigma = 0;    // rad: the mean of it over the two directions
  bool by_outline = false;  // of the body itself; else by the ellipse
};

/// One camera, through the optics of the eye (thesis 5).
class Localizer {
 public:
  /// `eye`: sees the robot's outline. The others as below.
  Localizer(const RigModel& model, std::unique_ptr<RobotEye> eye, const Eigen::Vector3d& axis,
            double axis_sigma = 0, ViewCalibration calibrated = ViewCalibration::none);
  /// By what differs from a background.
  /// `axis`: unit, world; taken for the robot's own, as the thesis does. With an `axis_sigma` (rad,
  /// above 0) it is only the most probable one, and the orientation is estimated with the position.
  /// `calibrated`: what of the model was found by a look at the robot on the retina.
  Localizer(const RigModel& model, vision::Background background, const Eigen::Vector3d& axis,
            double axis_sigma = 0, ViewCalibration calibrated = ViewCalibration::none);
  /// Of a plain view the depth is unknown: 0, with a variance that says so. It wants a second
  /// camera.
  Observation look(const cv::Mat& image);
  /// The axis that is expected from the next image on, unit, world. The body turns with it the
  /// short way, as a robot does that nothing turns about its axis.
  void expect_axis(const Eigen::Vector3d& axis);
  /// Of crossed plates that are turned about their axis the side camera's outline points another
  /// way than the axis does: by what, at the attitude of the last image, is taken off.
  void straighten(SideObservation& side) const;
  /// What was seen is not the robot: it is searched anew.
  void forget();
  const RobotEye& eye() const { return *eye_; }
  /// Whether the robot is localized by its body's outline, where a frame's contour allows it: of a
  /// shape that shows no ellipse, by an axis that is estimated.
  bool outlined() const { return outline_.has_value(); }
  /// From now on by the ellipse: an outline takes longer (docs/localization.md).
  void use_ellipse() { outline_.reset(); }

 private:
  struct Found {
    Eigen::Vector3d position_in_eye;
    Eigen::Matrix3d covariance;
    double residual_px;
    std::optional<Eigen::Matrix3d> attitude{};  // body to eye, its third axis the robot's
    Eigen::Matrix3d axis_covariance = Eigen::Matrix3d::Zero();  // eye
    std::optional<Eigen::Matrix3d> stays{};  // m^2, of an outline: of attitude and outline
    double axis_sigma = 0;                   // rad, what was taken to be unknown of the axis
  };
  void localize(Observation& observation);
  void from_above(Observation& observation) const;
  std::optional<Found> by_axis(const vision::EllipseMeasurement& seen);
  vision::EllipseMeasurement as_of_spheroid(const vision::EllipseMeasurement& seen) const;
  SystematicDoubt systematic_of(const Found& found, const vision::EllipseMeasurement& seen) const;
  bool relocate(Found& found, const vision::EllipseMeasurement& seen) const;
  Eigen::Matrix3d expected_attitude() const;
  bool lies_level() const;
  bool astray(double residual_px);
  std::optional<Found> with_axis(const optics::ObjectPoseSettings& settings,
                                 const vision::EllipseMeasurement& seen,
                                 const Eigen::Vector3d& start_in_eye) const;
  std::optional<Found> by_outline(const vision::EllipseMeasurement& seen,
                                  const Eigen::Vector3d& start_in_eye) const;

  RigModel model_;
  Eigen::Vector3d axis_;
  Eigen::Vector3d side_;  // unit, across axis_: one of the plates lies in the plane of both
  std::unique_ptr<RobotEye> eye_;
  optics::PoseSettings pose_;
  std::optional<optics::ObjectPoseSettings> flat_ended_;  // a cylinder or a disc
  std::optional<ViewDoubt> doubt_;                        // none of a plain view
  std::optional<optics::ObjectPoseSettings> tilted_;      // where the axis is to be estimated
  std::optional<optics::ObjectPoseSettings> astray_;      // where it is taken, and is another one
  bool is_astray_ = false;                                // in the last image
  std::optional<OutlineLocalizer> outline_;               // and the body shows no ellipse
  std::optional<Eigen::Vector3d> last_in_eye_;
  std::optional<Eigen::Matrix3d> last_attitude_;
};

/// Two orthogonal cameras: the position that fits both best, each weighted by its covariance
/// (least squares). The side camera measures x and z; what z says about x and y along the top
/// camera's line of sight is in the covariance: a robot that is larger than believed is nearer for
/// one of them, not for both. An observation without a position stays so: one
/// side view is not enough. Both in the world frame.
void join_side(Observation& observation, const SideObservation& side);

/// The same of the axis, where the side camera measured its direction in the plane of x and z and
/// the top camera has one at all.
void join_side_axis(Observation& observation, const SideObservation& side);

}  // namespace vitreo
