// Rig: the instruments by role, and the nominal model of the optics, the coils and the robot.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "control/field_model.h"
#include "control/robot.h"
#include "devices/roles/camera.h"
#include "devices/roles/current_sensor.h"
#include "devices/roles/enable_line.h"
#include "devices/roles/field_probe.h"
#include "devices/roles/instrument.h"
#include "devices/roles/lamp.h"
#include "devices/roles/lens_mover.h"
#include "devices/roles/operator_input.h"
#include "devices/roles/pose_sensor.h"
#include "devices/roles/rotation_stage.h"
#include "devices/roles/sample_handler.h"
#include "devices/roles/stage.h"
#include "host/config/config.h"
#include "host/rig/view_uncertainty.h"
#include "host/safety/interlock.h"
#include "optics/pose/pose.h"
#include "optics/rays/observer.h"

#include <Eigen/Core>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace vitreo {

struct MeasuredChain;

/// The nominal model: what the loop computes with. The real thing (or the simulated one) differs.
struct RigModel {
  optics::System eye;
  optics::Microscope microscope;
  optics::ImageScale top_image;  // pixel from aerial image
  /// The thesis' (5.2) to (5.11), fitted to the chief rays of eye and microscope.
  optics::SingleViewpoint projection;
  std::optional<optics::ExactProjection> exact;  // instead of it, where the rig asks for it
  Eigen::Vector3d eye_in_world{0, 0, -5e-3};     // m: the retina's vertex; the axes are parallel
  /// The top camera looks down without an eye, orthographic, top_image at the object: no depth.
  bool plain_view = false;
  double side_pixel = 20.4e-6;           // m per pixel of the side view, orthographic along +y
  Eigen::Vector2d side_center_px{0, 0};  // where the world's origin shows in the side view
  control::FieldModel field = control::CoilField::octomag();  // dipoles, or a measured calibration
  double command_delay = 50e-3;   // s, from a new set-point to the first change of current
  double command_bandwidth = 15;  // Hz, first order, of the coils
  std::vector<int> dead_coils;    // channels from 1 that must stay without current
  control::Robot robot;
  control::Medium medium;
  KeepOutSettings keep_out;
  ViewUncertainty uncertainty;
  /// What a calibration found that is installed (host/rig/measured_chain.h); null: none. Shared:
  /// models are copied, and a chain is large.
  std::shared_ptr<const MeasuredChain> chain{};
  std::string focus_axis = "z";            // of the stage that carries the sensor, along the light
  std::string eye_name = "model_eye_5_3";  // of the prescription that `eye` is
  std::string eye_id;                      // which one is there (sample.eye); "": not said
};

/// Commands that only a simulated rig takes. None of them returns anything of the truth.
class Simulation {
 public:
  virtual ~Simulation() = default;
  /// From now on the machine is another of the same kind: number 0 is the one that the run's seed
  /// drew. The robot is taken out; what is beyond the draw (cameras, eye) stays.
  virtual void sample_machine(std::uint64_t number) = 0;
  /// From now on the coils are those of a measured calibration, as they are: no other machine draws
  /// theirs anew. The robot is taken out. Throws std::invalid_argument for another number of coils
  /// than the machine has.
  virtual void use_calibration(const control::FieldModel& measured) = 0;
  /// The true eye becomes this one; what the rig believes stays. Throws std::invalid_argument for
  /// another kind of eye.
  virtual void set_eye(const optics::System& eye) = 0;
  /// Puts a body of the rig file elsewhere, m, world. Throws std::invalid_argument when there is
  /// none of that name.
  virtual void move_body(const std::string& name, const Eigen::Vector3d& position) = 0;
};

/// An instrument under a name that the rig file chose: a second stage, a heater, a pump.
struct FreeRole {
  std::string name;
  std::string kind;  // "stage", "rotation_stage", "field_probe", "operator_input", or a free kind
  std::variant<Instrument*, Stage*, RotationStage*, FieldProbe*, OperatorInput*> device;
};

/// Borrowed instruments; null where the rig has none.
struct Rig {
  std::string title;
  Camera* top_camera = nullptr;
  Camera* side_camera = nullptr;
  Interlock* coils = nullptr;  // the only way to the coils
  PausePolicy coil_pause = PausePolicy::hold;
  EnableLine* enable_line = nullptr;  // of the coils' amplifiers; the interlock's alone to set
  CurrentSensor* current_sensor = nullptr;
  LensMover* lens_mover = nullptr;
  OperatorInput* joystick = nullptr;
  OperatorInput* pedal = nullptr;
  SampleHandler* sample = nullptr;
  Stage* stage = nullptr;
  RotationStage* rotation_stage = nullptr;
  FieldProbe* field_probe = nullptr;
  std::vector<FreeRole> free_roles;   // sorted by name
  PoseSensor* pose_sensor = nullptr;  // simulated rigs only: the one role that gives the truth
  Simulation* simulation = nullptr;   // null as soon as one role is real
  RigModel model;
  Lamp* lamp = nullptr;
  double lamp_level = 0;  // of the full current, from the begin of a run on; every end is dark
  /// Reads the Lua file of that role's instrument anew, and opens it by what it says now; what
  /// holds the instrument holds it on. Returns the file. Throws std::invalid_argument for a role
  /// that is none of a Lua file, DeviceError{refused} while it is energized, moves, or is used by a
  /// servo loop; Reloadable.
  std::function<RigSource(const std::string& role)> reload;
  std::vector<std::string> warnings;  ///< of the rig file and its calibration files, a line each
  /// The names of the roles that are there and a script can use, sorted.
  std::vector<std::string> roles() const;
  /// Whether it has what a protocol asks for: a role, or a kind, "sensor", "sensor:temperature".
  bool has(const std::string& need) const { return !fitting(need).empty(); }
  /// The roles that are what a protocol asks for, sorted.
  std::vector<std::string> fitting(const std::string& need) const;
};

/// Gives a run the light that the rig file says; opening a rig leaves the lamp dark. Throws
/// DeviceError.
void switch_light_on(Rig& rig);

}  // namespace vitreo
