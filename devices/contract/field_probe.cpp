// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/field_probe.h"

#include "devices/contract/examination.h"

#include <cmath>

namespace vitreo::contract {
namespace {

/// What is wrong with its description.
std::vector<std::string> describe(const FieldProbeInfo& info) {
  std::vector<std::string> findings;
  if (info.identity.name.empty()) findings.emplace_back("it has no name");
  if (info.axes != 1 && info.axes != 3) findings.emplace_back("it has neither one axis nor three");
  if (!(std::isfinite(info.range) && info.range > 0)) findings.emplace_back("it has no range");
  return findings;
}

/// One reading: a number per axis, measured during the call, within the range and true.
/// Without `really` the reading is compared with itself, so the tolerance then only refuses NaN.
void measure(FieldProbe& probe, Clock& clock, const FieldProbeCheck& how,
             std::vector<std::string>& findings) {
  const Time before = clock.now();
  const FieldReading reading = probe.measure(how.timeout);
  if (reading.field.size() != static_cast<std::size_t>(probe.info().axes)) {
    findings.emplace_back("a reading has not one number per axis");
    return;
  }
  if (reading.measured < before || reading.measured > clock.now())
    findings.emplace_back("a reading was not taken when it was asked for");
  const std::vector<double> really = how.really ? how.really() : reading.field;
  for (std::size_t i = 0; i < reading.field.size(); ++i) {
    // Written so that a NaN fails too.
    if (!(std::abs(reading.field[i]) <= probe.info().range))
      findings.emplace_back("a reading is beyond the range");
    if (!(std::abs(reading.field[i] - really[i]) <= how.tolerance))
      findings.emplace_back("a reading is not what is really there");
  }
}

/// No instrument measures in no time.
void miss_the_deadline(FieldProbe& probe, std::vector<std::string>& findings) {
  const auto kind = error_without_time([&probe] { probe.measure(Time::zero()); });
  if (!kind)
    findings.emplace_back("measure() does not notice its deadline");
  else if (*kind != DeviceErrorKind::timeout)
    findings.emplace_back("at the deadline, measure() fails with another kind of error");
}

}  // namespace

std::vector<std::string> check(FieldProbe& probe, Clock& clock, const FieldProbeCheck& how) {
  std::vector<std::string> findings = describe(probe.info());
  try {
    for (int i = 0; i < 3 && findings.empty(); ++i) measure(probe, clock, how, findings);
    if (!findings.empty()) return findings;
    if (how.answer) how.answer(true);
    miss_the_deadline(probe, findings);
    if (how.answer) how.answer(false);
    // An answer that comes late must not be taken for that of the next question.
    measure(probe, clock, how, findings);
  } catch (const Stopped&) {
    throw;  // a stop of the task is no finding
  } catch (const std::exception& error) {
    findings.push_back(std::string("measure: threw ") + error.what());
  }
  return findings;
}

}  // namespace vitreo::contract
