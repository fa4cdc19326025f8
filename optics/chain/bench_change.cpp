// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/bench_change.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

namespace vitreo::optics {
namespace {

constexpr double kSmall = 0.3;           // of a part's sigma: a push rather than a new setup
constexpr double kMisfitsBefore = 0.02;  // of right frames; 0.6 to 1.5 % were measured
constexpr double kMisfitsAfter = 0.3;

bool starts_with(const std::string& name, const char* start) { return name.rfind(start, 0) == 0; }

/// The part of a bench that a parameter belongs to, as a hand may move it alone; "" for the eye.
std::string part_of(const std::string& name) {
  if (starts_with(name, "lens_")) return "condensing_lens";
  if (starts_with(name, "eye_rotation")) return "eye_rotation";
  if (starts_with(name, "robot_")) return "robot";
  for (const char* of_microscope :
       {"pupil_power", "microscope_", "object_plane", "pixel", "center"})
    if (starts_with(name, of_microscope)) return "microscope";
  return "";
}

double log_determinant(const Eigen::PartialPivLU<Eigen::MatrixXd>& factor) {
  return factor.matrixLU().diagonal().array().abs().log().sum();
}

/// log(sum of exp), whatever their size.
double log_sum(const std::vector<double>& logs) {
  const double most = *std::max_element(logs.begin(), logs.end());
  double sum = 0;
  for (const double one : logs) sum += std::exp(one - most);
  return most + std::log(sum);
}

/// Of a change after `after` frames, by how many frames no place explains: Bernoulli's.
double of_misfits(std::size_t after, std::size_t frames, const std::vector<std::size_t>& misfits) {
  const auto many = static_cast<double>(
      std::count_if(misfits.begin(), misfits.end(), [&](std::size_t at) { return at >= after; }));
  return many * std::log(kMisfitsAfter / kMisfitsBefore) +
         static_cast<double>(frames - after) * std::log((1 - kMisfitsAfter) / (1 - kMisfitsBefore));
}

}  // namespace

/// Householder: Q' J1 = [R; 0], so that the rows below R hold no unknown of the look's own.
ReducedRows reduced(const ChainBlock& block, const Eigen::VectorXd& theta) {
  const Eigen::Index own = block.by_own.cols();
  const Eigen::Index left = block.residuals.size() - own;
  const Eigen::HouseholderQR<Eigen::MatrixXd> factor(block.by_own);
  Eigen::MatrixXd all(block.residuals.size(), block.by_theta.cols() + 1);
  all << block.by_theta, block.residuals;
  all.applyOnTheLeft(factor.householderQ().adjoint());
  ReducedRows rows{all.bottomLeftCorner(left, block.by_theta.cols()),
                   all.col(all.cols() - 1).tail(left)};
  rows.offset -= rows.by_theta * theta;
  return rows;
}

void BenchChangeTest::Sums::add(const ReducedRows& rows) {
  information.noalias() += rows.by_theta.transpose() * rows.by_theta;
  vector.noalias() -= rows.by_theta.transpose() * rows.offset;
}

/// Frames after a change: what they say, and how likely they are had there been another bench.
struct BenchChangeTest::Window {
  ChangeInformation change;
  double of_another = 0;
};

BenchChangeTest::BenchChangeTest(const ChainBelief& prior, int block, int most_frames)
    : prior_{prior.covariance.inverse(), {}}, block_(block) {
  prior_.vector = prior_.information * prior.chain.theta();
  const auto& parameters = prior.chain.parameters();
  std::vector<Eigen::Index> all;
  for (Eigen::Index i = 0; i < prior.chain.size(); ++i) all.push_back(i);
  for (const char* name : {"condensing_lens", "eye_rotation", "microscope", "robot"}) {
    std::vector<Eigen::Index> own;
    for (const Eigen::Index i : all)
      if (part_of(parameters[static_cast<std::size_t>(i)].name) == name) own.push_back(i);
    if (own.empty()) continue;
    parts_.push_back({name, own, 1});
    parts_.push_back({name, own, kSmall});
  }
  parts_.push_back({"bench", all, kSmall});
  // Two more in which all is another, by the frames' rows and by those that nothing explains.
  const auto changes = static_cast<double>(parts_.size() + 2);
  log_weight_ = -std::log(changes * std::max(1, most_frames / block));
}

BenchChangeTest::Sums BenchChangeTest::none() const {
  const Eigen::Index size = prior_.vector.size();
  return {Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)};
}

/// With g = vector - L theta the slope of the later frames' log likelihood where the earlier ones
/// have theta, N(0, L + L C L) without a change: score = (1 + L C)^-1 g, information =
/// (1 + L C)^-1 L. A Gaussian theta ~ N(m, C) makes the frames as likely as
///   exp(vector' m - m' L m / 2 + g' C (1 + L C)^-1 g / 2) / sqrt(det(1 + L C)).
BenchChangeTest::Window BenchChangeTest::window(const Sums& all, const Sums& after) const {
  const Eigen::Index size = prior_.vector.size();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(size, size);
  const Eigen::LLT<Eigen::MatrixXd> before(prior_.information + all.information -
                                           after.information);
  const Eigen::VectorXd theta = before.solve(prior_.vector + all.vector - after.vector);
  const Eigen::MatrixXd covariance = before.solve(one);
  const Eigen::PartialPivLU<Eigen::MatrixXd> factor(one + after.information * covariance);
  const Eigen::VectorXd slope = after.vector - after.information * theta;
  Window made;
  made.change.score = factor.solve(slope);
  made.change.information = factor.solve(after.information);
  const double same = theta.dot(after.vector) - theta.dot(after.information * theta) / 2 +
                      slope.dot(covariance * made.change.score) / 2 - log_determinant(factor) / 2;
  const Eigen::PartialPivLU<Eigen::MatrixXd> another(one + after.information);
  made.of_another =
      after.vector.dot(another.solve(after.vector)) / 2 - log_determinant(another) / 2 - same;
  return made;
}

/// -log det(1 + D M) / 2 + h' (D^-1 + M)^-1 h / 2, of the part's parameters, D = sigma^2.
double BenchChangeTest::of_part(const Part& part, const Window& window) const {
  const double variance = part.sigma * part.sigma;
  const Eigen::VectorXd score = window.change.score(part.parameters);
  const auto size = static_cast<Eigen::Index>(part.parameters.size());
  const Eigen::PartialPivLU<Eigen::MatrixXd> factor(
      Eigen::MatrixXd::Identity(size, size) +
      variance * window.change.information(part.parameters, part.parameters));
  return variance * score.dot(factor.solve(score)) / 2 - log_determinant(factor) / 2;
}

BenchChange BenchChangeTest::most_probable(const std::vector<const ReducedRows*>& frames,
                                           const std::vector<std::size_t>& misfits) const {
  Sums all = none();
  for (const ReducedRows* one : frames) all.add(*one);
  Sums after = none();
  std::vector<double> logs;
  double most = -INFINITY;
  std::size_t part = 0;
  std::size_t at = frames.size();
  const auto consider = [&](double log_ratio, std::size_t which, std::size_t first) {
    logs.push_back(log_ratio + log_weight_);
    if (log_ratio <= most) return;
    most = log_ratio, part = which, at = first;
  };
  const auto block = static_cast<std::size_t>(block_);
  for (std::size_t first = frames.size() / block * block, last = frames.size();; first -= block) {
    for (std::size_t i = first; i < last; ++i) after.add(*frames[i]);
    last = first;
    consider(of_misfits(first, frames.size(), misfits), parts_.size() + 1, first);
    if (first < frames.size()) {
      const Window here = window(all, after);
      for (std::size_t i = 0; i < parts_.size(); ++i) consider(of_part(parts_[i], here), i, first);
      consider(here.of_another, parts_.size(), first);
    }
    if (first == 0) break;
  }
  BenchChange made = believed_after(part, at, frames);
  made.log_evidence = log_sum(logs);
  return made;
}

/// Before the change as the frames until then say; what moved is as uncertain as the move, and of
/// another bench only what was known beforehand.
BenchChange BenchChangeTest::believed_after(std::size_t part, std::size_t after,
                                            const std::vector<const ReducedRows*>& frames) const {
  BenchChange made;
  made.after = after;
  const Eigen::Index size = prior_.vector.size();
  if (part >= parts_.size()) {
    made.part = "bench";
    made.theta = Eigen::VectorXd::Zero(size);
    made.covariance = Eigen::MatrixXd::Identity(size, size);
    return made;
  }
  Sums before = prior_;
  for (std::size_t i = 0; i < after; ++i) before.add(*frames[i]);
  const Eigen::LLT<Eigen::MatrixXd> factor(before.information);
  made.part = parts_[part].name;
  made.theta = factor.solve(before.vector);
  made.covariance = factor.solve(Eigen::MatrixXd::Identity(size, size));
  for (const Eigen::Index i : parts_[part].parameters)
    made.covariance(i, i) += parts_[part].sigma * parts_[part].sigma;
  return made;
}

ChangeInformation BenchChangeTest::information(const std::vector<const ReducedRows*>& frames,
                                               std::size_t after) const {
  Sums all = none();
  Sums later = none();
  for (std::size_t i = 0; i < frames.size(); ++i) {
    all.add(*frames[i]);
    if (i >= after) later.add(*frames[i]);
  }
  return window(all, later).change;
}

}  // namespace vitreo::optics
