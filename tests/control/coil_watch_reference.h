// Coil watch, beside the whole history of innovations: dense error motions of the filter, and one
// least squares a hypothesis with the healthy coils' errors as unknowns of known variance.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_lack.h"
#include "control/coil_watch.h"

#include <Eigen/Dense>

#include <algorithm>
#include <cmath>
#include <random>
#include <utility>
#include <vector>

namespace vitreo::control::watch_reference {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Finding = CoilWatch::Finding;

// The header's: begins each 0.4 s, up to 4 s old, heard from 0.4 s on; "since ever" with a memory
// of 2.5 s, heard after 10 s.
constexpr double kEvery = 0.4, kOldest = 4, kYoungest = 0.4, kMemory = 2.5, kStanding = 10;
// docs/control_margins.md: errors of healthy coils, the evidence from which turns are asked for,
// lacks that no fault has, what exchanged leads must be likelier by.
constexpr double kGainError = 0.05, kTurnError = 0.022, kAsked = 25;
constexpr double kDead = 1.1, kExchanged = 1.7, kLikelier = 9;
// Told nowhere: lacks below a hundredth are not looked for (without it this reference tells lacks
// of some thousandths, and the watch none), nor some large ones: findings with one beyond kFar are
// not compared.
constexpr double kLeast = 0.01, kFar = 2.4;

/// One call of the watch.
struct Step {
  double span = 0;
  bool restarted = false;
  Innovation innovation;
  EstimatorUpdate update;
  MatrixXd faults;  // 3 x 2 coils: linear, curved
  MatrixXd turned;  // 3 x 3 coils
};

struct Draw {
  explicit Draw(unsigned seed) : random(seed) {}
  double between(double low, double high) {
    return low + (high - low) * (static_cast<double>(random()) + 0.5) / 4294967296.0;
  }
  // Nearly Gaussian, of variance 1.
  double normal() {
    double sum = 0;
    for (int k = 0; k < 12; ++k) sum += between(-0.5, 0.5);
    return sum;
  }
  MatrixXd matrix(Index rows, Index columns, double scale) {
    MatrixXd made(rows, columns);
    for (double& one : made.reshaped()) one = scale * normal();
    return made;
  }
  std::mt19937 random;
};

/// Error of the whole state, true less estimated, a column a cause.
struct ErrorMotion {
  explicit ErrorMotion(Index columns) : error(MatrixXd::Zero(8, columns)) {}
  /// What the innovation sees, and the error after the update.
  MatrixXd after(const Step& step, const MatrixXd& moved) {
    if (step.restarted) {
      error.topRows(3).setZero();
      return {};
    }
    MatrixXd transition = MatrixXd::Identity(8, 8);
    transition.block(0, 3, 3, 3).diagonal().setConstant(step.span);
    transition.block(0, 6, 3, 1) = step.update.by_gain;
    transition.block(0, 7, 3, 1) = step.update.by_delay;
    error = (transition * error).eval();
    error.topRows(3) += moved;
    const MatrixXd seen = error.topRows(3);
    error -= step.update.gain * seen;
    return seen;
  }
  MatrixXd error;
};

/// 2 ln of the likelihood ratio of each coil under one hypothesis, its lack, and what is left.
struct Judged {
  VectorXd evidence, lack;
  double left = 0;  // squares that the likeliest coil leaves
  int best() const {
    Index at = 0;
    return evidence.maxCoeff(&at) > 0 ? static_cast<int>(at) : -1;
  }
  double second() const {
    double most = 0;
    for (Index k = 0; k < evidence.size(); ++k)
      if (k != best()) most = std::max(most, evidence[k]);
    return most;
  }
};

class Reference {
 public:
  explicit Reference(int coils) : coils_(coils) {}
  std::vector<Step> history;
  // The lack by most_probable_lack, which is not exact where signatures are curved: here its sums
  // are compared, it has tests of its own.
  bool by_newton = false;

  Finding most_suspect();
  bool comparable() const { return comparable_; }

 private:
  struct Rows {
    MatrixXd healthy, fault;
    VectorXd value;
    double count = 0;
  };
  struct Heard {
    Rows rows;
    Finding by_gains;
  };
  void see_errors();
  Rows rows_since(std::size_t begin, bool fading) const;
  Judged judge(const Rows& rows, Index errors, double noise);
  std::pair<Judged, double> judge(const Rows& rows, Index errors);
  Finding by_gains(const Rows& rows);
  Finding with_turns(const Heard& heard);
  std::pair<double, double> likeliest(double low, double high, const VectorXd& s, const VectorXd& t,
                                      const VectorXd& v) const;
  double spans_after(std::size_t begin) const {
    double sum = 0;
    for (std::size_t i = begin + 1; i < history.size(); ++i) sum += history[i].span;
    return sum;
  }

  Index coils_;
  std::vector<MatrixXd> off_;    // h, of every step
  std::vector<Vector3d> value_;  // the innovations less what the bounds made
  bool comparable_ = true;
};

inline void Reference::see_errors() {
  off_.clear();
  value_.clear();
  ErrorMotion off(4 * coils_), known(1);
  for (const Step& step : history) {
    MatrixXd moved(3, 4 * coils_);
    moved << kGainError * step.faults.leftCols(coils_), kTurnError * step.turned;
    off_.push_back(off.after(step, moved));
    const MatrixXd seen = known.after(step, MatrixXd::Zero(3, 1));
    if (!step.restarted) known.error -= step.update.bounded;
    value_.push_back(step.restarted ? Vector3d(0, 0, 0)
                                    : Vector3d(step.innovation.value - seen.col(0)));
  }
}

// All in units of the innovations' standard deviations.
inline Reference::Rows Reference::rows_since(std::size_t begin, bool fading) const {
  Rows rows;
  const Index most = 3 * static_cast<Index>(history.size() - begin);
  rows.healthy = MatrixXd::Zero(most, 4 * coils_);
  rows.fault = MatrixXd::Zero(most, 2 * coils_);
  rows.value = VectorXd::Zero(most);
  ErrorMotion lack(2 * coils_);
  Index row = 0;
  for (std::size_t i = begin; i < history.size(); ++i, row += 3) {
    const Step& step = history[i];
    const MatrixXd seen = lack.after(step, -step.faults);
    if (step.restarted) continue;
    double old = 0;  // s, of measurements
    for (std::size_t j = i + 1; j < history.size(); ++j)
      old += history[j].restarted ? 0 : history[j].span;
    const double weight = fading ? std::exp(-old / kMemory) : 1;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> spread(step.innovation.covariance);
    const Eigen::Matrix3d whiten = std::sqrt(weight) * spread.operatorInverseSqrt();
    rows.healthy.middleRows(row, 3) = whiten * off_[i];
    rows.fault.middleRows(row, 3) = whiten * seen;
    rows.value.segment(row, 3) = whiten * value_[i];
    rows.count += weight;
  }
  return rows;
}

// Lack in the interval by which the squares fall most, and by how much: all places 2e-3 apart, then
// thirds of what is left.
inline std::pair<double, double> Reference::likeliest(double low, double high, const VectorXd& s,
                                                      const VectorXd& t, const VectorXd& v) const {
  const double vv = v.dot(v), ss = s.dot(s), tt = t.dot(t);
  const double sv = s.dot(v), tv = t.dot(v), st = s.dot(t);
  if (by_newton) {
    const Lack lack = most_probable_lack({sv, tv, ss, st, tt}, low, high);
    return {lack.part, lack.ratio};
  }
  const auto fall = [&](double c) {
    const double square = c * c;
    const double left = vv + square * ss + square * square * tt - 2 * c * sv - 2 * square * tv +
                        2 * c * square * st;
    return vv - left;
  };
  double best = low;
  for (double c = low; c <= high; c += 2e-3)
    if (fall(c) > fall(best)) best = c;
  double from = std::max(low, best - 2e-3), to = std::min(high, best + 2e-3);
  for (int round = 0; round < 40; ++round) {
    const double third = (to - from) / 3;
    (fall(from + third) < fall(to - third) ? from : to) +=
        fall(from + third) < fall(to - third) ? third : -third;
  }
  const double c = (from + to) / 2;
  return {c, std::max(0.0, fall(c))};
}

// min over e of |value - H e|^2 / noise + |e|^2: what the orthogonal complement of [H; sqrt(noise)]
// keeps.
inline Judged Reference::judge(const Rows& rows, Index errors, double noise) {
  const Index n = rows.value.size();
  MatrixXd stacked = MatrixXd::Zero(n + errors, errors);
  stacked.topRows(n) = rows.healthy.leftCols(errors);
  stacked.bottomRows(errors).diagonal().setConstant(std::sqrt(noise));
  MatrixXd columns = MatrixXd::Zero(n + errors, 2 * coils_ + 1);
  columns.topRows(n) << rows.fault, rows.value;
  columns.applyOnTheLeft(stacked.householderQr().householderQ().adjoint());
  const MatrixXd rest = columns.bottomRows(n) / std::sqrt(noise);
  const VectorXd v = rest.col(2 * coils_);
  Judged judged{VectorXd::Zero(coils_), VectorXd::Zero(coils_)};
  for (Index k = 0; k < coils_; ++k) {
    const VectorXd s = rest.col(k), t = rest.col(coils_ + k);
    const auto weak = likeliest(kLeast, kDead, s, t, v);
    const auto exchanged = likeliest(kExchanged, 4, s, t, v);
    const auto& lack = exchanged.second > weak.second + kLikelier ? exchanged : weak;
    comparable_ = comparable_ && (exchanged.first < kFar || exchanged.second < weak.second);
    judged.lack[k] = lack.first;
    judged.evidence[k] = lack.second;
  }
  judged.left = noise * (v.squaredNorm() - std::max(0.0, judged.evidence.maxCoeff()));
  return judged;
}

// By the filter's covariance, then by that times what is left over.
inline std::pair<Judged, double> Reference::judge(const Rows& rows, Index errors) {
  const Judged first = judge(rows, errors, 1);
  const double rest = rows.count > 0 ? std::max(1.0, first.left / (3 * rows.count)) : 1;
  return {rest > 1 ? judge(rows, errors, rest) : first, rest};
}

inline Finding Reference::by_gains(const Rows& rows) {
  const auto [judged, rest] = judge(rows, coils_);
  Finding found;
  found.rest = rest;
  if (judged.best() < 0) return found;
  found.coil = judged.best() + 1;
  found.lack = judged.lack[judged.best()];
  found.evidence = judged.evidence[judged.best()];
  found.next = judged.second();
  return found;
}

// The lead is the gains'.
inline Finding Reference::with_turns(const Heard& heard) {
  Finding found = heard.by_gains;
  if (found.evidence < kAsked) return found;
  const Judged all = judge(heard.rows, 4 * coils_).first;
  const double lead = found.evidence - found.next;
  found.evidence = std::min(found.evidence, all.evidence[found.coil - 1]);
  found.next = std::max(0.0, found.evidence - lead);
  return found;
}

inline Finding Reference::most_suspect() {
  comparable_ = true;
  see_errors();
  std::vector<Heard> heard;
  const auto hear = [&](std::size_t begin, bool fading) {
    Rows rows = rows_since(begin, fading);
    const Finding found = by_gains(rows);
    heard.push_back({std::move(rows), found});
  };
  double strongest = 0, since = 0;
  for (std::size_t i = 0; i < history.size(); ++i) {
    since += history[i].span;
    if (i > 0 && since < kEvery) continue;
    since = 0;
    if (const double age = spans_after(i); age < kYoungest || age > kOldest) continue;
    hear(i, false);
    strongest = std::max(strongest, heard.back().by_gains.evidence);
  }
  double all = 0;
  for (const Step& step : history) all += step.span;
  if (all > kStanding && strongest < kAsked) {
    hear(0, true);
  }
  Finding most;
  for (const Heard& one : heard)
    if (const Finding found = with_turns(one); found.evidence > most.evidence) most = found;
  return most;
}

}  // namespace vitreo::control::watch_reference
