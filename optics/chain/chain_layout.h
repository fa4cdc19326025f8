// Layout of the viewing chain: where each surface and the microscope stand for given parameters.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_parameters.h"

#include <Eigen/Core>

#include <string>
#include <vector>

namespace vitreo::optics::detail {

/// What is local to one refracting surface: vertex (0 to 2, m), tilt about x then y (3, 4, rad),
/// curvature (5, 1/m) and the ratio of the indices outside / inside (6), as light from outside
/// meets them.
using SurfaceNumbers = Eigen::Matrix<double, 7, 1>;
/// Of the microscope: the axis' point in the object plane (0 to 2, m), tilt about x then y (3, 4),
/// 1 / pupil distance (5, 1/m), scale (6, m per pixel).
using MicroscopeNumbers = Eigen::Matrix<double, 7, 1>;

struct PlacedChain {
  std::vector<SurfaceNumbers> surfaces;  // surfaces[i] is the prescription's surface i + 2
  MicroscopeNumbers microscope;
  double robot_length = 1;  // factors
  double robot_width = 1;
  double dilation_px = 0;
  double dilation_slope = 0;  // px/m
  /// m: depth, tilt x and y, curvature, astigmatism twice; at kRetinaRadius where not the depth.
  Eigen::Matrix<double, 6, 1> retina = Eigen::Matrix<double, 6, 1>::Zero();
};

/// Heights about which the outline's dilation changes, and the distance from the axis at which the
/// retina's shape is stated.
inline constexpr double kDilationHeight = 5e-3;  // m
inline constexpr double kRetinaRadius = 4e-3;    // m

/// Places the chain for parameters theta. The names are looked up once.
class ChainLayout {
 public:
  ChainLayout(const NominalChain& nominal, const std::vector<ChainParameter>& parameters);
  PlacedChain place(const Eigen::VectorXd& theta) const;
  const std::vector<Surface>& surfaces() const { return nominal_.prescription.system.surfaces; }

 private:
  enum class Kind { radius, thickness, index, own };
  struct Target {
    Kind kind = Kind::own;
    std::size_t surface = 0;  // of the prescription, from 0
    double sigma = 0;
    std::string name;
  };
  struct Values;
  void find(const ChainParameter& parameter);
  void set(Values& values, const Target& target, double off) const;
  void place_surfaces(const Values& values, PlacedChain& placed) const;

  NominalChain nominal_;
  std::vector<Target> targets_;
  std::size_t first_outside_ = 0;  // surface (from 0) of the condensing lens
  std::vector<bool> inner_lens_;   // which surfaces are the eye's own lens
};

}  // namespace vitreo::optics::detail
