// Table of the isopixel lines of a chain: for each m of the aerial image the straight line in the
// vitreous that is imaged there, x = at_retina + slope z, and its change with m. Eye frame, m.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <functional>
#include <optional>
#include <vector>

namespace vitreo::optics::detail {

struct IsopixelLine {
  Eigen::Vector2d at_retina;  // m, at z = 0
  Eigen::Vector2d slope;      // dx/dz, dy/dz
  // their derivatives by m
  Eigen::Matrix2d at_retina_per_m;
  Eigen::Matrix2d slope_per_m;
  Eigen::Vector2d at(double z) const { return at_retina + z * slope; }
  Eigen::Matrix2d per_m(double z) const { return at_retina_per_m + z * slope_per_m; }
};

/// The traced line of m; nothing when the ray is lost.
struct TracedLine {
  Eigen::Vector2d at_retina;
  Eigen::Vector2d slope;
  Eigen::Vector2d at(double z) const { return at_retina + z * slope; }
};
using TraceLine = std::function<std::optional<TracedLine>(const Eigen::Vector2d& m)>;

/// Lines in planes through the axis, the same all round: x = m (A + S z), A and S polynomials in
/// |m|^2.
class RadialLines {
 public:
  RadialLines() = default;
  /// Sampled from the axis outwards up to max_m, or to the first lost ray. Throws
  /// std::invalid_argument when more than half are lost.
  RadialLines(const TraceLine& trace, double max_m);
  double max_m() const { return max_m_; }
  bool covers(const Eigen::Vector2d& m) const;
  IsopixelLine line(const Eigen::Vector2d& m) const;
  /// The m whose line passes the point, and that line; false when there is none in the table.
  bool solve(const Eigen::Vector3d& point, Eigen::Vector2d& m, IsopixelLine& line) const;

 private:
  static constexpr int kTerms = 16;
  struct Values {
    // A, S and their derivatives by |m|^2
    double a;
    double s;
    double a_per;
    double s_per;
  };
  Values values(double m2) const;
  static IsopixelLine line(const Eigen::Vector2d& m, const Values& v);
  double max_m_ = 0;
  int terms_ = 0;  // those that matter
  // in powers of 2 |m|^2 / max_m^2 - 1
  std::array<double, kTerms> a_{};
  std::array<double, kTerms> s_{};
};

/// Lines without symmetry: four functions on a square grid of m, interpolated by cubics.
class GridLines {
 public:
  GridLines() = default;
  /// Covers the square of side 2 max_m where no ray is lost. Throws std::invalid_argument when the
  /// middle is lost.
  GridLines(const TraceLine& trace, double max_m);
  double max_m() const { return max_m_; }
  bool covers(const Eigen::Vector2d& m) const;
  IsopixelLine line(const Eigen::Vector2d& m) const;
  bool solve(const Eigen::Vector3d& point, Eigen::Vector2d& m, IsopixelLine& line) const;

 private:
  static constexpr int kNodes = 81;  // a side; odd, so that one is the middle
  static constexpr int kMiddle = kNodes / 2;
  double max_m_ = 0;
  double step_ = 0;
  std::vector<Eigen::Vector4d> nodes_;  // at_retina x, y, slope x, y; NaN where lost
};

}  // namespace vitreo::optics::detail
