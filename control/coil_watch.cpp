// SPDX-License-Identifier: Apache-2.0
#include "control/coil_watch.h"

#include "control/coil_lack.h"
#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <vector>

namespace vitreo::control {
namespace {

// What a healthy coil is off by: part of its current's effect, and rad about each axis. Two
// calibrations of one machine differ by 3 % of gain, 1.5 degrees and 1.2 mm (FieldPerturbation): of
// the degrees 0.018 rad fall to each axis, of the millimeters, 0.1 m away, 0.012.
constexpr double kHealthyGain = 0.05;
constexpr double kHealthyTurn = 0.022;
// Evidence against gains alone below which the rest is not asked for: it explains more, so that
// less is left, and takes many times as long.
constexpr double kAsked = 25;
// Lacks that are looked for: a coil that is weak or dead, and one whose leads are exchanged (2). No
// fault is between them; and where a lack's two parts go against each other, one of 1.5 moves the
// robot as one of a half does.
constexpr double kLeast = 0.01;
constexpr double kDead = 1.1;
constexpr double kLeastExchanged = 1.7;
constexpr double kMost = 2.5;
// 2 ln of the odds of a coil that grows weak against one whose leads are exchanged under way.
constexpr double kWeakRather = 9;

}  // namespace

CoilWatch::CoilWatch(int coils)
    : coils_((require(coils > 0 && coils <= kMaxCoils, "coils: must be in [1, kMaxCoils]"), coils)),
      errors_(4 * coils_),
      off_(errors_),
      known_(1),
      standing_(coils_) {
  reset();
}

CoilWatch::Begin CoilWatch::begin() const {
  Begin made(coils_);
  made.healthy = healthy_;
  return made;
}

void CoilWatch::age(double span) {
  standing_.age += span;
  for (Begin& begin : begins_) begin.age += span;
  // A bank of hypotheses, each of a fault that began at another time; a lack that is older than all
  // of them is the standing one's to find.
  if (begins_.empty() || begins_.back().age >= kEvery) begins_.push_back(begin());
  while (begins_.front().age > kOldest) begins_.pop_front();
}

// The filter's error e = true - estimated, of all it estimates, obeys e := (1 - K H) (F e + what
// moved the robot unseen); with a coil that lacks all of its current that is -given. A fault moves
// gain and delay too, by which the commands that follow it are seen otherwise.
template <class Motions>
void CoilWatch::Signatures<Motions>::follow(const EstimatorUpdate& update, double span,
                                            const Motions& given) {
  seen = position + span * disturbance - given;
  seen += update.by_gain.lazyProduct(gain) + update.by_delay.lazyProduct(delay);
  position = seen;
  position -= update.gain.topRows<3>().lazyProduct(seen);
  disturbance -= update.gain.middleRows<3>(3).lazyProduct(seen);
  gain -= update.gain.row(6).lazyProduct(seen);
  delay -= update.gain.row(7).lazyProduct(seen);
}

CoilWatch::ErrorMotions CoilWatch::errors_of(const CoilMotions& given,
                                             const CoilTurns& turned) const {
  ErrorMotions off = ErrorMotions::Zero(3, errors_);
  off.leftCols(coils_) = kHealthyGain * given.linear;
  if (turned.cols() > 0) off.rightCols(3 * coils_) = kHealthyTurn * turned;
  return off;
}

CoilWatch::Sums::Sums(Eigen::Index coils)
    : information(FaultSums::Zero(2 * coils)),
      mixed(Currents::Zero(coils)),
      product(information),
      crossed(Crossed::Zero(2 * coils, 4 * coils)) {}

// `weighted`: S^-1 h.
void CoilWatch::Sums::add(const Eigen::Vector3d& innovation, const Eigen::Matrix3d& weight,
                          const Faults& fault, const ErrorMotions& weighted) {
  const Eigen::Vector3d value = weight * innovation;
  count += 1;
  power += innovation.dot(value);
  const Faults weighted_fault = weight * fault;
  const Eigen::Index coils = mixed.size();
  information += weighted_fault.cwiseProduct(fault).colwise().sum().transpose();
  mixed += weighted_fault.leftCols(coils)
               .cwiseProduct(fault.rightCols(coils))
               .colwise()
               .sum()
               .transpose();
  product += fault.transpose() * value;
  // Three terms each: Eigen's blocked product would spend its time in packing them.
  crossed += fault.transpose().lazyProduct(weighted);
}

// Exponential forgetting keeps the standing hypothesis' sums of the newest seconds; its signatures
// are states of the filter's error and do not fade.
void CoilWatch::fade(double factor) {
  Sums& sums = standing_.sums;
  sums.count *= factor;
  sums.power *= factor;
  sums.information *= factor;
  sums.mixed *= factor;
  sums.product *= factor;
  sums.crossed *= factor;
  standing_.healthy.squares *= factor;
  standing_.healthy.explained *= factor;
}

void CoilWatch::add(const Innovation& innovation, const EstimatorUpdate& update, double span,
                    const CoilMotions& given, const CoilTurns& turned) {
  age(span);
  const Eigen::Matrix3d weight =
      Eigen::LLT<Eigen::Matrix3d>(innovation.covariance).solve(Eigen::Matrix3d::Identity());
  off_.follow(update, span, errors_of(given, turned));
  known_.follow(update, span, Faults::Zero(3, 1));
  known_.position.col(0) -= update.bounded.head<3>();
  known_.disturbance.col(0) -= update.bounded.segment<3>(3);
  known_.gain[0] -= update.bounded[6];
  known_.delay[0] -= update.bounded[7];
  const Eigen::Vector3d value = innovation.value - known_.seen.col(0);
  const ErrorMotions weighted = weight * off_.seen;
  const ErrorSquare squares = off_.seen.transpose().lazyProduct(weighted);
  const Errors explained = weighted.transpose() * value;
  fade(std::exp(-span / kMemory));
  for (Healthy* sums : {&healthy_, &standing_.healthy}) {
    sums->squares += squares;
    sums->explained += explained;
  }
  Faults faults = Faults::Zero(3, 2 * coils_);
  faults.leftCols(coils_) = given.linear;
  if (given.curved.cols() > 0) faults.rightCols(coils_) = given.curved;
  const auto see = [&](Begin& one) {
    one.signatures.follow(update, span, faults);
    one.sums.add(value, weight, one.signatures.seen, weighted);
  };
  see(standing_);
  for (Begin& begin : begins_) see(begin);
}

// The innovation itself was an outlier to the filter, and is none of this test's.
void CoilWatch::restart(double span) {
  age(span);
  // The filter's place is right again by what was measured; what it believes of the velocity is as
  // it was, and so is its error.
  off_.position.setZero();
  known_.position.setZero();
  standing_.signatures.position.setZero();
  for (Begin& begin : begins_) begin.signatures.position.setZero();
}

// With N = sum h' S^-1 h + 1 (the errors' information and prior), C = sum s' S^-1 h, n = sum h'
// S^-1 v, of the first `errors` of them: A - C N^-1 C' and b - C N^-1 n. `noise`: by which S is
// larger than the filter says.
CoilWatch::Finding CoilWatch::suspect_of(const Hypothesis& one, Eigen::Index errors,
                                         double noise) const {
  const Sums& sums = *one.sums;
  ErrorSquare known = one.until->squares.topLeftCorner(errors, errors);
  Errors explained = one.until->explained.head(errors);
  if (one.from != nullptr) {
    known -= one.from->squares.topLeftCorner(errors, errors);
    explained -= one.from->explained.head(errors);
  }
  known.diagonal().array() += noise;
  // With N = L L' they are A - |L^-1 C'|^2 and b - (L^-1 C')' L^-1 n.
  const Eigen::LLT<Eigen::Ref<ErrorSquare>> off(known);
  const Eigen::Index both = 2 * coils_;
  constexpr int kMost = 2 * kMaxCoils + 1;  // columns
  Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMaxErrors, kMost> white(errors,
                                                                                    both + 1);
  white.leftCols(both) = sums.crossed.leftCols(errors).transpose();
  white.col(both) = explained;
  off.matrixL().solveInPlace(white);
  const FaultSums information =
      sums.information - white.leftCols(both).colwise().squaredNorm().transpose();
  const FaultSums product = sums.product - white.leftCols(both).transpose() * white.col(both);
  Finding found;
  for (Eigen::Index k = 0; k < coils_; ++k) {
    const double mixed = sums.mixed[k] - white.col(k).dot(white.col(coils_ + k));
    const LackSums of_coil{product[k], product[coils_ + k], information[k], mixed,
                           information[coils_ + k]};
    const Lack weak = most_probable_lack(of_coil, kLeast, kDead);
    const Lack exchanged = most_probable_lack(of_coil, kLeastExchanged, kMost);
    const Lack lack = exchanged.ratio > weak.ratio + kWeakRather * noise ? exchanged : weak;
    const double evidence = lack.ratio / noise;
    if (evidence > found.evidence) {
      found.next = found.evidence;
      found.coil = static_cast<int>(k) + 1;
      found.lack = lack.part;
      found.evidence = evidence;
    } else if (evidence > found.next) {
      found.next = evidence;
    }
  }
  // Three coordinates an innovation: about 1 where the filter's covariance is right.
  const double left = sums.power - white.col(both).squaredNorm() - noise * found.evidence;
  if (sums.count > 0) found.rest = std::max(1.0, left / (3 * sums.count));
  return found;
}

// By the filter's own covariance first, then by the size of what that leaves.
CoilWatch::Finding CoilWatch::suspect_of(const Hypothesis& one, Eigen::Index errors) const {
  Finding found = suspect_of(one, errors, 1);
  const double rest = found.rest;
  if (rest > 1) found = suspect_of(one, errors, rest);
  found.rest = rest;
  return found;
}

// Gains alone choose the coil and give its lead: the directions would take as much from the one
// that died as from those beside it. What evidence is left of it when the directions are off too is
// the evidence that it has; where they favor another coil it is the second's at most.
CoilWatch::Finding CoilWatch::with_turns(const Hypothesis& one, Finding found) const {
  const Finding all = suspect_of(one, errors_);
  const double lead = found.evidence - found.next;
  found.evidence = std::min(found.evidence, all.coil == found.coil ? all.evidence : all.next);
  found.next = std::max(0.0, found.evidence - lead);
  return found;
}

CoilWatch::Finding CoilWatch::most_suspect() const {
  struct Suspect {
    Hypothesis hypothesis;
    Finding by_gains;
  };
  std::vector<Suspect> suspects;
  suspects.reserve(begins_.size() + 1);
  const auto suspect = [&](const Hypothesis& one) {
    suspects.push_back({one, suspect_of(one, coils_)});
  };
  for (const Begin& begin : begins_)
    if (begin.age >= kYoungest) suspect({&begin.sums, &healthy_, &begin.healthy});
  // Turns only take from the evidence of gains: where what is left of one is more than the gains'
  // of the next, the next need not be asked.
  std::stable_sort(suspects.begin(), suspects.end(), [](const Suspect& a, const Suspect& b) {
    return a.by_gains.evidence > b.by_gains.evidence;
  });
  // One that began within the last seconds, if any: of a lack since ever, which explains as much of
  // what came of it, a half looks like exchanged leads.
  if (standing_.age > kStanding &&
      (suspects.empty() || suspects.front().by_gains.evidence < kAsked)) {
    const Hypothesis since_ever{&standing_.sums, &standing_.healthy, nullptr};
    suspects.insert(suspects.begin(), {since_ever, suspect_of(since_ever, coils_)});
  }
  Finding most;
  for (const auto& [hypothesis, by_gains] : suspects) {
    if (by_gains.evidence < most.evidence) break;
    const Finding found = by_gains.evidence < kAsked ? by_gains : with_turns(hypothesis, by_gains);
    if (found.evidence > most.evidence) most = found;
  }
  return most;
}

void CoilWatch::reset() {
  begins_.clear();
  off_ = Signatures<ErrorMotions>(errors_);
  known_ = Signatures<Faults>(1);
  healthy_ = {ErrorSquare::Zero(errors_, errors_), Errors::Zero(errors_)};
  standing_ = begin();
}

}  // namespace vitreo::control
