// Record of what the instruments of free roles measure by themselves: a stream each.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/rig/rig.h"

#include <vector>

namespace vitreo {

/// From its construction to its end every number and flag that is asked for by itself
/// (QuantityInfo::every) is a sample of the stream "ROLE_QUANTITY", at the middle between question
/// and answer. Both outlive it.
class InstrumentRecord {
 public:
  InstrumentRecord(Rig& rig, Recorder& recorder);
  ~InstrumentRecord();
  InstrumentRecord(const InstrumentRecord&) = delete;
  InstrumentRecord& operator=(const InstrumentRecord&) = delete;

 private:
  std::vector<Instrument*> listened_;
};

}  // namespace vitreo
