// SPDX-License-Identifier: Apache-2.0
#include "optics/design/designer.h"

#include <ceres/ceres.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::optics::detail {
namespace {

struct Named {
  const char* suffix;
  ShapeKind kind;
};
/// A radius is designed as its curvature, which passes through the plane without a pole.
constexpr Named kShapes[] = {{".radius", ShapeKind::curvature},
                             {".conic", ShapeKind::conic},
                             {".a4", ShapeKind::a4},
                             {".a6", ShapeKind::a6},
                             {".a8", ShapeKind::a8},
                             {".a10", ShapeKind::a10},
                             {".thickness", ShapeKind::thickness}};

/// By the prescription's name or the surface's number; surface 1, the retina, is no variable.
ShapeVariable find_shape(const Prescription& prescription, const std::string& name) {
  (void)parameter(prescription, name);  // refuses an unknown one, with suggestions
  for (std::size_t i = 1; i < prescription.system.surfaces.size(); ++i) {
    const std::string number = "surface_" + std::to_string(i + 1);
    for (const Named& one : kShapes) {
      const auto& owner =
          one.kind == ShapeKind::thickness ? prescription.media[i] : prescription.surfaces[i];
      if (name == owner + one.suffix || name == number + one.suffix) return {i, one.kind, 1};
    }
  }
  throw std::invalid_argument("variables: " + name +
                              " cannot be designed; a radius, conic, a4 to a10 or thickness can");
}

/// Scale of a variable per unit of x: about kUnit of sag at the rim, so that the solver's variables
/// are of one size. Curvature c has sag c r^2 / 2, a_2k has a_2k r^2k.
double scale_of(ShapeKind kind, double reach) {
  switch (kind) {
    case ShapeKind::curvature:
      return 2 * DesignProblem::kUnit / (reach * reach);
    case ShapeKind::conic:
      return 1;
    case ShapeKind::thickness:
      return DesignProblem::kUnit * 10;
    default: {
      const int order = 4 + 2 * (static_cast<int>(kind) - static_cast<int>(ShapeKind::a4));
      return DesignProblem::kUnit / std::pow(reach, order);
    }
  }
}

/// From the prescription's number to the shape's value: a curvature for a radius, 0 for a plane.
double to_shape(ShapeKind kind, double parameter) {
  return kind == ShapeKind::curvature ? 1 / parameter : parameter;
}

/// Bounds of the shape's value. 1 / R falls with R while R keeps its sign, so the bounds are
/// exchanged.
std::pair<double, double> bounds_of(const DesignVariable& variable, ShapeKind kind) {
  if (kind != ShapeKind::curvature) return {variable.lower, variable.upper};
  if (std::isinf(variable.lower) && std::isinf(variable.upper))
    return {variable.lower, variable.upper};
  if (!(variable.lower > 0 || variable.upper < 0)) {
    throw std::invalid_argument("variables: " + variable.parameter +
                                " has bounds on both sides of zero");
  }
  const auto reciprocal = [](double radius) { return std::isinf(radius) ? 0 : 1 / radius; };
  return {reciprocal(variable.upper), reciprocal(variable.lower)};
}

}  // namespace

/// Variables by name, their bounds, and the first surface that changes: rays are traced once up to
/// the one before it.
Designer::Designer(const Prescription& start, const LensDesignOptions& options)
    : start_(start), now_(start), options_(options) {
  start.check();
  start.system.require_centered();
  options.check();
  if (!start.system.stop) throw std::invalid_argument("stop: the system has none");
  std::size_t first = start.system.surfaces.size();
  for (const DesignVariable& variable : options.variables) {
    auto shape = find_shape(start, variable.parameter);
    bounds_.push_back(bounds_of(variable, shape.kind));
    const auto same = [&](const auto& other) {
      return other.surface == shape.surface && other.kind == shape.kind;
    };
    if (std::any_of(problem_.variables.begin(), problem_.variables.end(), same)) {
      throw std::invalid_argument("variables: " + variable.parameter + " stands there twice");
    }
    const double value = parameter(start, variable.parameter);
    if (!(value >= variable.lower && value <= variable.upper)) {
      throw std::invalid_argument("variables: " + variable.parameter +
                                  " starts outside its bounds");
    }
    problem_.variables.push_back(shape);
    // A thickness moves what lies behind it, so the next surface is the first that changes.
    first = std::min(first, shape.kind == ShapeKind::thickness ? shape.surface + 1 : shape.surface);
  }
  problem_.from = first - 1;
  problem_.flatness_weight = options.flatness_weight;
  problem_.spot_weight = options.spot_weight;
  problem_.max_spot = options.max_spot;
  problem_.keeps = options.keeps;
  problem_.min_edge_thickness = options.min_edge_thickness;
  problem_.min_center_thickness = options.min_center_thickness;
}

/// Half of one field's bundle (the other is its mirror image, hence weight 2), aimed at the stop
/// through the present lens and kept behind the last surface that does not change; `lost` of its
/// rays do not come through. Notes how far out the rays meet each surface.
/// Aimed with the lens as it is, a ray is then held up to the first surface that changes: so the
/// merit is differentiable, and the next round aims anew.
std::optional<DesignBundle> Designer::bundle(const PupilTracer& tracer, double angle, int& lost) {
  constexpr double kOnPlane = 1e-9;  // of the unit disc
  const auto object = point_at_field(now_.system, angle, options_.depth);
  if (!object) return std::nullopt;
  const auto surfaces = design_surfaces<double>(now_.system);
  DesignBundle made;
  for (const Eigen::Vector2d& sample : disc_samples(options_.rings, options_.arms)) {
    if (sample.y() < -kOnPlane) continue;
    const double weight = sample.y() < kOnPlane ? 1 : 2;
    const auto ray = tracer.aim(*object, sample);
    Eigen::Vector3d origin = ray ? ray->origin : Eigen::Vector3d::Zero();
    Eigen::Vector3d direction(0, 0, 1);
    if (ray) direction = ray->direction;
    bool through = ray.has_value();
    for (std::size_t i = 1; through && i < surfaces.size(); ++i) {
      if (i == problem_.from + 1)
        made.origin.push_back(origin), made.direction.push_back(direction);
      origin.z() -= surfaces[i - 1].thickness;
      const Crossing<DesignSurface<double>> at{surfaces[i],
                                               surfaces[i - 1].index / surfaces[i].index};
      through = cross(at, origin, direction) == TraceStatus::ok;
      if (through) problem_.reach[i] = std::max(problem_.reach[i], origin.head<2>().norm());
    }
    if (through) {
      made.weight.push_back(weight);
      continue;
    }
    ++lost;
    // The lost ray's start may have been noted already.
    made.origin.resize(made.weight.size());
    made.direction.resize(made.weight.size());
  }
  return made;
}

/// The bundles of the first `fields` fields for the next round, and how far out all of them reach.
/// `used` and `whole` are compared from round to round: a set of rays that changes makes another
/// merit.
Designer::Rays Designer::gather(std::size_t fields) {
  constexpr std::size_t kFewest = 6;  // rays that still make a spot
  const PupilTracer tracer(now_.system, Pupil::of_stop(now_.system));
  Rays rays;
  problem_.system = now_.system;
  problem_.bundles.clear();
  problem_.reach.assign(now_.system.surfaces.size(), 0.0);
  for (std::size_t i = 0; i < options_.angles.size(); ++i) {
    int lost = 0;
    auto one = bundle(tracer, options_.angles[i], lost);
    // A field that loses rays still counts with those that come through, so that the design can win
    // it back; all fields are traced for the reach, whether they count or not.
    if (!one || one->weight.size() < kFewest || i >= fields) continue;
    if (lost == 0) ++rays.whole;
    rays.used.push_back(i);
    problem_.bundles.push_back(std::move(*one));
  }
  if (options_.aperture) {
    for (double& reach : problem_.reach) reach = std::max(reach, *options_.aperture);
  }
  for (std::size_t i = 0; i < problem_.reach.size(); ++i) {
    problem_.reach[i] = std::min(problem_.reach[i], now_.system.surfaces[i].semi_diameter);
  }
  return rays;
}

/// The present shapes in the solver's units.
std::vector<double> Designer::start_of_round() const {
  std::vector<double> x;
  for (std::size_t i = 0; i < problem_.variables.size(); ++i) {
    const auto& v = problem_.variables[i];
    x.push_back(to_shape(v.kind, parameter(now_, options_.variables[i].parameter)) / v.scale);
  }
  return x;
}

/// The residuals for Ceres, in doubles or Jets. False refuses the step: a ray is lost, and there is
/// no merit to compare.
struct MeritFunctor {
  const DesignProblem& problem;
  template <class T>
  bool operator()(T const* const* x, T* residuals) const {
    std::vector<T> values;
    if (!design_residuals(problem, x[0], values)) return false;
    std::copy(values.begin(), values.end(), residuals);
    return true;
  }
};

/// One round: least squares by Ceres with automatic derivatives, within bounds. Aspheric terms of
/// an order above `highest` are held.
/// True when Ceres converged, or when all variables are held. Adds to `iterations` what it used of
/// the whole design's allowance; the derivatives are exact, since the tracer itself runs on Jets.
bool Designer::solve(std::vector<double>& x, ShapeKind highest, int& iterations, double& cost) {
  // Derivatives per pass of Ceres' dynamic automatic differentiation.
  constexpr int kStride = 8;
  std::vector<double> first;
  if (!design_residuals(problem_, x.data(), first)) return false;
  auto* function =
      new ceres::DynamicAutoDiffCostFunction<MeritFunctor, kStride>(new MeritFunctor{problem_});
  function->AddParameterBlock(static_cast<int>(x.size()));
  function->SetNumResiduals(static_cast<int>(first.size()));
  ceres::Problem problem;
  problem.AddResidualBlock(function, nullptr, x.data());  // Ceres owns the function
  for (std::size_t i = 0; i < x.size(); ++i) {
    const double scale = problem_.variables[i].scale;
    if (std::isfinite(bounds_[i].first))
      problem.SetParameterLowerBound(x.data(), int(i), bounds_[i].first / scale);
    if (std::isfinite(bounds_[i].second))
      problem.SetParameterUpperBound(x.data(), int(i), bounds_[i].second / scale);
  }
  std::vector<int> still;
  for (std::size_t i = 0; i < x.size(); ++i) {
    const ShapeKind kind = problem_.variables[i].kind;
    if (is_coefficient(kind) && kind > highest) still.push_back(static_cast<int>(i));
  }
  if (still.size() == x.size()) return true;
  if (!still.empty())
    problem.SetManifold(x.data(), new ceres::SubsetManifold(static_cast<int>(x.size()), still));
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_QR;
  options.logging_type = ceres::SILENT;
  options.max_num_iterations = std::max(1, options_.max_iterations - iterations);
  // a step that loses a ray is too long, no failure
  options.max_num_consecutive_invalid_steps = 30;
  // Rounds follow each other, so a round need not be exact.
  options.function_tolerance = 1e-7;
  options.parameter_tolerance = 1e-10;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  iterations += static_cast<int>(summary.iterations.size());
  cost = summary.final_cost;
  return summary.termination_type == ceres::CONVERGENCE;
}

/// Adopts the solver's shapes, unless they make no system; `unsound_` then names the fault.
/// The penalties do not exclude what System::check refuses, such as a thickness a little below
/// zero.
void Designer::adopt(const std::vector<double>& x) {
  const Prescription last = now_;
  const auto surfaces = shaped(problem_, x.data());
  for (std::size_t i = 1; i < surfaces.size(); ++i) {
    Surface& s = now_.system.surfaces[i];
    if (problem_.is_variable(i)) {
      // 1 / (1 / R) is not always R; a radius that did not change keeps its bits.
      if (s.radius * surfaces[i].curvature != 1) s.radius = 1 / surfaces[i].curvature;
      s.conic = surfaces[i].conic;
      s.aspheric = surfaces[i].aspheric;
    }
    if (problem_.thickness_is_variable(i)) s.thickness = surfaces[i].thickness;
  }
  try {
    now_.system.check();
  } catch (const std::invalid_argument& why) {
    unsound_ = why.what();
    now_ = last;
  }
}

/// Figures before and after by the plain tracer. A lost field outranks a violated constraint, that
/// outranks a design that did not settle.
/// A parameter within 0.1 % of a bound is marked: the optimum may lie beyond. Before and after are
/// traced with the options' own bundle.
LensDesign Designer::report(bool settled, int iterations) const {
  constexpr double kTouches = 1e-3;
  LensDesign made;
  made.prescription = now_;
  made.before = lens_image(start_.system, options_);
  made.after = lens_image(now_.system, options_);
  made.iterations = iterations;
  for (const DesignVariable& variable : options_.variables) {
    const double before = parameter(start_, variable.parameter);
    const double after = parameter(now_, variable.parameter);
    const auto touches = [&](double bound) {
      return std::isfinite(bound) && std::abs(after - bound) <= kTouches * std::abs(bound);
    };
    made.parameters.push_back(
        {variable.parameter, before, after, touches(variable.lower) || touches(variable.upper)});
  }
  made.reason = violated();
  if (!unsound_.empty()) made.reason = unsound_;
  made.status = DesignStatus::converged;
  if (made.after.lost_fields > 0) {
    made.status = DesignStatus::rays_lost;
    made.reason = std::to_string(made.after.lost_fields) + " of " +
                  std::to_string(options_.angles.size()) + " fields lose rays on their path";
  } else if (!made.reason.empty()) {
    made.status = DesignStatus::constraint_violated;
  } else if (!settled) {
    made.status = DesignStatus::not_converged;
    made.reason = "max_iterations: " + std::to_string(iterations) + " did not settle it";
  }
  return made;
}

/// Rays are aimed through the lens as it is, then held while the shapes are solved for; rounds
/// repeat until cost and set of rays settle. By the path, a field or the next order joins each
/// round, as thesis 3.2 determines a4, a6, a8, a10 in sequence.
/// Throws std::invalid_argument when the start does not image the first field: there is no focus to
/// improve.
LensDesign Designer::run(const Path& path) {
  constexpr int kMaxRounds = 60;
  constexpr double kSettled = 1e-5;  // of the cost, from one round to the next
  const std::size_t all = options_.angles.size();
  std::size_t fields = path.fields_grow ? std::min<std::size_t>(2, all) : all;
  ShapeKind highest = path.orders_grow ? ShapeKind::a4 : ShapeKind::a10;
  const LensImage image = lens_image(start_.system, options_);
  problem_.kept =
      options_.keeps == DesignKeeps::focal_length ? image.focal_length : image.image_distance;
  Rays rays = gather(fields);
  if (rays.used.empty() || rays.used.front() != 0 || !std::isfinite(problem_.kept)) {
    throw std::invalid_argument("angles: the start images not even the first field");
  }
  double last = std::numeric_limits<double>::infinity();
  int iterations = 0;
  bool settled = false;
  for (int round = 0; round < kMaxRounds && !settled && iterations < options_.max_iterations;
       ++round) {
    for (auto& v : problem_.variables)
      v.scale = scale_of(v.kind, std::max(problem_.reach[v.surface], 1e-3));
    std::vector<double> x = start_of_round();
    double cost = 0;
    const bool converged = solve(x, highest, iterations, cost);
    adopt(x);
    if (!unsound_.empty()) break;
    const bool complete = fields == all && highest == ShapeKind::a10;
    if (fields < all) {
      ++fields;
    } else if (highest != ShapeKind::a10) {
      highest = static_cast<ShapeKind>(static_cast<int>(highest) + 1);
    }
    const Rays next = gather(fields);
    settled = complete && converged && next == rays && std::abs(last - cost) <= kSettled * cost;
    rays = next;
    last = cost;
  }
  return report(settled, iterations);
}

}  // namespace vitreo::optics::detail
