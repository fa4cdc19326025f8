// Field probes and current sensors from one Lua file.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/connection.h"
#include "devices/scripted/instrument.h"

#include <cmath>
#include <utility>

namespace vitreo::scripted {
namespace {

/// What the file's measure(io, timeout) gives, `count` numbers, in SI.
std::vector<double> measured(Connection& connection, Time timeout, std::size_t count) {
  const Exchange::Deadline limit(connection.exchange(),
                                 later(connection.dialogue().clock().now(), timeout));
  const auto said = connection.exchange().call(connection.declaration().functions.at("measure"),
                                               {to_seconds(timeout)});
  std::vector<double> list;
  if (const auto* one = said ? std::get_if<double>(&*said) : nullptr) list = {*one};
  if (const auto* all = said ? std::get_if<std::vector<double>>(&*said) : nullptr) list = *all;
  if (list.size() != count)
    connection.dialogue().fail(DeviceErrorKind::protocol,
                               "its driver gave " + std::to_string(list.size()) + " numbers, not " +
                                   std::to_string(count));
  for (double& one : list) one = connection.declaration().unit.to_si(one);
  return list;
}

class ScriptedProbe final : public FieldProbe {
 public:
  explicit ScriptedProbe(Opening opening)
      : clock_(opening.clock),
        connection_(std::move(opening.loaded), std::move(opening.link), opening.name,
                    opening.clock) {
    const auto& numbers = connection_.declaration().numbers;
    info_ = {connection_.identity(), static_cast<int>(numbers.at("axis_count")),
             numbers.at("range")};
  }
  const FieldProbeInfo& info() const override { return info_; }
  // The instrument measures between question and answer: the reading is of the middle, give or
  // take.
  FieldReading measure(Time timeout) override {
    const Dialogue::Turn turn(connection_.dialogue());
    connection_.be_open();
    const Time began = clock_.now();
    FieldReading reading;
    reading.field = measured(connection_, timeout, static_cast<std::size_t>(info_.axes));
    const Exchange& exchange = connection_.exchange();
    const Time from = std::max(began, exchange.asked());
    // A file that asks nothing says what it has, now.
    const Time to = exchange.answered() < from ? clock_.now() : exchange.answered();
    reading.within = (to - from) / 2;
    reading.measured = from + reading.within;
    // Some probes say a number all the same when they are overloaded.
    for (const double component : reading.field)
      if (std::abs(component) > info_.range)
        connection_.dialogue().fail(DeviceErrorKind::refused, "the field is beyond its range");
    return reading;
  }

 private:
  Clock& clock_;
  Connection connection_;
  FieldProbeInfo info_;
};

class ScriptedSensor final : public CurrentSensor {
 public:
  explicit ScriptedSensor(Opening opening)
      : connection_(std::move(opening.loaded), std::move(opening.link), opening.name,
                    opening.clock) {
    info_.identity = connection_.identity();
    // From 1 in the file, as on the amplifier's front; from 0 in the program.
    for (const int coil : connection_.declaration().coils) info_.coils.push_back(coil - 1);
  }
  const CurrentSensorInfo& info() const override { return info_; }
  std::vector<double> measure(Time timeout) override {
    const Dialogue::Turn turn(connection_.dialogue());
    connection_.be_open();
    return measured(connection_, timeout, info_.coils.size());
  }

 private:
  Connection connection_;
  CurrentSensorInfo info_;
};

}  // namespace

std::unique_ptr<FieldProbe> open_field_probe(Opening opening) {
  return std::make_unique<ScriptedProbe>(std::move(opening));
}

std::unique_ptr<CurrentSensor> open_current_sensor(Opening opening) {
  return std::make_unique<ScriptedSensor>(std::move(opening));
}

}  // namespace vitreo::scripted
