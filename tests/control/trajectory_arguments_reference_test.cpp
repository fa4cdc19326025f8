// Trajectory's refusals on both sides of each, its holds and its glides, against its header.
// SPDX-License-Identifier: Apache-2.0
#include "control/trajectory.h"

#include <Eigen/Dense>
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::control {
namespace VITREO_TEST_FILE {

using Eigen::Vector3d;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();
constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kTiny = std::numeric_limits<double>::denorm_min();
const Vector3d kPlace(1e-3, -2e-3, 3e-3), kSide(2e-3, 1e-3, -0.5e-3), kUp(-1e-3, 2e-3, 0.5e-3);
const Vector3d kFirst(0, 1.5e-3, 0), kSecond(0, 0, -1.5e-3);
const MotionLimits kLimits{0.8e-3, 1.7e-3};

/// What the call throws as std::invalid_argument says; "" where it throws nothing.
std::string refusal(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

/// `call` with each coordinate of `good` spoiled in turn is refused with `message`, and `good` not.
void expect_finite(const Vector3d& good, const std::string& message,
                   const std::function<void(const Vector3d&)>& call) {
  EXPECT_EQ(refusal([&] { call(good); }), "");
  for (int i = 0; i < 3; ++i) {
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      Vector3d spoiled = good;
      spoiled(i) = bad;
      EXPECT_EQ(refusal([&] { call(spoiled); }), message) << i << " " << bad;
    }
  }
}

/// `call` with a number that is not finite or not above 0 is refused with `message`.
void expect_above_zero(const std::string& message, const std::function<void(double)>& call) {
  for (const double bad : {0.0, -kTiny, -1e-3, -2.0, kNan, kInfinity, -kInfinity}) {
    EXPECT_EQ(refusal([&] { call(bad); }), message) << bad;
  }
}

TEST(TrajectoryArguments, limits_are_above_zero_for_each_that_takes_them) {
  using Make = std::function<void(const MotionLimits&)>;
  for (const Make& make :
       {Make([](const MotionLimits& l) { l.check(); }),
        Make([](const MotionLimits& l) { Trajectory::line(kPlace, kSide, l); }),
        Make([](const MotionLimits& l) { Trajectory::line(kPlace, kPlace, l); }),
        Make([](const MotionLimits& l) { Trajectory::rectangle(kPlace, kSide, kUp, l); }),
        Make([](const MotionLimits& l) { Trajectory::circle(kPlace, kFirst, kSecond, 1, l); }),
        Make([](const MotionLimits& l) { Trajectory::spiral({}, l); }),
        Make([](const MotionLimits& l) { Trajectory::waypoints({kPlace}, l); }),
        Make([](const MotionLimits& l) {
          Trajectory::waypoints({kPlace, kSide}, l);
        }),
        Make([](const MotionLimits& l) {
          Trajectory::spline({kPlace, kSide, kUp}, l);
        }),
        Make([](const MotionLimits& l) {
          Trajectory::curve([](double u) { return Vector3d(kPlace + u * kSide); }, l);
        })}) {
    EXPECT_EQ(refusal([&] { make(kLimits); }), "");
    expect_above_zero("speed: must be finite and above 0 m/s", [&](double bad) {
      make({bad, kLimits.acceleration});
    });
    expect_above_zero("acceleration: must be finite and above 0 m/s^2", [&](double bad) {
      make({kLimits.speed, bad});
    });
  }
  EXPECT_EQ(refusal([] { MotionLimits{kTiny, 1e300}.check(); }), "");
  EXPECT_EQ(refusal([] { MotionLimits{1e300, kTiny}.check(); }), "");
  // allowed, but nothing that ends
  EXPECT_EQ(refusal([] {
              Trajectory::line(kPlace, kSide, {kTiny, 1e-3});
            }),
            "speed: too slow for the path");
  EXPECT_EQ(refusal([] {
              Trajectory::line(kPlace, kSide, {1e-3, kTiny});
            }),
            "speed: too slow for the path");
}

TEST(TrajectoryArguments, places_are_finite) {
  expect_finite(kPlace, "point: not finite", [](auto& p) { Trajectory::hold_at(p); });
  expect_finite(kPlace, "point: not finite", [](auto& p) { Trajectory::glide(p, kSide, 1); });
  expect_finite(kSide, "velocity: not finite", [](auto& v) { Trajectory::glide(kPlace, v, 1); });
  const std::string points = "waypoints: a number is not finite";
  expect_finite(kPlace, points, [](auto& p) { Trajectory::line(p, kSide, kLimits); });
  expect_finite(kPlace, points, [](auto& p) { Trajectory::line(kSide, p, kLimits); });
  expect_finite(kPlace, points, [](auto& p) { Trajectory::rectangle(p, kSide, kUp, kLimits); });
  expect_finite(kSide, points, [](auto& s) { Trajectory::rectangle(kPlace, s, kUp, kLimits); });
  expect_finite(kUp, points, [](auto& u) { Trajectory::rectangle(kPlace, kSide, u, kLimits); });
  for (std::size_t k = 0; k < 3; ++k) {
    const auto with = [&](const Vector3d& p) {
      std::vector<Vector3d> all{kPlace, kSide, kUp};
      all[k] = p;
      return all;
    };
    expect_finite(kFirst, points, [&](auto& p) { Trajectory::waypoints(with(p), kLimits); });
    expect_finite(kFirst, points, [&](auto& p) { Trajectory::spline(with(p), kLimits); });
  }
  expect_finite(kPlace, "center: not finite",
                [](auto& p) { Trajectory::circle(p, kFirst, kSecond, 1, kLimits); });
  expect_finite(kFirst, "first: must be a finite radius above 0 m",
                [](auto& f) { Trajectory::circle(kPlace, f, kSecond, 1, kLimits); });
  Spiral shape;
  expect_finite(kPlace, "bottom: not finite", [&](auto& p) {
    shape.bottom = p;
    Trajectory::spiral(shape, kLimits);
  });
  // of a curve anywhere: first, last, between
  for (const double from : {0.0, 0.4, 1.0}) {
    expect_finite(kSide, "curve: a number is not finite", [&](auto& side) {
      Trajectory::curve([&](double u) { return Vector3d(kPlace + u * (u >= from ? side : kSide)); },
                        kLimits);
    });
  }
}

TEST(TrajectoryArguments, lengths_and_numbers_are_above_zero) {
  expect_above_zero("time: must be finite and above 0 s",
                    [](double t) { Trajectory::glide(kPlace, kSide, t); });
  EXPECT_EQ(Trajectory::glide(kPlace, kSide, 1e-9).duration(), 1e-9);
  expect_above_zero("turns: must be above 0", [](double turns) {
    Trajectory::circle(kPlace, kFirst, kSecond, turns, kLimits);
  });
  for (const auto& [member, message] :
       {std::pair{&Spiral::height, "height: must be above 0 m"},
        std::pair{&Spiral::first_radius, "first_radius: must be above 0 m"},
        std::pair{&Spiral::last_radius, "last_radius: must be above 0 m"},
        std::pair{&Spiral::turns, "turns: must be above 0"}}) {
    const auto make = [&](double value) {
      Spiral shape;
      shape.*member = value;
      Trajectory::spiral(shape, kLimits);
    };
    expect_above_zero(message, make);
    EXPECT_EQ(refusal([&] { make(1e-9); }), "");
  }
  EXPECT_EQ(refusal([] { Trajectory::waypoints({}, kLimits); }),
            "waypoints: at least one is needed");
  EXPECT_EQ(refusal([] { Trajectory::spline({}, kLimits); }), "waypoints: at least one is needed");
  EXPECT_EQ(refusal([] { Trajectory::curve([](double) { return kPlace; }, kLimits); }),
            "curve: stands still");
}

TEST(TrajectoryArguments, the_radii_of_a_circle_are_of_one_length_and_at_a_right_angle) {
  const auto said = [](const Vector3d& first, const Vector3d& second) {
    return refusal([&] { Trajectory::circle(kPlace, first, second, 0.7, kLimits); });
  };
  const Vector3d nothing(0, 0, 0);
  EXPECT_EQ(said(nothing, nothing), "first: must be a finite radius above 0 m");
  const std::string length = "second: must be as long as first";
  EXPECT_EQ(said(kFirst, nothing), length);
  for (int i = 0; i < 3; ++i) {
    for (const double bad : {kNan, kInfinity, -kInfinity}) {
      Vector3d second = kSecond;
      second(i) = bad;
      EXPECT_EQ(said(kFirst, second), length);
    }
  }
  for (const double error : {1e-2, 1.2e-6}) {
    EXPECT_EQ(said(kFirst, kSecond * (1 + error)), length);
    EXPECT_EQ(said(kFirst, kSecond * (1 - error)), length);
    EXPECT_EQ(said(kFirst * (1 + error), kSecond), length);
  }
  for (const double error : {5e-2, 2e-6}) {
    for (const double side : {-1.0, 1.0}) {
      const Vector3d askew = kSecond * std::cos(error) + side * kFirst * std::sin(error);
      EXPECT_EQ(said(kFirst, askew), "second: must be at a right angle to first");
    }
  }
  EXPECT_EQ(said(kFirst, -kFirst), "second: must be at a right angle to first");
  for (const double error : {-5e-7, 5e-7}) {  // rounding is allowed
    EXPECT_EQ(said(kFirst, kSecond * (1 + error)), "");
    EXPECT_EQ(said(kFirst, kSecond * std::cos(error) + kFirst * std::sin(error)), "");
  }
}

TEST(TrajectoryArguments, a_hold_is_one_place_at_all_times) {
  for (const Trajectory& path :
       {Trajectory::hold_at(kPlace), Trajectory::waypoints({kPlace}, kLimits),
        Trajectory::waypoints({kPlace, kPlace}, kLimits), Trajectory::spline({kPlace}, kLimits),
        Trajectory::spline({kPlace, kPlace, kPlace}, kLimits)}) {
    EXPECT_EQ(path.duration(), 0);
    EXPECT_EQ(path.length(), 0);
    for (const double time : {-kInfinity, -3.0, 0.0, 1e-9, 7.5, kInfinity}) {
      EXPECT_EQ(path.at(time).position, kPlace);
      EXPECT_EQ(path.at(time).velocity, Vector3d(0, 0, 0));
    }
    EXPECT_EQ(refusal([&] { path.at(kNan); }), "time: not a number");
  }
}

TEST(TrajectoryArguments, a_glide_is_a_constant_velocity_and_then_rest) {
  const Vector3d velocity(1.5e-4, -2.5e-4, 0.5e-4), still(0, 0, 0);
  const double time = 2.75;
  const Trajectory path = Trajectory::glide(kPlace, velocity, time);
  EXPECT_EQ(path.duration(), time);
  EXPECT_NEAR(path.length(), velocity.norm() * time, 1e-18);
  for (const double t : {-kInfinity, -2.0, -1e-9}) {
    EXPECT_EQ(path.at(t).position, kPlace);
    EXPECT_EQ(path.at(t).velocity, still);
  }
  for (const double t : {0.0, 1e-9, 0.4, 1.9, 2.749999}) {
    EXPECT_LE((path.at(t).position - kPlace - t * velocity).norm(), 1e-17);
    EXPECT_LE((path.at(t).velocity - velocity).norm(), 1e-18);
  }
  for (const double t : {time, time + 1e-9, 99.0, kInfinity}) {
    EXPECT_LE((path.at(t).position - kPlace - time * velocity).norm(), 1e-17);
    EXPECT_EQ(path.at(t).velocity, still);
  }
  EXPECT_EQ(refusal([&] { path.at(kNan); }), "time: not a number");
  const Trajectory stays = Trajectory::glide(kPlace, still, 0.5);
  EXPECT_EQ(stays.at(0.3).position, kPlace);
  EXPECT_EQ(stays.at(0.3).velocity, still);
}

// Docs: sampled 4096 times, so that of many turns there are few samples each. A thousand turns of
// 1.5 mm came out 10 % short.
TEST(TrajectoryArguments, a_circle_has_the_length_of_its_turns_or_is_refused) {
  const double length = 64 * 2 * 3.14159265358979 * kFirst.norm();
  EXPECT_NEAR(Trajectory::circle(kPlace, kFirst, kSecond, 64, kLimits).length(), length,
              1e-3 * length);
  EXPECT_EQ(refusal([] { Trajectory::circle(kPlace, kFirst, kSecond, 64.1, kLimits); }),
            "turns: must be at most 64");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::control
