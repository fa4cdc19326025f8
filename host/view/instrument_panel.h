// Instrument panel: the stages, the focus, the lamp and the cameras of a run that a person may
// adjust by hand while it goes on, within the limits of the rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/session/run_control.h"

#include <nlohmann/json.hpp>

#include <atomic>
#include <cstddef>
#include <functional>
#include <map>
#include <memory>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::view {

/// One quantity of one instrument.
struct AdjustableInfo {
  std::string name;  // "stage z", "lens_mover", "lamp", "top_camera exposure"
  std::string unit;  // "m", "rad", "s", "dB"; "%" of a ratio, which is 0 to 1
  double min = 0;    // in SI, as the rig or the instrument has it; infinite: an endless axis
  double max = 0;
  double step = 0;  // the smallest that makes sense
};

/// Any thread asks; a task of the clock carries out, so an instrument is spoken to as by a script.
/// Nothing is asked of an instrument, and nothing moves, before a person wants it. What was asked
/// for and not begun is dropped when the run is asked to end, or ends; what goes on is stopped by
/// the rig's own safe state. For a run at the pace of the wall clock: no hand has another. Who
/// adjusted what is an event "adjust"; what was read, a sample of the stream "panel_ROLE".
class InstrumentPanel {
 public:
  InstrumentPanel(Clock& clock, Rig& rig, Recorder& recorder, const RunControl& control);
  ~InstrumentPanel();
  InstrumentPanel(const InstrumentPanel&) = delete;
  InstrumentPanel& operator=(const InstrumentPanel&) = delete;

  /// From here on instruments can be adjusted, until the run ends or is told to. With the clock's
  /// baton, as the end of this.
  void begin();

  /// Asks for `value`, SI; it replaces what was asked of the same quantity and not begun. Throws
  /// std::invalid_argument for no such quantity, a value outside of its range, a run that is ending
  /// or whose instruments cannot be adjusted.
  void adjust(const std::string& name, double value, const std::string& by);
  /// Asks that all are read anew. Throws std::invalid_argument as adjust() does.
  void read();

  /// [{"name", "unit", "min", "max", "step", "value", "busy", "by", "refused"}]; a value that is
  /// not known, and an end that is infinite, are null. Empty before begin().
  nlohmann::json status() const;
  unsigned long changes() const noexcept { return changes_.load(); }

 private:
  struct Knob {
    AdjustableInfo info;
    std::optional<double> value{};
    bool busy = false;
    std::string by{};       // whose hand was the last
    std::string refused{};  // why the last one was not carried out; empty: it was
  };
  /// The knobs of one role, read in one go.
  struct Device {
    std::string role;
    std::vector<Knob> knobs;
    std::function<std::vector<double>()> read;
    std::function<void(std::size_t knob, double value)> set;  // returns when it is there
    int stream = -1;
  };
  struct Wanted {
    double value = 0;
    std::string by{};
  };

  void add_stage(const std::string& role, Stage& stage);
  void add_rotation_stage(const std::string& role, RotationStage& stage);
  void add_lens_mover();
  void add_lamp();
  void add_camera(const std::string& role, Camera* Rig::*slot);
  void work();
  void ask_cameras();
  void read_all();
  void read_device(Device& device);
  bool take(std::string& name, Wanted& wanted);
  void carry_out(const std::string& name, const Wanted& wanted);
  std::pair<Device*, std::size_t> find(const std::string& name);
  void check_open() const;
  bool ending() const;

  Clock& clock_;
  Rig& rig_;
  Recorder& recorder_;
  const RunControl& control_;
  bool open_ = false;
  bool cameras_asked_ = false;
  mutable std::mutex mutex_;  // of what follows; never held while an instrument is spoken to
  std::vector<std::unique_ptr<Device>> devices_;
  std::map<std::string, Wanted> wanted_;
  bool read_wanted_ = false;
  std::atomic<unsigned long> changes_{0};
  std::unique_ptr<Task> task_;  // last: it uses the others
};

}  // namespace vitreo::view
