// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/plant_sample.h"

#include "devices/sim/checks.h"
#include "devices/sim/hardware_sample.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <stdexcept>

namespace vitreo::sim {
namespace {

constexpr double kMostSigmas = 3;

// The parameters' streams, by Purpose::plant and a number of their own.
enum class Parameter : std::uint64_t {
  viscosity = 1,
  mass,
  size,
  coil_delay,
  coil_bandwidth,
  latency,
  background,
  heat_gain,
  top_pixel,
  side_pixel,
  tilt,
  side_turn,
  eye,
  stamp
};

std::mt19937_64 stream(std::uint64_t seed, Parameter parameter) {
  return std::mt19937_64(
      mix(seed_for(seed, Purpose::plant), static_cast<std::uint64_t>(parameter), 0));
}

// A standard normal number, cut at three standard deviations: what lies beyond is a mistake that a
// laboratory finds.
double normal(std::uint64_t seed, Parameter parameter) {
  auto random = stream(seed, parameter);
  return std::clamp(std::normal_distribution<double>()(random), -kMostSigmas, kMostSigmas);
}

// Each coordinate of one stream, cut as above.
template <class Vector>
void draw(Vector& vector, double sigma, std::uint64_t seed, Parameter parameter) {
  auto random = stream(seed, parameter);
  std::normal_distribution<double> each;
  for (double& coordinate : vector)
    coordinate = sigma * std::clamp(each(random), -kMostSigmas, kMostSigmas);
}

}  // namespace

// Viscosity: of an oil at a temperature that is known to a few degrees, and of another batch. Mass
// and size: electroplated parts under a microscope. Delay, bandwidth: what a step of the current
// shows at 15 frames/s. Latency, jitter: of an exposure's stamp to the program. Background: the
// earth's field. The fields' fall with heat: assumed, a third of its size. Pixel: of a scale read
// off a target of some 5 mm to a pixel or two. Tilt: a fifth of a degree, of a mounting by hand.
// Eye: of a place found with the side camera, two of its pixels. Stamp: of a read-out's begin in
// place of the exposure's middle, what is left of it when that is corrected.
PlantSigmas PlantSigmas::stated() {
  PlantSigmas sigmas;
  sigmas.viscosity = 0.10;
  sigmas.mass = 0.05;
  sigmas.size = 0.01;
  sigmas.coil_delay = 0.25;
  sigmas.coil_bandwidth = 0.10;
  sigmas.latency = 0.125;
  sigmas.jitter = 2e-3;
  sigmas.background = 50e-6;
  sigmas.heat_gain = 0.3;
  sigmas.pixel = 0.005;
  sigmas.tilt = 3.5e-3;
  sigmas.eye = 50e-6;
  sigmas.stamp = 1e-3;
  return sigmas;
}

void PlantSigmas::check() const {
  const auto relative = [](double sigma, const char* name) {
    if (!(sigma >= 0 && sigma < 1 / kMostSigmas))
      throw std::invalid_argument(std::string(name) + " must be in [0, 1/3)");
  };
  relative(viscosity, "viscosity_sigma");
  relative(mass, "mass_sigma");
  relative(size, "size_sigma");
  relative(coil_bandwidth, "coil_bandwidth_sigma");
  relative(coil_delay, "coil_delay_sigma");
  relative(latency, "latency_sigma");
  relative(pixel, "pixel_sigma");
  require_not_negative(tilt, "tilt_sigma");
  require_not_negative(eye, "eye_sigma");
  require_not_negative(stamp, "stamp_sigma");
  require_not_negative(heat_gain, "heat.gain_sigma");
  require_not_negative(jitter, "jitter");
  require_not_negative(background, "background_sigma");
}

std::vector<std::pair<std::string, double>> PlantSample::named() const {
  return {{"viscosity_factor", viscosity},
          {"mass_factor", mass},
          {"size_factor", size},
          {"coil_delay_factor", coil_delay},
          {"coil_bandwidth_factor", coil_bandwidth},
          {"latency_factor", latency},
          {"jitter_s", jitter},
          {"background_x_T", background.x()},
          {"background_y_T", background.y()},
          {"background_z_T", background.z()},
          {"heat_gain_factor", heat_gain},
          {"top_pixel_factor", top_pixel},
          {"side_pixel_factor", side_pixel},
          {"tilt_x_rad", tilt.x()},
          {"tilt_y_rad", tilt.y()},
          {"side_turn_rad", side_turn},
          {"eye_x_m", eye.x()},
          {"eye_y_m", eye.y()},
          {"eye_z_m", eye.z()},
          {"stamp_s", stamp}};
}

PlantSample sample_plant(const PlantSigmas& sigmas, std::uint64_t seed) {
  sigmas.check();
  PlantSample sample;
  sample.viscosity = 1 + sigmas.viscosity * normal(seed, Parameter::viscosity);
  sample.mass = 1 + sigmas.mass * normal(seed, Parameter::mass);
  sample.size = 1 + sigmas.size * normal(seed, Parameter::size);
  sample.coil_delay = 1 + sigmas.coil_delay * normal(seed, Parameter::coil_delay);
  sample.coil_bandwidth = 1 + sigmas.coil_bandwidth * normal(seed, Parameter::coil_bandwidth);
  sample.latency = 1 + sigmas.latency * normal(seed, Parameter::latency);
  sample.jitter = sigmas.jitter;
  sample.heat_gain = 1 + sigmas.heat_gain * normal(seed, Parameter::heat_gain);
  sample.top_pixel = 1 + sigmas.pixel * normal(seed, Parameter::top_pixel);
  sample.side_pixel = 1 + sigmas.pixel * normal(seed, Parameter::side_pixel);
  sample.side_turn = sigmas.tilt * normal(seed, Parameter::side_turn);
  sample.stamp = sigmas.stamp * normal(seed, Parameter::stamp);
  draw(sample.tilt, sigmas.tilt, seed, Parameter::tilt);
  draw(sample.eye, sigmas.eye, seed, Parameter::eye);
  // Three coordinates, each with its part of the magnitude.
  auto random = stream(seed, Parameter::background);
  std::normal_distribution<double> each;
  for (double& coordinate : sample.background)
    coordinate = sigmas.background / std::sqrt(3.0) * each(random);
  return sample;
}

// The robot's metal scales with the cube of its size, at the same density; `mass` is the density's.
void apply(const PlantSample& sample, WorldSettings& world) {
  world.medium.kinematic_viscosity *= sample.viscosity;
  control::Robot& robot = world.robot;
  robot.semi_axis *= sample.size;
  robot.semi_radius *= sample.size;
  if (robot.helix) robot.helix = robot.helix->scaled(sample.size);
  if (robot.tail) robot.tail = robot.tail->scaled(sample.size);
  robot.solid_volume *= sample.size * sample.size * sample.size;
  robot.solid_density *= sample.mass;
  CoilBankSettings& coils = world.coils;
  coils.delay *= sample.coil_delay;
  coils.bandwidth *= sample.coil_bandwidth;
  coils.gain_temperature_coefficient *= sample.heat_gain;
  world.field.set_uniform_background(world.field.uniform_background() + sample.background);
  if (!world.gel) return;
  // Of a gel both parts that flow: its network is as the rig file says.
  world.gel->solvent_viscosity *= sample.viscosity;
  world.gel->plastic_viscosity *= sample.viscosity;
}

// 20 A make 0.8 T in the core, and CoFe saturates at 2.3 T: 57 A. A coercive field of 80 A/m over
// the demagnetizing factor 0.06 is 1.3 kA/m of magnetization, of 640 kA/m at 20 A: 40 mA of
// remanence; a susceptibility of 2000 after a reversal makes the slope 1 / (2000 * 0.06), a
// hundredth. The field per ampere falls with the cores' and the formers' expansion and with the
// amplifiers' sense resistors, assumed 200 ppm/K.
void add_stated_truth(CoilBankSettings& coils) {
  coils.saturation = 57;
  coils.remanence = 40e-3;
  coils.reversal_slope = 0.01;
  coils.gain_temperature_coefficient = -2e-4;
}

double sampled_latency(const PlantSample& sample, double latency) {
  constexpr double kMost = 0.39;  // s: instruments ask for half a second of the past at most
  return std::min(latency * sample.latency, kMost);
}

}  // namespace vitreo::sim
