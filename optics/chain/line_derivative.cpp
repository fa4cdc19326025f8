// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/line_derivative.h"

#include <Eigen/Dense>
#include <ceres/jet.h>

namespace vitreo::optics::detail {
namespace {

/// Outer line: 0 to 3. The surface's vertex: 4 to 6, tilts: 7, 8, curvature: 9, ratio: 10.
using Vectors = Eigen::Matrix<double, 3, 11>;
using Scalars = Eigen::Matrix<double, 1, 11>;

/// Of a surface at one of its points, in its own frame.
struct Bend {
  Eigen::Matrix3d normal_by_point;
  Eigen::Vector3d normal_by_curvature;  // m, at a point that stays
  double rise = 0;                      // m^2: along the normal, by the curvature
};

/// Of n = m / |m|, m the gradient of what vanishes on the surface: dn = (1 - n n') dm / |m|.
Bend bend_of(const Eigen::Vector3d& gradient, const Eigen::Matrix3d& by_point,
             const Eigen::Vector3d& by_curvature, double vanishing_by_curvature) {
  const double length = gradient.norm();
  const Eigen::Vector3d n = gradient / length;
  const Eigen::Matrix3d across = (Eigen::Matrix3d::Identity() - n * n.transpose()) / length;
  return {across * by_point, across * by_curvature, -vanishing_by_curvature / length};
}

/// Of the conic -F / 2 = z - c (x^2 + y^2 + (1 + k) z^2) / 2.
Bend conic_bend(const ChainSurface<double>& surface, const Eigen::Vector3d& p) {
  const Eigen::Vector3d diagonal(1, 1, 1 + surface.conic);
  const Eigen::Vector3d stretched = diagonal.cwiseProduct(p);
  return bend_of(Eigen::Vector3d::UnitZ() - surface.curvature * stretched,
                 -surface.curvature * Eigen::Matrix3d(diagonal.asDiagonal()), -stretched,
                 -p.dot(stretched) / 2);
}

/// Of z - sag(r), by Jets of the point and the curvature.
Bend asphere_bend(const ChainSurface<double>& surface, const Eigen::Vector3d& p) {
  using Jet = ceres::Jet<double, 4>;
  const auto& [a4, a6, a8, a10] = surface.aspheric;
  const ChainSurface<Jet> jets{
      Jet(surface.curvature, 3), Jet(surface.conic), {Jet(a4), Jet(a6), Jet(a8), Jet(a10)}, true};
  Vector3<Jet> normal;
  const Jet gap =
      height_over(jets, Vector3<Jet>(Jet(p.x(), 0), Jet(p.y(), 1), Jet(p.z(), 2)), normal);
  Eigen::Matrix<double, 3, 4> by;
  for (int i = 0; i < 3; ++i) by.row(i) = normal[i].v;
  return bend_of({normal[0].a, normal[1].a, normal[2].a}, by.leftCols<3>(), by.col(3), gap.v[3]);
}

}  // namespace

/// With P the line's point at the height of the hit H, d its direction, W = v + w x (H - vertex)
/// what the surface itself moves there, n its normal, and "rise" what more curvature adds to it:
///   dH = dP + d dt,  dt = (n.W + rise dc - n.dP) / n.d
///   dn = w x n + N (dH - W) + n_c dc,  N the change of the normal from point to point
///   d' = mu d + (K - mu C) n,  C = d.n,  K^2 = 1 - mu^2 (1 - C^2).
bool refract_inwards(const ChainStep<double>& at, LineOf<double>& line, StepDerivative& by) {
  ChainRefraction<double> met;
  if (!refract_inwards(at, line, met)) return false;
  const Eigen::Vector3d arm = at.turn * met.hit;
  const Eigen::Vector3d n = at.turn * met.normal;
  const Eigen::Vector3d d = at.turn * met.direction;
  const double z = at.vertex.z() + arm.z();

  Vectors P = Vectors::Zero();  // of the outer line's point
  P(0, 0) = P(1, 1) = 1;
  P(0, 2) = P(1, 3) = z;
  Vectors out = Vectors::Zero();  // of d = -(slope, 1) / length, then of the inner direction
  const double cosine = -d.z();   // 1 / length
  for (int i = 0; i < 2; ++i) out.col(2 + i) = cosine * (d * d[i] - Eigen::Vector3d::Unit(i));
  Vectors W = Vectors::Zero();
  W.middleCols<3>(4).setIdentity();
  const Eigen::Vector3d about_x = at.turn.col(0);  // turned about y after x
  W.col(7) = about_x.cross(arm);
  W.col(8) = Eigen::Vector3d::UnitY().cross(arm);

  const Bend bend =
      at.surface.asphere ? asphere_bend(at.surface, met.hit) : conic_bend(at.surface, met.hit);
  Scalars along = n.transpose() * (W - P);
  along[9] += bend.rise;
  const Vectors H = P + d * (along / met.cos_in);
  Vectors normal = (at.turn * bend.normal_by_point * at.turn.transpose()) * (H - W);
  normal.col(7) += about_x.cross(n);
  normal.col(8) += Eigen::Vector3d::UnitY().cross(n);
  normal.col(9) += at.turn * bend.normal_by_curvature;

  const double mu = at.ratio;
  const double C = met.cos_in;
  const double K = met.cos_out;
  const Scalars of_C = n.transpose() * out + d.transpose() * normal;
  Scalars of_both = (mu * mu * C / K - mu) * of_C;  // of K - mu C
  of_both[10] -= mu * (1 - C * C) / K + C;
  out = (mu * out + n * of_both + (K - mu * C) * normal).eval();
  out.col(10) += d;
  const double along_z = mu * d.z() + (K - mu * C) * n.z();
  const Eigen::Vector2d slope = line.tail<2>();
  by.bottomRows<2>() = (out.topRows<2>() - slope * out.row(2)) / along_z;
  by.topRows<2>() = H.topRows<2>() - z * by.bottomRows<2>() - slope * H.row(2);
  return true;
}

}  // namespace vitreo::optics::detail
