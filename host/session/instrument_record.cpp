// SPDX-License-Identifier: Apache-2.0
#include "host/session/instrument_record.h"

#include "host/record/meaning.h"

#include <string>
#include <utility>

namespace vitreo {
namespace {

/// One stream a quantity, for each has a pace of its own; -1: it is not recorded.
std::vector<int> add_streams(const FreeRole& role, const InstrumentInfo& info, Recorder& recorder) {
  std::vector<int> streams(info.quantities.size(), -1);
  for (std::size_t i = 0; i < streams.size(); ++i) {
    const QuantityInfo& one = info.quantities[i];
    const bool number = one.type == QuantityType::number || one.type == QuantityType::flag;
    if (one.every == Time::zero() || !number) continue;
    streams[i] =
        recorder.add_stream({role.name + "_" + one.name,
                             to_string(info.identity) + (one.help.empty() ? "" : ": " + one.help),
                             {{one.name, one.unit, one.help.empty() ? one.name : one.help}},
                             kReading});
  }
  return streams;
}

}  // namespace

InstrumentRecord::InstrumentRecord(Rig& rig, Recorder& recorder) {
  for (const FreeRole& role : rig.free_roles) {
    auto* const* found = std::get_if<Instrument*>(&role.device);
    if (found == nullptr) continue;
    Instrument& instrument = **found;
    instrument.on_sample([&recorder, streams = add_streams(role, instrument.info(), recorder)](
                             const QuantitySample& sample) {
      const int stream = streams[sample.quantity];
      if (stream < 0) return;
      const auto* const flag = std::get_if<bool>(&sample.value);
      const double value =
          flag != nullptr ? static_cast<double>(*flag) : std::get<double>(sample.value);
      recorder.sample(stream, sample.time, std::span(&value, 1));
    });
    listened_.push_back(&instrument);
  }
}

InstrumentRecord::~InstrumentRecord() {
  for (Instrument* const one : listened_) one->on_sample({});
}

}  // namespace vitreo
