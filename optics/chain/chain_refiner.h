// Self-calibration: the viewing chain refined by frames of a run, in the recursive information form
// of its estimator, with guards against drift, frames that are no new ones, and twin solutions.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/bench_change.h"
#include "optics/chain/chain_hypothesis.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace vitreo::optics {

struct ChainRefinerSettings {
  /// A frame nearer than this to one that was taken less than `same_for` ago shares the errors of
  /// its outline: it is no new one.
  double least_apart = 1e-3;  // m
  double same_for = 3;        // s
  int most_frames = 1000;     // what they share is not averaged by more
  /// After so many frames the bench is tested for a change (BenchChangeTest).
  int block = 10;
  double false_alarm = 0.005;  // of a run on a bench that stays, at most
  /// Turns of the eye, in its own sigmas, from which twins are looked for when the frames have
  /// doubled.
  double start_rotation = 1.2;
  double equal_chi2 = 9.2;  // as ChainEstimatorSettings
  void check() const;       // throws std::invalid_argument naming a bad one
};

/// What became of a frame.
enum class RefinerOutcome {
  taken,    // and is in the belief, or will be with its block
  no_new,   // too near to an earlier one in place and time
  misfit,   // explained by no place of the robot
  changed,  // the bench is no longer the same: nothing is taken any more
  full
};

/// The refined chain of a run. No clock: the time of a frame is an argument. When its bench has
/// changed, the frames since then are dropped, what moved is uncertain again, and it takes no
/// more.
class ChainRefiner {
 public:
  /// `anchors`: looks that the prior was estimated from, to be linearized anew as well.
  ChainRefiner(ChainBelief prior, const ChainRefinerSettings& settings = {},
               const ChainAnchors& anchors = {});
  /// A frame of free flight: the robot somewhere near `near`, its axis about `axis`.
  RefinerOutcome add(const OutlineSeen& seen, const Eigen::Vector3d& axis,
                     const Eigen::Vector3d& near, double time);
  /// Looks at about so many frames anew, some 0.15 ms each: for the time that is left of a turn.
  void work(int frames);
  /// The best chain; with twins its covariance is that of all, as in ChainEstimate.
  const ChainBelief& belief() const { return belief_; }
  std::size_t frames() const { return best_.frames(); }
  std::size_t explanations() const { return 1 + twins_.size(); }
  double chi2() const { return best_.chi2(); }  // of 2 degrees a frame
  /// Of a change of the bench, as log of a ratio of likelihoods: alarm above -log(false_alarm).
  double change_evidence() const { return change_.log_evidence; }
  /// What the frames after the first `after` say against the others.
  ChangeInformation information_since(std::size_t after) const {
    return test_.information(best_.rows(), after);
  }
  /// What moved, when it has; its `after` frames are those that are kept.
  const std::optional<BenchChange>& changed() const { return changed_; }

 private:
  bool is_new(const Eigen::Vector3d& near, double time) const;
  bool misfits(const ReducedRows& rows) const;
  RefinerOutcome close_block();
  RefinerOutcome look_for_change();
  void spawn();
  void decide();
  void stop();
  void refresh();

  ChainBelief prior_;
  ChainRefinerSettings settings_;
  ChainHypothesis best_;
  std::vector<ChainHypothesis> candidates_;  // on their way to a minimum
  std::vector<ChainHypothesis> twins_;       // minima of their own that explain as much
  BenchChangeTest test_;
  std::vector<std::size_t> misfits_;  // how many frames were there before each
  BenchChange change_;                // the most probable one of the last test
  std::optional<BenchChange> changed_;
  std::vector<std::pair<Eigen::Vector3d, double>> lately_;
  std::size_t spawn_at_ = 20;
  ChainBelief belief_;
};

}  // namespace vitreo::optics
