// Where an intraocular point is imaged sharply, and back: the whole wide-angle image formation (thesis 3.2) as a table.
// Frame: the eye frame; lengths in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/detail/chebyshev.h"
#include "optics/pupil.h"

#include <Eigen/Core>

#include <numbers>
#include <optional>
#include <vector>

namespace vitreo::optics {

struct WideAngleSettings {
  /// Who looks: nothing is a bare sensor at the aerial image, and the bundle is the one that fills the eye's stop. A
  /// microscope takes its own small bundle, and its pupil moves with it as it is focused; a point whose chief ray the
  /// eye's stop blocks is in the iris' shadow and outside. It must be centred.
  std::optional<Microscope> microscope;
  /// m, from the eye's last vertex to the condensing lens (the last two surfaces); nothing: as prescribed.
  std::optional<double> lens_distance;
  double max_angle = 35 * std::numbers::pi / 180;  // rad, at the centre of the eye's stop
  double max_depth = 8e-3;                         // m before the retina, along the line to the stop's centre
  int rings = 12, arms = 24;                       // of the bundle: disc_samples
  int angle_nodes = 18, depth_nodes = 14;          // of the table, 4 to 32
  void check() const;                              // throws std::invalid_argument naming the parameter
};

/// The system with its last two surfaces moved. Throws std::invalid_argument for fewer than four surfaces, or a
/// distance that is not finite or negative.
System with_lens_distance(const System& system, double distance);

struct AerialPoint {
  Eigen::Vector2d m{0, 0};  // m; d_op with its azimuth, at the point's own best focus; the image may be inverted
  double focus = 0;         // m; d_ls, from the last vertex to the best focus
};

/// (field angle, depth) -> (d_ls, d_op) by bundles traced at Chebyshev nodes, interpolated; inverted by Newton.
/// Rotationally symmetric. Outside its validity it says nothing; it never extrapolates.
class WideAngleMap {
 public:
  /// Where bundles are vignetted, or the table would be off by more than 2 um, it ends: max_angle() may be less than
  /// asked. Throws std::invalid_argument for bad arguments, or when not even a tenth of the angle is left.
  explicit WideAngleMap(const System& system, const WideAngleSettings& settings = {});

  /// Nothing for a point that is behind the retina, in the lens, outside the table, where one image place belongs to
  /// two points, or not finite.
  std::optional<AerialPoint> image(const Eigen::Vector3d& point) const;
  /// The point whose image is there; its inverse, to 1e-10 m.
  std::optional<Eigen::Vector3d> point(const AerialPoint& aerial) const;
  /// The same by tracing the bundle, without the table.
  std::optional<AerialPoint> traced_image(const Eigen::Vector3d& point) const;

  double max_angle() const { return max_angle_; }
  double max_depth() const { return settings_.max_depth; }
  double tail() const { return tail_; }  // m, about the error that the table's truncation leaves
  const System& system() const { return tracer_.system(); }

  // In the meridional plane, without azimuth: for drawing the curves.
  struct Plane {
    double r, z;  // m
  };
  struct Place {
    double angle, depth;  // rad, m
  };
  struct Meridional {
    double focus, height;       // m; height is negative for an inverted image
    Eigen::Matrix2d per_place;  // derivative of both by angle and depth
  };
  /// Nothing outside the table or where the map folds.
  std::optional<Meridional> at(const Place& place) const;
  std::optional<Place> find(double focus, double height) const;
  Plane plane_point(const Place& place) const;  // the place as taken to lie in the table
  std::optional<Place> place_of(const Plane& point) const;

 private:
  bool build(double max_angle);
  std::optional<AerialPoint> focus_bundle(const Eigen::Vector3d& point, PupilTracer& tracer, Spot& spot) const;
  Meridional evaluate(const Place& place) const;
  std::optional<Place> newton(double focus, double height, Place start) const;
  void plant_seeds();
  bool in_shadow(const Place& place) const;
  WideAngleSettings settings_;
  PupilTracer tracer_;
  std::vector<Eigen::Vector2d> samples_;
  double stop_z_, stop_radius_, max_angle_ = 0, tail_ = 0;
  int orientation_ = 1;               // sign of the Jacobian's determinant
  detail::Chebyshev2 focus_, scale_;  // of (angle^2, depth); scale: height / distance from the axis
  detail::Chebyshev2 stop_;           // the chief ray's distance from the axis in the stop / the point's
  detail::Chebyshev2 distance_;       // of angle^2; m, from the stop's centre to the retina
  struct Seed {
    double focus, height;
    Place place;
  };
  std::vector<Seed> seeds_;  // where `find` may start
};

}  // namespace vitreo::optics
