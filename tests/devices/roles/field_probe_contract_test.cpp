// The contract of a field probe: a probe that fails late is a finding like another.
// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/field_probe.h"
#include "devices/time/error.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;
using Findings = std::vector<std::string>;

/// Measures 1 mT in 10 ms; a question that was given up before may have an effect on the next.
struct PlainProbe final : FieldProbe {
  enum class After { nothing, device_error, other_error };
  PlainProbe(Clock& its_clock, After its_end) : clock(its_clock), end(its_end) {
    probe_info = {{}, 1, 0.1};
    probe_info.identity.name = "plain";
  }
  const FieldProbeInfo& info() const override { return probe_info; }
  FieldReading measure(Time timeout) override {
    if (given_up && end == After::device_error)
      throw DeviceError(DeviceErrorKind::protocol, "plain", "an answer to an older question");
    if (timeout < 10ms) {
      if (end == After::other_error) throw std::logic_error("no deadline");
      given_up = true;
      throw DeviceError(DeviceErrorKind::timeout, "plain", "late");
    }
    const Time asked = clock.now();
    clock.sleep_for(10ms);
    return {{1e-3}, asked};
  }
  Clock& clock;
  After end;
  FieldProbeInfo probe_info;
  bool given_up = false;
};

Findings findings_of(PlainProbe::After end) {
  const auto clock = virtual_clock();
  PlainProbe probe(*clock, end);
  return contract::check(probe, *clock);
}

TEST(FieldProbeContract, FindsNothingInAProbeThatKeepsIt) {
  EXPECT_EQ(findings_of(PlainProbe::After::nothing), Findings{});
}

TEST(FieldProbeContract, TakesEveryErrorAfterTheDeadlineAsAFinding) {
  EXPECT_EQ(findings_of(PlainProbe::After::device_error),
            Findings{"measure: threw plain: an answer to an older question (protocol)"});
  EXPECT_EQ(findings_of(PlainProbe::After::other_error), Findings{"measure: threw no deadline"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
