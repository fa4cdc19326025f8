// SPDX-License-Identifier: Apache-2.0
#include "tests/optics/pose/exact_silhouette.h"

#include <Eigen/Dense>
#include <ceres/jet.h>
#include <ceres/tiny_solver.h>
#include <ceres/tiny_solver_autodiff_function.h>

#include <cmath>
#include <numbers>
#include <stdexcept>

namespace vitreo::optics {

double miss_distance(const ExactScene& scene, const Eigen::Vector3d& position,
                     const Eigen::Vector3d& axis, const Eigen::Vector2d& pixel) {
  const auto line = isopixel_line(scene.system, scene.microscope, scene.image.m_from_pixel(pixel));
  if (!line) throw std::runtime_error("an isopixel line of the silhouette is lost");
  const auto to_sphere = [&](const Eigen::Vector3d& p) -> Eigen::Vector3d {
    const double along = axis.dot(p);
    return (p - along * axis) / scene.robot.semi_radius + along / scene.robot.semi_axis * axis;
  };
  const Eigen::Vector3d o = to_sphere(line->origin - position), d = to_sphere(line->direction);
  return o.cross(d).squaredNorm() / d.squaredNorm() - 1;
}

ExactContour exact_contour(const ExactScene& scene, const Eigen::Vector3d& position,
                           const Eigen::Vector3d& axis, const EllipseVector& near) {
  const Eigen::Matrix2d shape =
      Eigen::Rotation2Dd(near[4]) * Eigen::Vector2d(near[2], near[3]).asDiagonal();
  ExactContour contour;
  for (int i = 0; i < kExactContourPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i / kExactContourPoints;
    const Eigen::Vector2d out = shape * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    double low = 0.5, high = 1.5;
    for (int halving = 0; halving < 40; ++halving) {
      const double middle = (low + high) / 2;
      (miss_distance(scene, position, axis, near.head<2>() + middle * out) < 0 ? low : high) =
          middle;
    }
    contour.col(i) = near.head<2>() + low * out;
  }
  return contour;
}

namespace {

/// Distance of the contour's points from an ellipse given by center and symmetric square root of
/// its shape matrix; px. With `orthogonal`, along the ellipse's normals (to first order); else
/// where the ellipse is a circle.
struct EllipseDistance {
  const ExactContour& contour;
  bool orthogonal;
  template <class T>
  bool operator()(const T* e, T* residuals) const {
    using std::sqrt;
    const T determinant = e[2] * e[4] - e[3] * e[3];
    const T size = sqrt(determinant);
    for (int i = 0; i < kExactContourPoints; ++i) {
      const T u = contour(0, i) - e[0], v = contour(1, i) - e[1];
      const T x = (e[4] * u - e[3] * v) / determinant, y = (e[2] * v - e[3] * u) / determinant;
      const T length = sqrt(x * x + y * y);
      const T gu = (e[4] * x - e[3] * y) / (determinant * length),
              gv = (e[2] * y - e[3] * x) / (determinant * length);
      residuals[i] = (length - 1.0) * (orthogonal ? T(1.0 / sqrt(gu * gu + gv * gv)) : size);
    }
    return true;
  }
};

}  // namespace

EllipseVector fit_ellipse(const ExactContour& contour, const EllipseVector& near, bool orthogonal) {
  const Eigen::Matrix2d turn = Eigen::Rotation2Dd(near[4]).toRotationMatrix();
  const Eigen::Matrix2d root =
      turn * Eigen::Vector2d(near[2], near[3]).asDiagonal() * turn.transpose();
  using Function = ceres::TinySolverAutoDiffFunction<EllipseDistance, kExactContourPoints, 5>;
  Eigen::Matrix<double, 5, 1> e;
  e << near.head<2>(), root(0, 0), root(0, 1), root(1, 1);
  const EllipseDistance distance{contour, orthogonal};
  const Function function(distance);
  ceres::TinySolver<Function> solver;
  solver.options.function_tolerance = 1e-14;
  solver.Solve(function, &e);
  Eigen::Matrix2d fitted;
  fitted << e[2], e[3], e[3], e[4];
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(fitted);
  EllipseVector ellipse;
  ellipse << e[0], e[1], axes.eigenvalues()[1], axes.eigenvalues()[0],
      std::atan(axes.eigenvectors()(1, 1) / axes.eigenvectors()(0, 1));
  return ellipse;
}

}  // namespace vitreo::optics
