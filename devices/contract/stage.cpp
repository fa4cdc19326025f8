// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/stage.h"

#include "devices/contract/examination.h"
#include "devices/roles/forwarding_stage.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::contract {
namespace {

using Position = std::vector<double>;  // m or rad, one per axis

/// A rotation stage as a stage of one axis, so that one suite examines both roles.
class AsStage final : public ForwardingMotion<Stage, RotationStage> {
 public:
  explicit AsStage(RotationStage& stage)
      : ForwardingMotion(stage), info_{stage.info().identity, {stage.info().axis}} {}
  const StageInfo& info() const override { return info_; }
  Position position() override { return {inner().position()}; }
  void start(std::span<const double> target, double speed) override {
    // RotationStage::start takes one number, so a wrong count cannot reach it.
    if (target.size() != 1) throw std::invalid_argument("target: one angle is wanted");
    inner().start(target.front(), speed);
  }

 private:
  StageInfo info_;
};

/// One function a duty. All move between two positions, near_ and far_, at speed_.
/// Motions that are to arrive are examined first, since most later duties begin with one.
class StageExaminer : Examination<StageExaminer> {
 public:
  StageExaminer(Stage& stage, Clock& clock, const StageCheck& how)
      : stage_(stage), clock_(clock), how_(how) {}

  std::vector<std::string> run() {
    duty("describe itself", &StageExaminer::describes_itself);
    if (!findings.empty()) return findings;  // nothing else can be asked of it
    choose_positions();
    if (how_.home) duty("find home", &StageExaminer::homes);
    duty("go where it is told", &StageExaminer::reaches_its_targets);
    duty("tell that it moves", &StageExaminer::reports_that_it_moves);
    duty("refuse a wrong target", &StageExaminer::refuses_what_is_no_target);
    duty("refuse what is beyond its limits", &StageExaminer::refuses_what_is_beyond_its_limits);
    duty("stop", &StageExaminer::stops);
    duty("stop at the deadline", &StageExaminer::stops_at_the_deadline);
    duty("make safe", &StageExaminer::makes_safe);
    duty("be left standing", &StageExaminer::makes_safe);
    return findings;
  }

 private:
  friend Examination<StageExaminer>;
  void leave_safe() { stage_.make_safe(); }

  const std::vector<StageAxis>& axes() const { return stage_.info().axes; }

  /// near_ in the middle of the travel, far_ a hundredth of the travel beside it; of an axis
  /// without ends, 0 and 0.1 (rad). The speed is that of the slowest axis.
  void choose_positions() {
    near_ = far_ = how_.start;
    speed_ = how_.speed > 0 ? how_.speed : std::numeric_limits<double>::infinity();
    for (std::size_t i = 0; i < axes().size(); ++i) {
      const StageAxis& axis = axes()[i];
      const bool endless = std::isinf(axis.travel_min) || std::isinf(axis.travel_max);
      if (how_.start.empty())
        near_.push_back(endless ? 0 : (axis.travel_min + axis.travel_max) / 2);
      const double way = how_.way > 0 ? how_.way
                         : endless    ? 0.1
                                      : (axis.travel_max - axis.travel_min) / 100;
      if (how_.start.empty()) far_.push_back(0);
      far_[i] = near_[i] + way;
      if (how_.speed <= 0) speed_ = std::min(speed_, axis.speed);
    }
  }

  /// Both what the stage reports and, where it is known, the truth.
  void expect_position(const Position& wanted, const std::string& when) {
    expect_near(stage_.position(), wanted, when + ", position() is not the target");
    if (how_.measured) expect_near(how_.measured(), wanted, when + ", it is really somewhere else");
  }
  void expect_near(const Position& position, const Position& wanted, const std::string& finding) {
    bool good = position.size() == wanted.size();
    for (std::size_t i = 0; good && i < position.size(); ++i) {
      const double tolerance = how_.tolerance > 0 ? how_.tolerance : 4 * axes()[i].resolution;
      good = std::abs(position[i] - wanted[i]) <= tolerance;
    }
    expect(good, finding);
  }
  // By the role's own move_to(), which also stops the stage where the wait fails.
  void go(const Position& target) { move_to(stage_, target, speed_, how_.timeout, clock_); }

  /// start() must throw `Error`, which tells a mistake of the caller from a limit of the stage, and
  /// nothing may move.
  template <class Error>
  void expect_refusal(const Position& target, double speed, const std::string& name) {
    try {
      stage_.start(target, speed);
      findings.push_back(name + " is accepted");
    } catch (const DeviceError& error) {
      expect(std::is_same_v<Error, DeviceError> && error.kind == DeviceErrorKind::out_of_range,
             name + " is refused with another kind of error: " + error.what());
    } catch (const std::invalid_argument&) {
      expect(std::is_same_v<Error, std::invalid_argument>,
             name + " is taken for a mistake of the caller");
    }
    expect(!stage_.moving(), "after " + name + ", it moves");
  }

  void describes_itself() {
    expect(!stage_.info().identity.name.empty(), "it has no name");
    expect(!axes().empty(), "it has no axes");
    for (const StageAxis& axis : axes()) {
      expect(axis.travel_min < axis.travel_max, "axis " + axis.name + " has no travel");
      expect(axis.speed > 0 && axis.speed <= axis.max_speed && std::isfinite(axis.max_speed),
             "axis " + axis.name + " has no speed within its limit");
      expect(axis.resolution > 0 && std::isfinite(axis.resolution),
             "axis " + axis.name + " has no resolution");
    }
    expect(!stage_.moving(), "it moves before it was set off");
  }
  void homes() {
    stage_.home(how_.timeout);
    expect(!stage_.moving(), "after home(), it moves");
  }
  // There and back, so that backlash and a wrong sign show, and at last a motion of no length,
  // which some controllers do not answer.
  void reaches_its_targets() {
    for (const Position& target : {near_, far_, near_}) {
      go(target);
      expect_position(target, "after a motion");
    }
    go(near_);
    expect_position(near_, "after a motion to where it stands");
  }
  // The motion must last long enough to be asked about in the middle (StageCheck::way). The second
  // wait() has nothing to wait for and returns at once.
  void reports_that_it_moves() {
    stage_.start(far_, speed_);
    expect(stage_.moving(), "it says that it stands while it moves");
    expect_busy();
    stage_.wait(how_.timeout);
    expect(!stage_.moving(), "it says that it moves when it is there");
    stage_.wait(how_.timeout);
    expect_position(far_, "after start() and wait()");
  }
  // Should it take the new target all the same, the caller finds it elsewhere than at far_.
  void expect_busy() {
    try {
      stage_.start(near_, speed_);
      findings.emplace_back("another motion is begun while it moves");
    } catch (const DeviceError& error) {
      expect(error.kind == DeviceErrorKind::refused,
             "while it moves, start() fails with another kind of error");
    }
  }
  // The target that is no number stands in the last axis, behind sound ones.
  void refuses_what_is_no_target() {
    go(near_);
    Position fewer = near_;
    Position more = near_;
    Position nothing = near_;
    fewer.pop_back();
    more.push_back(0);
    nothing.back() = std::numeric_limits<double>::quiet_NaN();
    expect_refusal<std::invalid_argument>(fewer, speed_, "a target with an axis too few");
    expect_refusal<std::invalid_argument>(more, speed_, "a target with an axis too many");
    expect_refusal<std::invalid_argument>(nothing, speed_, "a target that is not a number");
    expect_refusal<std::invalid_argument>(far_, 0, "a speed of zero");
    expect_refusal<std::invalid_argument>(far_, std::numeric_limits<double>::quiet_NaN(),
                                          "a speed that is not a number");
    expect_position(near_, "after refusals");
  }
  /// Ten steps beyond each end of each axis, and a hundredth above its speed.
  void refuses_what_is_beyond_its_limits() {
    go(near_);
    for (std::size_t i = 0; i < axes().size(); ++i) {
      const StageAxis& axis = axes()[i];
      for (const double edge : {axis.travel_min, axis.travel_max}) {
        if (std::isinf(edge)) continue;
        Position beyond = near_;
        beyond[i] = edge + (edge == axis.travel_min ? -1 : 1) * 10 * axis.resolution;
        expect_refusal<DeviceError>(beyond, speed_,
                                    "a target beyond the travel of axis " + axis.name);
      }
      expect_refusal<DeviceError>(far_, 1.01 * axis.max_speed,
                                  "a speed above that of axis " + axis.name);
    }
    expect_position(near_, "after refusals");
  }
  /// A stop is no arrival: wait() must throw; and a motion after it must work.
  void stops() {
    go(near_);
    stage_.start(far_, speed_);
    stage_.stop();
    expect(!stage_.moving(), "after stop(), it moves");
    try {
      stage_.wait(how_.timeout);
      findings.emplace_back("wait() takes a stop for an arrival");
    } catch (const DeviceError& error) {
      expect(error.kind == DeviceErrorKind::refused,
             "after stop(), wait() fails with another kind of error");
    }
    stands("after stop()");
    stage_.stop();
    go(far_);
    expect_position(far_, "after a stop and another motion");
  }
  /// A wait whose deadline passes must leave the stage standing.
  void stops_at_the_deadline() {
    go(near_);
    stage_.start(far_, speed_);
    try {
      stage_.wait(Time::zero());
      findings.emplace_back("wait() does not notice its deadline");
    } catch (const DeviceError& error) {
      expect(error.kind == DeviceErrorKind::timeout,
             "at the deadline, wait() fails with another kind of error");
    }
    stands("after the deadline");
  }
  void makes_safe() {
    stage_.make_safe();
    stage_.make_safe();
    stands("after make_safe()");
  }
  /// Two equal positions, 30 ms apart.
  void stands(const std::string& when) {
    const Position before = stage_.position();
    clock_.sleep_for(std::chrono::milliseconds(30));
    expect_near(stage_.position(), before, when + ", it still moves");
  }

  Stage& stage_;
  Clock& clock_;
  const StageCheck& how_;
  Position near_;
  Position far_;
  double speed_ = 0;
};

}  // namespace

std::vector<std::string> check(Stage& stage, Clock& clock, const StageCheck& how) {
  return StageExaminer(stage, clock, how).run();
}

std::vector<std::string> check(RotationStage& stage, Clock& clock, const StageCheck& how) {
  AsStage as_stage(stage);
  return StageExaminer(as_stage, clock, how).run();
}

}  // namespace vitreo::contract
