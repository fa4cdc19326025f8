// What errors of size and pixel move a position by, against localizations with those errors; first
// guesses; and what the localization by pose refuses.
// SPDX-License-Identifier: Apache-2.0
#include "optics/pose/pose.h"

#include <Eigen/Core>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo::optics {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kFar = std::numeric_limits<double>::infinity();
const Vector3d kPosition(2.1e-3, -1.3e-3, 3.9e-3);
const Vector3d kAxis(0.7, 0.4, -0.3);

PoseSettings settings() {
  PoseSettings s;
  s.projection.viewpoint = 17.2e-3;
  s.projection.slope_from_m = {2.3e5, 700, 63, 0};
  s.projection.max_m = 6.5e-3;
  s.projection.max_z = 15e-3;
  s.projection.axis_m = {0.21e-3, -0.13e-3};
  s.image.pixel = 9.7e-6;
  s.image.center_px = {612.3, 488.9};
  s.robot = {0.93e-3, 0.41e-3};
  s.angle_weight = 0.23;
  s.contour_points = 40;
  s.max_residual_px = 5;
  return s;
}
EllipseVector seen() { return *project_spheroid(settings(), kPosition, kAxis); }

TEST(PoseReferenceSensitivity, is_what_wrong_sizes_and_pixels_do) {
  // aside, and about the camera's center, where a pixel's error changes little but the axes
  for (const Vector3d& position : {kPosition, Vector3d(0.21e-3, -0.14e-3, 3.9e-3)}) {
    const PoseSettings believed = settings();
    const auto stated = pose_sensitivity(believed, position, kAxis);
    ASSERT_TRUE(stated);
    const auto found = [&](const PoseSettings& truth) {
      const auto e = project_spheroid(truth, position, kAxis);
      return locate(believed, *e, EllipseCovariance::Identity(), kAxis, position)->position_in_eye;
    };
    const double h = 2e-3;
    Vector3d size(0, 0, 0);
    Vector3d pixel(0, 0, 0);
    for (const double sign : {-1.0, 1.0}) {
      PoseSettings truth = settings();
      truth.robot.semi_axis *= 1 + sign * h;
      truth.robot.semi_radius *= 1 + sign * h;
      size += sign * found(truth) / (2 * h);
      truth = settings();
      truth.image.pixel *= 1 + sign * h;
      pixel += sign * found(truth) / (2 * h);
    }
    EXPECT_GT(size.norm(), 5e-3);  // a body larger by a tenth looks nearer by more than 0.5 mm
    EXPECT_LT((stated->size - size).norm(), (position == kPosition ? 1e-2 : 2e-2) * size.norm())
        << stated->size.transpose() << " | " << size.transpose();
    EXPECT_LT((stated->pixel - pixel).norm(), 1e-3 * pixel.norm())
        << stated->pixel.transpose() << " | " << pixel.transpose();
  }
}

TEST(PoseReferenceGuess, has_the_line_of_sight_and_the_size) {
  for (const Vector3d& position :
       {kPosition, Vector3d(-1.2e-3, 1.8e-3, 6.1e-3), Vector3d(0.3e-3, -0.2e-3, 2e-3)}) {
    const auto e = project_spheroid(settings(), position, kAxis);
    const auto guess = first_guess(settings(), *e, -4 * kAxis);
    ASSERT_TRUE(guess);
    EXPECT_LT((*guess - position).norm(), 0.2e-3);
    const auto found = locate(settings(), *e, EllipseCovariance::Identity(), kAxis, *guess);
    ASSERT_TRUE(found);
    EXPECT_LT((found->position_in_eye - position).norm(), 1e-9);
    EXPECT_LT(found->residual_px, 1e-6);
  }
  const auto scaled = [&](double factor) {
    EllipseVector e = seen();
    e[2] *= factor;
    e[3] *= factor;
    return first_guess(settings(), e, kAxis);
  };
  EXPECT_FALSE(scaled(0.1));
  EXPECT_FALSE(scaled(60));
  EllipseVector aside = seen();
  aside[0] += 2000;
  EXPECT_FALSE(first_guess(settings(), aside, kAxis));
}

TEST(PoseReferenceGuess, gives_nothing_that_does_not_fit) {
  EXPECT_FALSE(project_spheroid(settings(), {9e-3, 9e-3, 12e-3}, kAxis));
  EXPECT_FALSE(pose_sensitivity(settings(), {9e-3, 9e-3, 12e-3}, kAxis));
  EXPECT_FALSE(
      locate(settings(), seen(), EllipseCovariance::Identity(), kAxis, {9e-3, 9e-3, 12e-3}));
  // as wide as it never is: the residual decides
  EllipseVector round = seen();
  round[3] = 0.8 * round[2];
  PoseSettings s = settings();
  s.max_residual_px = 1e3;
  const auto loose = locate(s, round, EllipseCovariance::Identity(), kAxis, kPosition);
  ASSERT_TRUE(loose);
  for (const double factor : {0.999, 1.001}) {
    s.max_residual_px = factor * loose->residual_px;
    EXPECT_EQ(locate(s, round, EllipseCovariance::Identity(), kAxis, kPosition).has_value(),
              factor > 1);
  }
}

std::string refusal(const std::function<void()>& act) {
  try {
    act();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// Every function with these settings refuses by a text that begins with the name.
void expect_all(const PoseSettings& s, const std::string& name) {
  const auto begins = [&](const std::string& what) {
    EXPECT_NE(what, "") << name;
    EXPECT_NE(what.find(name), std::string::npos) << what;
  };
  begins(refusal([&] { s.check(); }));
  begins(refusal([&] { project_spheroid(s, kPosition, kAxis); }));
  begins(refusal([&] { locate(s, seen(), EllipseCovariance::Identity(), kAxis, kPosition); }));
  begins(refusal([&] { pose_sensitivity(s, kPosition, kAxis); }));
  begins(refusal([&] { first_guess(s, seen(), kAxis); }));
}

TEST(PoseReferenceArguments, of_the_settings_are_checked) {
  const auto with = [](const std::function<void(PoseSettings&)>& change) {
    PoseSettings s = settings();
    change(s);
    return s;
  };
  for (const double bad : {0.0, -1e-3, kNan, kFar}) {
    expect_all(with([&](PoseSettings& s) { s.robot.semi_axis = bad; }), "semi_axis");
    expect_all(with([&](PoseSettings& s) { s.robot.semi_radius = bad; }), "semi_radius");
    expect_all(with([&](PoseSettings& s) { s.image.pixel = bad; }), "pixel");
    if (bad != kFar) {  // without a bound all is accepted
      expect_all(with([&](PoseSettings& s) { s.max_residual_px = bad; }), "max_residual_px");
    }
    expect_all(with([&](PoseSettings& s) { s.projection.max_m = bad; }), "max_m");
    if (bad != 0) {
      expect_all(with([&](PoseSettings& s) { s.angle_weight = bad; }), "angle_weight");
    }
  }
  for (const int bad : {-3, 0, 7, 65}) {
    expect_all(with([&](PoseSettings& s) { s.contour_points = bad; }), "contour_points");
  }
  for (const int good : {8, 64}) {
    with([&](PoseSettings& s) { s.contour_points = good; }).check();
  }
  with([](PoseSettings& s) { s.angle_weight = 0; }).check();
}

TEST(PoseReferenceArguments, of_each_call_are_checked) {
  const PoseSettings s = settings();
  const EllipseCovariance c = EllipseCovariance::Identity();
  const auto names = [](const std::string& name, const std::function<void()>& act) {
    EXPECT_EQ(refusal(act).rfind(name, 0), 0u) << name << " | " << refusal(act);
    EXPECT_NE(refusal(act), "");
  };
  for (int k = 0; k < 3; ++k) {
    for (const double bad : {kNan, kFar, -kFar}) {
      Vector3d position = kPosition;
      Vector3d axis = kAxis;
      position[k] = bad;
      axis[k] = bad;
      names("position_in_eye", [&] { project_spheroid(s, position, kAxis); });
      names("position_in_eye", [&] { pose_sensitivity(s, position, kAxis); });
      names("start_in_eye", [&] { locate(s, seen(), c, kAxis, position); });
      names("axis_in_eye", [&] { project_spheroid(s, kPosition, axis); });
      names("axis_in_eye", [&] { pose_sensitivity(s, kPosition, axis); });
      names("axis_in_eye", [&] { locate(s, seen(), c, axis, kPosition); });
      names("axis_in_eye", [&] { first_guess(s, seen(), axis); });
    }
  }
  const Vector3d none(0, 0, 0);
  names("axis_in_eye", [&] { project_spheroid(s, kPosition, none); });
  names("axis_in_eye", [&] { pose_sensitivity(s, kPosition, none); });
  names("axis_in_eye", [&] { locate(s, seen(), c, none, kPosition); });
  names("axis_in_eye", [&] { first_guess(s, seen(), none); });
  const auto bad_ellipse = [&](int i, double value) {
    EllipseVector e = seen();
    e[i] = value;
    names("observed", [&] { locate(s, e, c, kAxis, kPosition); });
    names("observed", [&] { first_guess(s, e, kAxis); });
  };
  for (int i = 0; i < 5; ++i) {
    for (const double bad : {kNan, kFar}) bad_ellipse(i, bad);
  }
  bad_ellipse(3, 0);
  bad_ellipse(3, -1);
  bad_ellipse(3, seen()[2] * 1.0001);  // the minor is the longer
  EllipseCovariance broken = c;
  broken(1, 1) = kNan;
  names("covariance", [&] { locate(s, seen(), broken, kAxis, kPosition); });
  PoseSettings weighted = s;
  weighted.weighted = true;
  broken = c;
  broken(2, 2) = -1;
  names("covariance", [&] { locate(weighted, seen(), broken, kAxis, kPosition); });
  broken(2, 2) = 0;
  names("covariance", [&] { locate(weighted, seen(), broken, kAxis, kPosition); });
  broken = c;
  broken(0, 3) = 0.4;  // not symmetric
  names("covariance", [&] { locate(weighted, seen(), broken, kAxis, kPosition); });
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::optics
