// Record of what the instruments of free roles measure by themselves, a stream each, and of their
// silence, which is an alarm.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/session/run_status.h"

#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

namespace vitreo {

/// What is done about an instrument that cannot be asked any more.
struct SilenceActions {
  std::function<void(const std::string& name, AlarmPriority, const std::string& text)> raise;
  std::function<void(const std::string& name)> clear;  ///< it is heard again
  std::function<void(StopTier, const std::string& reason)> end_run;
};

/// From its construction to its end every number and flag that is asked for by itself
/// (QuantityInfo::every) is a sample of the stream "ROLE_QUANTITY", at the middle between question
/// and answer. A question in vain is an event; the second one in a row an alarm "ROLE.QUANTITY",
/// and what InstrumentInfo::on_silence says. Clock, rig and recorder outlive it.
class InstrumentRecord {
 public:
  InstrumentRecord(Clock& clock, Rig& rig, Recorder& recorder, SilenceActions actions);
  ~InstrumentRecord();
  InstrumentRecord(const InstrumentRecord&) = delete;
  InstrumentRecord& operator=(const InstrumentRecord&) = delete;

  /// Around an exchange of the role's driver, whose quantities may be others after it. Of a role
  /// that is no such instrument: nothing.
  void pause(const std::string& role);
  void resume(const std::string& role);

 private:
  struct Listening;
  Instrument* find(const std::string& role) const;
  int stream_of(const std::string& role, const InstrumentInfo& info, const QuantityInfo& quantity);
  void listen(const std::string& role, Instrument& instrument);
  void hear(Listening& listening, std::size_t index, const Instrument::Latest& latest);
  void note_silence(Listening& listening, std::size_t index, const std::string& why);

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  const SilenceActions actions_;
  std::map<std::string, std::unique_ptr<Listening>> listening_;  // by role
  std::map<std::string, int> streams_;                           // by name and unit
};

}  // namespace vitreo
