// Watch of the lamp: decorator that asks it while it burns, and lets its heartbeat line beat; what
// fails darkens it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/lamp.h"
#include "devices/time/clock.h"
#include "host/safety/heartbeat_line.h"

#include <functional>
#include <memory>
#include <string>

namespace vitreo {

/// No set-point follows for a light that is held, as for a current that is held (Interlock).
class WatchedLamp final : public Lamp {
 public:
  /// `failed`: why it has been darkened, or what of it cannot be; must not throw. Lamp and clock
  /// outlive this.
  WatchedLamp(Lamp& lamp, Clock& clock, std::function<void(const std::string&)> failed);
  /// From here on the lamp's own line beats while it burns and as long as the watch turns; its end
  /// darkens the lamp. A first level waits for its pick-up. Wants lamp.enable_line().
  void beat(const HeartbeatSettings& settings);

  std::string identity() const override { return lamp_.identity(); }
  void set_level(double level) override;
  double level() const override { return lamp_.level(); }
  void ask() override { lamp_.ask(); }
  LinkState link_state() const override { return lamp_.link_state(); }
  void make_safe() override;
  EnableLine* enable_line() override { return lamp_.enable_line(); }

 private:
  void watch();
  std::string listen_for(Time period);
  void look();
  void start_beat();
  void fail(const std::string& why);
  std::string beat_forbidden() const;

  Lamp& lamp_;
  Clock& clock_;
  const std::function<void(const std::string&)> failed_;
  bool lit_ = false;    // it may burn
  int darkenings_ = 0;  // calls of make_safe()
  std::string told_;    // the last failure, which is told once
  Time dark_since_{};   // with the line beating
  Time asked_at_{};
  Time watched_at_{};  // the watch's last turn
  Signal changed_;
  std::unique_ptr<HeartbeatLine> line_;  // null: none
  Time answer_within_{};                 // where there is one
  std::unique_ptr<Task> watch_;          // last: it uses the others
};

}  // namespace vitreo
