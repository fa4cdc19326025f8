// Simulated laboratory: the world and its instruments. The roles (camera, amplifier, ...) give no
// access to the world behind them; the truth is handed out separately, for tests and reports.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/pololu_tic/driver.h"
#include "devices/instruments/pololu_tic/emulator.h"
#include "devices/instruments/usb3103/emulator.h"
#include "devices/roles/camera.h"
#include "devices/roles/sample_handler.h"
#include "devices/sim/faults.h"
#include "devices/sim/hardware_sample.h"
#include "devices/sim/plant_sample.h"
#include "devices/sim/probe.h"
#include "devices/sim/renderer.h"
#include "devices/sim/simulated_camera.h"
#include "devices/sim/stage_play.h"
#include "devices/sim/truth.h"
#include "devices/sim/world.h"
#include "optics/projection/single_viewpoint.h"
#include "optics/rays/observer.h"

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::sim {

/// Kind of top camera: a microscope on the aerial image, a bare sensor in it (thesis chapter 4;
/// turned about the axis by the rotation stage, appendix A), or a microscope without an eye below
/// it.
enum class TopView { microscope, bare_sensor, plain };

struct LaboratorySettings {
  WorldSettings world;
  control::FieldPerturbation field_perturbation;  // of world.field, sampled from the seed
  double moment_sigma = 0.05;  // relative, of the robot's true moment, sampled from the seed
  double roll_sigma = 0;       // rad, about world.roll, sampled from the seed
  PlantSigmas sigmas;          // of the plant's other parameters, sampled from the seed
  std::optional<HandTuning> hand_tuning;  // before the run; nothing: untrimmed
  control::FieldModel believed_field = control::CoilField::octomag();  // the operator tuned by it
  std::vector<std::pair<std::string, double>> drawn_bench;  // as OpticsSample names it, for drawn()
  optics::System eye = optics::model_eye_5_3();
  optics::Microscope microscope;
  optics::ImageScale top_image;
  CameraSettings top;
  CameraSettings side;
  TopView top_view = TopView::microscope;
  PlainMicroscope plain;           // of the view without an eye
  double sensor_aperture = 0.159;  // NA of the eye's pupil, seen from a bare sensor (thesis 4.1)
  // soft robots are drawn as the crossed plates they are; the localizer's are ellipsoids
  bool plates = true;
  // m/s: fastest speed at which the retina's picture alone goes to and fro, by 1.5 mm either way.
  float fundus_drift = 0;
  ProbeSettings probe;
  StagePlaySettings stage_play;              // of what the microscope or the sensor stands on
  double side_pixel = 20.4e-6;               // m per pixel
  Eigen::Vector2d side_center_px{328, 245};  // where the world's origin shows
  double side_turn = 0;                      // rad, of the side camera about its line of sight
  std::string fundus;                        // file of a photograph; empty: drawn
  double fundus_width = 30e-3;               // m of retina that the photograph spans
  double amperes_per_volt = 2;               // of the amplifiers behind the USB-3103
  std::optional<int> enable_line;            // of the USB-3103, as a heartbeat line
  double dac_offset = 2;  // counts, standard deviation of the outputs' calibration, from the seed
  pololu_tic::Settings lens;  // of the BIOM's motor: how far a step of it moves the lens
  // Imperfections of the observation itself, for tests of what the loop can see; world frame, m.
  Eigen::Vector3d truth_shift{0, 0, 0};  // added to the reported truth
  Eigen::Vector3d drawn_shift{0, 0, 0};  // added to where the cameras draw the robot
};

/// The plant of a machine: the settings' with everything sampled from its seed, what the operator's
/// tuning left included. The World that the laboratory simulates is made of it.
WorldSettings sampled_world(const LaboratorySettings& settings, std::uint64_t seed);

class Laboratory {
 public:
  /// Everything random comes from `seed`. Throws std::invalid_argument naming a parameter.
  Laboratory(const LaboratorySettings& settings, Clock& clock, std::uint64_t seed);
  ~Laboratory();
  Camera& top_camera();
  Camera& side_camera();
  /// The BIOM's motor, homed before the run; the lens stands at its nominal position.
  pololu_tic::Emulator& lens_motor();
  SampleHandler& sample();
  /// What the microscope or the bare sensor stands on, by drivers' emulators: m along the light
  /// from its nominal focus, and rad about the axis (bare sensor only), at a time up to a second
  /// back. Nothing: it stands still at 0.
  void carry_sensor(std::function<double(Time)> position);
  void turn_sensor(std::function<double(Time)> angle);
  /// The same for the field probe: m, world frame.
  void carry_probe(std::function<Eigen::Vector3d(Time)> position);
  FieldProbe& field_probe();
  usb3103::Emulator& coil_outputs();
  /// The light in the eye, part of what it was made with, from now on; 1 by default. The side
  /// view has its own.
  void set_light(double level);
  /// Injected faults of the instruments, to be set at any time.
  Faults& faults();
  /// After a change of faults().lens: its motor loses its steps, or its limit switch cuts it off.
  void apply_lens_faults();
  /// After a change of saturation, cut_off or coil_response of faults(): the amplifiers give what
  /// they now can.
  void apply_coil_faults();
  /// A, per coil, asked for by amplifiers that are not behind the USB-3103.
  void drive_coils(Time now, const std::vector<double>& currents);
  /// The amplifiers' heartbeat line, where settings.world.coils.one_shot stands behind it.
  void set_enable_line(bool high);
  /// T, as it really is at `position` (m, world frame).
  Eigen::Vector3d field(const Eigen::Vector3d& position, Time time);
  /// Another machine of the same kind, its plant sampled from `seed`; without a robot, its currents
  /// zero until the next set-point. The cameras stay.
  void redraw(std::uint64_t seed);
  /// The machine of the last seed with coils that are exactly these, for every later sample too, in
  /// the background that there is. Throws std::invalid_argument for another number of coils.
  void use_field(const control::FieldModel& field);
  /// Another eye stands there from now on, of any build (lens_groups.h), in the same cavity: its
  /// retina is to be the settings' one. Throws std::invalid_argument when it is unsound, or no eye
  /// before a condensing lens.
  void set_eye(const optics::System& eye);
  /// Another robot, and another medium, from now on, in the machine of the last seed; without a
  /// robot in it. `gel`: nothing for the fluid.
  void change(const control::Robot& robot, const std::optional<control::Gel>& gel);
  /// Puts a body of the settings elsewhere (m, world). Throws std::invalid_argument naming it.
  void move_body(const std::string& name, const Eigen::Vector3d& position);
  /// What the top camera sees, with the noise of frame `number`. Drawn by the call of what is
  /// returned: once, before this object ends, by any thread, beside whatever else is done here.
  Picture expose_top(Time exposed, std::uint64_t number);
  Picture expose_side(Time exposed, std::uint64_t number);
  /// The same, drawn at once.
  cv::Mat top_image(Time exposed, std::uint64_t number);
  cv::Mat side_image(Time exposed, std::uint64_t number);
  /// Nothing while no robot is in the eye. `time` may lie up to a second back.
  std::optional<Truth> truth(Time time);
  /// At `time`, or now where that is past.
  CoilTruth coils(Time time);
  /// What was drawn of machine and bench, with the moment: a name and value each, for the record.
  std::vector<std::pair<std::string, double>> drawn() const;
  /// Counts the machines that there have been: it rises with each redraw().
  int machines() const;
  /// s: of an instrument in this laboratory, where it should be `latency`.
  double latency_of(double latency) const;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::sim
