// SPDX-License-Identifier: Apache-2.0
#include "control/coil_watch.h"

#include "control/preconditions.h"

#include <Eigen/Cholesky>

#include <cmath>

namespace vitreo::control {

CoilWatch::CoilWatch(int coils) : coils_(static_cast<std::size_t>(coils)) {
  require(coils > 0 && coils <= kMaxCoils, "coils: must be in [1, kMaxCoils]");
  reset();
}

void CoilWatch::age(double span) {
  standing_.age += span;
  for (Begin& begin : begins_) begin.age += span;
  // A bank of hypotheses, each of a fault that began at another time; a lack that is older than all
  // of them is the standing one's to find.
  if (begins_.empty() || begins_.back().age >= kEvery)
    begins_.push_back({0, 0, 0, std::vector<Signature>(coils_)});
  while (begins_.front().age > kOldest) begins_.pop_front();
}

// The filter's error e = true - predicted obeys e := F (I - K H) e + what moved the robot unseen;
// with a coil that lacks all of its current that is -given. Its velocity part is disturbance and
// gain's error together, as velocity_gain is.
void CoilWatch::take(Begin& begin, const Innovation& innovation, const Eigen::Matrix3d& weight,
                     const Eigen::Matrix3d& position_gain, const Eigen::Matrix3d& velocity_gain,
                     double span, const CoilMotions& given) {
  // weight is S^-1, position_gain K of the filter's last update, velocity_gain that of disturbance
  // and gain as a velocity; `given` a column a coil, m.
  const Eigen::Vector3d weighted = weight * innovation.value;
  begin.count += 1;
  begin.power += innovation.value.dot(weighted);
  for (std::size_t k = 0; k < begin.coils.size(); ++k) {
    Signature& coil = begin.coils[k];
    const Eigen::Vector3d seen =
        coil.position + span * coil.velocity - given.col(static_cast<Eigen::Index>(k));
    coil.information += seen.dot(weight * seen);
    coil.product += seen.dot(weighted);
    coil.position = seen - position_gain * seen;
    coil.velocity -= velocity_gain * seen;
  }
}

void CoilWatch::add(const Innovation& innovation, const Eigen::Matrix3d& position_gain,
                    const Eigen::Matrix3d& velocity_gain, double span, const CoilMotions& given) {
  age(span);
  const Eigen::Matrix3d weight =
      Eigen::LLT<Eigen::Matrix3d>(innovation.covariance).solve(Eigen::Matrix3d::Identity());
  // Exponential forgetting keeps the standing hypothesis' sums of the newest seconds; its
  // signatures are states of the filter's error and do not fade.
  const double fade = std::exp(-span / kMemory);
  standing_.count *= fade;
  standing_.power *= fade;
  for (Signature& coil : standing_.coils) {
    coil.information *= fade;
    coil.product *= fade;
  }
  take(standing_, innovation, weight, position_gain, velocity_gain, span, given);
  for (Begin& begin : begins_)
    take(begin, innovation, weight, position_gain, velocity_gain, span, given);
}

// The innovation itself was an outlier to the filter, and is none of this test's.
void CoilWatch::restart(double span) {
  age(span);
  // The filter's place is right again by what was measured; what it believes of the velocity is as
  // it was, and so is its error.
  for (Signature& coil : standing_.coils) coil.position.setZero();
  for (Begin& begin : begins_)
    for (Signature& coil : begin.coils) coil.position.setZero();
}

CoilWatch::Finding CoilWatch::suspect_of(const Begin& begin) const {
  Finding found;
  for (std::size_t k = 0; k < coils_; ++k) {
    const Signature& coil = begin.coils[k];
    // b below 0 would be a coil that carries more than it was given, which amplifiers do not.
    if (!(coil.information > 0) || !(coil.product > 0)) continue;
    const double evidence = coil.product * coil.product / coil.information;
    if (evidence > found.evidence) {
      found.next = found.evidence;
      found.coil = static_cast<int>(k) + 1;
      found.lack = coil.product / coil.information;
      found.evidence = evidence;
    } else if (evidence > found.next) {
      found.next = evidence;
    }
  }
  // Three coordinates an innovation: about 1 where the filter's covariance is right.
  if (begin.count > 0) found.rest = (begin.power - found.evidence) / (3 * begin.count);
  return found;
}

CoilWatch::Finding CoilWatch::most_suspect() const {
  Finding most;
  if (standing_.age > kStanding) most = suspect_of(standing_);
  for (const Begin& begin : begins_) {
    if (begin.age < kYoungest) continue;
    const Finding found = suspect_of(begin);
    if (found.evidence > most.evidence) most = found;
  }
  return most;
}

void CoilWatch::reset() {
  begins_.clear();
  standing_ = {0, 0, 0, std::vector<Signature>(coils_)};
}

}  // namespace vitreo::control
