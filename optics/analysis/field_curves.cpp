// SPDX-License-Identifier: Apache-2.0
#include "optics/analysis/field_curves.h"

#include "optics/numerics/preconditions.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics {
namespace {

/// The plane in which distortion is measured, and the magnification that it is measured against.
struct OnAxis {
  double focus;
  double magnification;
};

/// Magnification from an object near the axis, by its chief ray in the plane of the on-axis focus.
/// Throws std::invalid_argument naming the depth: without an image on the axis no field can be
/// referred to one.
OnAxis on_axis(const PupilTracer& tracer, const std::vector<Eigen::Vector2d>& samples, double depth,
               Spot& spot) {
  constexpr double kNearAxis = 1e-4;  // rad: distortion grows as its square
  const auto middle = point_at_field(tracer.system(), 0, depth);
  const auto beside = point_at_field(tracer.system(), kNearAxis, depth);
  detail::require(middle && beside && tracer.trace(*middle, samples, spot) && spot.rays() > 1,
                  "depth: no image on the axis");
  const double focus = spot.moments().best_focus();
  if (!tracer.trace(*beside, samples, spot))
    throw std::invalid_argument("depth: no image near the axis");
  return {focus, spot.chief_at(focus).x() / beside->x()};
}

/// The object lies in the x-z plane: tangential is the width along x, sagittal along y.
/// A share of rays is a share of light, as the samples of disc_samples stand for equal areas of the
/// pupil. Best foci are m behind the last vertex.
FieldPoint image_of(const Eigen::Vector3d& object, const OnAxis& axis, const Spot& spot) {
  const SpotMoments moments = spot.moments();
  FieldPoint made;
  made.transmitted = static_cast<double>(spot.rays()) / (spot.rays() + spot.lost);
  made.best_focus = moments.best_focus();
  made.tangential = moments.best_focus_along(Eigen::Vector2d::UnitX());
  made.sagittal = moments.best_focus_along(Eigen::Vector2d::UnitY());
  made.chief_height = spot.chief_at(made.best_focus).x();
  made.rms = moments.rms(made.best_focus);
  // Distortion: height in the plane of the on-axis focus over the ideal height, less one.
  // At the axis itself both heights are 0, and so is the distortion that their ratio tends to.
  const double ideal = axis.magnification * object.x();
  made.distortion = ideal == 0 ? 0 : spot.chief_at(axis.focus).x() / ideal - 1;
  return made;
}

}  // namespace

/// A field whose chief ray is lost stays in the list, with nothing transmitted.
std::vector<FieldPoint> field_curves(const PupilTracer& tracer, const std::vector<double>& angles,
                                     const std::vector<Eigen::Vector2d>& samples, double depth) {
  Spot spot;
  const OnAxis axis = on_axis(tracer, samples, depth, spot);
  std::vector<FieldPoint> curve;
  for (const double angle : angles) {
    const auto object = point_at_field(tracer.system(), angle, depth);
    FieldPoint made;
    if (object && tracer.trace(*object, samples, spot) && spot.rays() > 1)
      made = image_of(*object, axis, spot);
    made.angle = angle;
    curve.push_back(made);
  }
  return curve;
}

/// Over the fields from which rays come through; 0 when there is none.
double field_curvature_span(const std::vector<FieldPoint>& curve) {
  double least = std::numeric_limits<double>::infinity();
  double most = -least;
  for (const FieldPoint& point : curve) {
    if (!(point.transmitted > 0)) continue;
    least = std::min(least, point.best_focus);
    most = std::max(most, point.best_focus);
  }
  return most >= least ? most - least : 0;
}

}  // namespace vitreo::optics
