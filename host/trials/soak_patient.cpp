// SPDX-License-Identifier: Apache-2.0
#include "host/trials/soak_patient.h"

#include "host/servo/robot_clearance.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>

namespace vitreo {
namespace {

constexpr double kApart = 0.5e-3;      // m, of belief and truth
constexpr double kApartFor = 0.5;      // s
constexpr double kFlowing = 0.05;      // A: below it nothing moves a robot
constexpr double kBlind = 1.5;         // s without an estimate: the usual lost_timeout and a half
constexpr double kTolerance = 0.1e-3;  // m: of the believed walls against the true ones
constexpr double kNearFor = 0.5;       // s
constexpr double kClearFor = 1.0;      // s, before a robot counts as one that was clear
constexpr double kPutAway = 1e-3;      // m, from row to row of the truth: no coil moves it so

// Streams of places begin with x, y, z: the record's own order (host/servo/servo_record.cpp). NaN
// where the loop did not see the robot, or it is not in the eye.
Eigen::Vector3d place(const Stream& stream, std::size_t row) {
  return {stream.at(row, 0), stream.at(row, 1), stream.at(row, 2)};
}

/// The row at `time` or before it; nothing before the first.
std::optional<std::size_t> row_at(const Stream& stream, Time time) {
  const auto after = std::upper_bound(stream.times.begin(), stream.times.end(), time);
  if (after == stream.times.begin()) return std::nullopt;
  return static_cast<std::size_t>(after - stream.times.begin()) - 1;
}

/// Between the rows before and after; nothing where the robot is not there, or a row is far.
std::optional<Eigen::Vector3d> place_at(const Stream& truth, Time time) {
  const auto row = row_at(truth, time);
  if (!row) return std::nullopt;
  const Eigen::Vector3d before = place(truth, *row);
  if (*row + 1 >= truth.times.size())
    return before.allFinite() && time - truth.times[*row] < std::chrono::milliseconds(20)
               ? std::optional(before)
               : std::nullopt;
  const Eigen::Vector3d after = place(truth, *row + 1);
  const Time span = truth.times[*row + 1] - truth.times[*row];
  if (!before.allFinite() || !after.allFinite() || span > std::chrono::milliseconds(250))
    return std::nullopt;
  const double part = to_seconds(time - truth.times[*row]) / std::max(to_seconds(span), 1e-9);
  return before + part * (after - before);
}

// By the set-points of the loop: the soak's faults of coils are behind them, so a coil that is open
// counts as flowing here, and a robot that falls beside it is a violation.
bool flows(const Stream* currents, Time time) {
  if (currents == nullptr) return false;
  const auto row = row_at(*currents, time);
  if (!row) return false;
  double most = 0;
  for (std::size_t k = 0; k < currents->info.channels.size(); ++k)
    most = std::max(most, std::abs(currents->at(*row, k)));
  return most > kFlowing;
}

/// How long something has been so, row by row; the longest is told once.
class Lasting {
 public:
  void see(bool is, Time now, double size) {
    if (!is) {
      since_.reset();
      return;
    }
    if (!since_) {
      since_ = now;
      most_ = 0;
    }
    most_ = std::max(most_, size);
    if (now - *since_ < longest_) return;
    longest_ = now - *since_;
    at_ = *since_;
    size_ = most_;
  }
  double longest() const { return to_seconds(longest_); }
  double size() const { return size_; }
  double at() const { return to_seconds(at_); }

 private:
  std::optional<Time> since_;
  Time longest_{};
  Time at_{};
  double most_ = 0;
  double size_ = 0;
};

/// A robot that is laid down on purpose, as the record says.
bool may_touch(const std::vector<Event>& events, Time time) {
  bool touch = false;
  for (const Event& event : events) {
    if (event.time > time) break;
    if (event.kind == "keep-out margin") touch = event.text.starts_with("off");
  }
  return touch;
}

/// The spans after the robot was put elsewhere while a sensor repeated an older place.
class PutUnseen {
 public:
  PutUnseen(const Stream* truth, const std::vector<Event>* events) {
    if (truth == nullptr || events == nullptr) return;
    for (const Event& event : *events) {
      if (!event.text.ends_with(" stale") && event.text.find(" stale ") == std::string::npos)
        continue;
      if (event.kind == "fault") repeats_.push_back({event.time, Time::max()});
      if (event.kind == "fault over" && !repeats_.empty()) repeats_.back().until = event.time;
    }
    for (Span& span : repeats_) span.from = put_within(*truth, span);
  }
  bool at(Time time) const {
    return std::any_of(repeats_.begin(), repeats_.end(),
                       [&](const Span& one) { return one.from <= time && time < one.until; });
  }

 private:
  struct Span {
    Time from, until;
  };
  static Time put_within(const Stream& truth, const Span& span) {
    for (std::size_t row = 1; row < truth.times.size(); ++row)
      if (truth.times[row] >= span.from && truth.times[row] < span.until &&
          (place(truth, row) - place(truth, row - 1)).norm() > kPutAway)
        return truth.times[row - 1];
    return span.until;
  }
  std::vector<Span> repeats_;
};

/// Of the loop that ran at `time`, as the record says: PD and velocity control steer by what they
/// saw and estimate nothing.
bool estimated(const std::vector<Event>& events, Time time) {
  bool estimates = true;
  for (const Event& event : events) {
    if (event.time > time) break;
    if (event.kind == "feedback")
      estimates = !event.text.starts_with("law pd") && !event.text.starts_with("law velocity");
  }
  return estimates;
}

/// Of a loop that estimates: its newest estimate is old while it steers.
void check_blind(const Recorder& recorder, std::vector<std::string>& found) {
  const Stream* const estimate = recorder.stream("estimate");
  const Stream* const servo = recorder.stream("servo");
  const Stream* const currents = recorder.stream("currents");
  if (estimate == nullptr || servo == nullptr || estimate->times.empty()) return;
  // A frame's row has its exposure's time and the estimate's is of the command, up to a latency
  // later: 0.2 s are allowed between them, and the currents must flow at both ends.
  Lasting blind;
  for (std::size_t row = 0; row < servo->times.size(); ++row) {
    const Time now = servo->times[row];
    const auto newest = row_at(*estimate, now + std::chrono::milliseconds(200));
    blind.see(newest && place(*servo, row).allFinite() && flows(currents, now) &&
                  flows(currents, now + std::chrono::milliseconds(200)) &&
                  to_seconds(now - estimate->times[*newest]) > kBlind &&
                  estimated(recorder.events(), now),
              now, 0);
  }
  if (blind.longest() > 0.2)
    found.push_back(fmt::format("the loop steered for {:.1f} s from {:.1f} s on by no measurement",
                                blind.longest() + kBlind, blind.at() - kBlind));
}

void check_nearness(const Recorder& recorder, OpenRig& rig, std::vector<std::string>& found) {
  const Stream* const servo = recorder.stream("servo");
  const Stream* const truth = recorder.stream("truth");
  const Stream* const currents = recorder.stream("currents");
  if (servo == nullptr || truth == nullptr) return;
  // The believed walls and any attitude of the body, at the true place and without its covariance:
  // what is left is the eye's own uncertainty, for which kTolerance stands.
  const RobotClearance surface(rig.rig().model, ClearanceBelief{});
  const PutUnseen unseen(truth, &recorder.events());
  Lasting near;
  double clear = 0;  // s, up to now
  Time before{};
  for (std::size_t row = 0; row < servo->times.size(); ++row) {
    const Time now = servo->times[row];
    const auto where = place_at(*truth, now);
    const auto clearance = where ? surface.at(*where) : std::nullopt;
    if (!clearance) continue;
    const double distance = clearance->nearest().distance;
    if (distance > surface.margin() + kTolerance) clear += to_seconds(now - before);
    before = now;
    // A robot that was let go sinks, and one that lay on the retina before it was taken up is near
    // it: neither is the loop's doing.
    const bool claimed = place(*servo, row).allFinite() && flows(currents, now) && !unseen.at(now);
    near.see(claimed && clear > kClearFor && distance < surface.margin() - kTolerance &&
                 !may_touch(recorder.events(), now),
             now, surface.margin() - distance);
  }
  if (near.longest() >= kNearFor)
    found.push_back(fmt::format(
        "the robot's surface was {:.2f} mm inside the margin of {:.2f} mm for {:.1f} s from {:.1f} "
        "s on, its currents on",
        near.size() * 1e3, surface.margin() * 1e3, near.longest(), near.at()));
}

}  // namespace

std::vector<std::string> check_claims(const PatientStreams& streams) {
  std::vector<std::string> found;
  if (streams.servo == nullptr || streams.truth == nullptr) return found;
  // A frame that is not seen neither ends nor lengthens the span: a loop that sees the robot at the
  // wrong place in every second frame is wrong all the time.
  const PutUnseen unseen(streams.truth, streams.events);
  Lasting apart;
  for (std::size_t row = 0; row < streams.servo->times.size(); ++row) {
    const Time now = streams.servo->times[row];
    const Eigen::Vector3d believed = place(*streams.servo, row);
    if (!believed.allFinite()) continue;
    const auto where = place_at(*streams.truth, now);
    const double error = where ? (*where - believed).norm() : 0;
    apart.see(error > kApart && flows(streams.currents, now) && !unseen.at(now), now, error);
  }
  if (apart.longest() >= kApartFor)
    found.push_back(fmt::format(
        "the robot was up to {:.2f} mm from where the loop saw it, for {:.1f} s from {:.1f} s on",
        apart.size() * 1e3, apart.longest(), apart.at()));
  return found;
}

std::vector<std::string> check_patient(const Recorder& recorder, OpenRig& rig) {
  std::vector<std::string> found = check_claims({recorder.stream("servo"), recorder.stream("truth"),
                                                 recorder.stream("currents"), &recorder.events()});
  check_blind(recorder, found);
  check_nearness(recorder, rig, found);
  return found;
}

}  // namespace vitreo
