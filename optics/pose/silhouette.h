// The ellipse that a spheroid shows through the single-viewpoint or the exact projection, for
// doubles and for Ceres' Jets.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/pose/pose_settings.h"
#include "optics/projection/single_viewpoint.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <array>
#include <cmath>
#include <numbers>

namespace vitreo::optics::detail {

template <class T>
using Contour = std::array<Vector2<T>, kMaxContourPoints>;

/// Cosines and sines of the contour's parameter, made once for all evaluations of a solve.
struct Circle {
  int count;
  std::array<double, kMaxContourPoints> cosine;
  std::array<double, kMaxContourPoints> sine;
  explicit Circle(int points) : count(points), cosine{}, sine{} {
    for (int i = 0; i < count; ++i) {
      cosine[i] = std::cos(2 * std::numbers::pi * i / count);
      sine[i] = std::sin(2 * std::numbers::pi * i / count);
    }
  }
};

/// An ellipse; pixels. Its angle comes as a vector, which stays smooth where the ellipse is a
/// circle.
template <class T>
struct ImageEllipse {
  Vector2<T> center;
  T semi_major;
  T semi_minor;
  // of twice the angle, times (semi_major^2 - semi_minor^2) / 2, px^2
  T twice_angle_cos;
  T twice_angle_sin;
};

template <class T>
bool viewpoint_near(const SingleViewpoint& view, const Vector3<T>&, Vector3<T>& viewpoint) {
  viewpoint = Vector3<T>(T(0), T(0), T(view.viewpoint));
  return true;
}
/// Lines that are not seen from one point touch the robot nearly where those do that come from the
/// point near which they meet. What is left of the error moves a silhouette's point round the
/// robot, and its image along the contour.
template <class T>
bool viewpoint_near(const ExactProjection& view, const Vector3<T>& position,
                    Vector3<T>& viewpoint) {
  return view.viewpoint_near(position, viewpoint);
}

template <class T>
bool project_from(const SingleViewpoint& view, const Vector3<T>&, const Vector3<T>& from_viewpoint,
                  Vector2<T>& m) {
  return project(view, from_viewpoint, m);
}
template <class T>
bool project_from(const ExactProjection& view, const Vector3<T>& viewpoint,
                  const Vector3<T>& from_viewpoint, Vector2<T>& m) {
  return view.project(Vector3<T>(viewpoint + from_viewpoint), m);
}

/// The silhouette in the image, (5.14). Lines of sight touch the spheroid where, in the space where
/// it is the unit sphere and the viewpoint is w, the point s has s.w = 1: a circle in the plane
/// across w at distance 1 / |w|, of radius sqrt(1 - 1 / |w|^2). False when any of it is outside the
/// projection.
template <class View, class T>
bool contour_through(const View& view, const PoseSettings& settings, const Circle& circle,
                     const Vector3<T>& position, const Eigen::Vector3d& axis, Contour<T>& contour) {
  using std::sqrt;
  const double along = settings.robot.semi_axis;
  const double radius = settings.robot.semi_radius;
  Vector3<T> viewpoint;
  if (!viewpoint_near(view, position, viewpoint)) return false;
  const Vector3<T> from_viewpoint = position - viewpoint;
  const Vector3<T> n = axis.cast<T>();
  const Vector3<T> w =
      -from_viewpoint / radius - n * (n.dot(from_viewpoint) * (1 / along - 1 / radius));
  const T inverse2 = 1.0 / w.squaredNorm();
  if (!(inverse2 < 1.0)) return false;  // the viewpoint lies inside the robot
  Eigen::Index least = 0;
  Eigen::Vector3d(scalar(w.x()), scalar(w.y()), scalar(w.z())).cwiseAbs().minCoeff(&least);
  const Vector3<T> reference = Eigen::Vector3d::Unit(least).cast<T>();
  const Vector3<T> e1 = w.cross(reference).normalized();
  const Vector3<T> e2 = w.cross(e1) * sqrt(inverse2);
  const auto stretch = [&](const Vector3<T>& s) {
    return Vector3<T>(s * radius + n * (n.dot(s) * (along - radius)));
  };
  const T spread = sqrt(1.0 - inverse2);
  const Vector3<T> middle = from_viewpoint + stretch(w * inverse2);
  const Vector3<T> side1 = stretch(e1 * spread);
  const Vector3<T> side2 = stretch(e2 * spread);
  for (int i = 0; i < circle.count; ++i) {
    const Vector3<T> touched = middle + side1 * circle.cosine[i] + side2 * circle.sine[i];
    Vector2<T> m;
    if (!project_from(view, viewpoint, touched, m)) return false;
    const ImageScale& image = settings.image;
    contour[i] = {image.center_px.x() - m.x() / image.pixel,
                  image.center_px.y() + m.y() / image.pixel};
  }
  return true;
}

/// By the projection that the settings ask for.
template <class T>
bool project_contour(const PoseSettings& settings, const Circle& circle, const Vector3<T>& position,
                     const Eigen::Vector3d& axis, Contour<T>& contour) {
  return settings.exact
             ? contour_through(*settings.exact, settings, circle, position, axis, contour)
             : contour_through(settings.projection, settings, circle, position, axis, contour);
}

/// An ellipse as the image of the unit circle: center + shape * (cos, sin).
template <class T>
struct AffineCircle {
  Vector2<T> center;
  Eigen::Matrix<T, 2, 2> shape;
};

/// The contour's first harmonic in its parameter (the discrete Fourier transform at order 1): the
/// exact ellipse when the contour is an affine image of its circle.
template <class T>
AffineCircle<T> first_harmonic(const Circle& circle, const Contour<T>& contour) {
  Vector2<T> sum(T(0), T(0));
  Vector2<T> with_cosine = sum;
  Vector2<T> with_sine = sum;
  for (int i = 0; i < circle.count; ++i) {
    sum += contour[i];
    with_cosine += contour[i] * circle.cosine[i];
    with_sine += contour[i] * circle.sine[i];
  }
  AffineCircle<T> ellipse{sum * (1.0 / circle.count), {}};
  ellipse.shape.col(0) = with_cosine * (2.0 / circle.count);
  ellipse.shape.col(1) = with_sine * (2.0 / circle.count);
  return ellipse;
}

/// One Gauss-Newton step towards the least-squares ellipse, as a tracker fits it: where the ellipse
/// is the unit circle, the contour's distance from it, rho(psi), is made free of the harmonics that
/// an ellipse can follow: dx cos + dy sin + p + s cos2 + t sin2.
template <class T>
void correct(const Circle& circle, const Contour<T>& contour, AffineCircle<T>& ellipse) {
  using std::sqrt;
  const T determinant =
      ellipse.shape(0, 0) * ellipse.shape(1, 1) - ellipse.shape(0, 1) * ellipse.shape(1, 0);
  const T scale = 1.0 / determinant;
  T dx(0);
  T dy(0);
  T p(0);
  T s(0);
  T t(0);
  for (int i = 0; i < circle.count; ++i) {
    const Vector2<T> q = contour[i] - ellipse.center;
    const T x = (ellipse.shape(1, 1) * q.x() - ellipse.shape(0, 1) * q.y()) * scale;
    const T y = (ellipse.shape(0, 0) * q.y() - ellipse.shape(1, 0) * q.x()) * scale;
    const T length = sqrt(x * x + y * y);
    const T rho = length - 1.0;
    const T cosine = x / length;
    const T sine = y / length;
    dx += rho * cosine;
    dy += rho * sine;
    p += rho;
    s += rho * (cosine * cosine - sine * sine);
    t += rho * (2.0 * cosine * sine);
  }
  const double mean = 1.0 / circle.count;
  ellipse.center += ellipse.shape * Vector2<T>(dx * (2 * mean), dy * (2 * mean));
  Eigen::Matrix<T, 2, 2> growth;
  growth << 1.0 + (p + 2.0 * s) * mean, 2.0 * t * mean, 2.0 * t * mean, 1.0 + (p - 2.0 * s) * mean;
  ellipse.shape = (ellipse.shape * growth).eval();
}

/// Axes from the shape S: a^2 and b^2 are the eigenvalues of S S^T, whose half difference is the
/// length of the vector of twice the angle; b from the determinant, a b = |det S|.
template <class T>
ImageEllipse<T> axes_of(const AffineCircle<T>& ellipse) {
  using std::abs;
  using std::sqrt;
  // px^2; rounds the cone's tip off, where semi-axes have no derivative
  constexpr double kCircle = 1e-5;
  const auto& shape = ellipse.shape;
  const T uu = shape(0, 0) * shape(0, 0) + shape(0, 1) * shape(0, 1);
  const T vv = shape(1, 0) * shape(1, 0) + shape(1, 1) * shape(1, 1);
  ImageEllipse<T> axes;
  axes.center = ellipse.center;
  axes.twice_angle_cos = (uu - vv) / 2.0;
  axes.twice_angle_sin = shape(0, 0) * shape(1, 0) + shape(0, 1) * shape(1, 1);
  const T half = sqrt(axes.twice_angle_cos * axes.twice_angle_cos +
                      axes.twice_angle_sin * axes.twice_angle_sin + kCircle * kCircle);
  axes.semi_major = sqrt((uu + vv) / 2.0 + half);
  axes.semi_minor = abs(shape(0, 0) * shape(1, 1) - shape(0, 1) * shape(1, 0)) / axes.semi_major;
  return axes;
}

/// The ellipse that a tracker sees of a spheroid with unit `axis`. False when it is outside the
/// projection.
template <class T>
bool project_ellipse(const PoseSettings& settings, const Circle& circle, const Vector3<T>& position,
                     const Eigen::Vector3d& axis, ImageEllipse<T>& ellipse) {
  Contour<T> contour;
  if (!project_contour(settings, circle, position, axis, contour)) return false;
  AffineCircle<T> fit = first_harmonic(circle, contour);
  correct(circle, contour, fit);
  ellipse = axes_of(fit);
  return true;
}

}  // namespace vitreo::optics::detail
