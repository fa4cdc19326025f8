// One explanation of a run's frames: a viewing chain in the information form of its estimator,
// whose rows are linearized anew in turn.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/bench_change.h"
#include "optics/chain/chain_session.h"

#include <Eigen/Core>

#include <cstddef>
#include <optional>
#include <vector>

namespace vitreo::optics {

/// Place (m) and turns of the axis (rad) of a look.
using OwnUnknowns = Eigen::Matrix<double, 5, 1>;

/// Looks of the session that a belief was estimated from, and where it has the robot in each.
struct ChainAnchors {
  std::vector<ChainLook> looks;
  std::vector<Eigen::Vector3d> places;  // m, nominal eye frame
};

/// One chain that explains the frames: rows of each frame, linearized about the theta of when it
/// was last looked at, and their sum in information form. `work` looks at frames anew, so that the
/// sum becomes that of Gauss-Newton at its own solution.
class ChainHypothesis {
 public:
  /// `prior`: before any frame; `start`: where the chain is linearized first. What the prior owes
  /// to the anchors is taken out of it and counted with the frames, linearized anew as they are:
  /// with landings left as their own solution has them 8 % more of the height is not known. They
  /// stay in it where it owes them less than they say, as with the covariance of twins.
  ChainHypothesis(const ChainBelief& prior, const Eigen::VectorXd& start,
                  const ChainAnchors& anchors = {});
  /// Linearizes a frame here, at the place that fits it best, which is put into `own`; nothing
  /// where the chain does not show it.
  std::optional<ReducedRows> linearized(const ChainLook& look, OwnUnknowns& own,
                                        int steps = 3) const;
  void add(const ChainLook& look, const OwnUnknowns& own, ReducedRows rows);
  /// Rows of all frames, in their order.
  std::vector<const ReducedRows*> rows() const;
  /// Without the later ones, solved anew.
  void keep_first(std::size_t frames);
  /// The same prior and frames, linearized about another theta from the next pass on.
  ChainHypothesis from(const Eigen::VectorXd& start) const;
  /// Looks at so many frames anew, and solves when the last of them was reached.
  void work(int frames);
  void solve();  // by the rows as they are
  const Eigen::VectorXd& theta() const { return theta_; }
  const ViewingChain& chain() const { return chain_; }
  const Eigen::MatrixXd& covariance() const { return covariance_; }
  /// Of what was believed before and the frames, over that of the anchors at the prior.
  double chi2() const { return chi2_; }
  int passes() const { return passes_; }
  double last_step() const { return last_step_; }  // in sigmas, the largest
  std::size_t frames() const { return frames_.size(); }

 private:
  struct Frame {
    ChainLook look;
    OwnUnknowns own;
    ReducedRows rows;
  };
  struct Sums;
  Sums sums() const;
  double cost(const Eigen::VectorXd& theta) const;
  void take_out(const ChainBelief& prior, const ChainAnchors& anchors);

  Eigen::VectorXd prior_theta_;
  Eigen::MatrixXd prior_information_;
  Eigen::VectorXd theta_;
  ViewingChain chain_;
  Eigen::MatrixXd covariance_;
  double chi2_ = 0;
  double chi2_before_ = 0;  // of the anchors at the prior
  std::vector<Frame> anchors_;
  std::vector<Frame> frames_;
  std::size_t next_ = 0;
  int passes_ = 0;
  double last_step_ = 0;
};

}  // namespace vitreo::optics
