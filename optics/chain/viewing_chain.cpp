// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/viewing_chain.h"

#include "optics/chain/line_derivative.h"
#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>
#include <ceres/jet.h>

#include <cmath>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr int kNumbers = 7;
/// Of the microscope: the pixel and its own numbers.
using MicroscopeJet = ceres::Jet<double, 2 + kNumbers>;
using ByTheta = Eigen::Matrix<double, kNumbers, Eigen::Dynamic>;

/// Central differences of the layout, which is smooth and cheap: the step is a thousandth of a
/// sigma, the error of second order in it.
constexpr double kStep = 1e-3;

/// In the order of OwnParameter.
constexpr const char* kOwnNames[] = {
    "robot_length",         "robot_width",          "dilation",       "dilation_slope",
    "retina_depth",         "retina_tilt_x",        "retina_tilt_y",  "retina_curvature",
    "retina_astigmatism_x", "retina_astigmatism_y", "eye_rotation_x", "eye_rotation_y",
    "axis_turn_x",          "axis_turn_y",          "axis_turn_z"};

/// (center - u, v - center): m over the pixel's width (ImageScale).
Eigen::Vector2d image_point(const ImageScale& image, const Eigen::Vector2d& pixel_px) {
  return {image.center_px.x() - pixel_px.x(), pixel_px.y() - image.center_px.y()};
}

// Variables of a step: its seven numbers, counted from kFirst on.
template <class Jet, int kFirst>
Eigen::Matrix<Jet, kNumbers, 1> jets_of(const Eigen::Matrix<double, kNumbers, 1>& numbers) {
  Eigen::Matrix<Jet, kNumbers, 1> jets;
  for (int i = 0; i < kNumbers; ++i) jets[i] = Jet(numbers[i], kFirst + i);
  return jets;
}

}  // namespace

ViewingChain::ViewingChain(const NominalChain& nominal, std::vector<ChainParameter> parameters,
                           const Eigen::VectorXd& theta)
    : nominal_(nominal), parameters_(std::move(parameters)), theta_(theta) {
  detail::require(theta.size() == size() && theta.allFinite(),
                  "theta: wants a finite number for each parameter");
  find_own();
  const detail::ChainLayout layout(nominal_, parameters_);
  detail::require(layout.surfaces().size() <= LineDerivatives::kMostSurfaces,
                  "prescription: the chain takes 16 surfaces");
  placed_ = layout.place(theta_);
  for (std::size_t k = 0; k < placed_.surfaces.size(); ++k)
    steps_.push_back(detail::chain_step<double>(layout.surfaces()[k + 1], placed_.surfaces[k]));
  surfaces_by_theta_.assign(placed_.surfaces.size(), ByTheta::Zero(kNumbers, size()));
  microscope_by_theta_ = ByTheta::Zero(kNumbers, size());
  for (Eigen::Index i = 0; i < size(); ++i) {
    Eigen::VectorXd off = theta_;
    off[i] += kStep;
    const detail::PlacedChain more = layout.place(off);
    off[i] -= 2 * kStep;
    const detail::PlacedChain less = layout.place(off);
    microscope_by_theta_.col(i) = (more.microscope - less.microscope) / (2 * kStep);
    for (std::size_t k = 0; k < placed_.surfaces.size(); ++k)
      surfaces_by_theta_[k].col(i) = (more.surfaces[k] - less.surfaces[k]) / (2 * kStep);
  }
}

/// Names are looked up once: a frame asks for them a thousand times.
void ViewingChain::find_own() {
  for (std::size_t i = 0; i < parameters_.size(); ++i) {
    if (parameters_[i].part == ChainPart::eye) ++eye_size_;
    for (std::size_t k = 0; k < own_.size(); ++k)
      if (parameters_[i].name == kOwnNames[k])
        own_[k] = {static_cast<Eigen::Index>(i), parameters_[i].sigma};
  }
}

// In the order of OwnParameter.
constexpr std::array kTurns{OwnParameter::axis_turn_x, OwnParameter::axis_turn_y,
                            OwnParameter::axis_turn_z};

/// a + turn x a, which is longer than a by half the turn's square.
Eigen::Vector3d ViewingChain::moved(const Eigen::Vector3d& axis) const {
  Eigen::Vector3d turn = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < kTurns.size(); ++i) {
    const Own& one = own(kTurns[i]);
    if (one.at >= 0) turn[static_cast<Eigen::Index>(i)] = one.sigma * theta_[one.at];
  }
  return axis + turn.cross(axis);
}

Eigen::Vector3d ViewingChain::turned(const Eigen::Vector3d& axis) const {
  return moved(axis).normalized();
}

Eigen::Matrix<double, 3, Eigen::Dynamic> ViewingChain::turned_by_theta(
    const Eigen::Vector3d& axis) const {
  Eigen::Matrix<double, 3, Eigen::Dynamic> by =
      Eigen::Matrix<double, 3, Eigen::Dynamic>::Zero(3, size());
  const Eigen::Vector3d a = moved(axis);
  const Eigen::Vector3d u = a.normalized();
  for (std::size_t i = 0; i < kTurns.size(); ++i) {
    const Own& one = own(kTurns[i]);
    if (one.at < 0) continue;
    // d (a / |a|) = (1 - u u') da / |a|
    const Eigen::Vector3d by_turn =
        one.sigma * Eigen::Vector3d::Unit(static_cast<Eigen::Index>(i)).cross(axis);
    by.col(one.at) = (by_turn - u * u.dot(by_turn)) / a.norm();
  }
  return by;
}

/// Against the light, from the pixel inwards.
std::optional<VitreousLine> ViewingChain::line(const Eigen::Vector2d& pixel_px) const {
  VitreousLine line =
      detail::line_in_air<double>(placed_.microscope, image_point(nominal_.image, pixel_px));
  detail::ChainRefraction<double> met;
  for (std::size_t k = steps_.size(); k-- > 0;)
    if (!detail::refract_inwards(steps_[k], line, met)) return std::nullopt;
  if (!line.allFinite()) return std::nullopt;
  return line;
}

/// Each step is differentiated by the line that comes and by its own seven numbers, in one pass:
/// the microscope's by Jets, a surface's in closed form.
std::optional<LineDerivatives> ViewingChain::differentiated_line(
    const Eigen::Vector2d& pixel_px) const {
  const Eigen::Vector2d at = image_point(nominal_.image, pixel_px);
  const detail::LineOf<MicroscopeJet> start = detail::line_in_air<MicroscopeJet>(
      jets_of<MicroscopeJet, 2>(placed_.microscope),
      detail::Vector2<MicroscopeJet>(MicroscopeJet(at.x(), 0), MicroscopeJet(at.y(), 1)));
  LineDerivatives made;
  for (int i = 0; i < 4; ++i) {
    made.line[i] = start[i].a;
    // u counts against m's x.
    made.by_pixel.row(i) << -start[i].v[0], start[i].v[1];
    made.by_microscope.row(i) = start[i].v.tail<kNumbers>();
  }
  detail::StepDerivative by;
  for (std::size_t k = steps_.size(); k-- > 0;) {
    if (!detail::refract_inwards(steps_[k], made.line, by)) return std::nullopt;
    made.through[k] = by.leftCols<4>();
    made.own[k] = by.rightCols<kNumbers>();
    made.by_pixel = (made.through[k] * made.by_pixel).eval();
  }
  if (!made.line.allFinite()) return std::nullopt;
  return made;
}

/// The chain rule from the result backwards, two rows wide:
///   sum over steps k of A through_1 ... through_(k-1) own_k (d numbers_k / d theta).
Eigen::Matrix<double, 2, Eigen::Dynamic> ViewingChain::by_theta(
    const LineDerivatives& line, const Eigen::Matrix<double, 2, 4>& of_line) const {
  Eigen::Matrix<double, 2, 4> through = of_line;
  Eigen::Matrix<double, 2, Eigen::Dynamic> sum =
      Eigen::Matrix<double, 2, Eigen::Dynamic>::Zero(2, size());
  for (std::size_t k = 0; k < placed_.surfaces.size(); ++k) {
    const Eigen::Matrix<double, 2, kNumbers> own = through * line.own[k];
    sum += own.lazyProduct(surfaces_by_theta_[k]);
    through = (through * line.through[k]).eval();
  }
  const Eigen::Matrix<double, 2, kNumbers> own = through * line.by_microscope;
  sum += own.lazyProduct(microscope_by_theta_);
  return sum;
}

/// Half-way, in power, between their two foci (ExactProjection).
std::optional<Eigen::Vector3d> ViewingChain::viewpoint(const LineDerivatives& line, double z) {
  const double power =
      -(line.by_pixel.bottomRows<2>() * line.pixel_at(z).inverse()).trace() / 2;  // 1/m along z
  if (!(power > 0)) return std::nullopt;
  Eigen::Vector3d point;
  point << line.at(z) + line.line.tail<2>() / power, z + 1 / power;
  return point;
}

/// g(p) = x(p) + z s(p) - P = 0 by Newton with the Jacobian of `near`, scaled to the point's height
/// (a chord method): the map from pixels to points is nearly linear, each step gains two digits.
std::optional<Eigen::Vector2d> ViewingChain::pixel(const Eigen::Vector3d& point,
                                                   const LineDerivatives& near,
                                                   const Eigen::Vector2d& near_px) const {
  constexpr int kSteps = 25;
  constexpr double kConverged = 1e-6;  // px
  constexpr double kFar = 1e4;         // px
  const double z = point.z();
  const Eigen::Matrix2d inverse = near.pixel_at(z).inverse();
  Eigen::Vector2d pixel_px = near_px + inverse * (point.head<2>() - near.at(z));
  for (int step = 0; step < kSteps; ++step) {
    // A pixel that runs away belongs to a fold of the map, or to no line at all.
    if (!((pixel_px - near_px).norm() < kFar)) return std::nullopt;
    const auto there = line(pixel_px);
    if (!there) return std::nullopt;
    const Eigen::Vector2d off =
        inverse * (point.head<2>() - there->head<2>() - z * there->tail<2>());
    pixel_px += off;
    if (off.norm() < kConverged) return pixel_px;
  }
  return std::nullopt;
}

/// dp = G^-1 (dP_xy - s dz - dg/dtheta dtheta) with G = dg/dp: one trace for all parameters.
std::optional<SeenPixel> ViewingChain::seen(const Eigen::Vector3d& point,
                                            const Eigen::Vector2d& near_px) const {
  const auto near = differentiated_line(near_px);
  if (!near) return std::nullopt;
  const auto pixel_px = pixel(point, *near, near_px);
  if (!pixel_px) return std::nullopt;
  const auto here = differentiated_line(*pixel_px);
  if (!here) return std::nullopt;
  const Eigen::Matrix2d inverse = here->pixel_at(point.z()).inverse();
  SeenPixel seen;
  seen.pixel_px = *pixel_px;
  seen.by_position << inverse, -inverse * here->line.tail<2>();
  Eigen::Matrix<double, 2, 4> of_line;
  of_line << -inverse, -point.z() * inverse;
  seen.by_theta = by_theta(*here, of_line);
  return seen;
}

}  // namespace vitreo::optics
