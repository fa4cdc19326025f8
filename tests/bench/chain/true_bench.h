// True bench: an eye, lens, microscope and robot drawn about the believed ones, with a ray tracer,
// silhouettes and an ellipse fit of its own, which share no code with optics/.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_session.h"

#include <Eigen/Core>

#include <cstdint>
#include <map>
#include <optional>
#include <random>
#include <string>
#include <vector>

namespace vitreo::optics {

/// Surfaces anywhere in space, met by a search along the ray for the sign of their implicit
/// function; refracted by the law of sines with the component along the normal kept.
class TrueBench {
 public:
  /// Every parameter of `sigmas` off by a normal number times its sigma, but for those of `fixed`.
  /// A draw that is no eye is drawn again.
  TrueBench(const NominalChain& nominal, const ChainSigmas& sigmas, std::uint64_t seed);

  /// The ellipse that a tracker sees of the robot at `position` along `axis`, without noise:
  /// tangent lines, by bisection, and a fit by least squares. Nothing where a line is lost.
  std::optional<EllipseVector> ellipse(const Eigen::Vector3d& position,
                                       const Eigen::Vector3d& axis) const;
  /// With noise of a tracker, `sigma_px` of center and semi-axes.
  std::optional<OutlineSeen> seen(const Eigen::Vector3d& position, const Eigen::Vector3d& axis,
                                  double sigma_px, double axis_sigma,
                                  std::mt19937_64& random) const;
  /// z of the retina.
  double retina(double x, double y) const;
  /// Where a point of the eye's own frame, on its retina, stands now.
  Eigen::Vector3d of_retina(double x, double y) const;
  std::optional<Eigen::Vector2d> pixel(const Eigen::Vector3d& point) const;
  double off(const std::string& name) const;  // in the parameter's unit
  /// The same bench with some parameters moved by as much, in their units.
  TrueBench moved(const std::map<std::string, double>& by) const;
  Spheroid robot() const;

 private:
  struct Body {
    Eigen::Vector3d vertex;
    Eigen::Matrix3d frame;  // bench from surface
    double curvature, conic;
    std::array<double, 4> aspheric;
    double inside, outside;  // indices
    double implicit(const Eigen::Vector3d& local) const;
    Eigen::Vector3d slope(const Eigen::Vector3d& local) const;
  };
  struct Sight {
    Eigen::Vector3d point, direction;
  };
  bool draw(std::mt19937_64& random);
  bool build();
  std::optional<Sight> sight(const Eigen::Vector2d& pixel_px) const;

  NominalChain nominal_;
  std::vector<ChainParameter> parameters_;
  std::map<std::string, double> off_;
  std::vector<Body> bodies_;
  double last_vertex_ = 0;
};

}  // namespace vitreo::optics
