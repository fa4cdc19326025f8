// SPDX-License-Identifier: Apache-2.0
#include "host/servo/plant_watch.h"

#include "host/servo/view_doubt.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace vitreo {
namespace {

// s, of a window. Below the shortest noise says nothing; above the longest a drift may be new.
constexpr double kPlantShortest = 0.1;
constexpr double kPlantLongest = 1.0;
// s: the drift is the mean of this span, that ended so long ago that a fault is not in it yet.
constexpr double kPlantDriftSpan = 1.0;
constexpr double kPlantLeastDriftSpan = 0.4;
constexpr double kPlantDriftAge = 0.6;
// Of what is left over, let pass: standard deviations of noise, m, m/s of a drift that changes, and
// a part of the motion that was told, for gain and drag.
constexpr double kPlantSigmas = 6;
constexpr double kPlantOffset = 30e-6;
constexpr double kPlantDriftChange = 0.3e-3;
constexpr double kPlantGainError = 0.5;
// Of the robot's response over the believed one, by what it did before.
constexpr double kPlantLeastPart = 0.3;
constexpr double kPlantMostPart = 2;
// Standard deviations of what the view is off by the robot's attitude (by 2, three healthy benches
// of 24 that were set up by hand were accused while the robot was pitched), and the part of each
// coil's share of the field by which it turns the robot unnoticed: a gain of 3 %, an axis of 1.5
// degrees (control::FieldPerturbation). Where coils work against each other that is 0.15 rad at 10
// mT.
constexpr double kPlantAttitudes = 4;
constexpr double kPlantCoilError = 0.04;
constexpr int kPlantSure = 2;  // measurements in a row
// m, told within a window, and a part of it that was gone: less is standing.
constexpr double kPlantTold = 0.4e-3;
constexpr double kPlantGone = 0.15;
constexpr int kPlantStoodFor = 4;  // measurements in a row
// s: windows over which what was told is held against what was seen, without their straight lines.
constexpr std::array kPlantBends{0.6, 0.8, 1.0, 1.25, 1.5};
constexpr double kPlantLeastBentSpan = 0.5;
constexpr double kPlantLags = 3;  // of the coils, until the first currents flow
// m, rms: of what was told, beyond a straight line, that says something. A robot that is held in
// place against a drift that changes is told as much and stands: docs/reliability.md.
constexpr double kPlantBent = 20e-6;
// The part of it that is surely not seen, by so many standard deviations: a robot of twice the drag
// and two thirds of the moment still shows a third.
constexpr double kPlantPart = 0.3;
constexpr double kPlantPartSigmas = 4;
// s after the robot was found: places by outlines of another attitude were up to 1.5 mm off, in two
// to five frames, and a drift of millimeters per second came of it that no motion had.
constexpr double kPlantTurnsIn = 0.5;
constexpr double kPlantKept = 2 * kPlantLongest + kPlantDriftSpan;  // s
constexpr int kPlantSubsteps =
    4;  // between two measurements, in which the currents' lag is followed

/// What was told and what was seen over time, both without their straight lines: how much of the
/// one is in the other, by least squares.
class Answer {
 public:
  void add(double time, const Eigen::Vector3d& told, const Eigen::Vector3d& seen) {
    count_ += 1;
    time_ += time;
    times_ += time * time;
    told_.add(time, told);
    seen_.add(time, seen);
    squares_ += told.squaredNorm();
    products_ += told.dot(seen);
  }
  /// m: root mean square distance of what was told from the line that fits best.
  double bent() const { return std::sqrt(squares() / count_); }
  double part() const { return without_lines(products_, seen_) / squares(); }
  /// Of the part, where a place has this variance, m^2.
  double sigma(double variance) const { return std::sqrt(variance / squares()); }

 private:
  struct Places {
    Eigen::Vector3d sum{0, 0, 0}, by_time{0, 0, 0};
    void add(double time, const Eigen::Vector3d& place) {
      sum += place;
      by_time += time * place;
    }
  };
  double squares() const { return std::max(1e-18, without_lines(squares_, told_)); }
  // sum told' other, of both what their lines leave.
  double without_lines(double products, const Places& other) const {
    const double spread = std::max(times_ - time_ * time_ / count_, 1e-12);
    const auto along = [&](const Places& one) -> Eigen::Vector3d {
      return one.by_time - time_ / count_ * one.sum;
    };
    return products - told_.sum.dot(other.sum) / count_ - along(told_).dot(along(other)) / spread;
  }
  double count_ = 0, time_ = 0, times_ = 0, squares_ = 0, products_ = 0;
  Places told_, seen_;
};

double largest_variance(const Eigen::Matrix3d& noise) { return noise.diagonal().maxCoeff(); }

}  // namespace

PlantWatch::PlantWatch(const RigModel& model)
    : model_(model),
      lag_(1 / (2 * M_PI * model.command_bandwidth)),
      flow_{control::Currents::Zero(model.field.coils()), 0, 0} {}

void PlantWatch::found(double time) {
  forget();
  heard_from_ = time + kPlantTurnsIn;
}

// The currents go on: what was commanded still acts.
void PlantWatch::forget() {
  samples_.clear();
  doubtful_ = stood_ = unanswered_ = 0;
  standing_ = false;
  excess_ = 0;
}

void PlantWatch::commanded(double now, const control::Currents& currents,
                           const Eigen::Matrix3d& mobility) {
  constexpr std::size_t kMost = 4096;  // where nothing is measured meanwhile
  if (told_.size() >= kMost) told_.pop_front();
  told_.push_back({now + model_.command_delay, currents});
  flows_from_ = std::min(flows_from_, now + model_.command_delay + kPlantLags * lag_);
  mobility_ = mobility;
}

// Behind delay and first-order lag: i' = (told - i) / lag, from command to command.
void PlantWatch::advance(Flow& flow, double time) const {
  while (flow.time < time) {
    while (flow.last + 1 < told_.size() && told_[flow.last + 1].acts <= flow.time) ++flow.last;
    const bool acts = !told_.empty() && told_[flow.last].acts <= flow.time;
    const std::size_t next = flow.last + (acts ? 1 : 0);
    const double until = next < told_.size() ? std::min(time, told_[next].acts) : time;
    if (acts)
      flow.currents +=
          (1 - std::exp(-(until - flow.time) / lag_)) * (told_[flow.last].currents - flow.currents);
    flow.time = until;
  }
}

void PlantWatch::flow_to(double time) {
  advance(flow_, time);
  told_.erase(told_.begin(), told_.begin() + static_cast<std::ptrdiff_t>(flow_.last));
  flow_.last = 0;
}

control::Currents PlantWatch::flowing_at(double time) const {
  Flow ahead = flow_;
  advance(ahead, time);
  return ahead.currents;
}

// m/s, at the currents that flow.
PlantMotions PlantWatch::velocities(const Eigen::Vector3d& position) const {
  const Eigen::Vector3d known = model_.field.nearest_valid(position);
  return plant_velocities(model_.robot,
                          {model_.field.matrix(known), model_.field.background(known),
                           model_.robot.net_weight(model_.medium), mobility_},
                          flow_.currents);
}

void PlantWatch::note_field(Sample& sample) const {
  const Eigen::Vector3d known = model_.field.nearest_valid(sample.position);
  const control::FieldMatrix matrix = model_.field.matrix(known);
  sample.shares = matrix.topRows<3>().colwise().norm().transpose().cwiseProduct(flow_.currents);
  sample.field = matrix * flow_.currents + model_.field.background(known);
}

void PlantWatch::measured(const WatchedPlace& seen, double delay) {
  const double time = seen.time;
  // What moved the robot until `time` are commands from the delay earlier. No command acts before
  // it is given.
  const double acting = time - std::max(delay, -model_.command_delay);
  Sample now;
  now.time = time;
  now.position = seen.position;
  now.variance = largest_variance(seen.noise);
  now.moved = PlantMotions::Zero(3, kPlantCoils + kPlantPerCoil * flow_.currents.size());
  now.by_attitude = seen.by_attitude;
  now.place_sigma = std::sqrt(std::max(0.0, seen.systematic.trace()) / 3);
  if (samples_.empty()) {
    flow_to(acting);
    note_field(now);
    samples_.push_back(std::move(now));
    return;
  }
  const double span = std::max(0.0, acting - flow_.time);
  const double begin = flow_.time;
  now.moved = samples_.back().moved;
  for (int k = 0; k < kPlantSubsteps; ++k) {
    flow_to(begin + span * (k + 0.5) / kPlantSubsteps);
    now.moved += (time - samples_.back().time) / kPlantSubsteps * velocities(seen.position);
  }
  flow_to(acting);
  note_field(now);
  samples_.push_back(std::move(now));
  while (time - samples_.front().time > kPlantKept) samples_.pop_front();
  unanswered_ = unanswered() ? unanswered_ + 1 : 0;
  if (const auto slow = before()) look_back(*slow);
  standing_ = stood_ >= kPlantStoodFor || unanswered_ >= kPlantSure;
}

// What was told lately, and what was seen, each without a straight line in time: a drift makes one,
// whatever its size, and a command that cancels it the same, so that neither need be known. What is
// left of the one is in the other as far as the robot obeys; where none of it is, the robot stands,
// or the view is old. From the first quarter of a second on, in which the drift of a robot that is
// free is unknown. Places by outlines of another attitude are no matter here: what moves does not
// stand.
bool PlantWatch::unanswered() const {
  return std::any_of(kPlantBends.begin(), kPlantBends.end(), [this](double window) {
    const Sample& now = samples_.back();
    const auto first = std::find_if(samples_.begin(), samples_.end(), [&](const Sample& one) {
      return one.time >= flows_from_ && now.time - one.time <= window;
    });
    if (first == samples_.end() || now.time - first->time < kPlantLeastBentSpan) return false;
    Answer answer;
    double variance = 0;
    for (auto one = first; one != samples_.end(); ++one) {
      answer.add(one->time - first->time,
                 one->moved.col(kPlantAsTold) - first->moved.col(kPlantAsTold),
                 one->position - first->position);
      variance = std::max(variance, one->variance);
    }
    const double told = (now.moved.col(kPlantAsTold) - first->moved.col(kPlantAsTold)).norm();
    const double went = (now.position - first->position).norm();
    return answer.bent() > kPlantBent &&
           answer.part() + kPlantPartSigmas * answer.sigma(variance) < kPlantPart &&
           went < kPlantGone * told + kPlantPartSigmas * std::sqrt(2 * variance);
  });
}

// At all windows that end now.
void PlantWatch::look_back(const Before& slow) {
  const double time = samples_.back().time;
  Verdict most;
  bool stands = false;
  double farthest = 0;  // m, that it was within the window from where it is
  for (auto then = samples_.rbegin(); then != samples_.rend(); ++then) {
    if (time - then->time > kPlantLongest || then->time < heard_from_) break;
    farthest = std::max(farthest, (then->position - samples_.back().position).norm());
    if (time - then->time < kPlantShortest) continue;
    const Verdict found = judge(*then, samples_.back(), slow, farthest);
    stands = stands || found.standing;
    if (found.excess > most.excess) most = found;
  }
  excess_ = most.excess;
  stood_ = stands ? stood_ + 1 : 0;
  const std::string text = most.doubtful ? cause(most, slow) : std::string();
  doubtful_ = text.empty() ? 0 : doubtful_ + 1;
  if (doubtful_ >= kPlantSure && fault_.empty()) fault_ = text;
}

std::optional<PlantWatch::Before> PlantWatch::before() const {
  const double until = samples_.back().time - kPlantDriftAge;
  const Sample* last = nullptr;
  const Sample* first = nullptr;
  for (const Sample& one : samples_) {
    if (one.time > until) break;
    if (one.time < heard_from_) continue;
    if (one.time >= until - kPlantDriftSpan && first == nullptr) first = &one;
    last = &one;
  }
  if (first == nullptr || last->time - first->time < kPlantLeastDriftSpan) return std::nullopt;
  const double span = last->time - first->time;
  return Before{*first, *last,
                (last->moved.col(kPlantAsTold) - first->moved.col(kPlantAsTold)) / span,
                (last->position - first->position) / span};
}

// m, along a direction: what the view makes of a robot that lies beside the field asked for. Coils
// that are wrong turn it, and a robot that is not where it is seen has another field there, by the
// gradient that moves it: by an angle b, of which a depth d by its size is off by b d'(pitch).
// Another b shows as motion, and so does the same b at another pitch: what was taken for level, and
// is steep by b, is by far more wrong when it is told to be steep. d' changes its sign with the
// pitch; of it the square is known.
double PlantWatch::by_turn(const Sample& then, const Sample& now, const Eigen::Vector3d& along) {
  constexpr double kLeastField = 1e-6;  // T
  const auto direction_off = [&now](const Eigen::VectorXd& shares,
                                    const control::FieldGradient& field) {
    return std::hypot(kPlantCoilError * shares.norm(),
                      now.place_sigma * control::gradient_matrix(field).norm());
  };
  const auto per_turn = [&along](const Sample& one) {
    const double square = along.dot(one.by_attitude * along);
    return std::copysign(std::sqrt(std::max(0.0, square)) / kTakenAxis, one.field[2]);
  };
  const double at_then = per_turn(then), at_now = per_turn(now);
  const double turned = direction_off(now.shares - then.shares, now.field - then.field) /
                        std::max(now.field.head<3>().norm(), kLeastField);
  const double off =
      direction_off(then.shares, then.field) / std::max(then.field.head<3>().norm(), kLeastField);
  return std::hypot(turned * at_now, off * (at_now - at_then));
}

// m, from `then` to `now`: so much of what was told, and the rest of the drift before.
Eigen::Vector3d PlantWatch::expected_by(double response, const Before& slow, const Sample& then,
                                        const Sample& now) {
  return response * (now.moved.col(kPlantAsTold) - then.moved.col(kPlantAsTold)) +
         (now.time - then.time) * (slow.went - response * slow.told);
}

std::string PlantWatch::cause(const Verdict& verdict, const Before& slow) const {
  const Sample& then = *verdict.then;
  std::vector<LeftOver> path;
  for (const Sample& one : samples_)
    if (one.time >= then.time)
      path.push_back({one.moved - then.moved, one.position - then.position -
                                                  expected_by(verdict.response, slow, then, one)});
  return plant_fault(path, std::sqrt(then.variance + samples_.back().variance));
}

PlantWatch::Verdict PlantWatch::judge(const Sample& then, const Sample& now, const Before& slow,
                                      double farthest) const {
  const double span = now.time - then.time;
  const PlantMotions moved = now.moved - then.moved;
  const Eigen::Vector3d went = now.position - then.position;
  // What was left over before is a drift, or a part of what was told: after a turn the two differ
  // by as much as the robot's response is wrong. The one that explains more counts.
  const double part =
      std::clamp(slow.went.dot(slow.told) / std::max(slow.told.squaredNorm(), 1e-18),
                 kPlantLeastPart, kPlantMostPart);
  const Eigen::Vector3d by_drift = expected_by(1, slow, then, now);
  const Eigen::Vector3d by_response = expected_by(part, slow, then, now);
  const bool drifts = (went - by_drift).norm() < (went - by_response).norm();
  const Eigen::Vector3d expected = drifts ? by_drift : by_response;
  const Eigen::Vector3d left = went - expected;
  const double sigma = std::sqrt(then.variance + now.variance);
  // What the turn made of the places before is in the drift, and is taken to go on.
  const Eigen::Vector3d along = left.normalized();
  const double by_attitude =
      std::hypot(by_turn(then, now, along),
                 by_turn(slow.first, slow.last, along) * span / (slow.last.time - slow.first.time));
  const double allowed = kPlantSigmas * sigma + kPlantOffset + kPlantDriftChange * span +
                         kPlantAttitudes * by_attitude +
                         kPlantGainError * moved.col(kPlantAsTold).norm();
  Verdict verdict;
  verdict.then = &then;
  verdict.response = drifts ? 1 : part;
  verdict.excess = left.norm() / allowed;
  // By what was told and by the drift too: of a robot that answers half, half of what it was told
  // is taken for a drift, and when it may rest, it rests.
  const double told = std::min(expected.norm(), moved.col(kPlantAsTold).norm());
  verdict.standing =
      told > kPlantTold && farthest < kPlantGone * told && kPlantSigmas * sigma < kPlantTold;
  // Standing is what a wall does, or a hand: no coil.
  verdict.doubtful = verdict.excess > 1 && went.norm() > 0.3 * left.norm();
  return verdict;
}

}  // namespace vitreo
