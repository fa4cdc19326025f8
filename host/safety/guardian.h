// Guardian, the host's side: starts, arms and feeds the process that brings the outputs to zero
// when the host dies or hangs.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/coil_amplifier.h"
#include "devices/roles/instrument.h"
#include "devices/roles/lamp.h"
#include "host/safety/guardian/wire.h"
#include "host/safety/sleep_inhibitor.h"

#include <atomic>
#include <functional>
#include <memory>
#include <mutex>
#include <set>
#include <string>
#include <sys/types.h>
#include <thread>
#include <vector>

namespace vitreo {

/// Started before the outputs are opened, and gone after they are closed.
class Guardian {
 public:
  /// `healthy`, called by a thread of its own: whether the program moves as it should; while
  /// something is energized and it does not, nothing is said to the guardian, which then acts.
  /// Throws DeviceError{not_found, refused}.
  Guardian(const std::vector<guardian::Output>& outputs, std::function<bool()> healthy);
  /// Sends it away; when something may still be energized it first brings that to zero.
  ~Guardian();
  Guardian(const Guardian&) = delete;
  Guardian& operator=(const Guardian&) = delete;

  /// Before the output of `role` is energized; from here on the guardian waits for heartbeats. The
  /// first of a row waits until it has answered, 0.1 s at most. Throws DeviceError{lost}, and is
  /// not armed, where it is gone or does not answer.
  void arm(const std::string& role);
  /// That output is at zero; with the last of them the heartbeats end.
  void disarm(const std::string& role);
  /// Any thread: it is gone, which shows within kBeat whatever the outputs do, or it does not
  /// answer while it should, which may end.
  bool lost() const noexcept { return gone_ || unanswered_ >= guardian::kUnanswered; }
  /// "the process that guards the outputs is gone"; "" where it is not lost.
  std::string trouble() const;
  pid_t process() const { return process_; }
  /// Whether it is in the host's control group: what kills that as a whole kills both.
  bool shares_group() const { return shares_group_; }

 private:
  bool begin(const std::vector<guardian::Output>& outputs, bool in_scope);
  bool start(int end, bool in_scope);
  std::string hand_over(const std::vector<guardian::Output>& outputs);
  void give_up();
  bool say(char message);
  void listen();
  bool answers();
  void await_end(bool patiently) const;
  void beat();

  const std::function<bool()> healthy_;
  const SleepInhibitor awake_;
  int socket_ = -1;
  pid_t process_ = -1;
  bool shares_group_ = false;
  std::mutex mutex_;                // of what is said and heard, of armed_ and owed_
  std::set<std::string> armed_;     // roles whose outputs may be energized
  int owed_ = 0;                    // acknowledgements
  std::atomic<int> unanswered_{0};  // turns in a row in which one was owed and none came
  std::atomic<bool> gone_{false};
  std::atomic<bool> done_{false};
  std::thread thread_;
};

/// The amplifier under guard: armed before a current, disarmed after the last zero. Both outlive
/// it.
std::unique_ptr<CoilAmplifier> guarded(CoilAmplifier& amplifier, Guardian& guardian);
/// The same of the light: a lamp's supply goes on shining into the eye when its host is dead.
std::unique_ptr<Lamp> guarded(Lamp& lamp, Guardian& guardian);
/// The same of an instrument of a free kind, under its role's name: from the first command or
/// setting on, until it was made safe.
std::unique_ptr<Instrument> guarded(Instrument& instrument, Guardian& guardian,
                                    const std::string& role);

}  // namespace vitreo
