// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/coil_amplifier.h"

#include "devices/contract/examination.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <type_traits>

namespace vitreo::contract {
namespace {

using Currents = std::vector<double>;

/// One function a duty.
/// Currents are small parts of the limit (CoilAmplifierCheck::fraction), for the suite runs on real
/// coils as well. A stop in the middle leaves them at zero.
struct AmplifierExaminer : Examination<AmplifierExaminer> {
  CoilAmplifier& amplifier;
  const CoilAmplifierCheck& how;
  AmplifierExaminer(CoilAmplifier& its, const CoilAmplifierCheck& check)
      : amplifier(its), how(check) {}
  void leave_safe() { amplifier.make_safe(); }

  std::size_t count() const { return static_cast<std::size_t>(amplifier.channels()); }

  /// A different current in each channel, of both signs.
  /// Channels that were swapped, or that all follow one of them, show by that.
  Currents pattern() const {
    Currents currents(count());
    for (std::size_t i = 0; i < currents.size(); ++i)
      currents[i] = how.fraction * amplifier.current_limit() * static_cast<double>(i + 1) /
                    static_cast<double>(currents.size()) * (i % 2 ? -1 : 1);
    return currents;
  }

  /// currents() is exactly what was set; what flows agrees within the tolerance.
  /// Without `measured` only the driver's word can be checked.
  void expect_currents(const Currents& wanted, const std::string& when) {
    expect(amplifier.currents() == wanted, when + ", currents() is not what was set");
    if (const auto own = amplifier.measured_currents())
      expect(own->size() == wanted.size() &&
                 std::all_of(own->begin(), own->end(), [](double i) { return std::isfinite(i); }),
             when + ", it does not measure a current for each channel");
    if (!how.measured) return;
    const Currents flowing = how.measured();
    bool good = flowing.size() == wanted.size();
    for (std::size_t i = 0; good && i < wanted.size(); ++i)
      good = std::abs(flowing[i] - wanted[i]) <= how.tolerance;
    expect(good, when + ", the currents that flow are not what was set");
  }

  /// Sets `bad` on top of the pattern: must throw what the role says and leave the pattern alone.
  /// The pattern is set anew for each case, so that there is something that could have changed.
  template <typename Error>
  void expect_refusal(const Currents& bad, const std::string& name) {
    const Currents before = pattern();
    amplifier.set_currents(before);
    try {
      amplifier.set_currents(bad);
      findings.push_back(name + " is accepted");
    } catch (const Error& error) {
      if constexpr (std::is_same_v<Error, DeviceError>)
        expect(error.kind == DeviceErrorKind::refused,
               name + " is refused with another kind of error");
    }
    expect_currents(before, "after " + name);
  }

  void describes_itself() {
    expect(!amplifier.identity().empty(), "identity() is empty");
    expect(amplifier.channels() > 0, "it has no channels");
    expect(std::isfinite(amplifier.current_limit()) && amplifier.current_limit() > 0,
           "current_limit() is not positive");
  }
  /// A change of sign crosses zero, where an amplifier of one sign only would fail.
  void sets_currents() {
    Currents wanted = pattern();
    amplifier.set_currents(wanted);
    expect_currents(wanted, "after set_currents");
    for (double& current : wanted) current = -current;
    amplifier.set_currents(wanted);
    expect_currents(wanted, "after a change of sign");
  }
  // A mistake of the caller's, and so std::invalid_argument; what is beyond the limit is the
  // amplifier's refusal, a DeviceError.
  void refuses_a_wrong_count() {
    Currents fewer = pattern();
    Currents more = pattern();
    fewer.pop_back();
    more.push_back(0);
    expect_refusal<std::invalid_argument>(fewer, "one current too few");
    expect_refusal<std::invalid_argument>(more, "one current too many");
    expect_refusal<std::invalid_argument>({}, "an empty list of currents");
  }
  // In the last channel, behind others that are sound: a driver that checks while it sends would
  // have set those.
  void refuses_what_is_no_number() {
    for (const double bad :
         {std::numeric_limits<double>::quiet_NaN(), std::numeric_limits<double>::infinity()}) {
      Currents currents(count());
      currents.back() = bad;
      expect_refusal<std::invalid_argument>(currents, "a current of " + std::to_string(bad));
    }
  }
  /// By a thousandth, and on one channel only: a check of sums or with a margin would let it pass.
  void refuses_what_is_beyond_the_limit() {
    for (const double sign : {1., -1.}) {
      Currents currents(count());
      currents.back() = sign * 1.001 * amplifier.current_limit();
      expect_refusal<DeviceError>(currents, "a current beyond the limit");
    }
  }
  /// Twice, for make_safe() is idempotent.
  void makes_safe() {
    amplifier.set_currents(pattern());
    amplifier.make_safe();
    expect_currents(Currents(count()), "after make_safe");
    amplifier.make_safe();
    expect_currents(Currents(count()), "after make_safe twice");
  }
  void works_after_make_safe() {
    amplifier.make_safe();
    amplifier.set_currents(pattern());
    expect_currents(pattern(), "set after make_safe");
  }
};

}  // namespace

// From the harmless to the rare; the last duty leaves the outputs at zero whatever failed before.
std::vector<std::string> check(CoilAmplifier& amplifier, const CoilAmplifierCheck& how) {
  AmplifierExaminer examiner(amplifier, how);
  examiner.duty("describe itself", &AmplifierExaminer::describes_itself);
  if (!examiner.findings.empty()) return examiner.findings;  // nothing else can be asked of it
  examiner.duty("set currents", &AmplifierExaminer::sets_currents);
  examiner.duty("refuse a wrong count", &AmplifierExaminer::refuses_a_wrong_count);
  examiner.duty("refuse what is no number", &AmplifierExaminer::refuses_what_is_no_number);
  examiner.duty("refuse what is beyond the limit",
                &AmplifierExaminer::refuses_what_is_beyond_the_limit);
  examiner.duty("make safe", &AmplifierExaminer::makes_safe);
  examiner.duty("work after make safe", &AmplifierExaminer::works_after_make_safe);
  examiner.duty("be left safe", &AmplifierExaminer::leave_safe);
  return examiner.findings;
}

}  // namespace vitreo::contract
