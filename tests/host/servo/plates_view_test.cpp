// Crossed plates in drawn images against the ellipse that the localizer expects of them, and a
// robot's axis found through the eye where it is steep and turned about itself.
// SPDX-License-Identifier: Apache-2.0
#include "control/robots.h"
#include "devices/sim/renderer.h"
#include "host/servo/localizer.h"
#include "optics/pose/object_pose.h"
#include "optics/system/prescriptions.h"
#include "vision/blob_tracker.h"

#include <Eigen/Geometry>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

constexpr double kDeg = std::numbers::pi / 180;
constexpr double kPixel = 14.3e-6;  // m
constexpr double kThickness = 42e-6;
constexpr int kWidth = 320, kHeight = 240;

sim::Renderer from_above() {
  sim::Sensor sensor;
  sensor.vignette = 0;
  const sim::ImageSize size{kWidth, kHeight};
  return sim::Renderer(
      sim::plain_view(kPixel, {159.5, 119.5}, size), {0.02, 550e-9, kPixel},
      [](const Eigen::Vector2d&, double) { return 0.0; },
      cv::Mat(size.height, size.width, CV_32F, cv::Scalar(0.6)), 0, sensor, {}, 9);
}

Eigen::Vector3d direction(double pitch, double azimuth) {
  return {std::cos(pitch) * std::cos(azimuth), std::cos(pitch) * std::sin(azimuth),
          std::sin(pitch)};
}

/// Body to world: one plate level, then rolled.
Eigen::Matrix3d attitude(double pitch, double azimuth, double roll) {
  const Eigen::Vector3d axis = direction(pitch, azimuth);
  const Eigen::Vector3d level = Eigen::Vector3d::UnitZ().cross(axis).normalized();
  Eigen::Matrix3d made;
  made.col(0) = Eigen::AngleAxisd(roll, axis) * level;
  made.col(1) = axis.cross(made.col(0));
  made.col(2) = axis;
  return made;
}

/// Center is none of it: mean semi-axis and the two of the elongation, px.
Eigen::Vector3d shape_of(const optics::EllipseVector& e) {
  const double half = (e[2] - e[3]) / 2;
  return {(e[2] + e[3]) / 2, half * std::cos(2 * e[4]), half * std::sin(2 * e[4])};
}

sim::DrawnBody drawn(const Eigen::Vector3d& place, const Eigen::Matrix3d& turn) {
  sim::BodyLook look;
  look.plate_thickness = kThickness;
  look.specular = 0.05;
  const sim::BodyState body{place, turn.col(2), 1e-3, 0.5e-3, turn.col(0)};
  return {body, body, look};
}

TEST(PlatesView, ShowTheTrackerWhatTheLocalizerExpects) {
  sim::Renderer renderer = from_above();
  vision::Background background;
  for (unsigned k = 0; k < 15; ++k) background.learn(renderer.render(nullptr, k));
  const auto plates = optics::crossed_ellipsoids(1e-3, 0.5e-3, kThickness / 2);
  const auto whole = optics::ellipsoid({0.5e-3, 0.5e-3, 1e-3});
  const Eigen::Vector3d right = Eigen::Vector3d::UnitX(), up = Eigen::Vector3d::UnitY();
  unsigned frame = 20;
  for (const double roll : {0.0, 5.0, 12.0})
    for (const double azimuth : {0.0, 20.0})
      for (const double pitch : {0.0, 15.0, 30.0, 45.0, 60.0, 70.0}) {
        const Eigen::Matrix3d turn = attitude(pitch * kDeg, azimuth * kDeg, roll * kDeg);
        vision::BlobTracker tracker(background, {});
        const auto seen = tracker.update(renderer.render({drawn({0, 0, 0}, turn)}, ++frame));
        ASSERT_TRUE(seen) << pitch;
        optics::EllipseVector e = seen->ellipse.vector();
        e[4] = -e[4];  // v points down
        const auto expected = optics::distant_ellipse(plates, turn, right, up, kPixel);
        const auto ellipsoid = optics::distant_ellipse(whole, turn, right, up, kPixel);
        ASSERT_TRUE(expected && ellipsoid);
        // px: a tenth is what the tracker's model of the rim leaves; of 70 px.
        EXPECT_LT((shape_of(*expected) - shape_of(e)).cwiseAbs().maxCoeff(), 0.15)
            << "pitch " << pitch << " azimuth " << azimuth << " roll " << roll;
        if (pitch == 60) {
          EXPECT_GT((shape_of(*ellipsoid) - shape_of(e)).norm(), 5) << "an ellipsoid is none of it";
        }
      }
}

// The bound of what one outline from above tells: a tilt d across the line of sight and a roll r
// make the same outline to first order where d = r tan(pitch) b^2 / (a^2 - b^2), so that the tilt
// is known no better than that part of the roll (docs/rotating_fields.md).
TEST(PlatesView, ARollLooksLikeATilt) {
  const double a = 1e-3, b = 0.5e-3;
  const auto plates = optics::crossed_ellipsoids(a, b, kThickness / 2);
  const auto shape = [&](const Eigen::Matrix3d& turn) -> Eigen::Vector3d {
    return shape_of(*optics::distant_ellipse(plates, turn, Eigen::Vector3d::UnitX(),
                                             Eigen::Vector3d::UnitY(), kPixel));
  };
  for (const double pitch : {30.0, 45.0, 65.0}) {
    const double tilt = 1 * kDeg;
    const double roll = tilt * (a * a - b * b) / (b * b * std::tan(pitch * kDeg));
    const Eigen::Matrix3d level = attitude(pitch * kDeg, 0, 0);
    // About the line across the axis in the vertical plane: the axis goes aside, along y.
    const Eigen::Matrix3d tilted = Eigen::AngleAxisd(tilt, level.col(1)) * level;
    const Eigen::Matrix3d both = tilted * Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ());
    const Eigen::Matrix3d against = tilted * Eigen::AngleAxisd(-roll, Eigen::Vector3d::UnitZ());
    const double alone = (shape(tilted) - shape(level)).norm();
    const double least =
        std::min((shape(both) - shape(level)).norm(), (shape(against) - shape(level)).norm());
    EXPECT_GT(alone, 0.2) << "px, of a degree";
    EXPECT_LT(least, 0.25 * alone) << "pitch " << pitch;
  }
}

/// A robot that the field turns `off` its expected axis, about the line across it that is level,
/// and about the one across both, as the two cameras see it.
struct Seen {
  double axis = 0;      // rad, off the true one
  double position = 0;  // m
};

class ThroughTheEye {
 public:
  ThroughTheEye() : renderer_(renderer(model_)), background_(background(renderer_)) {}

  Seen look(double pitch, double azimuth, double level, double across, double roll) {
    const Eigen::Matrix3d wanted = attitude(pitch, azimuth, 0);
    const Eigen::Vector3d axis = wanted.col(2);
    const Eigen::Matrix3d turn = Eigen::AngleAxisd(level, wanted.col(0)) *
                                 Eigen::AngleAxisd(across, wanted.col(1)) *
                                 Eigen::AngleAxisd(roll, axis) * wanted;
    const Eigen::Vector3d place(1e-3, 0, 0.5e-3);
    Localizer localizer(model_, background_, {1, 0, 0}, 0.07);
    for (int k = 1; k <= 20; ++k)  // azimuth, then pitch: a plate stays level
      localizer.expect_axis(k <= 10 ? direction(0, azimuth * k / 10)
                                    : direction(pitch * (k - 10) / 10, azimuth));
    return seen_by(localizer, place, turn);
  }

  /// The same after turns through `directions`, level at the first, about no roll of its own; then
  /// pitched by `off` more.
  Seen after(const std::vector<Eigen::Vector3d>& directions, const Eigen::Vector3d& place,
             double off) {
    Localizer localizer(model_, background_, directions.front(), 0.07);
    Eigen::Matrix3d turn;
    turn.col(2) = directions.front();
    turn.col(0) = Eigen::Vector3d::UnitZ().cross(turn.col(2)).normalized();
    turn.col(1) = turn.col(2).cross(turn.col(0));
    for (const Eigen::Vector3d& direction : directions) {
      turn = Eigen::Quaterniond::FromTwoVectors(turn.col(2), direction) * turn;
      localizer.expect_axis(direction);
    }
    const Eigen::Vector3d level = turn.col(2).cross(Eigen::Vector3d::UnitZ()).normalized();
    return seen_by(localizer, place, Eigen::AngleAxisd(off, level) * turn);
  }

 private:
  Seen seen_by(Localizer& localizer, const Eigen::Vector3d& place, const Eigen::Matrix3d& turn) {
    Observation seen = localizer.look(renderer_.render({drawn(place, turn)}, ++frame_));
    EXPECT_TRUE(seen.position);
    if (!seen.position) return {1, 1};
    SideObservation side;
    side.position = {place.x(), place.z()};
    side.covariance = 4e-12 * Eigen::Matrix2d::Identity();
    const auto shown = optics::distant_ellipse(
        optics::crossed_ellipsoids(1e-3, 0.5e-3, kThickness / 2), turn, Eigen::Vector3d::UnitX(),
        Eigen::Vector3d::UnitZ(), model_.side_pixel);
    side.direction = Eigen::Vector2d(std::cos((*shown)[4]), std::sin((*shown)[4]));
    side.direction_sigma = 0.3 / ((*shown)[2] - (*shown)[3]);
    localizer.straighten(side);
    join_side(seen, side);
    join_side_axis(seen, side);
    return {std::acos(std::min(1.0, std::abs(seen.axis->dot(turn.col(2))))),
            (*seen.position - place).norm()};
  }

  static sim::Renderer renderer(const RigModel& model) {
    sim::Sensor sensor;
    sim::View view =
        sim::eye_view(model.eye, model.microscope, model.top_image, {}, model.eye_in_world);
    const cv::Mat ground(view.height, view.width, CV_32F, cv::Scalar(0.5));
    return sim::Renderer(
        std::move(view), {model.microscope.numerical_aperture, 550e-9, model.top_image.pixel},
        sim::eye_defocus(model.eye, model.microscope, model.top_image), ground, 0, sensor, {}, 9);
  }
  static vision::Background background(sim::Renderer& renderer) {
    vision::Background learnt;
    for (unsigned k = 0; k < 15; ++k) learnt.learn(renderer.render(nullptr, k));
    return learnt;
  }
  static RigModel nominal() {
    RigModel model;
    model.eye = optics::model_eye_5_3();
    model.robot = control::coni_2mm();
    model.projection = optics::fit_single_viewpoint(model.eye, model.microscope, 7e-3);
    model.top_image.center_px = {691.5, 517.5};
    return model;
  }

  RigModel model_ = nominal();
  sim::Renderer renderer_;
  vision::Background background_;
  unsigned frame_ = 100;
};

TEST(PlatesView, TheAxisOfASteepRobotIsFoundByTwoCamerasAsFarAsItsRollIsKnown) {
  ThroughTheEye view;
  for (const double pitch : {0.0, 30.0, 60.0})
    for (const double azimuth : {0.0, 20.0})
      for (const double level : {0.0, 4.0})
        for (const double across : {0.0, 7.0})
          for (const double roll : {0.0, 4.0}) {
            const Seen seen =
                view.look(pitch * kDeg, azimuth * kDeg, level * kDeg, across * kDeg, roll * kDeg);
            // Degrees: of a quarter of a pixel of outline and the prior's pull; and the bound
            // above.
            const double bound = 2 + roll * std::tan(pitch * kDeg) / 3;
            EXPECT_LT(seen.axis / kDeg, bound)
                << pitch << " " << azimuth << " " << level << " " << across << " " << roll;
            EXPECT_LT(seen.position, 20e-6);
          }
}

// Turned from one level direction up and down to another, a robot that nothing rolls is rolled by
// the area that its axis went round: 28 degrees here, and the outline of a level robot is none of
// it. Of the pitch the top camera then knows little, so the side camera's must count.
TEST(PlatesView, TheAxisIsFoundOfARobotThatComesRolledOutOfASteepTurn) {
  ThroughTheEye view;
  const std::vector<Eigen::Vector3d> turns = {direction(0, -45 * kDeg), direction(45 * kDeg, 0),
                                              direction(0, 20 * kDeg)};
  for (const Eigen::Vector3d& place : {Eigen::Vector3d(0, 0, 2e-3),
                                       {-2.5e-3, -1.6e-3, 2e-3},
                                       {2.5e-3, -2e-3, 2e-3},
                                       {1e-3, 2e-3, 2e-3}})
    for (const double off : {-8.0, 0.0, 8.0}) {
      const Seen seen = view.after(turns, place, off * kDeg);
      EXPECT_LT(seen.axis / kDeg, 2) << place.transpose() << ", off by " << off;
      EXPECT_LT(seen.position, 30e-6) << place.transpose() << ", off by " << off;
    }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
