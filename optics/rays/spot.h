// Spots: bundles of rays behind the system, their moments, best focus in closed form, point spread
// and its transform. Frame: transverse coordinates of the eye frame; distances count from the last
// vertex, in m, in the direction of light.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <vector>

namespace vitreo::optics {

/// Means and covariances of a bundle in the last vertex plane: enough for every focus and rms
/// radius.
struct SpotMoments {
  int rays = 0;
  Eigen::Vector2d mean{0, 0};                          // m
  Eigen::Vector2d mean_slope{0, 0};                    // dx/dz, dy/dz
  Eigen::Matrix2d position = Eigen::Matrix2d::Zero();  // m^2, covariance of positions
  // m, of positions and slopes, made symmetric
  Eigen::Matrix2d position_slope = Eigen::Matrix2d::Zero();
  Eigen::Matrix2d slope = Eigen::Matrix2d::Zero();  // of slopes

  /// Distance of least rms radius: the variance of x + s u is var x + 2 s cov(x, u) + s^2 var u,
  /// least at s = -cov / var; both transverse directions summed. NaN without a spread of slopes.
  double best_focus() const { return -position_slope.trace() / slope.trace(); }
  /// The same for the width along the unit vector `along` alone: tangential when that points from
  /// the axis, sagittal when across.
  double best_focus_along(const Eigen::Vector2d& along) const {
    return -along.dot(position_slope * along) / along.dot(slope * along);
  }
  double rms(double distance) const;  // m, radius about the mean
  Eigen::Vector2d mean_at(double distance) const { return mean + distance * mean_slope; }
};

/// A traced bundle; only rays that came through.
struct Spot {
  std::vector<Eigen::Vector2d> position;  // m, in the last vertex plane
  std::vector<Eigen::Vector2d> slope;     // dx/dz, dy/dz
  int lost = 0;                           // vignetted, missed, totally reflected
  Eigen::Vector2d chief{0, 0};            // m, of the ray through the pupil's center
  Eigen::Vector2d chief_slope{0, 0};      // of the same ray
  int rays() const { return static_cast<int>(position.size()); }
  Eigen::Vector2d chief_stop{0, 0};  // m, where that one crosses the system's stop; 0 without one
  Eigen::Vector2d chief_at(double distance) const { return chief + distance * chief_slope; }
  std::vector<Eigen::Vector2d> at(double distance) const;  // the spot diagram
  SpotMoments moments() const;
};

/// Geometric modulation transfer at a frequency (cycles per m, a vector: its direction matters):
/// the modulus of the spot's Fourier transform. 1 at zero; 0 for an empty spot.
double geometric_mtf(const Spot& spot, double distance, const Eigen::Vector2d& frequency);

/// Geometric point spread: the share of rays in each of cells x cells squares round the mean, rows
/// along y, columns along x. Rays further out than half_width (m) are in no cell. Throws
/// std::invalid_argument for bad arguments.
Eigen::MatrixXd geometric_psf(const Spot& spot, double distance, double half_width, int cells);

}  // namespace vitreo::optics
