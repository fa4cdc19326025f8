// Safety interlock: decorator of the coil amplifier that enforces limits and cannot be by-passed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/coil_amplifier.h"
#include "devices/time/clock.h"
#include "host/safety/coil_rest.h"
#include "host/safety/coil_temperature.h"
#include "host/safety/current_watch.h"
#include "host/safety/heartbeat_line.h"
#include "host/safety/read_back.h"

#include <atomic>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

struct InterlockLimits {
  double current = 12;        // A, per channel
  double total_current = 60;  // A, sum of magnitudes
  /// A/s: largest change of a channel since the last set-point, over the time between.
  double slew = 2000;
  /// s, within which every heartbeat must come while the coils are energized.
  double dead_man = 0.25;
  CoilHeat heat{};
  /// A: by which a current that is measured may be outside of what was set lately.
  double read_back = 0.25;
  void check() const;  // throws std::invalid_argument naming the limit
};

/// What the coils have carried so far.
struct CoilUse {
  std::vector<double> peak;        // A, largest magnitude of each channel
  double peak_total = 0;           // A, largest sum of magnitudes
  double energized = 0;            // s with any current; without a clock 0
  std::vector<std::string> trips;  // why it opened, in order
};

/// What the coils may do while the field is paused.
enum class PausePolicy { hold, ramp, zero };

/// Refuses (DeviceError{refused}, the outputs go to zero) what is beyond a limit or not a number.
/// After make_safe(), or a trip, it stays at zero, and refuses, until enable(). Without a clock the
/// rules of time (slew, heat, dead-man) rest.
class Interlock : public CoilAmplifier {
 public:
  Interlock(CoilAmplifier& amplifier, const InterlockLimits& limits, Clock* clock = nullptr);
  ~Interlock() override;
  std::string identity() const override { return amplifier_.identity(); }
  int channels() const override { return amplifier_.channels(); }
  double current_limit() const override;
  double total_limit() const { return limits_.total_current; }  // A, sum of magnitudes
  void set_currents(std::span<const double> currents) override;
  /// The nearest set-point to these that the slew limit lets through now. Two frames that come in
  /// one burst make two set-points at once; a loop sends what is reachable, and the rest with its
  /// next step.
  std::vector<double> reachable(std::span<const double> currents) const;
  std::vector<double> currents() const override { return amplifier_.currents(); }
  std::optional<std::vector<double>> measured_currents() override {
    return amplifier_.measured_currents();
  }
  LinkState link_state() const override { return amplifier_.link_state(); }
  void make_safe() override;
  bool enabled() const { return enabled_; }
  /// Lets set-points through again; the outputs stay at zero until one comes.
  void enable();

  /// A loop that must stay alive for the coils to stay energized: it beats at each turn. It lives
  /// as long as the loop.
  class Heartbeat {
   public:
    Heartbeat(Interlock& interlock, std::string name);
    ~Heartbeat();
    Heartbeat(const Heartbeat&) = delete;
    Heartbeat& operator=(const Heartbeat&) = delete;
    void beat();

   private:
    friend class Interlock;
    Interlock& interlock_;
    const std::string name_;
    Time last_;
  };

  /// Currents that no loop sets are let for so long: without another hold_for() until then they go
  /// to zero, which is a trip. Of a script that sets them itself, and may stand still or forget
  /// them. A zero ends it, and while a loop beats it rests.
  void hold_for(Time duration);

  /// A condition under which a current may flow, beside the heartbeats (a pedal that is held);
  /// `why` says that it does not hold. Asked before the coils are energized and every 50 ms while
  /// they are; must not throw.
  void require(std::string why, std::function<bool()> holds);

  /// Of a loop that knows where its robot is, each turn before its set-point: how near the surface
  /// is to a wall, and how fast the currents alone drive it there.
  struct Nearness {
    std::string wall;   // "retina"
    double bound = 0;   // m, the clearance's lower bound
    double margin = 0;  // m
    double push = 0;    // m/s, towards the wall
  };
  /// Inside the margin, pushed for a second without getting away: a trip, as a set-point beyond a
  /// limit is. Currents that carry the robot, or lead it away, are let: at zero it would sink.
  /// Nothing: the robot is not seen, or may touch.
  void near(const std::optional<Nearness>& now);

  /// From here on the line beats while a current may flow, and as long as the watch, every
  /// heartbeat and every condition let it; its end is a trip. A first set-point waits for its
  /// pick-up. The line outlives this. Wants a clock.
  void beat_on(EnableLine& line, const HeartbeatSettings& settings);

  /// From here on, while a current flows, what the sensor measures is compared with what was set; a
  /// contradiction is a trip. The sensor outlives this. Wants a clock. Throws std::invalid_argument
  /// for a coil that there is not.
  void watch_by(CurrentSensor& sensor, const CurrentWatchSettings& settings);
  /// Reads the currents back, by the sensor or the amplifier itself, until they count as zero, for
  /// half a second at most: after make_safe(). Throws nothing but Stopped.
  CoilRest read_rest();
  /// Called with what was read back after each make_safe() of coils that carried a current.
  void on_rest(std::function<void(const CoilRest&)> listener) { on_rest_ = std::move(listener); }

  /// Opens at once, the coils at zero, and says why: to `on_trip` and in each refusal until it is
  /// enabled again.
  void trip(const std::string& why) { trip(Trip{why, false}); }
  struct Trip {
    std::string why;
    bool broken = false;  ///< an instrument does not do what it was told, or is gone
  };
  void on_trip(std::function<void(const Trip&)> listener) { on_trip_ = std::move(listener); }
  /// Why it is open; empty when it is not, or when it was asked to.
  const std::string& tripped() const { return tripped_; }
  /// Whether there is a loop that must stay alive.
  bool has_loop() const { return !heartbeats_.empty(); }
  /// Any thread: whether a current may flow.
  bool energized() const noexcept { return energized_; }
  std::vector<double> temperatures();  // K, estimated; empty without a clock
  const CoilUse& use() const { return use_; }

  /// The coils go to zero (zero: at once; ramp: within 0.5 s); set-points are dropped, not queued,
  /// until resume().
  void pause(PausePolicy policy);
  /// Throws DeviceError when the amplifier does not read back zero, so that no
  /// loop continues on a wrong state.
  void resume();

 private:
  void check(std::span<const double> currents);
  void check_slew(std::span<const double> currents);
  double largest_step() const;
  [[noreturn]] void refuse(const std::string& why);
  void send(std::span<const double> currents);
  void count(std::span<const double> currents);
  void warm_up();
  void forget_slew();
  void watch();
  std::string late_heartbeat() const;
  std::string outlived() const;
  std::string beat_forbidden() const;
  void start_beat();
  void stop_beat();
  std::string fault() const;
  void trip(const Trip& trip);
  void trip_quietly(const std::string& why);
  std::string listen_for(Time period);
  void look();
  void ask_amplifier();
  std::string unmet() const;
  std::optional<std::vector<double>> currents_now();
  void report_rest();
  void note_set(Time at);

  CoilAmplifier& amplifier_;
  const InterlockLimits limits_;
  Clock* const clock_;
  bool enabled_ = true;
  bool paused_ = false;
  std::atomic<bool> energized_{false};
  std::string tripped_;
  std::function<void(const Trip&)> on_trip_;
  std::function<void(const CoilRest&)> on_rest_;
  bool rest_due_ = false;  // made safe, and not read back yet
  Time zeroed_at_{};
  Time zero_since_{};  // at zero, with the line beating
  CoilTemperature temperature_;
  std::vector<double> sent_;  // A
  Time sent_at_{};
  ReadBack read_back_;
  Time asked_at_{};
  Time warmed_at_{};
  std::vector<Heartbeat*> heartbeats_;
  struct Condition {
    std::string why;
    std::function<bool()> holds;
  };
  std::vector<Condition> conditions_;
  Signal energized_changed_;
  CoilUse use_;
  struct Pushed {
    Time since;
    double bound;  // m, then
  };
  std::optional<Pushed> pushed_;          // against a wall, inside the margin
  Time watched_at_{};                     // the watch's last turn
  std::unique_ptr<HeartbeatLine> line_;   // null: none
  Time answer_within_{};                  // where there is a line
  std::unique_ptr<CurrentWatch> sensed_;  // null: none
  struct Hold {
    Time since{};
    Time duration{};
  };
  std::optional<Hold> hold_;  // of currents that a script set
  std::unique_ptr<Task> watch_;
};

}  // namespace vitreo
