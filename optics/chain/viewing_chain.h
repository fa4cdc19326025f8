// Viewing chain at given parameters: the line in the vitreous that a pixel shows, and its
// derivatives by the pixel and by every parameter.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_layout.h"
#include "optics/chain/line_step.h"

#include <Eigen/Core>

#include <array>
#include <optional>
#include <vector>

namespace vitreo::optics {

/// x = at_zero + slope z in the nominal eye frame, as (x, y at z = 0, dx/dz, dy/dz).
using VitreousLine = Eigen::Vector4d;

/// A line with the derivatives of each step on its way in; ViewingChain::by_theta() joins them.
struct LineDerivatives {
  static constexpr std::size_t kMostSurfaces = 16;
  VitreousLine line;
  Eigen::Matrix<double, 4, 2> by_pixel;
  Eigen::Matrix<double, 4, 7> by_microscope;  // in air, by MicroscopeNumbers
  // Of each surface, from the vitreous outwards: the inner line by the outer, and by
  // SurfaceNumbers.
  std::array<Eigen::Matrix4d, kMostSurfaces> through;
  std::array<Eigen::Matrix<double, 4, 7>, kMostSurfaces> own;
  Eigen::Vector2d at(double z) const { return line.head<2>() + z * line.tail<2>(); }
  Eigen::Matrix2d pixel_at(double z) const {
    return by_pixel.topRows<2>() + z * by_pixel.bottomRows<2>();
  }
};

/// Of a point in the vitreous: the pixel that shows it and what moves that.
struct SeenPixel {
  Eigen::Vector2d pixel_px;
  Eigen::Matrix<double, 2, 3> by_position;            // px/m
  Eigen::Matrix<double, 2, Eigen::Dynamic> by_theta;  // px per sigma of the parameter
};

/// Parameters that move no surface alone, by name in viewing_chain.cpp.
enum class OwnParameter {
  robot_length,
  robot_width,
  dilation,
  dilation_slope,
  retina_depth,
  retina_tilt_x,
  retina_tilt_y,
  retina_curvature,
  retina_astigmatism_x,
  retina_astigmatism_y,
  eye_rotation_x,
  eye_rotation_y,
  axis_turn_x,
  axis_turn_y,
  axis_turn_z
};

/// The chain linearized in its parameters about theta. Lines are those of the refracting surfaces,
/// however far from the axis: rims and stops clip nothing.
class ViewingChain {
 public:
  /// Throws std::invalid_argument naming what is wrong with the nominal chain.
  ViewingChain(const NominalChain& nominal, std::vector<ChainParameter> parameters,
               const Eigen::VectorXd& theta);

  const std::vector<ChainParameter>& parameters() const { return parameters_; }
  Eigen::Index size() const { return static_cast<Eigen::Index>(parameters_.size()); }
  const Eigen::VectorXd& theta() const { return theta_; }
  const NominalChain& nominal() const { return nominal_; }
  const detail::PlacedChain& placed() const { return placed_; }
  /// Where a parameter that is no surface's or microscope's stands in theta.
  struct Own {
    Eigen::Index at = -1;  // -1: held
    double sigma = 0;
  };
  const Own& own(OwnParameter which) const { return own_[static_cast<std::size_t>(which)]; }
  /// to[at] += by * sigma, where it is not held.
  template <class Row>
  void add(OwnParameter which, double by, Row&& to) const {
    if (own(which).at >= 0) to[own(which).at] += by * own(which).sigma;
  }
  /// The robot's axis where it is believed to be `axis`, both unit: turned as all looks' are.
  Eigen::Vector3d turned(const Eigen::Vector3d& axis) const;
  /// d turned(axis) / d theta: across the axis.
  Eigen::Matrix<double, 3, Eigen::Dynamic> turned_by_theta(const Eigen::Vector3d& axis) const;
  /// The parameters of the eye come first.
  Eigen::Index eye_size() const { return eye_size_; }

  /// Nothing where a surface is missed or reflects all.
  std::optional<VitreousLine> line(const Eigen::Vector2d& pixel_px) const;
  std::optional<LineDerivatives> differentiated_line(const Eigen::Vector2d& pixel_px) const;
  /// Of two linear functions of the line, `of_line` times it: by every parameter.
  Eigen::Matrix<double, 2, Eigen::Dynamic> by_theta(
      const LineDerivatives& line, const Eigen::Matrix<double, 2, 4>& of_line) const;
  /// Near which the lines past a point at height z meet. Nothing where they diverge.
  static std::optional<Eigen::Vector3d> viewpoint(const LineDerivatives& line, double z);
  /// The pixel that shows a point, by Newton from a pixel near it. Nothing where there is none.
  std::optional<SeenPixel> seen(const Eigen::Vector3d& point, const Eigen::Vector2d& near_px) const;
  /// The same without derivatives, from the linearization at a pixel near it.
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector3d& point, const LineDerivatives& near,
                                       const Eigen::Vector2d& near_px) const;

 private:
  void find_own();
  Eigen::Vector3d moved(const Eigen::Vector3d& axis) const;
  NominalChain nominal_;
  std::vector<ChainParameter> parameters_;
  Eigen::VectorXd theta_;
  std::array<Own, 15> own_{};
  Eigen::Index eye_size_ = 0;
  detail::PlacedChain placed_;
  std::vector<detail::ChainStep<double>> steps_;  // of the surfaces, from the vitreous outwards
  // by theta, of each surface's and the microscope's numbers
  std::vector<Eigen::Matrix<double, 7, Eigen::Dynamic>> surfaces_by_theta_;
  Eigen::Matrix<double, 7, Eigen::Dynamic> microscope_by_theta_;
};

}  // namespace vitreo::optics
