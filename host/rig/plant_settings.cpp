// SPDX-License-Identifier: Apache-2.0
#include "host/rig/plant_settings.h"

#include "host/rig/field_calibration_yaml.h"
#include "host/text/units.h"

#include <bit>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr double kPlantMilli = 1e-3;

/// machine = "sampled", the default: all that a laboratory does not know of its plant is drawn.
/// "coils": the coils' geometry, the moment and the converter's offsets alone. "nominal": nothing
/// is drawn, and the coils are without what is in no model. Single settings beside it still count.
void read_machine(ConfigReader& reader, sim::LaboratorySettings& laboratory) {
  const std::string machine = reader.choice("machine", "sampled", {"sampled", "coils", "nominal"});
  laboratory.world.wall_drag = machine == "sampled";
  if (machine == "sampled") {
    laboratory.sigmas = sim::PlantSigmas::stated();
    sim::add_stated_truth(laboratory.world.coils);
  }
  if (machine != "nominal") return;
  laboratory.field_perturbation = {0, 0, 0};
  laboratory.moment_sigma = 0;
  laboratory.dac_offset = 0;
}

/// bench = "sampled": eye, condensing lens, microscope and retina are drawn about what the rig
/// believes, as those of a bench set up by hand are off. "believed", the default: they are as
/// believed. Single sigmas beside it still count.
void read_optics(ConfigReader reader, sim::OpticsSigmas& sigmas) {
  const std::string bench = reader.choice("bench", "believed", {"sampled", "believed"});
  if (bench == "sampled") sigmas = sim::OpticsSigmas::stated();
  const auto length = [&reader](const char* key, double& sigma) {
    sigma = reader.number(key, sigma, {0, 2 * kPlantMilli, "m"});
  };
  sigmas.pupil_power = reader.number("pupil_power_sigma", sigmas.pupil_power, {0, 5, "1/m"});
  sigmas.microscope_tilt =
      reader.number("microscope_tilt_sigma", sigmas.microscope_tilt, {0, 0.05, "rad"});
  sigmas.pixel = reader.number("pixel_sigma", sigmas.pixel, {0, 0.1, ""});
  const auto angle = [&reader](const char* key, double& sigma) {
    sigma = reader.number(key, sigma, {0, 0.1, "rad"});
  };
  angle("lens_tilt_sigma", sigmas.lens_tilt);
  angle("eye_rotation_sigma", sigmas.eye_rotation);
  angle("inner_lens_tilt_sigma", sigmas.inner_lens_tilt);
  length("lens_aside_sigma", sigmas.lens_aside);
  length("inner_lens_aside_sigma", sigmas.inner_lens_aside);
  length("stage_backlash_sigma", sigmas.stage_backlash);
  length("stage_noise", sigmas.stage_noise);
  length("object_plane_sigma", sigmas.object_plane);
  length("center_sigma", sigmas.center);
  length("lens_axial_sigma", sigmas.lens_axial);
  length("axial_length_sigma", sigmas.axial_length);
  length("retina_depth_sigma", sigmas.retina_depth);
  length("retina_curvature_sigma", sigmas.retina_curvature);
  reader.finish();
}

// Relative, but for background and jitter. A third at most: three of them leave something.
void read_sigmas(ConfigReader& reader, sim::PlantSigmas& sigmas) {
  const auto relative = [&reader](const char* key, double& sigma) {
    sigma = reader.number(key, sigma, {0, 0.33, ""});
  };
  relative("viscosity_sigma", sigmas.viscosity);
  relative("mass_sigma", sigmas.mass);
  relative("size_sigma", sigmas.size);
  relative("coil_delay_sigma", sigmas.coil_delay);
  relative("coil_bandwidth_sigma", sigmas.coil_bandwidth);
  relative("latency_sigma", sigmas.latency);
  relative("pixel_sigma", sigmas.pixel);
  sigmas.tilt = reader.number("tilt_sigma", sigmas.tilt, {0, 0.05, "rad"});
  sigmas.eye = reader.number("eye_sigma", sigmas.eye, {0, 1 * kPlantMilli, "m"});
  sigmas.stamp = reader.number("stamp_sigma", sigmas.stamp, {0, 0.02, "s"});
  sigmas.jitter = reader.number("jitter", sigmas.jitter, {0, 0.1, "s"});
  sigmas.background =
      reader.number("background_sigma", sigmas.background, {0, 1 * kPlantMilli, "T"});
}

// What the draws are about: by default what the loop believes.
void read_medium(ConfigReader reader, control::Medium& medium) {
  medium.density = reader.number("density", medium.density, {500, 3000, "kg/m^3"});
  medium.kinematic_viscosity =
      reader.number("kinematic_viscosity", medium.kinematic_viscosity, {1e-7, 1, "m^2/s"});
  reader.finish();
}

// Factors of what the loop believes of the robot.
void read_robot(ConfigReader reader, sim::WorldSettings& world) {
  sim::PlantSample factors;
  factors.mass = reader.number("mass", 1, {0.1, 10, ""});
  factors.size = reader.number("size", 1, {0.1, 10, ""});
  world.moment_gain = reader.number("moment", world.moment_gain, {0.1, 10, ""});
  sim::apply(factors, world);
  reader.finish();
}

void read_core(ConfigReader reader, sim::CoilBankSettings& coils) {
  coils.saturation = reader.number("saturation", coils.saturation, {0, 1000, "A"});
  coils.remanence = reader.number("remanence", coils.remanence, {0, 1, "A"});
  coils.reversal_slope = reader.number("reversal_slope", coils.reversal_slope, {0, 1, ""});
  reader.finish();
}

// C T' = I^2 R(T) - (T - T_ambient) / R_th with R = R_0 (1 + alpha (T - T_ambient)); the current is
// at most the supply's voltage over R (docs/simulated_laboratory.md). Ohm, 1/K, J/K, K/W, K and V,
// which a rig file gives as plain numbers.
// The field per ampere gains `gain_temperature_coefficient` a kelvin.
void read_heat(ConfigReader reader, sim::CoilBankSettings& coils, sim::PlantSigmas& sigmas) {
  coils.resistance = reader.number("resistance", coils.resistance, {1e-3, 1000, ""});
  coils.temperature_coefficient =
      reader.number("temperature_coefficient", coils.temperature_coefficient, {0, 0.1, ""});
  coils.heat_capacity = reader.number("heat_capacity", coils.heat_capacity, {1e-3, 1e6, ""});
  coils.thermal_resistance =
      reader.number("thermal_resistance", coils.thermal_resistance, {1e-4, 1000, ""});
  coils.ambient = reader.number("ambient", coils.ambient, {200, 400, ""});
  coils.supply_voltage = reader.number("supply_voltage", coils.supply_voltage, {0.1, 10000, ""});
  coils.gain_temperature_coefficient = reader.number(
      "gain_temperature_coefficient", coils.gain_temperature_coefficient, {-4e-3, 4e-3, ""});
  sigmas.heat_gain = reader.number("gain_sigma", sigmas.heat_gain, {0, 1, ""});
  reader.finish();
}

void read_coils(ConfigReader& reader, sim::CoilBankSettings& coils, sim::PlantSigmas& sigmas) {
  coils.bandwidth = reader.number("coil_bandwidth", coils.bandwidth, {0.1, 10000, "Hz"});
  coils.delay = reader.number("coil_delay", coils.delay, {0, 0.3, "s"});
  coils.noise = reader.number("current_noise", coils.noise, {0, 1, "A"});
  for (const double coil : reader.numbers("dead_coils", {}, {1, control::kMaxCoils, ""})) {
    if (coil != std::floor(coil))
      reader.fail("dead_coils", "must be whole numbers: coils count from 1");
    coils.dead.push_back(static_cast<int>(coil));
  }
  read_heat(reader.table("heat"), coils, sigmas);
  read_core(reader.table("core"), coils);
}

void read_field(ConfigReader& reader, sim::LaboratorySettings& laboratory,
                std::string& calibration) {
  calibration = reader.text("calibration", "");
  control::FieldPerturbation& field = laboratory.field_perturbation;
  // A measured field is the machine as it is: sigmas, where they are given, come on top of it.
  if (!calibration.empty()) field = {0, 0, 0};
  field.gain = reader.number("coil_gain_sigma", field.gain, {0, 0.5, ""});
  field.position = reader.number("coil_position_sigma", field.position, {0, 0.02, "m"});
  field.axis = reader.number("coil_axis_sigma", field.axis, {0, 0.5, "rad"});
  laboratory.world.field.set_uniform_background(
      reader.vector3("background", {0, 0, 0}, {-10 * kPlantMilli, 10 * kPlantMilli, "T"}));
}

// A named gel with single values replaced; the yield strain is a strain, the moduli are in Pa, the
// viscosities in Pa s.
void read_gel(ConfigReader reader, std::optional<control::Gel>& gel) {
  gel = control::gel_named(reader.choice("name", "gel_1", control::gel_names()));
  gel->storage_modulus = reader.number("storage_modulus", gel->storage_modulus, {1e-3, 1e5, ""});
  gel->yield_strain = reader.number("yield_strain", gel->yield_strain, {1e-3, 100, ""});
  gel->solvent_viscosity =
      reader.number("solvent_viscosity", gel->solvent_viscosity, {1e-4, 1000, ""});
  gel->plastic_viscosity =
      reader.number("plastic_viscosity", gel->plastic_viscosity, {1e-4, 1000, ""});
  gel->density = reader.number("density", gel->density, {500, 3000, "kg/m^3"});
  reader.finish();
}

// Where the table stands at all, the operator has trimmed by hand before the run, within
// `tolerance` of drift.
void read_tuning(ConfigReader reader, std::optional<sim::HandTuning>& tuning) {
  tuning.emplace();
  tuning->tolerance = reader.number("tolerance", tuning->tolerance, {0, 10 * kPlantMilli, "m/s"});
  tuning->field = reader.number("field", tuning->field, {1 * kPlantMilli, 0.1, "T"});
  tuning->axis = reader.vector3("axis", tuning->axis, {-1, 1, ""});
  if (!(tuning->axis.norm() > 1e-6)) reader.fail("axis", "must be a direction");
  reader.finish();
}

sim::BodySettings read_body(ConfigReader reader, const std::string& name) {
  sim::BodySettings body;
  body.name = name;
  const std::string shape = reader.choice("shape", "disc", {"disc", "rod", "spheroid"});
  body.shape = shape == "rod"    ? sim::Shape::rod
               : shape == "disc" ? sim::Shape::disc
                                 : sim::Shape::spheroid;
  body.semi_axis = reader.number("semi_axis", body.semi_axis, {1e-6, 50 * kPlantMilli, "m"});
  body.semi_radius = reader.number("semi_radius", body.semi_radius, {1e-6, 50 * kPlantMilli, "m"});
  body.position =
      reader.vector3("position", body.position, {-20 * kPlantMilli, 20 * kPlantMilli, "m"});
  body.axis = reader.vector3("axis", body.axis, {-1, 1, ""});
  body.density = reader.number("density", body.density, {500, 30000, "kg/m^3"});
  body.fixed = reader.flag("fixed", body.fixed);
  const Eigen::Vector3d color =
      reader.vector3("color", {body.color[0], body.color[1], body.color[2]}, {0, 1, ""});
  body.color = {color[0], color[1], color[2]};
  body.dotted = reader.flag("dotted", body.dotted);
  body.dot_pitch = reader.number("dot_pitch", body.dot_pitch, {10e-6, 10 * kPlantMilli, "m"});
  reader.finish();
  return body;
}

using CoilFields = Eigen::Matrix<double, 3, Eigen::Dynamic>;

/// T/A of each coil at the workspace's center.
CoilFields fields_at_center(const control::FieldModel& model) {
  return model.matrix(Eigen::Vector3d::Zero()).topRows<3>();
}

/// Entry k: the channel, from 1, that drives coil k of the file. A file that numbers the same coils
/// in another order is wired by where they point; one that fits as it is, or in no order, is left
/// as it is.
/// By the fields' directions at the center, since gains may differ.
std::vector<int> wiring(const control::FieldModel& measured, const control::FieldModel& before) {
  // Of the mean cosine between coils that are taken for the same; a neighbor of an OctoMag's coil
  // is at 0.5 or less.
  constexpr double kAlike = 0.9;
  constexpr double kUnlike = 0.7;
  const CoilFields from = fields_at_center(measured).colwise().normalized(),
                   to = fields_at_center(before).colwise().normalized();
  const Eigen::MatrixXd cosine = from.transpose() * to;
  const auto coils = static_cast<std::size_t>(cosine.rows());
  std::vector<int> channels(coils);
  for (std::size_t k = 0; k < coils; ++k) channels[k] = static_cast<int>(k) + 1;
  if (cosine.diagonal().mean() > kUnlike) return channels;
  // Assignment problem, by dynamic programming over sets (Held & Karp 1962): best[set] is the
  // largest sum of cosines of the first |set| coils on exactly these channels. 2^8 sets of 8 coils.
  const std::size_t sets = std::size_t{1} << coils;
  std::vector<double> best(sets, -1e9);
  std::vector<std::size_t> last(sets, 0);
  best[0] = 0;
  for (std::size_t set = 0; set + 1 < sets; ++set) {
    const auto coil = static_cast<Eigen::Index>(std::popcount(set));
    for (std::size_t channel = 0; channel < coils; ++channel) {
      const std::size_t with = set | (std::size_t{1} << channel);
      const double sum = best[set] + cosine(coil, static_cast<Eigen::Index>(channel));
      if (with == set || sum <= best[with]) continue;
      best[with] = sum;
      last[with] = channel;
    }
  }
  if (best[sets - 1] < kAlike * static_cast<double>(coils)) return channels;
  for (std::size_t set = sets - 1, coil = coils; coil-- > 0; set ^= std::size_t{1} << last[set])
    channels[coil] = static_cast<int>(last[set]) + 1;
  return channels;
}

/// The field with its coils in the order of the channels that drive them.
control::MultipoleField rewired(const control::MultipoleField& field,
                                const std::vector<int>& channels) {
  std::vector<control::MultipoleField::Sources> coils(channels.size());
  for (std::size_t k = 0; k < channels.size(); ++k)
    coils[static_cast<std::size_t>(channels[k]) - 1] = field.sources()[k];
  return {std::move(coils), field.background_sources(), field.region()};
}

/// The units are the file's word only: a decimal comma, or coefficients of another unit, would make
/// a field that no coil has.
void check_strength(const control::FieldModel& field) {
  constexpr double kStrongest = 1;  // T/A; OctoMag's coils make 2 to 3 mT/A
  const CoilFields fields = fields_at_center(field);
  for (Eigen::Index k = 0; k < fields.cols(); ++k) {
    const double strength = fields.col(k).norm();
    const std::string coil = "coil " + std::to_string(k + 1);
    if (!(strength > 0))
      throw std::invalid_argument(coil + " makes no field at the workspace's center");
    if (!(strength < kStrongest))
      throw std::invalid_argument(
          coil + " makes " + format_number(strength, 3) +
          " T per ampere at the workspace's center: coefficients are T/A and m");
  }
}

}  // namespace

void read_plant(ConfigReader reader, sim::LaboratorySettings& laboratory, sim::OpticsSigmas& optics,
                std::string& calibration) {
  sim::WorldSettings& world = laboratory.world;
  read_machine(reader, laboratory);
  read_optics(reader.table("optics"), optics);
  read_sigmas(reader, laboratory.sigmas);
  read_field(reader, laboratory, calibration);
  read_coils(reader, world.coils, laboratory.sigmas);
  read_medium(reader.table("medium"), world.medium);
  read_robot(reader.table("robot"), world);
  laboratory.moment_sigma = reader.number("moment_sigma", laboratory.moment_sigma, {0, 0.3, ""});
  laboratory.dac_offset = reader.number("dac_offset_sigma", laboratory.dac_offset, {0, 200, ""});
  world.roll = reader.number("roll", world.roll, {-M_PI, M_PI, "rad"});
  laboratory.plates = reader.choice("drawn_as", "plates", {"plates", "ellipsoid"}) == "plates";
  laboratory.roll_sigma = reader.number("roll_sigma", laboratory.roll_sigma, {0, M_PI, "rad"});
  if (reader.has("hand_tuning")) read_tuning(reader.table("hand_tuning"), laboratory.hand_tuning);
  if (reader.has("gel")) read_gel(reader.table("gel"), world.gel);
  world.friction = reader.number("friction", world.friction, {0, 2, ""});
  world.wall_drag = reader.flag("wall_drag", world.wall_drag);
  world.flow = reader.vector3("flow", world.flow, {-10 * kPlantMilli, 10 * kPlantMilli, "m/s"});
  ConfigReader bodies = reader.table("bodies");
  for (const std::string& name : bodies.keys())
    world.bodies.push_back(read_body(bodies.table(name), name));
  bodies.finish();
  laboratory.fundus = reader.text("fundus", laboratory.fundus);
  laboratory.fundus_width =
      reader.number("fundus_width", laboratory.fundus_width, {1 * kPlantMilli, 0.2, "m"});
  laboratory.fundus_drift =
      static_cast<float>(reader.number("fundus_drift", 0, {0, 100 * kPlantMilli, "m/s"}));
  reader.finish();
}

// The order matters: the number of coils before the wiring, the wiring before the comparison.
// No channel may change its meaning unseen: the channels are part of the result.
MeasuredField read_calibration(const std::filesystem::path& file,
                               const control::FieldModel& before) {
  const auto wrong = [&file](const std::string& what) {
    return std::invalid_argument(file.string() + ": " + what);
  };
  std::ifstream stream(file, std::ios::binary);
  if (!stream || std::filesystem::is_directory(file)) throw wrong("cannot be read");
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  try {
    const control::FieldCalibration read = parse_field_calibration(text);
    if (read.field.coils() != before.coils())
      throw std::invalid_argument("it has " + std::to_string(read.field.coils()) +
                                  " coils, the rig's model " + std::to_string(before.coils()));
    if (!read.field.region().contains(Eigen::Vector3d::Zero()))
      throw std::invalid_argument("Workspace_Dimensions do not hold the workspace's center");
    check_strength(read.field);
    MeasuredField found;
    found.system_name = read.system_name;
    found.channels = wiring(read.field, before);
    found.field = rewired(read.field, found.channels);
    found.coils = control::compare_coils(found.field, before, Eigen::Vector3d::Zero());
    for (const std::string& warning : read.warnings)
      found.warnings.push_back(file.string() + ": " + warning);
    found.field.set_uniform_background(before.uniform_background());
    return found;
  } catch (const std::invalid_argument& problem) {
    throw wrong(problem.what());
  }
}

}  // namespace vitreo
