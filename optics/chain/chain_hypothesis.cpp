// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_hypothesis.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kLongestStep = 1.5;  // sigmas, of one solution: a twin's valley is curved
constexpr double kAtRest = 1e-10;     // m and rad, of a look's own unknowns

/// Of an anchor's own unknowns, at most: its axis starts where it was believed to be. What is taken
/// out of the prior a thousandth of a radian beside is off by several times what was known of some
/// directions before the anchors (after three steps by -1.2 to +21; eight are enough).
constexpr int kAnchorSteps = 30;

}  // namespace

/// Normal equations: Lambda theta = right.
struct ChainHypothesis::Sums {
  Eigen::MatrixXd information;
  Eigen::VectorXd right;
  void add(const ReducedRows& rows, double sign = 1) {
    information.noalias() += sign * rows.by_theta.transpose() * rows.by_theta;
    right.noalias() -= sign * rows.by_theta.transpose() * rows.offset;
  }
};

ChainHypothesis::ChainHypothesis(const ChainBelief& prior, const Eigen::VectorXd& start,
                                 const ChainAnchors& anchors)
    : prior_theta_(prior.chain.theta()),
      prior_information_(prior.covariance.inverse()),
      theta_(prior_theta_),
      chain_(prior.chain),
      covariance_(prior.covariance) {
  take_out(prior, anchors);
  theta_ = start;
  chain_ = ViewingChain(prior.chain.nominal(), prior.chain.parameters(), start);
}

/// Linearized where the prior's chain is, as they were when it was estimated: what is left is what
/// was known without them.
void ChainHypothesis::take_out(const ChainBelief& prior, const ChainAnchors& anchors) {
  detail::require(anchors.looks.size() == anchors.places.size(),
                  "anchors: wants a place for each look");
  Sums left{prior_information_, prior_information_ * prior_theta_};
  for (std::size_t i = 0; i < anchors.looks.size(); ++i) {
    OwnUnknowns own = OwnUnknowns::Zero();
    own.head<3>() = anchors.places[i];
    auto rows = linearized(anchors.looks[i], own, kAnchorSteps);
    if (!rows) continue;
    left.add(*rows, -1);
    anchors_.push_back({anchors.looks[i], own, std::move(*rows)});
  }
  const Eigen::LLT<Eigen::MatrixXd> factor(left.information);
  if (anchors_.empty() || factor.info() != Eigen::Success) {
    anchors_.clear();
    return;
  }
  prior_information_ = left.information;
  prior_theta_ = factor.solve(left.right);
  chi2_before_ = cost(prior.chain.theta());
}

double ChainHypothesis::cost(const Eigen::VectorXd& theta) const {
  const Eigen::VectorXd off = theta - prior_theta_;
  double sum = off.dot(prior_information_ * off);
  for (const auto* all : {&anchors_, &frames_})
    for (const Frame& one : *all)
      sum += (one.rows.by_theta * theta + one.rows.offset).squaredNorm();
  return sum;
}

ChainHypothesis::Sums ChainHypothesis::sums() const {
  Sums all{prior_information_, prior_information_ * prior_theta_};
  for (const Frame& one : anchors_) all.add(one.rows);
  for (const Frame& one : frames_) all.add(one.rows);
  return all;
}

/// Gauss-Newton in the five unknowns alone; what the last step leaves is linear in them, and gone
/// from the reduced rows.
std::optional<ReducedRows> ChainHypothesis::linearized(const ChainLook& look, OwnUnknowns& own,
                                                       int steps) const {
  for (int step = 0;; ++step) {
    const auto block = block_of(chain_, look, own.head<3>(), own.tail<2>(), true);
    if (!block || !block->residuals.allFinite()) return std::nullopt;
    const OwnUnknowns move = block->by_own.colPivHouseholderQr().solve(block->residuals);
    if (!move.allFinite()) return std::nullopt;
    ReducedRows rows = reduced(*block, theta_);
    own -= move;
    if (step + 1 >= steps || move.cwiseAbs().maxCoeff() < kAtRest) return rows;
  }
}

std::vector<const ReducedRows*> ChainHypothesis::rows() const {
  std::vector<const ReducedRows*> all;
  all.reserve(frames_.size());
  for (const Frame& one : frames_) all.push_back(&one.rows);
  return all;
}

void ChainHypothesis::keep_first(std::size_t frames) {
  frames_.resize(std::min(frames, frames_.size()));
  next_ = 0;
  solve();
}

ChainHypothesis ChainHypothesis::from(const Eigen::VectorXd& start) const {
  ChainHypothesis other = *this;
  other.theta_ = start;
  other.chain_ = ViewingChain(chain_.nominal(), chain_.parameters(), start);
  other.next_ = 0;
  other.passes_ = 0;
  return other;
}

void ChainHypothesis::add(const ChainLook& look, const OwnUnknowns& own, ReducedRows rows) {
  frames_.push_back({look, own, std::move(rows)});
}

/// A frame that is not shown by the chain as it is now keeps its rows of before. The anchors come
/// before the frames.
void ChainHypothesis::work(int frames) {
  const std::size_t all = anchors_.size() + frames_.size();
  for (int i = 0; i < frames && !frames_.empty(); ++i) {
    Frame& frame = next_ < anchors_.size() ? anchors_[next_] : frames_[next_ - anchors_.size()];
    if (auto rows = linearized(frame.look, frame.own, 1)) frame.rows = std::move(*rows);
    if (++next_ < all) continue;
    next_ = 0;
    ++passes_;
    solve();
  }
}

/// (Lambda_0 + sum B'B) theta = Lambda_0 theta_0 - sum B'f; cost = |theta - theta_0|^2 in Lambda_0
/// and the rows' squares.
void ChainHypothesis::solve() {
  const Sums all = sums();
  const Eigen::LDLT<Eigen::MatrixXd> factor(all.information);
  Eigen::VectorXd step = factor.solve(all.right) - theta_;
  last_step_ = step.cwiseAbs().maxCoeff();
  if (last_step_ > kLongestStep) step *= kLongestStep / last_step_;
  theta_ += step;
  covariance_ = factor.solve(Eigen::MatrixXd::Identity(theta_.size(), theta_.size()));
  chi2_ = cost(theta_) - chi2_before_;
  chain_ = ViewingChain(chain_.nominal(), chain_.parameters(), theta_);
}

}  // namespace vitreo::optics
