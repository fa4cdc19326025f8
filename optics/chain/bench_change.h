// Test for a bench that changes while the frames of a run refine its chain: evidence that grows
// with the frames, is valid at any time, and names the part that moved.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "optics/chain/chain_session.h"

#include <Eigen/Core>

#include <cstddef>
#include <string>
#include <vector>

namespace vitreo::optics {

/// Rows of unit variance that are left of a measurement when its own unknowns are free:
///   by_theta theta + offset ~ N(0, 1), the bottom of Q' [J2 | r - J2 theta] with J1 = Q R.
struct ReducedRows {
  Eigen::MatrixXd by_theta;
  Eigen::VectorXd offset;
};
ReducedRows reduced(const ChainBlock& block, const Eigen::VectorXd& theta);

/// What the frames after one of them say of theta, as against what was believed before: had theta
/// moved by delta, score ~ N(information delta, information). delta' information delta is the
/// noncentrality of every test for that move.
struct ChangeInformation {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;  // (C + L^-1)^-1, C believed before, L of the frames after
};

/// The most probable change, and what would be believed of theta after it without a frame.
struct BenchChange {
  double log_evidence = 0;  // of all changes together against none
  std::string part;         // "condensing_lens", "eye_rotation", "microscope", "robot", "bench"
  std::size_t after = 0;    // so many frames were before it
  Eigen::VectorXd theta;
  Eigen::MatrixXd covariance;
};

/// Likelihood of the frames after each block's end under a change there, divided by that without
/// one: a part that was put up anew (theta + N(0, 1) of its parameters, or a third of that), a
/// bench that moved as a whole by a third, one that is another (N(0, 1) of all), and one of whose
/// frames no place explains a third. Each ratio has the expectation 1 as long as nothing changes,
/// and so has their mean, whose chance of ever passing 1 / alpha is alpha at most (Ville's
/// inequality): it may be looked at after every block.
class BenchChangeTest {
 public:
  /// `block`: frames between two places where a change is looked for; `most_frames` of a run.
  BenchChangeTest(const ChainBelief& prior, int block, int most_frames);

  /// `misfits`: of each frame that no place explained, how many others came before it.
  BenchChange most_probable(const std::vector<const ReducedRows*>& frames,
                            const std::vector<std::size_t>& misfits) const;
  /// Of a change after `after` frames.
  ChangeInformation information(const std::vector<const ReducedRows*>& frames,
                                std::size_t after) const;

 private:
  struct Part {
    std::string name;
    std::vector<Eigen::Index> parameters;
    double sigma;
  };
  /// Information and its vector: sum B'B, -sum B'f.
  struct Sums {
    Eigen::MatrixXd information;
    Eigen::VectorXd vector;
    void add(const ReducedRows& rows);
  };
  struct Window;
  Window window(const Sums& all, const Sums& after) const;
  double of_part(const Part& part, const Window& window) const;
  BenchChange believed_after(std::size_t part, std::size_t after,
                             const std::vector<const ReducedRows*>& frames) const;
  Sums none() const;

  Sums prior_;
  int block_;
  double log_weight_;
  std::vector<Part> parts_;
};

}  // namespace vitreo::optics
