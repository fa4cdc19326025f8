// Instrument panel: the stages, the focus, the lamp and the cameras of a run that a person may
// adjust by hand while it goes on, within the limits of the rig.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/clock.h"
#include "host/record/recorder.h"
#include "host/rig/rig.h"
#include "host/session/face.h"
#include "host/session/hand_controls.h"
#include "host/session/operator_desk.h"
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
class InstrumentPanel final : public HandControls {
 public:
  InstrumentPanel(Clock& clock, Rig& rig, Recorder& recorder, const RunControl& control);
  ~InstrumentPanel() override;
  InstrumentPanel(const InstrumentPanel&) = delete;
  InstrumentPanel& operator=(const InstrumentPanel&) = delete;

  /// From here on instruments can be adjusted, until the run ends or is told to. With the clock's
  /// baton, as the end of this.
  void begin();

  /// It replaces what was asked of the same quantity and not begun.
  void adjust(const std::string& name, double value, const std::string& by) override;
  void read() override;
  /// Empty before begin().
  nlohmann::json status() const override;
  unsigned long changes() const noexcept override { return changes_.load(); }

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

/// "instrument" and "to" of a request "adjust"; neither: read only. Throws std::invalid_argument.
void read_adjustment(const nlohmann::json& request, OperatorCommand& command);

/// The panel of each run at the pace of the wall clock, for all of its faces.
class PanelFace final : public Face {
 public:
  void begin(Session& session) override;
  void end(const std::string& outcome) override;

 private:
  Session* session_ = nullptr;
  std::unique_ptr<InstrumentPanel> panel_;
};

}  // namespace vitreo::view
