// Dense samples of a body's surface and their least distance from the eye's walls: the judge of
// clearances, written without control/clearance. World frame, m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <vector>

namespace vitreo::samples {

using Points = std::vector<Eigen::Vector3d>;  // in the body's frame: z along its axis

/// x = b sin t cos f, y = b sin t sin f, z = a cos t.
inline Points spheroid(double a, double b, int rings = 180, int spokes = 90) {
  Points points;
  for (int i = 0; i <= rings; ++i)
    for (int k = 0; k < spokes; ++k) {
      const double t = std::numbers::pi * i / rings;
      const double f = 2 * std::numbers::pi * k / spokes;
      points.emplace_back(b * std::sin(t) * std::cos(f), b * std::sin(t) * std::sin(f),
                          a * std::cos(t));
    }
  return points;
}

/// Flat ends: only the two rims can be nearest to a wall that is flat or hollow.
inline Points cylinder(double half_length, double radius, int spokes = 720) {
  Points points;
  for (int k = 0; k < spokes; ++k) {
    const double f = 2 * std::numbers::pi * k / spokes;
    for (const double end : {-1.0, 1.0})
      points.emplace_back(radius * std::cos(f), radius * std::sin(f), end * half_length);
  }
  return points;
}

/// Two elliptical plates that cross along the axis, `thick`, one of them turned by `roll` from x.
inline Points crossed_plates(double a, double b, double thick, double roll, int spokes = 720) {
  Points points;
  for (int plate = 0; plate < 2; ++plate) {
    const double turn = roll + plate * std::numbers::pi / 2;
    const Eigen::Vector3d in_plane(std::cos(turn), std::sin(turn), 0);
    const Eigen::Vector3d across(-std::sin(turn), std::cos(turn), 0);
    for (int k = 0; k < spokes; ++k) {
      const double t = 2 * std::numbers::pi * k / spokes;
      const Eigen::Vector3d rim =
          a * std::cos(t) * Eigen::Vector3d::UnitZ() + b * std::sin(t) * in_plane;
      for (const double side : {-0.5, 0.5}) points.push_back(rim + side * thick * across);
    }
  }
  return points;
}

struct Eye {
  Eigen::Vector3d vertex{0, 0, -5e-3};  // of the retina
  double radius = 11.5e-3;
  double lens = 15.5e-3;  // above the vertex
};

/// From the ball of the retina up to its equator, above it from the tube of the same radius.
inline double from_retina(const Eye& eye, const Eigen::Vector3d& point) {
  const double up = point.z() - eye.vertex.z() - eye.radius;
  const double aside = std::hypot(point.x() - eye.vertex.x(), point.y() - eye.vertex.y());
  return eye.radius - (up < 0 ? std::hypot(aside, up) : aside);
}

struct Least {
  double retina = std::numeric_limits<double>::infinity();
  double lens = std::numeric_limits<double>::infinity();
  double nearest() const { return std::min(retina, lens); }
};

/// Of the body at `position` whose axis is `axis` (unit).
inline Least least_distance(const Eye& eye, const Points& body, const Eigen::Vector3d& position,
                            const Eigen::Vector3d& axis) {
  const Eigen::Quaterniond turn =
      Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitZ(), axis);
  const Eigen::Matrix3d world_from_body = turn.toRotationMatrix();
  Least least;
  for (const Eigen::Vector3d& point : body) {
    const Eigen::Vector3d there = position + world_from_body * point;
    least.retina = std::min(least.retina, from_retina(eye, there));
    least.lens = std::min(least.lens, eye.vertex.z() + eye.lens - there.z());
  }
  return least;
}

}  // namespace vitreo::samples
