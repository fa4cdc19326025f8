// Coil watch: which one coil, carrying less current than it was given, would explain a filter's
// innovations.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/coil_field.h"
#include "control/estimator.h"

#include <Eigen/Core>

#include <deque>

namespace vitreo::control {

/// m: what each coil's current moved the robot, a column a coil. With a part c of it lacking, that
/// much of the motion is missing:
///   c linear + c^2 curved,
/// since the robot's moment follows the field that is left. No column of `curved`: 0.
struct CoilMotions {
  using Columns = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxCoils>;
  Columns linear;
  Columns curved = Columns(3, 0);
};
/// m/rad: what it would add to the motion that each coil's field is turned where the robot is,
/// about x (a column a coil), then about y, then about z.
using CoilTurns = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 3 * kMaxCoils>;

/// Generalized likelihood ratio test of Willsky & Jones (1976) for one fault at a time, that began
/// within the last seconds, or long ago, among coils that all are a little off. What a coil fails
/// to do moves the robot; through the filter's own gains that leaves a signature in the innovations
/// v of covariance S:
///   v = s_k c + t_k c^2 + sum_j h_j e_j + noise,   e_j ~ N(0, sigma_j^2),
/// s_k, t_k the signature of a lack c of coil k since the fault's begin, h_j those of what healthy
/// coils are off by since ever: four a coil, its gain and the direction of its field (a turn about
/// three axes). The second moves the robot across what the coil was given, as much as the first
/// along it. With all sums taken since the begin and the errors e of healthy coils marginalized (a
/// Schur complement), 2 ln of the likelihood ratio is a polynomial of fourth degree in c; its
/// largest value is the coil's evidence, there where c is the most probable lack. So where the
/// allocation goes over to other currents, or the axis turns, a coil that carries a twentieth of
/// the whole is not accused of what all the others' errors explain, and a tone in the null space of
/// the allocation (FieldAllocator::tone), in which all carry alike, still keeps every coil apart
/// from the others. The gains alone choose the coil and its lead over the next; its evidence is
/// what is left of it when all four errors are allowed.
class CoilWatch {
 public:
  /// Throws std::invalid_argument.
  explicit CoilWatch(int coils);
  /// One measurement that the filter used, `span` s after the one before. `given`: m, what each
  /// coil's current moved the robot since then, as believed. `turned`: what the directions of their
  /// fields add to it; no column: they are known.
  void add(const Innovation& innovation, const EstimatorUpdate& update, double span,
           const CoilMotions& given, const CoilTurns& turned = CoilTurns(3, 0));
  /// One from which the filter began anew: its position is what was measured, the rest is kept.
  void restart(double span);
  struct Finding {
    int coil = 0;         // from 1; 0: nothing is known yet
    double lack = 0;      // part of its current that is missing: 1 for a dead coil
    double evidence = 0;  // 2 ln of the likelihood ratio against "no coil"
    double next = 0;      // the same of the next coil
    // Squared innovations that it leaves over their degrees of freedom, 1 at least. The noise is
    // taken to be larger by it, as of a quasi-likelihood: tens where a robot falls.
    double rest = 1;
  };
  /// The coil and begin with the most evidence.
  Finding most_suspect() const;
  void reset();

 private:
  static constexpr double kEvery = 0.4;  // s, between the begins that are tried
  static constexpr double kOldest = 4;   // s
  static constexpr double kYoungest = 0.4;
  static constexpr double kMemory = 2.5;            // s, of the one that began long ago
  static constexpr double kStanding = 10;           // s, until that one is heard
  static constexpr int kMaxErrors = 4 * kMaxCoils;  // the gains first
  // Of each coil the linear part, then of each the curved one.
  using Faults = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, 2 * kMaxCoils>;
  using FaultSums = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 2 * kMaxCoils, 1>;
  using Errors = Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMaxErrors, 1>;
  using ErrorMotions = Eigen::Matrix<double, 3, Eigen::Dynamic, 0, 3, kMaxErrors>;
  using ErrorSquare =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxErrors, kMaxErrors>;
  using Crossed =
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 2 * kMaxCoils, kMaxErrors>;
  /// Error of the filter's state per unit of lack, or of a healthy coil's error over its standard
  /// deviation, a column each.
  template <class Motions>
  struct Signatures {
    using Row =
        Eigen::Matrix<double, 1, Eigen::Dynamic, Eigen::RowMajor, 1, Motions::MaxColsAtCompileTime>;
    explicit Signatures(Eigen::Index columns)
        : position(Motions::Zero(3, columns)),
          disturbance(position),
          gain(Row::Zero(columns)),
          delay(gain),
          seen(position) {}
    Motions position;     // m
    Motions disturbance;  // m/s
    Row gain;             // of the response
    Row delay;            // s
    Motions seen;         // m, in the last innovation
    void follow(const EstimatorUpdate& update, double span, const Motions& given);
  };
  /// Sums over the innovations, weighted by S^-1, of the healthy coils' signatures.
  struct Healthy {
    ErrorSquare squares;  // h_i' h_j
    Errors explained;     // h_j' v
  };
  /// Sums since a begin, weighted by S^-1.
  struct Sums {
    explicit Sums(Eigen::Index coils);
    double count = 0;       // innovations
    double power = 0;       // v' v
    FaultSums information;  // s_k' s_k, t_k' t_k
    Currents mixed;         // s_k' t_k
    FaultSums product;      // s_k' v, t_k' v
    Crossed crossed;        // s_k' h_j, t_k' h_j
    void add(const Eigen::Vector3d& innovation, const Eigen::Matrix3d& weight, const Faults& fault,
             const ErrorMotions& weighted);
  };
  struct Begin {
    explicit Begin(Eigen::Index coils) : signatures(2 * coils), sums(coils) {}
    double age = 0;  // s
    Signatures<Faults> signatures;
    Sums sums;
    Healthy healthy;  // until its begin; of the standing one since ever, faded
  };
  Begin begin() const;
  ErrorMotions errors_of(const CoilMotions& given, const CoilTurns& turned) const;
  void fade(double factor);
  /// Of a fault's begin; the healthy coils' sums are those of `until` less those of `from`.
  struct Hypothesis {
    const Sums* sums;
    const Healthy* until;
    const Healthy* from;  // null: none
  };
  Finding suspect_of(const Hypothesis& one, Eigen::Index errors, double noise) const;
  Finding suspect_of(const Hypothesis& one, Eigen::Index errors) const;
  Finding with_turns(const Hypothesis& one, Finding by_gains) const;
  void age(double span);
  Eigen::Index coils_;
  Eigen::Index errors_;
  Signatures<ErrorMotions> off_;  // what healthy coils are off by, since ever
  // In its one column the error that the filter's own bounds gave its state, whatever coils do.
  Signatures<Faults> known_;
  Healthy healthy_;           // since ever
  Begin standing_;            // as if it had always been so, with faded sums
  std::deque<Begin> begins_;  // the oldest first
};

}  // namespace vitreo::control
