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
    3;                    // px: a link this far off joined two places that only look alike
constexpr int kGrid = 5;  // points a side

// Mosaic from view. Euclidean: angle and shift of the view's middle, which keeps the two apart.
// Affine: the six numbers, the linear part by half the view's width, so that all are in pixels.
template <int N, typename T>
Eigen::Matrix<T, 2, 1> placed(const T* pose, const Eigen::Vector2d& p,
                              const Eigen::Vector2d& middle) {
  const Eigen::Vector2d d = p - middle;
  if constexpr (N == 3) {
    using std::cos, std::sin;
    const T c = cos(pose[0]), s = sin(pose[0]);
    return {c * d.x() - s * d.y() + pose[1], s * d.x() + c * d.y() + pose[2]};
  } else {
    const Eigen::Vector2d e = d / middle.x();
    return {pose[0] * e.x() + pose[1] * e.y() + pose[4],
            pose[2] * e.x() + pose[3] * e.y() + pose[5]};
  }
}

template <int N>
struct LinkResidual {
  Eigen::Vector2d in_first, in_second, middle;
  template <typename T>
  bool operator()(const T* first, const T* second, T* residual) const {
    const Eigen::Matrix<T, 2, 1> miss =
        placed<N>(first, in_first, middle) - placed<N>(second, in_second, middle);
    residual[0] = miss[0];
    residual[1] = miss[1];
    return true;
  }
};

template <int N>
std::array<double, N> pose_of(const Eigen::Affine2d& mosaic_from_view,
                              const Eigen::Vector2d& middle) {
  const Eigen::Matrix2d& a = mosaic_from_view.linear();
  const Eigen::Vector2d shift = mosaic_from_view * middle;
  if constexpr (N == 3)
    return {std::atan2(a(1, 0) - a(0, 1), a(0, 0) + a(1, 1)), shift.x(), shift.y()};
  if constexpr (N == 6) {
    const double s = middle.x();
    return {s * a(0, 0), s * a(0, 1), s * a(1, 0), s * a(1, 1), shift.x(), shift.y()};
  }
}

template <int N>
Eigen::Affine2d affine_of(const std::array<double, N>& pose, const Eigen::Vector2d& middle) {
  Eigen::Affine2d result = Eigen::Affine2d::Identity();
  const Eigen::Vector2d zero = placed<N>(pose.data(), {0, 0}, middle);
  const Eigen::Vector2d u = placed<N>(pose.data(), {1, 0}, middle),
                        v = placed<N>(pose.data(), {0, 1}, middle);
  result.linear() << u - zero, v - zero;
  result.translation() = zero;
  return result;
}

template <int N>
void solve(MosaicPlan& plan, const cv::Size& size, int fixed) {
  const Eigen::Vector2d middle((size.width - 1) / 2.0, (size.height - 1) / 2.0);
  std::vector<std::array<double, N>> poses;
  for (const auto& place : plan.mosaic_from_view)
    poses.push_back(pose_of<N>(place.value_or(Eigen::Affine2d::Identity()), middle));
  ceres::Problem problem;
  for (const MosaicLink& link : plan.links) {
    if (!link.used) continue;
    const auto first = static_cast<std::size_t>(link.first),
               second = static_cast<std::size_t>(link.second);
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
  options.num_threads = 1;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    if (plan.mosaic_from_view[k]) plan.mosaic_from_view[k] = affine_of<N>(poses[k], middle);
  }
}

double rms_of(const MosaicLink& link, const MosaicPlan& plan, const cv::Size& size) {
  const Eigen::Affine2d& first = *plan.mosaic_from_view[static_cast<std::size_t>(link.first)];
  const Eigen::Affine2d& second = *plan.mosaic_from_view[static_cast<std::size_t>(link.second)];
  const std::vector<Eigen::Vector2d> points =
      common_points(link.registration.first_from_second, size);
  double sum = 0;
  for (const Eigen::Vector2d& p : points)
    sum += (first * (link.registration.first_from_second * p) - second * p).squaredNorm();
  return points.empty() ? 0 : std::sqrt(sum / static_cast<double>(points.size()));
}

void report(MosaicPlan& plan, const cv::Size& size) {
  double squares = 0, variances = 0, worst = 0;
  int used = 0;
  for (MosaicLink& link : plan.links) {
    link.rms_px = rms_of(link, plan, size);
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

// The worst contradiction goes, one at a time: it may be what pulled the others off. A link that
// alone holds a view contradicts nothing and stays.
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

std::vector<Eigen::Vector2d> common_points(const Eigen::Affine2d& first_from_second,
                                           const cv::Size& view_size) {
  std::vector<Eigen::Vector2d> points;
  for (int j = 0; j < kGrid; ++j) {
    for (int i = 0; i < kGrid; ++i) {
      const Eigen::Vector2d p(i * (view_size.width - 1.0) / (kGrid - 1),
                              j * (view_size.height - 1.0) / (kGrid - 1));
      const Eigen::Vector2d q = first_from_second * p;
      if (q.x() >= 0 && q.y() >= 0 && q.x() <= view_size.width - 1 && q.y() <= view_size.height - 1)
        points.push_back(p);
    }
  }
  return points;
}

void adjust_mosaic(MosaicPlan& plan, const cv::Size& view_size, int fixed, ViewModel model) {
  do {
    if (model == ViewModel::euclidean)
      solve<3>(plan, view_size, fixed);
    else
      solve<6>(plan, view_size, fixed);
    report(plan, view_size);
  } while (drop_worst(plan));
}

}  // namespace vitreo::vision
