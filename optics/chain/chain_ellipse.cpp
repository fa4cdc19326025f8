// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_ellipse.h"

#include "optics/pose/level_plates.h"
#include "optics/pose/silhouette.h"

#include <Eigen/Dense>
#include <Eigen/Geometry>
#include <ceres/jet.h>

#include <array>
#include <cmath>

namespace vitreo::optics {
namespace detail {

/// The chain as contour_through() asks for a projection: it knows its viewpoint, and remembers the
/// points of the body that make the outline, with their pixels.
struct ChainOutline {
  const ViewingChain& chain;
  const LineDerivatives& near;
  Eigen::Vector2d near_px;
  Eigen::Vector3d viewpoint;
  mutable std::array<Eigen::Vector3d, kMaxContourPoints> points{};
  mutable std::array<Eigen::Vector2d, kMaxContourPoints> pixels{};
  mutable std::size_t count = 0;
};

// contour_through() finds these two by their arguments.
bool viewpoint_near(const ChainOutline& view, const Eigen::Vector3d&, Eigen::Vector3d& viewpoint) {
  viewpoint = view.viewpoint;
  return true;
}
bool project_from(const ChainOutline& view, const Eigen::Vector3d& viewpoint,
                  const Eigen::Vector3d& from_viewpoint, Eigen::Vector2d& m) {
  const Eigen::Vector3d point = viewpoint + from_viewpoint;
  const auto pixel_px = view.chain.pixel(point, view.near, view.near_px);
  if (!pixel_px) return false;
  view.points[view.count] = point;
  view.pixels[view.count++] = *pixel_px;
  m = view.chain.nominal().image.m_from_pixel(*pixel_px);
  return true;
}

}  // namespace detail

namespace {

constexpr int kOutlinePoints = 12;
constexpr int kDifferentiated = 6;  // of them, each second

/// dx / dz and dy / dz of the line of sight through a point near a line, by that line's pixel, and
/// what moves it.
struct Slope {
  Eigen::Vector2d value;
  Eigen::Matrix2d by_place;  // 1/m, by the point's x and y
};

Slope slope_at(const Eigen::Vector3d& point, const LineDerivatives& near) {
  const Eigen::Matrix2d by_place =
      near.by_pixel.bottomRows<2>() * near.pixel_at(point.z()).inverse();
  return {near.line.tail<2>() + by_place * (point.head<2>() - near.at(point.z())), by_place};
}

/// Of two crossed plates the one that is seen more nearly face-on makes the outline: that of a thin
/// ellipsoid, narrower than a round body's by
///   sqrt((c^2 + r^2 q^2) / (c^2 + q^2))
/// with c and q the parts of the line of sight along its normal and its side, r its `ratio` of
/// thickness and width.
double width_factor(double ratio, const Eigen::Vector2d& slope, const Eigen::Vector3d& axis) {
  if (ratio == 1) return 1;
  const Eigen::Vector3d sight(slope.x(), slope.y(), 1);
  const Eigen::Vector3d side = level_side(axis);
  const double one = std::pow(sight.dot(axis.cross(side)), 2);
  const double other = std::pow(sight.dot(side), 2);
  const double c = std::max(one, other);
  const double q = std::min(one, other);
  return std::sqrt((c + ratio * ratio * q) / (c + q));
}

// By the parameters; the chain's robot is the believed one.
Spheroid true_size(const ViewingChain& chain, double narrower) {
  const Spheroid& robot = chain.nominal().robot;
  return {robot.semi_axis * chain.placed().robot_length,
          robot.semi_radius * chain.placed().robot_width * narrower};
}

/// (a^2 - b^2) / 2 over a + b is the half difference. `shape`: of a circle, px.
template <class T>
Eigen::Matrix<T, 5, 1> smooth_of(const detail::AffineCircle<T>& circle) {
  const detail::ImageEllipse<T> axes = detail::axes_of(circle);
  const T sum = axes.semi_major + axes.semi_minor;
  Eigen::Matrix<T, 5, 1> smooth;
  smooth << axes.center.x(), axes.center.y(), sum / 2.0, axes.twice_angle_cos / sum,
      axes.twice_angle_sin / sum;
  return smooth;
}

// Of both semi-axes alike, so it is in their mean and not in their difference.
double dilation_at(const ViewingChain& chain, double z) {
  return chain.placed().dilation_px + chain.placed().dilation_slope * (z - detail::kDilationHeight);
}

struct Outlined {
  SmoothEllipseVector ellipse;
  detail::AffineCircle<double> circle;
  detail::ChainOutline outline;
};

/// `near` belongs to place.near_px. Seen from where the lines past the body meet: those near its
/// center's place in the image will do.
std::optional<Outlined> outline_of(const ViewingChain& chain, const RobotPlace& place,
                                   const LineDerivatives& near) {
  const auto viewpoint = ViewingChain::viewpoint(near, place.position.z());
  if (!viewpoint) return std::nullopt;
  PoseSettings settings;
  settings.image = chain.nominal().image;
  settings.robot = true_size(chain, width_factor(chain.nominal().plate_ratio,
                                                 slope_at(place.position, near).value, place.axis));
  static const detail::Circle kCircle(kOutlinePoints);
  Outlined made{{}, {}, {chain, near, place.near_px, *viewpoint}};
  detail::Contour<double> contour;
  if (!detail::contour_through(made.outline, settings, kCircle, place.position, place.axis,
                               contour))
    return std::nullopt;
  made.circle = detail::first_harmonic(kCircle, contour);
  detail::correct(kCircle, contour, made.circle);
  made.ellipse = smooth_of(made.circle);
  made.ellipse[2] += dilation_at(chain, place.position.z());
  return made;
}

/// The outline of a place, linearized where its center is shown: the place's own pixel is only near
/// that.
struct Centered {
  RobotPlace place;
  LineDerivatives near;
};
std::optional<Centered> centered(const ViewingChain& chain, const RobotPlace& place) {
  constexpr double kNear = 3;  // px
  auto near = chain.differentiated_line(place.near_px);
  if (!near) return std::nullopt;
  const auto pixel_px = chain.pixel(place.position, *near, place.near_px);
  if (!pixel_px) return std::nullopt;
  if ((*pixel_px - place.near_px).norm() < kNear) return Centered{place, *near};
  near = chain.differentiated_line(*pixel_px);
  if (!near) return std::nullopt;
  return Centered{{place.position, place.axis, *pixel_px}, *near};
}

/// d pixel / d (position, axis, theta, ln width) of a point of the body. The outline's points may
/// be taken as fixed to the body: where they slide, they slide along the outline or along the line
/// of sight.
Eigen::MatrixXd body_point_derivative(const ViewingChain& chain, const RobotPlace& place,
                                      const Eigen::Matrix<double, 3, 2>& across,
                                      const Eigen::Vector3d& point, const LineDerivatives& line) {
  const Eigen::Vector3d offset = point - place.position;
  const Eigen::Matrix2d inverse = line.pixel_at(point.z()).inverse();
  // dp = G^-1 (dP_xy - s dz), as in ViewingChain::seen().
  Eigen::Matrix<double, 2, 3> by_point;
  by_point << inverse, -inverse * line.line.tail<2>();
  Eigen::MatrixXd all(2, 6 + chain.size());
  all.leftCols<3>() = by_point;
  for (int i = 0; i < 2; ++i)
    all.col(3 + i) = by_point * place.axis.cross(across.col(i)).cross(offset);
  Eigen::Matrix<double, 2, 4> of_line;
  of_line << -inverse, -point.z() * inverse;
  all.middleCols(5, chain.size()) = chain.by_theta(line, of_line);
  // A longer robot moves a point of its surface along the axis, a wider one across it, each by its
  // part of the offset from the center.
  const Eigen::Vector3d along = place.axis * place.axis.dot(offset);
  const auto grow = [&](OwnParameter which, const Eigen::Vector3d& part, double factor) {
    const ViewingChain::Own& own = chain.own(which);
    if (own.at >= 0) all.col(5 + own.at) += by_point * part * (own.sigma / factor);
  };
  grow(OwnParameter::robot_length, along, chain.placed().robot_length);
  grow(OwnParameter::robot_width, offset - along, chain.placed().robot_width);
  all.rightCols<1>() = by_point * (offset - along);
  return all;
}

/// What moves the outline along itself does not change it. Where the ellipse is the unit circle the
/// outward part rho of the displacements is taken, and of that the harmonics that an ellipse can
/// follow, as correct() has them:
///   d center = S (a1, b1),  d S = S [p + s, t; t, p - s]
/// with the means a1, b1 of 2 rho cos, 2 rho sin; p of rho; s, t of 2 rho cos2, 2 rho sin2. From
/// that to the smooth coordinates by Jets of the six numbers.
std::optional<Eigen::MatrixXd> ellipse_derivative(const ViewingChain& chain,
                                                  const RobotPlace& place,
                                                  const Eigen::Matrix<double, 3, 2>& across,
                                                  const Outlined& made) {
  const Eigen::Index columns = 6 + chain.size();
  const Eigen::Matrix2d& S = made.circle.shape;
  const Eigen::Matrix2d to_circle = S.inverse();
  Eigen::MatrixXd means = Eigen::MatrixXd::Zero(5, columns);  // a1, b1, p, s, t
  for (int i = 0; i < kDifferentiated; ++i) {
    const std::size_t k = static_cast<std::size_t>(i) * (kOutlinePoints / kDifferentiated);
    const auto line = chain.differentiated_line(made.outline.pixels[k]);
    if (!line) return std::nullopt;
    const Eigen::Vector2d on_circle =
        (to_circle * (made.outline.pixels[k] - made.circle.center)).normalized();
    const Eigen::RowVectorXd rho =
        (on_circle.transpose() * to_circle) *
        body_point_derivative(chain, place, across, made.outline.points[k], *line);
    const double c = on_circle.x();
    const double s = on_circle.y();
    Eigen::Matrix<double, 5, 1> weights;
    weights << 2 * c, 2 * s, 1, 2 * (c * c - s * s), 4 * c * s;
    means += (weights / kDifferentiated) * rho;
  }
  Eigen::MatrixXd harmonic(6, columns);  // of center, and of S column by column
  harmonic.topRows<2>() = S * means.topRows<2>();
  harmonic.middleRows<2>(2) = S.col(0) * (means.row(2) + means.row(3)) + S.col(1) * means.row(4);
  harmonic.bottomRows<2>() = S.col(0) * means.row(4) + S.col(1) * (means.row(2) - means.row(3));
  using Jet = ceres::Jet<double, 6>;
  detail::AffineCircle<Jet> circle;
  circle.center = {Jet(made.circle.center.x(), 0), Jet(made.circle.center.y(), 1)};
  for (int column = 0; column < 2; ++column)
    for (int row = 0; row < 2; ++row)
      circle.shape(row, column) = Jet(made.circle.shape(row, column), 2 + 2 * column + row);
  const Eigen::Matrix<Jet, 5, 1> smooth = smooth_of(circle);
  Eigen::MatrixXd by(5, columns);
  for (int row = 0; row < 5; ++row) by.row(row) = smooth[row].v.transpose() * harmonic;
  return by;
}

/// What turns the line of sight about plates changes how wide they look. `by_width`: by ln width.
void add_narrowing(const ViewingChain& chain, const RobotPlace& place, const LineDerivatives& near,
                   const SmoothEllipseVector& by_width, ShownEllipse& shown) {
  const double ratio = chain.nominal().plate_ratio;
  if (ratio == 1) return;
  const Slope slope = slope_at(place.position, near);
  // Central differences of a smooth function of numbers of order 1.
  constexpr double kStep = 1e-5;
  const auto difference = [&](const Eigen::Vector2d& by_slope, const Eigen::Vector3d& by_axis) {
    const auto at = [&](double step) {
      return std::log(width_factor(ratio, slope.value + step * by_slope,
                                   (place.axis + step * by_axis).normalized()));
    };
    return (at(kStep) - at(-kStep)) / (2 * kStep);
  };
  const Eigen::Vector3d still = Eigen::Vector3d::Zero();
  const Eigen::RowVector2d by_slope(difference({1, 0}, still), difference({0, 1}, still));
  for (int i = 0; i < 2; ++i)
    shown.by_axis.col(i) += by_width * difference({0, 0}, shown.across.col(i));
  // The line through a point that stays: its pixel moves against what moves the line there.
  Eigen::Matrix<double, 2, 3> by_position;
  by_position << slope.by_place, -slope.by_place * near.line.tail<2>();
  shown.by_position += by_width * (by_slope * by_position);
  const double z = place.position.z();
  Eigen::Matrix<double, 2, 4> of_line;
  of_line << -slope.by_place, Eigen::Matrix2d::Identity() - z * slope.by_place;
  shown.by_theta += by_width * (by_slope * chain.by_theta(near, of_line));
}

}  // namespace

Eigen::Matrix<double, 3, 2> directions_across(const Eigen::Vector3d& axis) {
  Eigen::Matrix<double, 3, 2> across;
  across.col(0) = axis.unitOrthogonal();
  across.col(1) = axis.cross(across.col(0));
  return across;
}

std::optional<SmoothEllipseVector> shown_ellipse(const ViewingChain& chain,
                                                 const RobotPlace& place) {
  const auto here = centered(chain, place);
  if (!here) return std::nullopt;
  const auto made = outline_of(chain, here->place, here->near);
  if (!made) return std::nullopt;
  return made->ellipse;
}

std::optional<ShownEllipse> differentiated_ellipse(const ViewingChain& chain,
                                                   const RobotPlace& place) {
  const auto here = centered(chain, place);
  if (!here) return std::nullopt;
  const auto made = outline_of(chain, here->place, here->near);
  if (!made) return std::nullopt;
  ShownEllipse shown;
  shown.ellipse = made->ellipse;
  shown.across = directions_across(place.axis);
  const auto by = ellipse_derivative(chain, place, shown.across, *made);
  if (!by) return std::nullopt;
  shown.by_position = by->leftCols<3>();
  shown.by_axis = by->middleCols<2>(3);
  shown.by_theta = by->middleCols(5, chain.size());
  add_narrowing(chain, here->place, here->near, by->rightCols<1>(), shown);
  shown.by_position(2, 2) += chain.placed().dilation_slope;
  chain.add(OwnParameter::dilation, 1, shown.by_theta.row(2));
  chain.add(OwnParameter::dilation_slope, place.position.z() - detail::kDilationHeight,
            shown.by_theta.row(2));
  return shown;
}

SmoothEllipseVector smooth_from(const EllipseVector& ellipse) {
  const double half = (ellipse[2] - ellipse[3]) / 2;
  SmoothEllipseVector smooth;
  smooth << ellipse[0], ellipse[1], (ellipse[2] + ellipse[3]) / 2, half * std::cos(2 * ellipse[4]),
      half * std::sin(2 * ellipse[4]);
  return smooth;
}

EllipseVector ellipse_from(const SmoothEllipseVector& smooth) {
  const double half = std::hypot(smooth[3], smooth[4]);
  EllipseVector ellipse;
  ellipse << smooth[0], smooth[1], smooth[2] + half, smooth[2] - half,
      std::atan2(smooth[4], smooth[3]) / 2;
  return ellipse;
}

}  // namespace vitreo::optics
