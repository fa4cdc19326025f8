// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/lamp.h"

#include "devices/contract/examination.h"

#include <cmath>
#include <limits>
#include <stdexcept>

namespace vitreo::contract {
namespace {

/// One function a duty.
struct LampExaminer : Examination<LampExaminer> {
  Lamp& lamp;
  const LampCheck& how;
  LampExaminer(Lamp& its, const LampCheck& check) : lamp(its), how(check) {}
  void leave_safe() { lamp.make_safe(); }

  /// level() is exactly what was set; the light agrees within the tolerance.
  void expect_level(double level, const std::string& when) {
    expect(lamp.level() == level, when + ", level() is not what was set");
    if (how.measured)
      expect(std::abs(how.measured() - level) <= how.tolerance, when + ", the light is another");
  }

  void describes_itself() {
    expect(!lamp.identity().empty(), "identity is empty");
    expect_level(0, "when it is opened");
  }
  // Down to dark and up again: level 0 is a state of its own in some drivers.
  void shines() {
    for (const double level : {how.level, how.level / 2, 0., how.level}) {
      lamp.set_level(level);
      expect_level(level, "at level " + std::to_string(level));
    }
  }
  // NaN too, which passes a test for "below 0 or above 1".
  void refuses_what_is_no_level() {
    lamp.set_level(how.level);
    for (const double wrong : {-0.1, 1.1, std::numeric_limits<double>::quiet_NaN()}) {
      try {
        lamp.set_level(wrong);
        expect(false, "it takes " + std::to_string(wrong) + " for a level");
      } catch (const std::invalid_argument&) {  // as the role says
      }
      expect_level(how.level, "after a level that is none");
    }
  }
  // A question is no command.
  void answers() {
    for (const double level : {how.level, 0.}) {
      lamp.set_level(level);
      lamp.ask();
      expect_level(level, "asked at level " + std::to_string(level));
    }
  }
  /// Twice, for make_safe() is idempotent.
  void makes_safe() {
    lamp.set_level(how.level);
    lamp.make_safe();
    expect_level(0, "after make_safe()");
    lamp.make_safe();
    expect_level(0, "after a second make_safe()");
  }
};

}  // namespace

// The last duty leaves the lamp dark.
std::vector<std::string> check(Lamp& lamp, const LampCheck& how) {
  LampExaminer examiner(lamp, how);
  examiner.duty("describe itself", &LampExaminer::describes_itself);
  examiner.duty("shine", &LampExaminer::shines);
  examiner.duty("refuse what is no level", &LampExaminer::refuses_what_is_no_level);
  examiner.duty("answer", &LampExaminer::answers);
  examiner.duty("make safe", &LampExaminer::makes_safe);
  return examiner.findings;
}

}  // namespace vitreo::contract
