// SPDX-License-Identifier: Apache-2.0
#include "devices/contract/current_sensor.h"

#include "devices/contract/examination.h"

#include <cmath>
#include <set>

namespace vitreo::contract {
namespace {

/// One function a duty.
struct CurrentSensorExaminer : Examination<CurrentSensorExaminer> {
  CurrentSensor& sensor;
  const CurrentSensorCheck& how;
  CurrentSensorExaminer(CurrentSensor& its, const CurrentSensorCheck& check)
      : sensor(its), how(check) {}
  void leave_safe() {}

  void describes_itself() {
    const CurrentSensorInfo& info = sensor.info();
    expect(!info.identity.name.empty(), "it has no name");
    expect(!info.coils.empty(), "it measures no coil");
    expect(std::set<int>(info.coils.begin(), info.coils.end()).size() == info.coils.size(),
           "it measures a coil twice");
    for (const int coil : info.coils) expect(coil >= 0, "a coil's number is below 0");
  }
  void measures() {
    for (int i = 0; i < 3; ++i) {
      const std::vector<double> read = sensor.measure(how.timeout);
      expect(read.size() == sensor.info().coils.size(), "a reading has not one current per coil");
      const std::vector<double> really = how.really ? how.really() : read;
      for (std::size_t k = 0; k < read.size() && k < really.size(); ++k)
        // Written so that a NaN fails too.
        expect(std::abs(read[k] - really[k]) <= how.tolerance,
               "a reading is not what really flows: coil " +
                   std::to_string(sensor.info().coils[k] + 1));
    }
  }
  /// No instrument measures in no time; and an answer that comes late must not be taken for that of
  /// the next question.
  void notices_its_deadline() {
    const auto kind = error_without_time([this] { sensor.measure(Time::zero()); });
    expect(kind.has_value(), "measure() does not notice its deadline");
    expect(kind.value_or(DeviceErrorKind::timeout) == DeviceErrorKind::timeout,
           "at the deadline, measure() fails with another kind of error");
    measures();
  }
};

}  // namespace

std::vector<std::string> check(CurrentSensor& sensor, const CurrentSensorCheck& how) {
  CurrentSensorExaminer examiner(sensor, how);
  examiner.duty("describe itself", &CurrentSensorExaminer::describes_itself);
  examiner.duty("measure", &CurrentSensorExaminer::measures);
  examiner.duty("notice its deadline", &CurrentSensorExaminer::notices_its_deadline);
  return examiner.findings;
}

}  // namespace vitreo::contract
