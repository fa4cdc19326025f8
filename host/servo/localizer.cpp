// SPDX-License-Identifier: Apache-2.0
#include "host/servo/localizer.h"

#include "control/crossed_plates.h"
#include "host/rig/measured_chain.h"
#include "host/servo/believed_view.h"
#include "optics/pose/equivalent_ellipse.h"
#include "optics/pose/level_plates.h"
#include "optics/pose/pose.h"

#include <Eigen/Geometry>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// What no tracker's covariance knows, the errors of contour and pose, is not below a tenth of a
/// pixel.
constexpr double kModelError_px = 0.1;

/// By how much the tracked outline's axes err for good: at most 0.1 px for plates whose roll is
/// known to 20 degrees (tests/host/servo/plates_view_test), and the tracker's own.
constexpr double kOutlineError_px = 0.15;

/// The same of a contour against the body's own outline: the plates' edges are neither sharp nor
/// round, which is 0.1 px (docs/localization.md).
constexpr double kContourError_px = 0.1;

constexpr double kEye = 30e-3;  // m, from the retina's vertex: more than any eye is long

/// A robot that does not lie as its field does not fit the outline of one that does, by kAskew_px
/// and more (px; one that does by 0.1 on the nominal eye), until it fits by less than kStraight_px.
/// Between, it may lie as it likes, within kAstray, rad.
constexpr double kAskew_px = 0.2;
constexpr double kStraight_px = 0.12;
constexpr double kAstray = 0.3;

/// The body whose outline the tracker sees.
optics::ObjectModel body_of(const control::Robot& robot) {
  const double thickness = control::plate_thickness(robot);
  if (robot.shape == control::BodyShape::crossed_plates && thickness > 0)
    return optics::crossed_ellipsoids(robot.semi_axis, robot.semi_radius, thickness / 2);
  if (has_flat_ends(robot)) return optics::cylinder(robot.semi_axis, robot.semi_radius);
  return optics::ellipsoid({robot.semi_radius, robot.semi_radius, robot.semi_axis});
}

/// m^2: how well it is known where the eye stands in the world. A chain that was measured by places
/// of a side camera, which looks along y, has its x and z: as its scale s and its turn t have them,
/// (s x + t z, s z - t x).
Eigen::Matrix3d place_covariance(const RigModel& model, const Eigen::Vector3d& position_in_eye,
                                 bool measured) {
  const ViewUncertainty& known = model.uncertainty;
  Eigen::Vector3d sigma = Eigen::Vector3d::Constant(known.eye);
  if (!measured || model.chain->touched) return sigma.cwiseAbs2().asDiagonal();
  const Eigen::Vector3d place = position_in_eye + model.eye_in_world;
  const Eigen::Vector3d by_scale = known.pixel * Eigen::Vector3d(place.x(), 0, place.z());
  const Eigen::Vector3d by_turn = known.tilt * Eigen::Vector3d(place.z(), 0, -place.x());
  sigma.x() = sigma.z() = 0;
  return Eigen::Matrix3d(sigma.cwiseAbs2().asDiagonal()) + by_scale * by_scale.transpose() +
         by_turn * by_turn.transpose();
}

}  // namespace

/// Throws std::invalid_argument naming axis_sigma. `tilted_` is set only where the axis is to be
/// estimated; it needs the answer by the known axis as its start, so both solvers are prepared.
Localizer::Localizer(const RigModel& model, std::unique_ptr<RobotEye> eye,
                     const Eigen::Vector3d& axis, double axis_sigma, ViewCalibration calibrated)
    : model_(model),
      axis_(axis),
      side_(optics::level_side(axis)),
      eye_(std::move(eye)),
      pose_(pose_settings_of(model)) {
  if (!(axis_sigma >= 0 && axis_sigma < 1))
    throw std::invalid_argument("axis_sigma must be in [0, 1) rad");
  if (!model_.plain_view) doubt_.emplace(model_, axis_, calibrated);
  if (has_flat_ends(model_.robot)) flat_ended_ = object_settings_of(model_, body_of(model_.robot));
  if (!(axis_sigma > 0)) {
    if (model_.plain_view) return;
    astray_ = object_settings_of(model_, body_of(model_.robot));
    astray_->orientation_sigma = kAstray;
    return;
  }
  tilted_ = object_settings_of(model_, body_of(model_.robot));
  tilted_->orientation_sigma = axis_sigma;
  // A cylinder or a disc is better found by its own ellipse (docs/localization.md): the rim of flat
  // ends is known to two tenths of a pixel and their corners are blurred, which a look on the
  // retina takes off the ellipse and not off the outline.
  if (model_.robot.shape != control::BodyShape::crossed_plates || model_.plain_view) return;
  const auto body = outlined_body(model_.robot);
  if (!body) return;
  optics::ObjectPoseSettings by_contour = *tilted_;
  by_contour.object = *body;
  outline_.emplace(std::move(by_contour), axis_sigma, kContourError_px);
}

Localizer::Localizer(const RigModel& model, vision::Background background,
                     const Eigen::Vector3d& axis, double axis_sigma, ViewCalibration calibrated)
    : Localizer(model, background_eye(model, std::move(background)), axis, axis_sigma, calibrated) {
}

void Localizer::forget() {
  last_in_eye_.reset();
  last_attitude_.reset();
  is_astray_ = false;
  eye_->forget();
}

void Localizer::expect_axis(const Eigen::Vector3d& axis) {
  const Eigen::Vector3d side =
      Eigen::Quaterniond::FromTwoVectors(axis_, axis).toRotationMatrix() * side_;
  axis_ = axis;
  side_ = (side - side.dot(axis) * axis).normalized();
}

Eigen::Matrix3d Localizer::expected_attitude() const {
  Eigen::Matrix3d attitude;
  attitude << side_, axis_.cross(side_), axis_;
  return attitude;
}

void Localizer::straighten(SideObservation& side) const {
  if (!side.direction || !last_attitude_ || !tilted_ || !tilted_->object.crossed) return;
  // Parallel rays along y, x to the right and z up.
  const Eigen::Matrix3d& attitude = *last_attitude_;
  const auto shown = optics::distant_ellipse(tilted_->object, attitude, Eigen::Vector3d::UnitX(),
                                             Eigen::Vector3d::UnitZ(), model_.side_pixel);
  constexpr double kRound_px = 2;  // difference of the axes, below which there is no direction
  if (!shown || (*shown)[2] - (*shown)[3] < kRound_px) return side.direction.reset();
  const double turned = (*shown)[4] - std::atan2(attitude(2, 2), attitude(0, 2));
  side.direction = Eigen::Rotation2Dd(-turned) * *side.direction;
}

/// An observation with an ellipse and without a position is a robot that is seen and could not be
/// located.
Observation Localizer::look(const cv::Mat& image) {
  Observation observation;
  observation.ellipse = eye_->look(image);
  if (observation.ellipse) localize(observation);
  return observation;
}

/// The thesis' localization knows spheroids: of flat ends the ellipse is larger, by an eighth where
/// they are seen from the side, and by nothing from straight above.
vision::EllipseMeasurement Localizer::as_of_spheroid(const vision::EllipseMeasurement& seen) const {
  if (!flat_ended_) return seen;
  const optics::EllipseVector own = seen.ellipse.vector();
  const auto round = last_in_eye_ ? optics::as_of_spheroid(*flat_ended_, own, axis_, *last_in_eye_)
                                  : optics::as_of_spheroid(*flat_ended_, own, axis_);
  vision::EllipseMeasurement converted = seen;
  if (round) converted.ellipse = {round->head<2>(), (*round)[2], (*round)[3], (*round)[4]};
  return converted;
}

/// The thesis' localization, (5.15): the axis is known, "taken from the magnetic field controller"
/// (5.5). It starts from the last frame's position, else from a search along the line of sight.
std::optional<Localizer::Found> Localizer::by_axis(const vision::EllipseMeasurement& seen) {
  const optics::EllipseVector observed = seen.ellipse.vector();
  // `axis_` is in the world frame: the axes of eye and world are parallel.
  if (!last_in_eye_) last_in_eye_ = optics::first_guess(pose_, observed, axis_);
  if (!last_in_eye_) return std::nullopt;
  const auto pose = optics::locate(pose_, observed, seen.covariance, axis_, *last_in_eye_);
  if (!pose) return std::nullopt;
  return Found{pose->position_in_eye, pose->covariance, pose->residual_px};
}

/// Maximum a posteriori estimate of position and axis, with a Gaussian prior on the axis about the
/// commanded one. An axis a degree or two off makes the robot look shorter or longer where it is
/// seen askew, which by_axis takes for a depth; here the depth comes from the width, which no pitch
/// changes, and the length says how the robot lies (docs/control.md).
std::optional<Localizer::Found> Localizer::with_axis(const optics::ObjectPoseSettings& settings,
                                                     const vision::EllipseMeasurement& seen,
                                                     const Eigen::Vector3d& start_in_eye) const {
  // Axis and outline are weighed against each other by their systematic errors, sigma_axis against
  // kOutlineError_px; the covariance given to the solver stays that of the noise, which a filter
  // averages. Scaling the prior's sigma by noise / hypot(noise, outline error) does both. Weighed
  // by its noise alone the outline would bend the axis by five degrees to save a tenth of a pixel,
  // one way or the other from frame to frame where the robot is seen from straight above.
  optics::ObjectPoseSettings weighed = settings;
  if (weighed.object.crossed && lies_level())
    weighed.object = optics::ellipsoid(
        {model_.robot.semi_radius, model_.robot.semi_radius, model_.robot.semi_axis});
  const double noise = std::sqrt(seen.covariance(2, 2));  // px, of the semi-major axis
  const double error = kOutlineError_px;
  weighed.orientation_sigma *= noise / std::hypot(noise, error);
  if (!(weighed.orientation_sigma > 0)) return std::nullopt;
  const auto found = optics::locate_object(weighed, seen.ellipse.vector(), seen.covariance,
                                           {start_in_eye, expected_attitude()});
  if (found.status != optics::PoseStatus::found && found.status != optics::PoseStatus::ambiguous)
    return std::nullopt;
  const optics::PoseCandidate& best = found.candidates.front();  // the smallest chi^2
  const Eigen::Matrix3d covariance = best.covariance.topLeftCorner<3, 3>();
  if (!covariance.allFinite()) return std::nullopt;
  // The body's third axis is the one of symmetry. The outline's systematic error, over the length
  // that shows it, is the least that is unknown of it, but for the prior.
  const double outline = error / seen.ellipse.semi_major_px;
  const double known = 1 / std::hypot(1 / outline, 1 / settings.orientation_sigma);
  // The solver had the prior as much too narrow as the outline, so its covariance is that of the
  // noise. What is unknown of the axis is the prior where the outline does not show it: back to
  // scale.
  const double scale = weighed.orientation_sigma / settings.orientation_sigma;
  Eigen::Matrix<double, 3, 2> across;  // what turning about the body's first two axes does to it
  across << -best.pose.orientation.col(1), best.pose.orientation.col(0);
  const Eigen::Matrix2d turning = best.covariance.block<2, 2>(3, 3) / (scale * scale) +
                                  known * known * Eigen::Matrix2d::Identity();
  return Found{best.pose.position_in_eye,
               covariance,
               best.residual_px,
               best.pose.orientation,
               across * turning * across.transpose(),
               {},
               settings.orientation_sigma};
}

bool Localizer::astray(double residual_px) {
  is_astray_ = residual_px > (is_astray_ ? kStraight_px : kAskew_px);
  return is_astray_;
}

/// Of plates that lie the ellipsoid's outline is off by the square of the sine of their pitch, 0.3
/// px at 15 degrees, and of rolled ones by what is lacking of their width, 35 px (1 - cos roll);
/// the plates' own by a tenth of a pixel, which is 40 um of depth: the better of the two
/// (docs/rotating_fields.md). A robot that was turned through a steep pitch comes back rolled.
bool Localizer::lies_level() const {
  constexpr double kLies = 0.15;     // sine of the pitch at which both are off alike
  constexpr double kLevel = 0.0757;  // sine of the roll, the same
  const double roll = std::min(std::abs(side_.z()), std::abs(axis_.cross(side_).z()));
  return std::abs(axis_.z()) < kLies && roll < kLevel;
}

/// The body's own outline through the contour's points, with the attitude that is expected: plates
/// that are seen askew lose of their width what no ellipsoid loses. Nothing where a contour is
/// missing.
std::optional<Localizer::Found> Localizer::by_outline(const vision::EllipseMeasurement& seen,
                                                      const Eigen::Vector3d& start_in_eye) const {
  if (!outline_) return std::nullopt;
  const auto pose = outline_->locate(seen, start_in_eye, expected_attitude());
  if (!pose) return std::nullopt;
  return Found{pose->position_in_eye, pose->noise, pose->residual_px,         pose->attitude,
               pose->axis_covariance, pose->stays, tilted_->orientation_sigma};
}

/// The view from straight above without an eye, a scaled orthographic projection: x and y, and of
/// the depth nothing but that it is in the eye.
void Localizer::from_above(Observation& observation) const {
  const optics::ImageScale& image = model_.top_image;
  const Eigen::Vector2d away =
      (observation.ellipse->ellipse.center_px - image.center_px) * image.pixel;
  // Image v points down, world y up.
  observation.position = Eigen::Vector3d(away.x(), -away.y(), 0);
  // Linear propagation J C J' with J = diag(pixel, -pixel, 0).
  Eigen::Matrix3d from_image = Eigen::Vector3d(image.pixel, -image.pixel, 0).asDiagonal();
  observation.covariance.setZero();
  observation.covariance.topLeftCorner<2, 2>() =
      observation.ellipse->covariance.topLeftCorner<2, 2>() +
      kModelError_px * kModelError_px * Eigen::Matrix2d::Identity();
  observation.covariance = from_image * observation.covariance * from_image;
  const ViewUncertainty& known = model_.uncertainty;
  const BenchUncertainty& bench = known.bench;
  // Of scale and center. The plane in focus and the robot are some millimeters apart in depth,
  // which nothing here shows: a pupil makes a scale of it, and a tilt moves the image.
  constexpr double kApart = 3e-3;  // m
  const double scale = std::hypot(known.pixel, bench.pixel, bench.pupil_power * kApart);
  const double moved =
      std::hypot(bench.center, kApart * std::hypot(known.tilt, bench.microscope_tilt));
  const Eigen::Vector2d out = observation.position->head<2>();
  observation.systematic.setZero();
  observation.systematic.topLeftCorner<2, 2>() =
      scale * scale * out * out.transpose() + moved * moved * Eigen::Matrix2d::Identity();
  observation.covariance += observation.systematic;
  observation.covariance(2, 2) = kEye * kEye;
}

/// What stays wrong: eye, scale, tilt, robot size, outline and axis by the viewing chain, and where
/// the eye stands. Where the chain shows nothing the position is anywhere in the eye.
SystematicDoubt Localizer::systematic_of(const Found& found,
                                         const vision::EllipseMeasurement& seen) const {
  const bool measured = doubt_->measured();
  const Eigen::Matrix3d of_place = place_covariance(model_, found.position_in_eye, measured);
  const Eigen::Vector3d axis =
      found.attitude && !measured ? Eigen::Vector3d(found.attitude->col(2)) : axis_;
  const auto of_view = doubt_->systematic(found.position_in_eye, axis, seen,
                                          found.attitude.has_value(), found.axis_sigma);
  if (!of_view) return {kEye * kEye * Eigen::Matrix3d::Identity(), Eigen::Matrix3d::Zero()};
  if (measured || !found.stays) return {of_place + of_view->whole, of_view->by_attitude};
  // Attitude and outline as the outline's own fit has them; eye and calibration as of the ellipse.
  return {of_place + of_view->whole - of_view->by_attitude + *found.stays, *found.stays};
}

/// What the centered optics found is where the measured chain's own search begins, about the axis
/// that is expected: the one that those optics estimate has their error in it. False where the
/// chain shows no robot there.
bool Localizer::relocate(Found& found, const vision::EllipseMeasurement& seen) const {
  const auto at = doubt_->located(found.position_in_eye, axis_, seen, found.axis_sigma);
  if (at) found.position_in_eye = *at;
  return at.has_value();
}

/// With an uncertain axis by_axis() gives the start and by_outline() the answer, or with_axis();
/// where they fail there is no position.
void Localizer::localize(Observation& observation) {
  if (model_.plain_view) return from_above(observation);
  const vision::EllipseMeasurement of_spheroid = as_of_spheroid(*observation.ellipse);
  auto found = by_axis(of_spheroid);
  if (found && tilted_) {
    const Eigen::Vector3d start = found->position_in_eye;
    found = by_outline(*observation.ellipse, start);
    observation.by_outline = found.has_value();
    if (!found) found = with_axis(*tilted_, *observation.ellipse, start);
  } else if (found && astray(found->residual_px)) {
    // What misfits the axis that is taken goes on counting: an axis that is free explains a vessel
    // as well.
    const double misfit = found->residual_px;
    found = with_axis(*astray_, *observation.ellipse, found->position_in_eye);
    if (found) found->residual_px = misfit;
  }
  // A residual may have a minimum far outside, where no robot can be: of 1e6 m, for one outline cut
  // by the image's edge.
  if (!found || !(found->position_in_eye.norm() < kEye)) {
    // The next frame starts afresh. What is no robot is not followed: the robot may be elsewhere in
    // the picture.
    forget();
    return;
  }
  last_in_eye_ = found->position_in_eye;
  last_attitude_ = found->attitude;
  if (doubt_->measured() && !relocate(*found, of_spheroid)) return;
  observation.position = found->position_in_eye + model_.eye_in_world;
  // The model's own error is systematic; as a variance it keeps a filter from trusting the noise
  // alone.
  const double error = kModelError_px * model_.top_image.pixel;
  const SystematicDoubt doubt = systematic_of(*found, of_spheroid);
  observation.systematic = doubt.whole;
  observation.by_attitude = doubt.by_attitude;
  observation.covariance =
      found->covariance + error * error * Eigen::Matrix3d::Identity() + observation.systematic;
  observation.residual_px = found->residual_px;
  // One that is astray may have its twin's axis, on the other side of the line of sight.
  if (!found->attitude || is_astray_) return;
  observation.axis = found->attitude->col(2);
  observation.axis_covariance = found->axis_covariance;
  observation.axis_sigma = std::sqrt(found->axis_covariance.trace() / 2);
}

// The update of a Kalman filter with the side view as measurement z = H p + noise, which for
// independent Gaussian errors is the least squares estimate weighted by both covariances. Errors
// that both cameras share are not modeled.
void join_side(Observation& observation, const SideObservation& side) {
  if (!observation.position) return;
  Eigen::Matrix<double, 2, 3> H;
  H << 1, 0, 0, 0, 0, 1;  // the side camera sees x and z
  const Eigen::Matrix3d P = observation.covariance;
  const Eigen::Matrix2d S = H * P * H.transpose() + side.covariance;      // of the innovation
  const Eigen::Matrix<double, 3, 2> K = P * H.transpose() * S.inverse();  // K = P H' S^-1
  // Two covariances that are both singular: the top view's answer stays.
  if (!K.allFinite()) return;
  const Eigen::Vector2d between = side.position - H * *observation.position;
  observation.apart = std::sqrt(between.dot(S.inverse() * between));  // Mahalanobis
  *observation.position += K * between;
  // Joseph form, (I - K H) P (I - K H)' + K R K': stays symmetric and positive definite.
  const Eigen::Matrix3d left = Eigen::Matrix3d::Identity() - K * H;
  observation.covariance = left * P * left.transpose() + K * side.covariance * K.transpose();
  // Of both cameras' errors what stays, by the same weights.
  observation.systematic =
      left * observation.systematic * left.transpose() + K * side.systematic * K.transpose();
  observation.by_attitude = left * observation.by_attitude * left.transpose();
}

// The side view's direction s, in the plane of x and z, says of the axis a that a.n = 0, n across s
// in that plane: one scalar measurement of a Kalman filter.
void join_side_axis(Observation& observation, const SideObservation& side) {
  if (!observation.axis || !side.direction) return;
  const Eigen::Vector3d normal(-side.direction->y(), 0, side.direction->x());
  Eigen::Vector3d& axis = *observation.axis;
  const double shown = std::hypot(axis.x(), axis.z());  // of its length, in the side view
  const double noise = side.direction_sigma * shown;
  Eigen::Matrix3d& P = observation.axis_covariance;
  const Eigen::Vector3d K = P * normal / (normal.dot(P * normal) + noise * noise);
  if (!K.allFinite()) return;
  axis = (axis - axis.dot(normal) * K).normalized();
  P = ((Eigen::Matrix3d::Identity() - K * normal.transpose()) * P).eval();
  observation.axis_sigma = std::sqrt(std::max(0.0, P.trace()) / 2);
}

}  // namespace vitreo
