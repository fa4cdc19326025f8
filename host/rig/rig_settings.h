// Settings from a rig file's tables: each section is read in one function, with its bounds.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/sim/laboratory.h"
#include "devices/sim/optics_sample.h"
#include "devices/sim/pose_sensor.h"
#include "host/config/config.h"
#include "host/rig/link_load.h"
#include "host/rig/registry.h"
#include "host/rig/rig.h"
#include "host/safety/guardian/wire.h"
#include "host/safety/interlock.h"

#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

/// A role whose name the rig file chose.
struct FreeRoleSettings {
  std::string name;
  std::string kind;
  std::string measures;  // of a sensor or an actuator: "temperature"
  std::variant<Opener<Instrument>, Opener<Stage>, Opener<RotationStage>, Opener<FieldProbe>,
               Opener<OperatorInput>>
      opener;
  bool guarded = false;  // the guardian brings it to its safe state
};

struct RigSettings {
  std::string title;
  RigModel model;                  // but for the projection, which is fitted
  double projection_reach = 7e-3;  // m of aerial image for which the projection is fitted
  sim::LaboratorySettings laboratory;
  sim::OpticsSigmas optics;       // by which the laboratory's optics are off what is believed
  std::string calibration;        // file of the plant's field, "" for the model's own dipoles
  bool exact_projection = false;  // localize by the exact projection instead
  InterlockLimits limits;
  LinkLoads links;
  PausePolicy coil_pause = PausePolicy::hold;
  std::optional<HeartbeatSettings> heartbeat;  // of the amplifiers' own line, or of enable_line
  std::string chain;              // a file of what a calibration of the viewing chain found
  std::string field_calibration;  // a file of ETH's software for the model's field; empty: dipoles
  std::optional<sim::PoseSensorSettings> pose_sensor;
  bool top_camera = false;
  bool side_camera = false;
  bool sample = false;
  bool sample_by_hand = false;
  // Empty where the rig has none, or, for cameras, the simulated one.
  Opener<Camera> top, side;
  Opener<OperatorInput> joystick, pedal;
  Opener<CoilAmplifier> coils;
  Opener<EnableLine> enable_line;
  Opener<CurrentSensor> current_sensor;
  CurrentWatchSettings current_watch;
  Opener<LensMover> lens_mover;
  Opener<Stage> stage;
  Opener<RotationStage> rotation_stage;
  Opener<FieldProbe> field_probe;
  Opener<Lamp> lamp;
  double lamp_level = 0;                            // from the begin of a run on
  std::optional<HeartbeatSettings> lamp_heartbeat;  // of its own line
  std::vector<FreeRoleSettings> free_roles;         // sorted by name
  std::uint32_t dead_man_pedals =
      0;                  // a bit a pedal that must be held while the coils are energized; 0: none
  bool guardian = false;  // a process that watches the host
  std::vector<guardian::Output> guarded;  // what it zeroes
  std::vector<std::string> warnings;      ///< of what the file says, with the key, a line each
};

/// Throws ConfigError with file and line.
RigSettings read_rig_settings(ConfigReader& reader);

/// The roles that a rig file gives its instruments to, sorted, once all of it was found within its
/// bounds. Opens nothing. Throws ConfigError.
/// `kinds`, where it is not null, gets what its free roles are: "sensor", "sensor:temperature".
std::vector<std::string> check_rig(const RigDescription& rig,
                                   std::vector<std::string>* kinds = nullptr);

/// Every setting that this rig's roles and drivers read, with defaults and bounds, as far as the
/// rig is read without an error. Keys that a driver reads only where the file has them are there
/// only then.
std::vector<KnownSetting> known_settings(const RigDescription& rig);

/// What the commands to the rig's instruments cost on their links. Opens nothing. Throws
/// ConfigError.
LinkLoads link_loads(const RigDescription& rig);

}  // namespace vitreo
