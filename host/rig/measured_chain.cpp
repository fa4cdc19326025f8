// SPDX-License-Identifier: Apache-2.0
#include "host/rig/measured_chain.h"

#include "control/crossed_plates.h"
#include "host/rig/bench_settings.h"
#include "host/rig/rig_settings.h"

#include <Eigen/Cholesky>
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

using nlohmann::json;

bool alike(double one, double other) {
  return std::abs(one - other) <= 1e-9 * std::max(std::abs(one), std::abs(other));
}

/// Offsets count from what was believed: with another belief they would be other ones. Empty where
/// it is the rig's, else what differs.
std::string other_belief(const json& about, const RigModel& model) {
  const optics::Microscope& microscope = model.microscope;
  const optics::ImageScale& image = model.top_image;
  const double power = std::isfinite(microscope.pupil_distance) ? 1 / microscope.pupil_distance : 0;
  const std::vector<double> center = about.at("center"), tilt = about.at("tilt");
  if (center.size() != 2 || tilt.size() != 2)
    throw std::invalid_argument("center and tilt must be two numbers each");
  if (about.at("eye") != model.eye_name) return "model.eye";
  if (!alike(about.at("pixel"), image.pixel)) return "top_camera.effective_pixel";
  if (!alike(center[0], image.center_px.x()) || !alike(center[1], image.center_px.y()))
    return "top_camera.center_px";
  if (!alike(about.at("pupil_power"), power)) return "top_camera.microscope.pupil_distance";
  if (!alike(tilt[0], microscope.tilt.x()) || !alike(tilt[1], microscope.tilt.y()))
    return "top_camera.microscope.tilt";
  return "";
}

struct Numbers {
  std::vector<optics::ChainParameter> parameters;
  Eigen::VectorXd theta;
  Eigen::MatrixXd covariance;
};

/// In sigmas of before, as a ViewingChain counts.
Numbers numbers_of(const json& file, const optics::NominalChain& nominal) {
  optics::ChainSigmas all;
  all.axis_turn = 1;  // of the sessions' own parameters
  const auto known = optics::chain_parameters(nominal, all);
  const json& entries = file.at("parameters");
  const auto size = static_cast<Eigen::Index>(entries.size());
  Numbers found{{}, Eigen::VectorXd(size), Eigen::MatrixXd(size, size)};
  Eigen::VectorXd sigmas(size);
  for (const json& entry : entries) {
    const auto i = static_cast<Eigen::Index>(found.parameters.size());
    optics::ChainParameter one =
        known[static_cast<std::size_t>(optics::index_of(known, entry.at("name")))];
    one.sigma = sigmas[i] = entry.at("sigma").get<double>();
    if (!(one.sigma > 0)) throw std::invalid_argument(one.name + ": its sigma must be above 0");
    found.theta[i] = entry.at("off").get<double>() / one.sigma;
    found.parameters.push_back(std::move(one));
  }
  const std::vector<double> covariance = file.at("covariance");
  if (covariance.size() != static_cast<std::size_t>(size * size))
    throw std::invalid_argument("covariance: wants a row and a column for each parameter");
  for (Eigen::Index i = 0; i < size; ++i)
    for (Eigen::Index j = 0; j < size; ++j)
      found.covariance(i, j) =
          covariance[static_cast<std::size_t>(i * size + j)] / (sigmas[i] * sigmas[j]);
  found.covariance = ((found.covariance + found.covariance.transpose()) / 2).eval();
  if (!found.theta.allFinite() || found.covariance.llt().info() != Eigen::Success)
    throw std::invalid_argument("covariance: is none");
  return found;
}

bool is_of_eye(const optics::ChainParameter& one) {
  return one.part == optics::ChainPart::eye || one.name.starts_with("eye_rotation");
}
bool is_of_robot(const optics::ChainParameter& one) { return one.name.starts_with("robot_"); }

/// Another one is in its place: of it nothing is known but what is known of any. What was measured
/// of the rest stays, its own part of the covariance.
void forget(Numbers& numbers, bool (*which)(const optics::ChainParameter&)) {
  for (Eigen::Index i = 0; i < numbers.theta.size(); ++i) {
    if (!which(numbers.parameters[static_cast<std::size_t>(i)])) continue;
    numbers.theta[i] = 0;
    numbers.covariance.row(i).setZero();
    numbers.covariance.col(i).setZero();
    numbers.covariance(i, i) = 1;
  }
}

}  // namespace

double MeasuredChain::sigma(const std::string& name) const {
  double largest = 0;
  for (Eigen::Index i = 0; i < belief.chain.size(); ++i) {
    const optics::ChainParameter& one = belief.chain.parameters()[static_cast<std::size_t>(i)];
    if (one.name == name || one.name == name + "_x" || one.name == name + "_y")
      largest = std::max(largest, one.sigma * std::sqrt(belief.covariance(i, i)));
  }
  return largest;
}

optics::NominalChain nominal_chain(const RigModel& model) {
  optics::NominalChain chain;
  chain.prescription = optics::prescription(model.eye_name);
  chain.prescription.system = model.eye;
  chain.microscope = model.microscope;
  chain.image = model.top_image;
  chain.robot = {model.robot.semi_axis, model.robot.semi_radius};
  return chain;
}

std::shared_ptr<const MeasuredChain> read_measured_chain(const std::string& text,
                                                         const RigModel& model,
                                                         std::vector<std::string>& warnings) {
  try {
    const json file = json::parse(text);
    const std::string other = other_belief(file.at("about"), model);
    if (!other.empty()) {
      warnings.push_back("model.chain: was measured with another " + other +
                         " than the rig has, and is not used");
      return nullptr;
    }
    optics::NominalChain nominal = nominal_chain(model);
    // Files of before 2026-11-30 took plates for round.
    if (file.at("about").value("plates", false))
      nominal.plate_ratio = control::plate_ratio(model.robot);
    Numbers numbers = numbers_of(file, nominal);
    const std::string measured_eye = file.at("eye"), robot = file.at("about").at("robot");
    if (measured_eye != model.eye_id) {
      forget(numbers, is_of_eye);
      warnings.push_back(fmt::format(
          "model.chain: was measured in the eye \"{}\", and there is \"{}\" (sample.eye): what is "
          "the eye's counts as not measured",
          measured_eye, model.eye_id));
    }
    if (robot != model.robot.name) {
      forget(numbers, is_of_robot);
      warnings.push_back("model.chain: was measured with another robot, " + robot +
                         ": the size of this one counts as not measured");
    }
    const double outline = file.value("outline_px", MeasuredChain::kUsualOutline_px);
    if (!(outline > 0 && outline < 10))
      throw std::invalid_argument("outline_px must be between 0 and 10 px");
    const bool touched = file.at("touched").get<bool>() && measured_eye == model.eye_id;
    optics::ViewingChain chain(nominal, std::move(numbers.parameters), numbers.theta);
    return std::make_shared<const MeasuredChain>(
        MeasuredChain{{std::move(chain), std::move(numbers.covariance)},
                      touched,
                      model.uncertainty.bench,
                      outline,
                      text});
  } catch (const json::exception& problem) {
    throw std::invalid_argument(std::string("is no measured chain: ") + problem.what());
  }
}

// A key that a base states is relative to the base, so that a rig in another folder can build on
// it.
void take_chain(const RigDescription& rig, const std::string& name, RigModel& model,
                std::vector<std::string>& warnings) {
  if (name.empty()) return;
  const std::string file =
      (std::filesystem::path(rig.source_of("model.chain").file).parent_path() / name).string();
  std::ifstream stream(file, std::ios::binary);
  std::ostringstream text;
  text << stream.rdbuf();
  if (!stream) throw ConfigError(file + ": the calibration of the viewing chain cannot be read");
  try {
    auto chain = read_measured_chain(text.str(), model, warnings);
    if (chain) use_measured_chain(model, std::move(chain));
  } catch (const std::invalid_argument& problem) {
    throw ConfigError(file + ": " + problem.what());
  }
}

std::vector<std::string> warnings_of(const RigDescription& rig) {
  ConfigReader reader(rig);
  RigSettings settings = read_rig_settings(reader);
  std::vector<std::string> warnings = settings.warnings;
  take_chain(rig, settings.chain, settings.model, warnings);
  return warnings;
}

void use_measured_chain(RigModel& model, std::shared_ptr<const MeasuredChain> chain) {
  BenchUncertainty& bench = model.uncertainty.bench;
  for (const BenchKey& key : bench_keys()) bench.*key.sigma = chain->sigma(key.name);
  bench.by_hand = false;
  model.chain = std::move(chain);
}

RigModel without_measured_chain(RigModel model) {
  if (model.chain) model.uncertainty.bench = model.chain->before;
  model.chain.reset();
  return model;
}

}  // namespace vitreo
