// The simulated laboratory: the world, and the instruments through which it can be seen and moved. Whoever is given the
// roles (camera, amplifier, ...) cannot reach the world behind them; the truth is handed out separately, for tests and
// reports.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/camera.h"
#include "devices/lens_mover.h"
#include "devices/sample_handler.h"
#include "devices/sim/renderer.h"
#include "devices/sim/world.h"
#include "devices/usb3103/emulator.h"
#include "optics/observer.h"
#include "optics/single_viewpoint.h"

#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::sim {

struct CameraSettings {
  ImageSize size;
  double frame_rate = 15;  // Hz
  double latency = 80e-3;  // s, from the middle of the exposure until the host has the frame
  Sensor sensor;
  void check() const;  // throws std::invalid_argument naming the parameter
};

struct LaboratorySettings {
  WorldSettings world;
  control::FieldPerturbation field_perturbation;  // of world.field, drawn from the seed
  double moment_sigma = 0.05;                     // relative, of the robot's true moment, drawn from the seed
  optics::System eye = optics::model_eye_5_3();
  optics::Microscope microscope;
  optics::ImageScale top_image;
  CameraSettings top, side;
  double side_pixel = 20.4e-6;               // m per pixel
  Eigen::Vector2d side_centre_px{328, 245};  // where the world's origin shows
  std::string fundus;                        // file of a photograph; empty: drawn
  double fundus_width = 30e-3;               // m of retina that the photograph spans
  double amperes_per_volt = 2;               // of the amplifiers behind the USB-3103
  double dac_offset = 2;                     // counts, standard deviation of the outputs' calibration, from the seed
  double lens_travel = 10e-3;                // m, of the BIOM mover, either way
  double lens_speed = 5e-3;                  // m/s
  // Imperfections of the observation itself, for tests of what the loop can and cannot see; world frame, m.
  Eigen::Vector3d truth_shift{0, 0, 0};  // added to the reported truth
  Eigen::Vector3d drawn_shift{0, 0, 0};  // added to where the cameras draw the robot
};

/// What really is, for the record and the tests. No type of the loop knows it.
struct Truth {
  Eigen::Vector3d position, axis;
  control::Currents currents;  // A, as they flow
};

class Laboratory {
 public:
  /// Everything that is drawn by chance comes from `seed`. Throws std::invalid_argument naming a parameter.
  Laboratory(const LaboratorySettings& settings, Clock& clock, std::uint64_t seed);
  ~Laboratory();
  Camera& top_camera();
  Camera& side_camera();
  LensMover& lens_mover();
  SampleHandler& sample();
  usb3103::Emulator& coil_outputs();
  /// A, per coil, asked for by amplifiers that are not behind the USB-3103.
  void drive_coils(Time now, const std::vector<double>& currents);
  /// T, as it really is at `place` (m, world frame).
  Eigen::Vector3d field(const Eigen::Vector3d& place, Time time);
  /// Nothing while no robot is in the eye. `time` may lie up to 0.5 s back.
  std::optional<Truth> truth(Time time);

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo::sim
