// SPDX-License-Identifier: Apache-2.0
#include "control/coil_watch.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <cmath>

namespace vitreo::control {
namespace {

// Part of its current's effect by which a healthy coil is off: two calibrations of one machine
// differ by 3 % of gain, 1.5 degrees and 1.2 mm (FieldPerturbation).
constexpr double kHealthy = 0.05;

}  // namespace

CoilWatch::CoilWatch(int coils) : coils_(coils) {
  require(coils > 0 && coils <= kMaxCoils, "coils: must be in [1, kMaxCoils]");
  reset();
}

CoilWatch::Begin CoilWatch::begin() const {
  Begin made;
  const CoilMotions none = CoilMotions::Zero(3, coils_);
  made.signatures = {none, none, none};
  made.sums.information = made.sums.product = made.sums.explained = Currents::Zero(coils_);
  made.sums.crossed = made.sums.errors = Square::Zero(coils_, coils_);
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

// The filter's error e = true - predicted obeys e := F (I - K H) e + what moved the robot unseen;
// with a coil that lacks all of its current that is -given. K is position_gain of the filter's last
// update; velocity_gain is that of disturbance and gain's error together, as a velocity.
void CoilWatch::Signatures::follow(const Eigen::Matrix3d& position_gain,
                                   const Eigen::Matrix3d& velocity_gain, double span,
                                   const CoilMotions& given) {
  seen = position + span * velocity - given;
  position = seen - position_gain * seen;
  velocity -= velocity_gain * seen;
}

void CoilWatch::Sums::add(const Innovation& innovation, const Eigen::Matrix3d& weight,
                          const Signatures& fault, const Signatures& healthy) {
  const Eigen::Vector3d weighted = weight * innovation.value;
  const CoilMotions errors_weighted = weight * healthy.seen;
  count += 1;
  power += innovation.value.dot(weighted);
  information += (weight * fault.seen).cwiseProduct(fault.seen).colwise().sum().transpose();
  product += fault.seen.transpose() * weighted;
  crossed += fault.seen.transpose() * errors_weighted;
  errors += healthy.seen.transpose() * errors_weighted;
  explained += healthy.seen.transpose() * weighted;
}

void CoilWatch::Sums::fade(double factor) {
  count *= factor;
  power *= factor;
  information *= factor;
  product *= factor;
  crossed *= factor;
  errors *= factor;
  explained *= factor;
}

void CoilWatch::add(const Innovation& innovation, const Eigen::Matrix3d& position_gain,
                    const Eigen::Matrix3d& velocity_gain, double span, const CoilMotions& given) {
  age(span);
  const Eigen::Matrix3d weight =
      Eigen::LLT<Eigen::Matrix3d>(innovation.covariance).solve(Eigen::Matrix3d::Identity());
  // Exponential forgetting keeps the standing hypothesis' sums of the newest seconds; its
  // signatures are states of the filter's error and do not fade.
  standing_.sums.fade(std::exp(-span / kMemory));
  standing_.signatures.follow(position_gain, velocity_gain, span, given);
  standing_.sums.add(innovation, weight, standing_.signatures, standing_.signatures);
  for (Begin& begin : begins_) {
    begin.signatures.follow(position_gain, velocity_gain, span, given);
    begin.sums.add(innovation, weight, begin.signatures, standing_.signatures);
  }
}

// The innovation itself was an outlier to the filter, and is none of this test's.
void CoilWatch::restart(double span) {
  age(span);
  // The filter's place is right again by what was measured; what it believes of the velocity is as
  // it was, and so is its error.
  standing_.signatures.position.setZero();
  for (Begin& begin : begins_) begin.signatures.position.setZero();
}

// With N = sum h' S^-1 h + 1 / kHealthy^2 (the errors' information and prior), C = sum s' S^-1 h,
// n = sum h' S^-1 v: A - C N^-1 C' and b - C N^-1 n. `noise`: by which S is larger than the filter
// says.
CoilWatch::Finding CoilWatch::suspect_of(const Sums& sums, double noise) const {
  const Square prior = Square::Identity(coils_, coils_) * (noise / (kHealthy * kHealthy));
  const Eigen::LLT<Square> healthy(sums.errors + prior);
  const Square crossed = healthy.solve(sums.crossed.transpose());  // N^-1 C', a column a fault
  const Currents errors = healthy.solve(sums.explained);
  Finding found;
  for (Eigen::Index k = 0; k < coils_; ++k) {
    const double information = sums.information[k] - sums.crossed.row(k).dot(crossed.col(k));
    const double product = sums.product[k] - sums.crossed.row(k).dot(errors);
    // b below 0 would be a coil that carries more than it was given, which amplifiers do not.
    if (!(information > 0) || !(product > 0)) continue;
    const double evidence = product * product / information / noise;
    if (evidence > found.evidence) {
      found.next = found.evidence;
      found.coil = static_cast<int>(k) + 1;
      found.lack = product / information;
      found.evidence = evidence;
    } else if (evidence > found.next) {
      found.next = evidence;
    }
  }
  // Three coordinates an innovation: about 1 where the filter's covariance is right.
  const double left = sums.power - sums.explained.dot(errors) - noise * found.evidence;
  if (sums.count > 0) found.rest = std::max(1.0, left / (3 * sums.count));
  return found;
}

// By the filter's own covariance first, then by the size of what that leaves.
CoilWatch::Finding CoilWatch::suspect_of(const Sums& sums) const {
  const Finding first = suspect_of(sums, 1);
  if (!(first.rest > 1)) return first;
  Finding found = suspect_of(sums, first.rest);
  found.rest = first.rest;
  return found;
}

CoilWatch::Finding CoilWatch::most_suspect() const {
  Finding most;
  if (standing_.age > kStanding) most = suspect_of(standing_.sums);
  for (const Begin& begin : begins_) {
    if (begin.age < kYoungest) continue;
    const Finding found = suspect_of(begin.sums);
    if (found.evidence > most.evidence) most = found;
  }
  return most;
}

void CoilWatch::reset() {
  begins_.clear();
  standing_ = begin();
}

}  // namespace vitreo::control
