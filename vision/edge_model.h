// Edge model: profile of a blurred, shaded ellipse along a normal of its rim, which an edge is
// compared with to be located to a fraction of a pixel.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include <array>
#include <vector>

namespace vitreo::vision {

/// At one position on a normal: the share of the pixel's light that comes from the body, and the
/// same weighted with n and with n^2, n being the component of the body's surface normal towards
/// the camera (0 at the rim, 1 in the middle): a lit round body's brightness is smooth in n, so
/// from the rim inwards it rises as a root before it rises linearly. With each its change as the
/// rim moves outwards (per px) and as the blur grows (per px of sigma).
struct EdgeSample {
  using Shades = Eigen::Vector3d;  // weighted with 1, n, n^2
  Shades value = Shades::Zero();
  Shades by_shift = Shades::Zero();
  Shades by_blur = Shades::Zero();
  double trust = 1;  // deep inside the body the three shades no longer describe it
};

class EdgeModel {
 public:
  static constexpr int kMaxSamples = 40;
  using Profile = std::array<EdgeSample, kMaxSamples>;

  EdgeModel();
  /// The profile at the ellipse's point (a cos t, b sin t), `count` samples 1 px apart along the
  /// outward normal, the first `inside` px within the rim; blurred by a Gaussian of `sigma`, the
  /// rim's curvature included.
  void profile(double semi_major_px, double semi_minor_px, double t, double sigma_px,
               double inside_px, int count, Profile& out) const;

 private:
  // Of depth below the rim in units of the blur: a blurred step, a blurred square root, and their
  // derivatives.
  struct Entry {
    double step;
    double root;
    double root1;
    double root2;
    double density;
  };
  struct Blurred {  // 1, n and n^2 at a depth, with their first and second derivatives by it
    Eigen::Vector3d value;
    Eigen::Vector3d first;
    Eigen::Vector3d second;
  };
  Entry at(double depth) const;
  Blurred blurred(double depth, double blur_per_chord) const;
  std::vector<Entry> table_;
};

}  // namespace vitreo::vision
