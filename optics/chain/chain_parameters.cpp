// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_parameters.h"

#include "optics/numerics/preconditions.h"

#include <cmath>
#include <stdexcept>

namespace vitreo::optics {
namespace {

// One row for each kind of parameter: its name in reports, and the sigma that it is given by. Two
// rows share the robot's size, as its length and width are measured with the same microscope.
struct NamedSigma {
  const char* name;
  const char* unit;
  double ChainSigmas::*sigma;
  const char* axes;  // one along, or about, each
  ChainPart part;
};

/// The retina counts as the eye's: it is what no image of the bench shows.
constexpr NamedSigma kSigmas[] = {
    {"axial_length", "m", &ChainSigmas::axial_length, "", ChainPart::eye},
    {"inner_lens_tilt", "rad", &ChainSigmas::inner_lens_tilt, "xy", ChainPart::eye},
    {"inner_lens_aside", "m", &ChainSigmas::inner_lens_aside, "xy", ChainPart::eye},
    {"retina_depth", "m", &ChainSigmas::retina_depth, "", ChainPart::eye},
    {"retina_tilt", "m", &ChainSigmas::retina_tilt, "xy", ChainPart::eye},
    {"retina_curvature", "m", &ChainSigmas::retina_curvature, "", ChainPart::eye},
    {"retina_astigmatism", "m", &ChainSigmas::retina_astigmatism, "xy", ChainPart::eye},
    {"eye_rotation", "rad", &ChainSigmas::eye_rotation, "xy", ChainPart::calibration},
    {"lens_axial", "m", &ChainSigmas::lens_axial, "", ChainPart::calibration},
    {"lens_aside", "m", &ChainSigmas::lens_aside, "xy", ChainPart::calibration},
    {"lens_tilt", "rad", &ChainSigmas::lens_tilt, "xy", ChainPart::calibration},
    {"pupil_power", "1/m", &ChainSigmas::pupil_power, "", ChainPart::calibration},
    {"microscope_tilt", "rad", &ChainSigmas::microscope_tilt, "xy", ChainPart::calibration},
    {"object_plane", "m", &ChainSigmas::object_plane, "", ChainPart::calibration},
    {"pixel", "", &ChainSigmas::pixel, "", ChainPart::calibration},
    {"center", "m", &ChainSigmas::center, "xy", ChainPart::calibration},
    {"robot_length", "", &ChainSigmas::robot_size, "", ChainPart::calibration},
    {"robot_width", "", &ChainSigmas::robot_size, "", ChainPart::calibration},
    {"dilation", "px", &ChainSigmas::dilation_px, "", ChainPart::calibration},
    {"dilation_slope", "px/m", &ChainSigmas::dilation_slope, "", ChainPart::calibration},
    {"axis_turn", "rad", &ChainSigmas::axis_turn, "xyz", ChainPart::calibration},
};

}  // namespace

// An infinite sigma would leave theta without a meaning: it counts in sigmas.
void ChainSigmas::check() const {
  for (const NamedSigma& one : kSigmas)
    if (!(this->*one.sigma >= 0 && std::isfinite(this->*one.sigma)))
      throw std::invalid_argument(std::string(one.name) + ": its sigma must not be negative");
}

// The start of a chain in which only some things are uncertain.
ChainSigmas ChainSigmas::none() {
  ChainSigmas sigmas;
  sigmas.eye.clear();
  for (const NamedSigma& one : kSigmas) sigmas.*one.sigma = 0;
  return sigmas;
}

// The eye's come first, which ViewingChain::eye_size() and the split of an uncertainty rest on.
std::vector<ChainParameter> chain_parameters(const NominalChain& nominal,
                                             const ChainSigmas& sigmas) {
  sigmas.check();
  std::vector<ChainParameter> all;
  for (const Uncertainty& one : applicable(sigmas.eye, nominal.prescription))
    if (one.relative > 0) all.push_back({one.parameter, "", one.relative, ChainPart::eye});
  for (const NamedSigma& one : kSigmas) {
    const double sigma = sigmas.*one.sigma;
    if (!(sigma > 0)) continue;
    const std::string name = one.name;
    if (*one.axes == '\0') all.push_back({name, one.unit, sigma, one.part});
    for (const char* axis = one.axes; *axis != '\0'; ++axis)
      all.push_back({name + "_" + *axis, one.unit, sigma, one.part});
  }
  return all;
}

Eigen::Index index_of(const std::vector<ChainParameter>& parameters, const std::string& name) {
  for (std::size_t i = 0; i < parameters.size(); ++i)
    if (parameters[i].name == name) return static_cast<Eigen::Index>(i);
  throw std::invalid_argument("parameter: the chain has no " + name);
}

}  // namespace vitreo::optics
