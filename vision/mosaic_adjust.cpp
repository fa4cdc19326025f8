// SPDX-License-Identifier: Apache-2.0
#include "vision/mosaic_adjust.h"

#include <ceres/autodiff_cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::vision {
namespace {

constexpr double kHuber = 0.5;  // px: more than registration noise
constexpr double kContradiction =
    3;                             // px: a link this far off joined two similar parts of the retina
constexpr int kPointsPerSide = 5;  // of the grid of common points

// A view's point in the mosaic, by the view's pose. Euclidean (N = 3): angle, and position of the
// view's center, about which a turn and a shift are uncorrelated. Similarity (N = 4): scale times
// cosine and sine, times half the view's width, and the same position. Affine (N = 6): linear part
// times half the view's width, and position of the center, so that all six are in pixels.
// Templated for Ceres' Jets; p and middle are constants.
template <int N, typename T>
Eigen::Matrix<T, 2, 1> transformed(const T* pose, const Eigen::Vector2d& p,
                                   const Eigen::Vector2d& middle) {
  const Eigen::Vector2d d = p - middle;
  if constexpr (N == 3) {
    using std::cos, std::sin;
    const T c = cos(pose[0]);
    const T s = sin(pose[0]);
    return {c * d.x() - s * d.y() + pose[1], s * d.x() + c * d.y() + pose[2]};
  } else if constexpr (N == 4) {
    const Eigen::Vector2d e = d / middle.x();
    return {pose[0] * e.x() - pose[1] * e.y() + pose[2],
            pose[1] * e.x() + pose[0] * e.y() + pose[3]};
  } else {
    const Eigen::Vector2d e = d / middle.x();
    return {pose[0] * e.x() + pose[1] * e.y() + pose[4],
            pose[2] * e.x() + pose[3] * e.y() + pose[5]};
  }
}

// Distance in the mosaic between the two images of one point of the retina.
template <int N>
struct LinkResidual {
  Eigen::Vector2d in_first;
  Eigen::Vector2d in_second;
  Eigen::Vector2d middle;
  template <typename T>
  bool operator()(const T* first, const T* second, T* residual) const {
    const Eigen::Matrix<T, 2, 1> miss =
        transformed<N>(first, in_first, middle) - transformed<N>(second, in_second, middle);
    residual[0] = miss[0];
    residual[1] = miss[1];
    return true;
  }
};

// Parameters of transformed(). The nearest rotation to A has the angle atan2(a21 - a12, a11 + a22).
// Of a Euclidean pose only the rotation and the shift are kept: composing a chain may have left
// some scale by rounding.
template <int N>
std::array<double, N> pose_of(const Eigen::Affine2d& mosaic_from_view,
                              const Eigen::Vector2d& middle) {
  const Eigen::Matrix2d& a = mosaic_from_view.linear();
  const Eigen::Vector2d shift = mosaic_from_view * middle;
  if constexpr (N == 3)
    return {std::atan2(a(1, 0) - a(0, 1), a(0, 0) + a(1, 1)), shift.x(), shift.y()};
  if constexpr (N == 4) {
    const double s = middle.x() / 2;
    return {s * (a(0, 0) + a(1, 1)), s * (a(1, 0) - a(0, 1)), shift.x(), shift.y()};
  }
  if constexpr (N == 6) {
    const double s = middle.x();
    return {s * a(0, 0), s * a(0, 1), s * a(1, 0), s * a(1, 1), shift.x(), shift.y()};
  }
}

// The affine map of transformed(), from the images of the origin and of the unit vectors.
template <int N>
Eigen::Affine2d affine_of(const std::array<double, N>& pose, const Eigen::Vector2d& middle) {
  Eigen::Affine2d result = Eigen::Affine2d::Identity();
  const Eigen::Vector2d zero = transformed<N>(pose.data(), {0, 0}, middle);
  const Eigen::Vector2d u = transformed<N>(pose.data(), {1, 0}, middle);
  const Eigen::Vector2d v = transformed<N>(pose.data(), {0, 1}, middle);
  result.linear() << u - zero, v - zero;
  result.translation() = zero;
  return result;
}

// min over the poses of sum_links sum_points huber(|T_first p_first - T_second p_second|^2), by
// Levenberg-Marquardt; the view `fixed` removes the freedom of the whole mosaic (gauge).
// Returns without a change when no used link touches the fixed view. Poses without a used link stay
// as they are.
template <int N>
void adjust(MosaicPlan& plan, const cv::Size& size, int fixed) {
  const Eigen::Vector2d middle((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  std::vector<std::array<double, N>> poses;
  for (const auto& pose : plan.mosaic_from_view)
    poses.push_back(pose_of<N>(pose.value_or(Eigen::Affine2d::Identity()), middle));
  ceres::Problem problem;
  for (const MosaicLink& link : plan.links) {
    if (!link.used) continue;
    const auto first = static_cast<std::size_t>(link.first);
    const auto second = static_cast<std::size_t>(link.second);
    for (const Eigen::Vector2d& p : common_points(link.registration.first_from_second, size)) {
      auto* const residual =
          new LinkResidual<N>{link.registration.first_from_second * p, p, middle};
      problem.AddResidualBlock(new ceres::AutoDiffCostFunction<LinkResidual<N>, 2, N, N>(residual),
                               new ceres::HuberLoss(kHuber), poses[first].data(),
                               poses[second].data());
    }
  }
  double* const still = poses[static_cast<std::size_t>(fixed)].data();
  if (!problem.HasParameterBlock(still)) return;
  problem.SetParameterBlockConstant(still);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 100;
  options.logging_type = ceres::SILENT;
  options.num_threads = 1;  // repeatable sums
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    if (plan.mosaic_from_view[k]) plan.mosaic_from_view[k] = affine_of<N>(poses[k], middle);
  }
}

// Root mean square over the link's points of the distance between its registration and the poses.
// 0 for views without common points.
double link_rms(const MosaicLink& link, const MosaicPlan& plan, const cv::Size& size) {
  const Eigen::Affine2d& first = *plan.mosaic_from_view[static_cast<std::size_t>(link.first)];
  const Eigen::Affine2d& second = *plan.mosaic_from_view[static_cast<std::size_t>(link.second)];
  const std::vector<Eigen::Vector2d> points =
      common_points(link.registration.first_from_second, size);
  double sum = 0;
  for (const Eigen::Vector2d& p : points)
    sum += (first * (link.registration.first_from_second * p) - second * p).squaredNorm();
  return points.empty() ? 0 : std::sqrt(sum / static_cast<double>(points.size()));
}

// The links' residuals and the plan's; a spanning tree of the joined views needs joined - 1 links.
// rms_px beside sigma_px tells whether the views lie on one plane: noise alone leaves about the
// latter.
void set_residuals(MosaicPlan& plan, const cv::Size& size) {
  double squares = 0;
  double variances = 0;
  double worst = 0;
  int used = 0;
  for (MosaicLink& link : plan.links) {
    link.rms_px = link_rms(link, plan, size);
    if (!link.used) continue;
    squares += link.rms_px * link.rms_px;
    variances += link.registration.sigma_px * link.registration.sigma_px;
    worst = std::max(worst, link.rms_px);
    ++used;
  }
  plan.rms_px = used > 0 ? std::sqrt(squares / used) : 0;
  plan.sigma_px = used > 0 ? std::sqrt(variances / used) : 0;
  plan.worst_px = worst;
  plan.spare_links = std::max(used - (plan.joined() - 1), 0);
}

// Drops the worst link, one at a time, as it may be the cause of the others' residuals. A link that
// alone holds a view has no residual and stays.
// False when no link is off by more than kContradiction, which ends the rounds.
bool drop_worst(MosaicPlan& plan) {
  MosaicLink* worst = nullptr;
  for (MosaicLink& link : plan.links) {
    if (link.used && (worst == nullptr || link.rms_px > worst->rms_px)) worst = &link;
  }
  if (worst == nullptr || worst->rms_px < kContradiction) return false;
  worst->used = false;
  return true;
}

}  // namespace

// The border is on the grid, since errors of a pose are largest there.
std::vector<Eigen::Vector2d> common_points(const Eigen::Affine2d& first_from_second,
                                           const cv::Size& view_size) {
  std::vector<Eigen::Vector2d> points;
  for (int j = 0; j < kPointsPerSide; ++j) {
    for (int i = 0; i < kPointsPerSide; ++i) {
      const Eigen::Vector2d p(i * (view_size.width - 1.0) / (kPointsPerSide - 1),
                              j * (view_size.height - 1.0) / (kPointsPerSide - 1));
      const Eigen::Vector2d q = first_from_second * p;
      if (q.x() >= 0 && q.y() >= 0 && q.x() <= view_size.width - 1 && q.y() <= view_size.height - 1)
        points.push_back(p);
    }
  }
  return points;
}

// Adjust, drop the worst contradicting link, adjust again: greedy outlier rejection beyond Huber's
// loss.
// Each round drops a link, so it ends.
void adjust_mosaic(MosaicPlan& plan, const cv::Size& view_size, int fixed, ViewModel model) {
  do {
    if (model == ViewModel::euclidean)
      adjust<3>(plan, view_size, fixed);
    else if (model == ViewModel::similarity)
      adjust<4>(plan, view_size, fixed);
    else
      adjust<6>(plan, view_size, fixed);
    set_residuals(plan, view_size);
  } while (drop_worst(plan));
}

}  // namespace vitreo::vision
