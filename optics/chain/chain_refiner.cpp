// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_refiner.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <utility>

namespace vitreo::optics {
namespace {

constexpr double kSettled = 0.02;  // sigmas: a step below it is the end of a search
constexpr int kFewestPasses = 3;   // of a search
constexpr int kMostPasses = 12;    // then it stays undecided and is given up

const ChainRefinerSettings& checked(const ChainRefinerSettings& settings) {
  settings.check();
  return settings;
}

/// Prior means turned along x and y both ways, as the estimator's starts.
std::vector<Eigen::VectorXd> turned_starts(const ChainBelief& prior, double rotation) {
  std::vector<Eigen::VectorXd> starts;
  for (const OwnParameter which : {OwnParameter::eye_rotation_x, OwnParameter::eye_rotation_y}) {
    const Eigen::Index at = prior.chain.own(which).at;
    if (at < 0) continue;
    for (const double sign : {1.0, -1.0}) {
      starts.push_back(prior.chain.theta());
      starts.back()[at] += sign * rotation * std::sqrt(prior.covariance(at, at));
    }
  }
  return starts;
}

/// Mahalanobis distance below 1.
bool same_minimum(const ChainHypothesis& a, const ChainHypothesis& b) {
  const Eigen::VectorXd apart = a.theta() - b.theta();
  return apart.dot(a.covariance().ldlt().solve(apart)) < 1;
}

}  // namespace

void ChainRefinerSettings::check() const {
  detail::require_positive(least_apart, "least_apart");
  detail::require_not_negative(same_for, "same_for");
  detail::require(block >= 1 && most_frames >= block, "block: wants 1 to most_frames");
  detail::require(false_alarm > 0 && false_alarm < 1, "false_alarm: wants 0 to 1");
}

ChainRefiner::ChainRefiner(ChainBelief prior, const ChainRefinerSettings& settings,
                           const ChainAnchors& anchors)
    : prior_(std::move(prior)),
      settings_(checked(settings)),
      best_(prior_, prior_.chain.theta(), anchors),
      test_(prior_, settings_.block, settings_.most_frames),
      belief_(prior_) {}

bool ChainRefiner::is_new(const Eigen::Vector3d& near, double time) const {
  return std::none_of(lately_.begin(), lately_.end(), [&](const auto& one) {
    return time - one.second < settings_.same_for &&
           (near - one.first).norm() < settings_.least_apart;
  });
}

/// A frame alone is judged by its two degrees of freedom, that a place of the robot leaves.
RefinerOutcome ChainRefiner::add(const OutlineSeen& seen, const Eigen::Vector3d& axis,
                                 const Eigen::Vector3d& near, double time) {
  if (changed_) return RefinerOutcome::changed;
  if (static_cast<int>(best_.frames()) >= settings_.most_frames) return RefinerOutcome::full;
  std::erase_if(lately_, [&](const auto& one) { return time - one.second >= settings_.same_for; });
  if (!is_new(near, time)) return RefinerOutcome::no_new;
  ChainLook look;
  look.seen = seen;
  look.axis = axis;
  OwnUnknowns own = OwnUnknowns::Zero();
  own.head<3>() = near;
  auto rows = best_.linearized(look, own);
  lately_.emplace_back(near, time);
  if (!rows || misfits(*rows)) {
    misfits_.push_back(best_.frames());
    return look_for_change() == RefinerOutcome::changed ? RefinerOutcome::changed
                                                        : RefinerOutcome::misfit;
  }
  // Other explanations see it when they come to it; until then as the best one does.
  for (ChainHypothesis& other : candidates_) other.add(look, own, *rows);
  for (ChainHypothesis& other : twins_) other.add(look, own, *rows);
  best_.add(look, own, std::move(*rows));
  return best_.frames() % static_cast<std::size_t>(settings_.block) == 0 ? close_block()
                                                                         : RefinerOutcome::taken;
}

bool ChainRefiner::misfits(const ReducedRows& rows) const {
  const Eigen::VectorXd innovation = rows.by_theta * best_.theta() + rows.offset;
  const Eigen::MatrixXd expected = Eigen::MatrixXd::Identity(innovation.size(), innovation.size()) +
                                   rows.by_theta * belief_.covariance * rows.by_theta.transpose();
  return innovation.dot(expected.ldlt().solve(innovation)) > kMisfitChi2;
}

RefinerOutcome ChainRefiner::close_block() {
  best_.solve();
  refresh();
  const RefinerOutcome outcome = look_for_change();
  if (outcome == RefinerOutcome::taken && best_.frames() >= spawn_at_) spawn();
  return outcome;
}

/// An explanation under which nothing changed is enough: a twin is no change.
RefinerOutcome ChainRefiner::look_for_change() {
  const double alarm = -std::log(settings_.false_alarm);
  change_ = test_.most_probable(best_.rows(), misfits_);
  for (const ChainHypothesis& one : twins_) {
    if (change_.log_evidence < alarm) break;
    BenchChange other = test_.most_probable(one.rows(), misfits_);
    if (other.log_evidence < change_.log_evidence) change_ = std::move(other);
  }
  if (change_.log_evidence < alarm) return RefinerOutcome::taken;
  stop();
  return RefinerOutcome::changed;
}

/// The frames before the change are linearized about what they say themselves.
void ChainRefiner::stop() {
  changed_ = change_;
  candidates_.clear();
  twins_.clear();
  best_.keep_first(change_.after);
  belief_ = {ViewingChain(prior_.chain.nominal(), prior_.chain.parameters(), change_.theta),
             change_.covariance};
}

/// From the turned eyes, with all frames of now; each start is linearized by `work`.
void ChainRefiner::spawn() {
  spawn_at_ = 2 * best_.frames();
  candidates_.clear();
  for (const Eigen::VectorXd& start : turned_starts(prior_, settings_.start_rotation))
    candidates_.push_back(best_.from(start));
}

void ChainRefiner::work(int frames) {
  if (changed_) return;
  const auto all = static_cast<int>(1 + candidates_.size() + twins_.size());
  const int each = std::max(1, frames / all);
  best_.work(each);
  for (ChainHypothesis& one : candidates_) one.work(each);
  for (ChainHypothesis& one : twins_) one.work(each);
  decide();
  refresh();
}

/// A search that has come to rest is a twin, until refresh() finds it to be none; one that does not
/// come to rest is in no minimum.
void ChainRefiner::decide() {
  std::erase_if(candidates_, [&](ChainHypothesis& one) {
    const bool rests = one.passes() >= kFewestPasses && one.last_step() < kSettled;
    const bool known = std::any_of(twins_.begin(), twins_.end(), [&](const ChainHypothesis& other) {
      return same_minimum(other, one);
    });
    if (rests && !known) twins_.push_back(one);
    return rests || one.passes() >= kMostPasses;
  });
}

/// The best first; what has become the same minimum, or explains too little, is dropped.
void ChainRefiner::refresh() {
  for (ChainHypothesis& one : twins_)
    if (one.chi2() < best_.chi2()) std::swap(one, best_);
  std::erase_if(twins_, [&](const ChainHypothesis& one) {
    return same_minimum(best_, one) || one.chi2() > best_.chi2() + settings_.equal_chi2;
  });
  Eigen::MatrixXd sum = best_.covariance();
  double weights = 1;
  for (const ChainHypothesis& one : twins_) {
    const double weight = std::exp(-(one.chi2() - best_.chi2()) / 2);
    const Eigen::VectorXd apart = one.theta() - best_.theta();
    sum += weight * (one.covariance() + apart * apart.transpose());
    weights += weight;
  }
  belief_ = {best_.chain(), sum / weights};
}

}  // namespace vitreo::optics
