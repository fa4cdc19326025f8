// SPDX-License-Identifier: Apache-2.0
#include "host/session/instrument_record.h"

#include "host/record/meaning.h"

#include <string>
#include <utility>

namespace vitreo {

/// One instrument that is listened to.
struct InstrumentRecord::Listening {
  struct Quantity {
    std::string name;
    int stream = -1;  // -1: it is no number
    int missed = 0;   // questions in a row
  };
  std::string role;
  Instrument* instrument = nullptr;
  OnSilence on_silence = OnSilence::alarm;
  std::vector<Quantity> quantities{};
};

InstrumentRecord::InstrumentRecord(Clock& clock, Rig& rig, Recorder& recorder,
                                   SilenceActions actions)
    : clock_(clock), rig_(rig), recorder_(recorder), actions_(std::move(actions)) {
  for (const FreeRole& role : rig.free_roles) resume(role.name);
}

InstrumentRecord::~InstrumentRecord() {
  // The instruments outlive the record: none may call into what is gone.
  for (const auto& [role, one] : listening_) one->instrument->on_poll({});
}

Instrument* InstrumentRecord::find(const std::string& role) const {
  for (const FreeRole& one : rig_.free_roles)
    if (one.name == role)
      if (auto* const* found = std::get_if<Instrument*>(&one.device)) return *found;
  return nullptr;
}

/// One a quantity, for each has a pace of its own. What a reload gave another unit is another one.
int InstrumentRecord::stream_of(const std::string& role, const InstrumentInfo& info,
                                const QuantityInfo& quantity) {
  const bool number = quantity.type == QuantityType::number || quantity.type == QuantityType::flag;
  if (quantity.every == Time::zero() || !number) return -1;
  std::string name = role + "_" + quantity.name;
  // A stream's unit cannot change within a record: the same quantity in another unit is another
  // stream.
  const auto [known, added] = streams_.try_emplace(name + " " + quantity.unit, -1);
  if (!added) return known->second;
  for (int i = 2; recorder_.stream(name) != nullptr; ++i)
    name = role + "_" + quantity.name + "_" + std::to_string(i);
  return known->second = recorder_.add_stream(
             {name,
              to_string(info.identity) + (quantity.help.empty() ? "" : ": " + quantity.help),
              {{quantity.name, quantity.unit,
                quantity.help.empty() ? quantity.name : quantity.help}},
              kReading});
}

void InstrumentRecord::pause(const std::string& role) {
  if (Instrument* const instrument = find(role)) instrument->on_poll({});
}

void InstrumentRecord::resume(const std::string& role) {
  if (Instrument* const instrument = find(role)) listen(role, *instrument);
}

void InstrumentRecord::listen(const std::string& role, Instrument& instrument) {
  auto& listening = listening_[role];
  if (listening)  // what was silent before is asked anew
    for (const auto& one : listening->quantities)
      if (one.missed > 1) actions_.clear(role + "." + one.name);
  const InstrumentInfo& info = instrument.info();
  listening = std::make_unique<Listening>(Listening{role, &instrument, info.on_silence});
  for (const QuantityInfo& one : info.quantities)
    listening->quantities.push_back({one.name, stream_of(role, info, one)});
  // The listener runs in the instrument's poll task, and a task holds the clock's baton: no lock.
  instrument.on_poll(
      [this, it = listening.get()](std::size_t index, const Instrument::Latest& latest) {
        hear(*it, index, latest);
      });
}

void InstrumentRecord::hear(Listening& listening, std::size_t index,
                            const Instrument::Latest& latest) {
  Listening::Quantity& quantity = listening.quantities.at(index);
  if (!latest.fault.empty()) return note_silence(listening, index, latest.fault);
  const std::string name = listening.role + "." + quantity.name;
  if (std::exchange(quantity.missed, 0) > 0) {
    recorder_.event(clock_.now(), "instrument", name + " is heard again");
    actions_.clear(name);
  }
  if (quantity.stream < 0) return;
  const auto* const flag = std::get_if<bool>(&latest.sample->value);
  // Flags are recorded as 0 and 1, beside the numbers.
  const double value =
      flag != nullptr ? static_cast<double>(*flag) : std::get<double>(latest.sample->value);
  recorder_.sample(quantity.stream, latest.sample->time, std::span(&value, 1));
}

/// Once an answer may be missed; what fails twice in a row is told once, until it is heard again.
void InstrumentRecord::note_silence(Listening& listening, std::size_t index,
                                    const std::string& why) {
  Listening::Quantity& quantity = listening.quantities.at(index);
  const std::string name = listening.role + "." + quantity.name;
  if (++quantity.missed == 1)
    return recorder_.event(clock_.now(), "instrument", name + " cannot be asked: " + why);
  if (quantity.missed != 2 || listening.on_silence == OnSilence::note) return;
  const bool ends = listening.on_silence != OnSilence::alarm;
  actions_.raise(name, ends ? AlarmPriority::high : AlarmPriority::medium, why);
  if (ends)
    actions_.end_run(listening.on_silence == OnSilence::stop ? StopTier::stop : StopTier::abort,
                     "because " + name + " cannot be asked: " + why);
}

}  // namespace vitreo
