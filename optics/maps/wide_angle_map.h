// Wide-angle map (thesis 3.2): from an intraocular point to its sharp aerial image and back, as a
// table of traced bundles. Frame: the eye frame; lengths in m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/maps/skew_table.h"
#include "optics/numerics/cell_search.h"
#include "optics/numerics/chebyshev.h"
#include "optics/rays/pupil.h"

#include <Eigen/Core>

#include <numbers>
#include <optional>
#include <vector>

namespace vitreo::optics {

struct WideAngleSettings {
  /// The viewing system: nothing is a bare sensor at the aerial image, and the bundle is the one
  /// that fills the eye's stop. A microscope takes its own small bundle, and as it is focused it
  /// moves along z with its pupil, so that the point's best focus lies in its plane; a point whose
  /// chief ray the eye's stop blocks is in the iris' shadow and outside. It may be decentered and
  /// tilted.
  std::optional<Microscope> microscope;
  /// m, from the eye's last vertex to the condensing lens (the last two surfaces); nothing: as
  /// prescribed.
  std::optional<double> lens_distance;
  /// rad, at the center of the eye's stop; of a chain without one, of the vertex plane where the
  /// tables have it, surface 3 (2, when that is the last).
  double max_angle = 35 * std::numbers::pi / 180;
  double max_depth = 8e-3;  // m before the retina, along the line to the stop's center
  // of the bundle: disc_samples
  int rings = 12;
  int arms = 24;
  // of the table, 4 to 32; more are taken where they do not do
  int angle_nodes = 18;
  int depth_nodes = 14;
  void check() const;  // throws std::invalid_argument naming the parameter
};

/// The system with its last two surfaces moved. Throws std::invalid_argument for fewer than four
/// surfaces, or a distance that is not finite or negative.
System with_lens_distance(const System& system, double distance);

struct AerialPoint {
  // m, eye frame; d_op with its azimuth, at the point's own best focus; may be inverted
  Eigen::Vector2d m{0, 0};
  double focus = 0;  // m; d_ls, from the last vertex along z to the best focus
};

/// (field, depth) -> (d_ls, d_op) by bundles traced at nodes, interpolated; inverted by Newton.
/// Rotationally symmetric, in (angle, depth), or, for a tilted microscope, a decentered one with a
/// finite pupil, and a system with a surface off the axis or a toric one, in two angles and the
/// depth. Outside its validity it gives nothing; it never
/// extrapolates. The boundary belongs to it: a position that misses it by less than edge() is taken
/// to lie on it.
class WideAngleMap {
 public:
  /// Where bundles are vignetted, or the table would be off by more than 0.5 um (of a symmetric
  /// system by its own estimate, which was exceeded by half where few nodes were asked for), it
  /// ends: max_angle() may be less than asked. Throws std::invalid_argument for bad arguments, for
  /// a bare sensor and no stop, or when not even a tenth of the angle is left.
  explicit WideAngleMap(const System& system, const WideAngleSettings& settings = {});

  /// Nothing for a point that is behind the retina, in the lens, outside the table, where one image
  /// position belongs to two points of the table, or so near a fold that they cannot be
  /// distinguished, or not finite.
  std::optional<AerialPoint> image(const Eigen::Vector3d& point) const;
  /// The point whose image is there; its inverse, to 1e-10 m. Nothing where there is none or more
  /// than one, or where the table's error would move it by more than 5 um.
  std::optional<Eigen::Vector3d> point(const AerialPoint& aerial) const;
  /// The same as image() by tracing the bundle, without the table, so without its edges and folds.
  std::optional<AerialPoint> traced_image(const Eigen::Vector3d& point) const;

  double max_angle() const { return max_angle_; }
  double max_depth() const { return settings_.max_depth; }
  double tail() const { return tail_; }  // m, in the image: about the error of the table
  /// m, in the eye: 1 nm of rounding and four times tail(), which is what an image's error can be
  /// in the eye.
  double edge() const { return 1e-9 + 4 * tail_; }
  bool symmetric() const { return symmetric_; }
  /// With the lens at its distance; for a microscope the stop is opened, or one added: its shadow
  /// is found by the chief ray.
  const System& system() const { return tracer_.system(); }

  // In the meridional plane, without azimuth: for drawing the curves. These throw
  // std::invalid_argument naming the microscope for a map that is not rotationally symmetric.
  struct Plane {
    // m
    double r;
    double z;
  };
  struct FieldPosition {
    double angle;  // rad
    double depth;  // m
  };
  struct Meridional {
    double focus;                  // m
    double height;                 // m; negative for an inverted image
    Eigen::Matrix2d per_position;  // derivative of both by angle and depth
  };
  /// Nothing outside the table or where the map folds.
  std::optional<Meridional> at(const FieldPosition& position) const;
  std::optional<FieldPosition> find(double focus, double height) const;
  // the position as taken to lie in the table
  Plane plane_point(const FieldPosition& position) const;
  std::optional<FieldPosition> position_of(const Plane& point) const;

 private:
  // image: d_ls, height; unit: angle and depth over their ends
  using FlatSearch = detail::CellSearch<2>;
  // image: mx, my, d_ls; unit: rho, azimuth over a turn, depth over its end
  using SkewSearch = detail::CellSearch<3>;
  std::optional<AerialPoint> focus_bundle(const Eigen::Vector3d& point, PupilTracer& tracer,
                                          Spot& spot) const;
  bool bundles_pass(double angle);
  bool build(double max_angle);
  bool trace_flat(Eigen::MatrixXd& focus, Eigen::MatrixXd& scale, Eigen::MatrixXd& stop);
  bool build_flat();
  bool build_skew();
  double skew_error() const;
  bool measure_distances();
  double distance(double angle) const;  // m, from the stop's center to the retina
  Meridional evaluate(const FieldPosition& position) const;
  std::optional<FlatSearch::Solution> solve(const FlatSearch::Point& image,
                                            const FlatSearch::Point& start) const;
  std::optional<SkewSearch::Solution> solve(const SkewSearch::Point& image,
                                            const SkewSearch::Point& start) const;
  FlatSearch::Sample sample(const FieldPosition& position) const;
  SkewSearch::Sample skew_sample(const Eigen::Vector3d& position) const;
  std::optional<Eigen::Vector3d> skew_position(const Eigen::Vector3d& point) const;  // xi, eta, v
  Eigen::Vector3d skew_point(const Eigen::Vector3d& position) const;
  std::optional<AerialPoint> skew_image(const Eigen::Vector3d& point) const;
  bool in_shadow(const FieldPosition& position) const;
  void require_symmetry() const;
  WideAngleSettings settings_;
  bool symmetric_;
  PupilTracer tracer_;
  std::vector<Eigen::Vector2d> samples_;
  std::vector<Eigen::Vector2d> coarse_;
  int angle_nodes_;
  int depth_nodes_;
  double stop_z_;
  double stop_radius_;
  double max_angle_ = 0;
  double tail_ = 0;
  double inverted_ = 1;          // -1 when the image is
  detail::Chebyshev2 focus_;     // of (angle^2, depth)
  detail::Chebyshev2 scale_;     // height / distance from the axis, of the same
  detail::Chebyshev2 stop_;      // the chief ray's distance from the axis in the stop / the point's
  detail::Chebyshev2 distance_;  // of angle^2
  detail::SkewTable skew_;
  FlatSearch flat_search_;
  SkewSearch skew_search_;
};

}  // namespace vitreo::optics
