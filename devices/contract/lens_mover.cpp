// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/lens_mover.h"

#include "devices/contract/examination.h"
#include "devices/time/error.h"

#include <cmath>
#include <limits>

namespace vitreo::contract {
namespace {

/// One function a duty.
struct LensMoverExaminer : Examination<LensMoverExaminer> {
  LensMover& mover;
  const LensMoverCheck& how;
  LensMoverExaminer(LensMover& its, const LensMoverCheck& check) : mover(its), how(check) {}
  void leave_safe() { mover.make_safe(); }

  // Targets are parts of the travel, so that one suite fits every mover.
  double middle() const { return (mover.travel_min() + mover.travel_max()) / 2; }
  double reach() const { return how.fraction * (mover.travel_max() - mover.travel_min()); }
  void expect_at(double wanted, const std::string& when) {
    expect(std::abs(mover.position() - wanted) <= how.tolerance,
           when + ", position() is not where it was sent");
    if (how.measured)
      expect(std::abs(how.measured() - wanted) <= how.tolerance, when + ", the lens is not there");
  }
  template <class Work>
  void expect_error(DeviceErrorKind kind, const std::string& name, Work work) {
    try {
      work();
      findings.push_back(name + " is accepted");
    } catch (const DeviceError& error) {
      expect(error.kind == kind, name + " ends in an error of another kind: " + error.what());
    }
  }

  void describes_itself() {
    expect(!mover.identity().empty(), "identity() is empty");
    expect(mover.travel_min() < mover.travel_max(), "its travel is empty");
    expect(how.fraction > 0 && how.fraction < 0.5, "fraction must be in (0, 0.5)");
  }
  /// Before it is homed it refuses to move; afterwards its position is a number.
  /// Homing is done only where it is wanted: it may move over the whole travel.
  void knows_its_position() {
    if (!mover.homed()) {
      expect_error(DeviceErrorKind::refused, "a move before it was homed",
                   [this] { mover.move_to(middle(), how.timeout); });
      mover.home(how.timeout);
    }
    expect(mover.homed(), "it is not homed after home()");
    expect(std::isfinite(mover.position()), "position() is not a number");
  }
  /// Both ways, so that a backlash or a wrong sign shows; and a motion of no length ends at once.
  void moves() {
    for (const double target : {middle(), middle() + reach(), middle() - reach()}) {
      mover.move_to(target, how.timeout);
      expect_at(target, "after a move");
    }
    const double there = mover.position();
    mover.move_to(there, how.timeout);
    expect_at(there, "after a move of no length");
  }
  void refuses_what_is_outside_the_travel() {
    const double before = mover.position();
    // NaN and infinity are targets outside the travel too.
    const double beyond = 0.01 * (mover.travel_max() - mover.travel_min());
    for (const double target :
         {mover.travel_max() + beyond, mover.travel_min() - beyond,
          std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()})
      expect_error(DeviceErrorKind::out_of_range, "a move to " + std::to_string(target),
                   [&] { mover.move_to(target, how.timeout); });
    expect(mover.position() == before, "a refused move moves it");
  }
  /// It stands when the call ends, and still knows where: it was decelerated, not halted.
  void stops_at_the_deadline() {
    mover.move_to(middle() - reach(), how.timeout);
    expect_error(DeviceErrorKind::timeout, "a move without time",
                 [this] { mover.move_to(middle() + reach(), Time::zero()); });
    const double there = mover.position();
    expect(mover.position() == there, "it still moves after the deadline of a move");
    expect(mover.homed(), "it forgets its place at the deadline of a move");
  }
  // Stopping twice, and not moving by it.
  void makes_safe() {
    mover.make_safe();
    const double there = mover.position();
    mover.make_safe();
    expect(mover.position() == there, "it moves by make_safe()");
  }
  void works_after_make_safe() {
    mover.make_safe();
    mover.move_to(middle(), how.timeout);
    expect_at(middle(), "moved after make_safe");
  }
};

}  // namespace

// Without a known position nothing else may move it, so findings of the first two duties end the
// suite.
std::vector<std::string> check(LensMover& mover, const LensMoverCheck& how) {
  LensMoverExaminer examiner(mover, how);
  examiner.duty("describe itself", &LensMoverExaminer::describes_itself);
  examiner.duty("know its place", &LensMoverExaminer::knows_its_position);
  if (!examiner.findings.empty()) return examiner.findings;  // nothing else can be asked of it
  examiner.duty("move", &LensMoverExaminer::moves);
  examiner.duty("refuse what is outside the travel",
                &LensMoverExaminer::refuses_what_is_outside_the_travel);
  examiner.duty("stop at the deadline", &LensMoverExaminer::stops_at_the_deadline);
  examiner.duty("make safe", &LensMoverExaminer::makes_safe);
  examiner.duty("work after make safe", &LensMoverExaminer::works_after_make_safe);
  examiner.duty("be left safe", &LensMoverExaminer::leave_safe);
  return examiner.findings;
}

}  // namespace vitreo::contract
