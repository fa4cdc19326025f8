// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/hardware_sample.h"

#include "control/allocation.h"
#include "devices/sim/checks.h"

#include <Eigen/Geometry>

#include <vector>

namespace vitreo::sim {
namespace {

constexpr double kTuningLimit = 20;  // A: the machine's peak

// Three independent standard normal numbers.
Eigen::Vector3d normal3(std::mt19937_64& random) {
  std::normal_distribution<double> normal;
  // One statement each: the order of evaluation within an expression is unspecified.
  const double x = normal(random);
  const double y = normal(random);
  const double z = normal(random);
  return {x, y, z};
}

// The perturbation of CoilField::perturbed for multipoles: a coil's sources move and turn as one
// body. Each turns about its own position; each component of the rotation vector is N(0,
// sigma.axis).
control::MultipoleField perturbed_sources(const control::MultipoleField& model,
                                          const control::FieldPerturbation& sigma,
                                          std::mt19937_64& random) {
  std::vector<control::MultipoleField::Sources> coils = model.sources();
  std::normal_distribution<double> normal;
  for (auto& sources : coils) {
    const double gain = 1 + sigma.gain * normal(random);
    const Eigen::Vector3d shift = sigma.position * normal3(random);
    const Eigen::Vector3d turn = sigma.axis * normal3(random);
    const double angle = turn.norm();
    Eigen::Matrix3d rotation = Eigen::Matrix3d::Identity();
    if (angle > 0) rotation = Eigen::AngleAxisd(angle, turn / angle);
    for (control::MultipoleSource& source : sources) {
      source.position += shift;
      source.axis = (rotation * source.axis).normalized();
      for (double& coefficient : source.regular) coefficient *= gain;
      for (double& coefficient : source.irregular) coefficient *= gain;
    }
  }
  return {coils, model.background_sources(), model.region()};
}

}  // namespace

// Seeds of separate streams, by std::seed_seq: the algorithm is fixed by the standard, so that a
// seed gives the same machine with every library.
std::uint64_t seed_for(std::uint64_t seed, Purpose purpose) {
  std::seed_seq mixed{static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32),
                      static_cast<std::uint32_t>(purpose)};
  std::uint32_t words[2];
  mixed.generate(words, words + 2);
  return (static_cast<std::uint64_t>(words[0]) << 32) | words[1];
}

// The golden ratio's increments and the finalizer of SplitMix64 (Steele, Lea & Flood 2014): a cheap
// hash for numbers that are wanted for each row of a frame, where seeding a generator would cost
// more than the noise.
std::uint64_t mix(std::uint64_t a, std::uint64_t b, std::uint64_t c) {
  std::uint64_t x = a + 0x9E3779B97F4A7C15U * (b + 1) + 0xD1B54A32D192ED03U * (c + 1);
  x = (x ^ (x >> 30)) * 0xBF58476D1CE4E5B9U;
  x = (x ^ (x >> 27)) * 0x94D049BB133111EBU;
  return x ^ (x >> 31);
}

// The uniform background is the room's and no coil's, so it is not perturbed.
control::FieldModel perturbed(const control::FieldModel& model,
                              const control::FieldPerturbation& sigma, std::mt19937_64& random) {
  const control::CoilField* dipoles = model.dipoles();
  control::FieldModel sampled =
      dipoles != nullptr
          ? control::FieldModel(dipoles->perturbed(sigma, random))
          : control::FieldModel(perturbed_sources(*model.multipoles(), sigma, random));
  sampled.set_uniform_background(model.uniform_background());
  return sampled;
}

void HandTuning::check() const {
  require_not_negative(tolerance, "hand_tuning tolerance");
  require_positive(field, "hand_tuning field");
  require(axis.allFinite() && axis.norm() > 1e-6, "hand_tuning axis must be a direction");
}

// The believed model's currents for levitation at the center make F_true in the true field. The
// hand trims until only a drift v is left, so the trimming adds
//   R v - (F_true - W)
// with Stokes drag R and weight W (facts/magnetics 2.2).
Eigen::Vector3d force_left_by_tuning(const HandTuning& tuning, const WorldSettings& plant,
                                     const control::FieldModel& believed, std::mt19937_64& random) {
  tuning.check();
  const control::Robot& robot = plant.robot;
  const Eigen::Vector3d center = Eigen::Vector3d::Zero();
  const Eigen::Vector3d wanted = tuning.field * tuning.axis.normalized();
  const Eigen::Vector3d weight(0, 0, robot.net_weight(plant.medium));
  const control::Allocation held = control::allocate(
      believed.matrix(center), control::robot_moment(robot, tuning.axis.normalized(), wanted),
      {wanted, weight, Eigen::Vector3d::Zero()}, kTuningLimit);
  const control::FieldGradient field =
      plant.field.matrix(center) * held.currents + plant.field.background(center);
  const Eigen::Vector3d b = field.head<3>();
  const Eigen::Vector3d along = b.normalized();
  const Eigen::Vector3d moment = plant.moment_gain * control::robot_moment(robot, along, b);
  const Eigen::Vector3d net = control::force_from_field(moment) * field - weight;
  const double speed = tuning.tolerance * std::abs(std::normal_distribution<double>()(random));
  const Eigen::Vector3d drift = speed * normal3(random).normalized();
  return control::resistance(robot, plant.medium, along) * drift - net;
}

}  // namespace vitreo::sim
