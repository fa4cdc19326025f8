// Merit of a lens design, for doubles and for Ceres' Jets: best foci and spots of bundles traced
// through it, and penalties where a constraint is not kept (thesis 3.2: the aspheric terms that
// flatten the image). Lengths in m; residuals in units of kUnit.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/design/design_options.h"
#include "optics/design/design_surface.h"

#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace vitreo::optics::detail {

constexpr double kGlass = 1.2;  // of refractive index: less is air, whose edge may be thin

enum class ShapeKind { curvature, conic, a4, a6, a8, a10, thickness };

/// One number of the solver: shape value = scale * x.
struct ShapeVariable {
  std::size_t surface;  // counted from 0
  ShapeKind kind;
  double scale;
};

/// Rays of one field behind the surface before the first one that changes, in its vertex frame;
/// half the bundle, as it is symmetric about the plane of axis and field.
struct DesignBundle {
  std::vector<Eigen::Vector3d> origin;
  std::vector<Eigen::Vector3d> direction;
  std::vector<double> weight;
};

struct DesignProblem {
  System system;  // as the round starts
  std::vector<ShapeVariable> variables;
  std::size_t from = 0;               // the bundles stand behind this surface
  std::vector<DesignBundle> bundles;  // of the fields that count in this round
  std::vector<double> reach;          // m, of each surface: out to where it must be sound
  double flatness_weight;
  double spot_weight;
  double max_spot;
  double min_edge_thickness;
  double min_center_thickness;
  DesignKeeps keeps;
  double kept = 0;  // m, of what is kept

  static constexpr double kUnit = 1e-4;  // m
  // weight of a constraint: violations stay below a micrometer
  static constexpr double kStrict = 1e3;
  static constexpr int kChecks = 16;  // positions along a profile where constraints are tested

  bool is_variable(std::size_t surface) const {
    return std::any_of(variables.begin(), variables.end(), [&](const ShapeVariable& v) {
      return v.surface == surface && v.kind != ShapeKind::thickness;
    });
  }
  bool thickness_is_variable(std::size_t surface) const {
    return std::any_of(variables.begin(), variables.end(), [&](const ShapeVariable& v) {
      return v.surface == surface && v.kind == ShapeKind::thickness;
    });
  }
  /// Whether surface, the next one, or what is between changes.
  bool gap_is_variable(std::size_t surface) const {
    return is_variable(surface) || is_variable(surface + 1) || thickness_is_variable(surface);
  }
};

template <class T>
T& shape_value(DesignSurface<T>& surface, ShapeKind kind) {
  switch (kind) {
    case ShapeKind::curvature:
      return surface.curvature;
    case ShapeKind::conic:
      return surface.conic;
    case ShapeKind::thickness:
      return surface.thickness;
    default:
      return surface
          .aspheric[static_cast<std::size_t>(kind) - static_cast<std::size_t>(ShapeKind::a4)];
  }
}

inline bool is_coefficient(ShapeKind kind) {
  return kind >= ShapeKind::a4 && kind <= ShapeKind::a10;
}

template <class T>
std::vector<DesignSurface<T>> shaped(const DesignProblem& problem, const T* x) {
  auto surfaces = design_surfaces<T>(problem.system);
  for (std::size_t i = 0; i < problem.variables.size(); ++i) {
    const ShapeVariable& v = problem.variables[i];
    shape_value(surfaces[v.surface], v.kind) = x[i] * v.scale;
    if (is_coefficient(v.kind)) surfaces[v.surface].asphere = true;
  }
  return surfaces;
}

template <class T>
struct DesignFocus {
  T distance;
  T rms;
};

/// Best focus in closed form, s = -cov(x, u) / var u, and the squared rms radius there, var x -
/// cov^2 / var u, as SpotMoments has them. False when a ray is lost.
template <class T>
bool focus_design(const DesignProblem& problem, const std::vector<DesignSurface<T>>& surfaces,
                  const DesignBundle& bundle, DesignFocus<T>& focus) {
  using std::sqrt;
  // m^2; rounds the cone's tip off, where the rms radius has no derivative
  constexpr double kTip = 1e-18;
  // the mean of y is zero by symmetry
  T total(0);
  T x(0);
  T u(0);
  T xx(0);
  T xu(0);
  T uu(0);
  for (std::size_t i = 0; i < bundle.origin.size(); ++i) {
    Vector3<T> origin = bundle.origin[i].cast<T>();
    Vector3<T> direction = bundle.direction[i].cast<T>();
    if (!trace_design(surfaces, problem.from, origin, direction)) return false;
    const T ux = direction.x() / direction.z();
    const T uy = direction.y() / direction.z();
    const T px = origin.x() - origin.z() * ux;
    const T py = origin.y() - origin.z() * uy;
    const double w = bundle.weight[i];
    total += T(w);
    x += w * px;
    u += w * ux;
    xx += w * (px * px + py * py);
    xu += w * (px * ux + py * uy);
    uu += w * (ux * ux + uy * uy);
  }
  const T position = xx / total - x * x / (total * total);
  const T slope = uu / total - u * u / (total * total);
  const T mixed = xu / total - x * u / (total * total);
  focus.distance = -mixed / slope;
  const T square = position + mixed * focus.distance;
  focus.rms = sqrt((square > 0.0 ? square : T(0)) + kTip);
  return true;
}

/// 1 / f by (4.5), (4.6) with derivatives: the paraxial ray of height 1 and angle 0 through all
/// surfaces; its last n u is a12 = -1 / f.
template <class T>
T power(const std::vector<DesignSurface<T>>& surfaces) {
  // n * angle
  T angle(0);
  T height(1);
  for (std::size_t i = 1; i < surfaces.size(); ++i) {
    const double before = surfaces[i - 1].index;
    const double behind = surfaces[i].index;
    angle -= (behind - before) * surfaces[i].curvature * height;
    if (i + 1 < surfaces.size()) height += angle * surfaces[i].thickness / behind;
  }
  return -angle;
}

/// Exterior penalty of value >= least: a residual linear in the violation, stiff enough to hold to
/// a micrometer.
template <class T>
T below(const T& value, double least) {
  return value < least ? T((least - value) * (DesignProblem::kStrict / DesignProblem::kUnit))
                       : T(0);
}

/// Collects residuals in their fixed order; the order and number do not depend on T.
template <class T>
class DesignResiduals {
 public:
  DesignResiduals(const DesignProblem& problem, const std::vector<DesignSurface<T>>& surfaces,
                  std::vector<T>& out)
      : problem_(problem), surfaces_(surfaces), out_(out) {}

  /// Flatness (focus less the mean focus), spot size and the limit of it for each field.
  bool fields() {
    std::vector<DesignFocus<T>> foci(problem_.bundles.size());
    T mean(0);
    for (std::size_t i = 0; i < foci.size(); ++i) {
      if (!focus_design(problem_, surfaces_, problem_.bundles[i], foci[i])) return false;
      mean += foci[i].distance / double(foci.size());
    }
    const double scale = 1 / (DesignProblem::kUnit * std::sqrt(double(foci.size())));
    for (const auto& focus : foci) {
      out_.push_back((focus.distance - mean) * (scale * problem_.flatness_weight));
      out_.push_back(focus.rms * (scale * problem_.spot_weight));
      out_.push_back(std::isfinite(problem_.max_spot) ? below(T(-focus.rms), -problem_.max_spot)
                                                      : T(0));
    }
    first_ = foci.front().distance;
    return true;
  }

  /// The equality constraint, as a stiff residual.
  void kept() {
    const double scale = DesignProblem::kStrict / DesignProblem::kUnit;
    if (problem_.keeps == DesignKeeps::image_distance)
      out_.push_back((first_ - problem_.kept) * scale);
    if (problem_.keeps == DesignKeeps::focal_length) {
      out_.push_back((power(surfaces_) * problem_.kept - 1.0) * (problem_.kept * scale));
    }
  }

  /// The profile reaches out and does not turn: its slope keeps the sign of its sag at the rim.
  void profiles() {
    constexpr double kLeastRoot2 = 0.01;  // under the root of (3.1): short of the equator
    for (std::size_t i = 1; i < surfaces_.size(); ++i) {
      if (!problem_.is_variable(i)) continue;
      const double reach = problem_.reach[i];
      const auto& s = surfaces_[i];
      const Profile<T> rim = profile(s, T(reach * reach));
      const double sign = rim.sag < 0.0 ? -1 : 1;
      for (int k = 1; k <= DesignProblem::kChecks; ++k) {
        const double r = reach * k / DesignProblem::kChecks;
        const T root2 = 1.0 - (1.0 + s.conic) * s.curvature * s.curvature * (r * r);
        const bool reaches = root2 > kLeastRoot2;
        out_.push_back(reaches ? T(0) : T((kLeastRoot2 - root2) * DesignProblem::kStrict));
        out_.push_back(reaches ? below(T(profile(s, T(r * r)).slope_over_r * (sign * r * reach)), 0)
                               : T(0));
      }
    }
  }

  /// Edge thickness out to the aperture, and center thickness.
  void gaps() {
    for (std::size_t i = 1; i + 1 < surfaces_.size(); ++i) {
      if (!problem_.gap_is_variable(i)) continue;
      const double reach = std::max(problem_.reach[i], problem_.reach[i + 1]);
      for (int k = 1; k <= DesignProblem::kChecks; ++k) {
        const T r2(reach * reach * k * k / (DesignProblem::kChecks * DesignProblem::kChecks));
        const T gap = surfaces_[i].thickness + profile(surfaces_[i + 1], r2).sag -
                      profile(surfaces_[i], r2).sag;
        const bool glass = surfaces_[i].index > kGlass;
        const bool both = gap == gap;  // NaN: one of them ends before
        out_.push_back(both ? below(gap, glass ? problem_.min_edge_thickness : 0) : T(0));
      }
    }
    for (std::size_t i = 0; i + 1 < surfaces_.size(); ++i) {
      if (problem_.thickness_is_variable(i))
        out_.push_back(below(surfaces_[i].thickness, problem_.min_center_thickness));
    }
  }

 private:
  const DesignProblem& problem_;
  const std::vector<DesignSurface<T>>& surfaces_;
  std::vector<T>& out_;
  T first_{0};
};

template <class T>
bool design_residuals(const DesignProblem& problem, const T* x, std::vector<T>& out) {
  const auto surfaces = shaped(problem, x);
  DesignResiduals<T> residuals(problem, surfaces, out);
  out.clear();
  if (!residuals.fields()) return false;
  residuals.kept();
  residuals.profiles();
  residuals.gaps();
  return true;
}

}  // namespace vitreo::optics::detail
