// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/chain_calls.h"

#include "host/lua/interpreter/values.h"
#include "host/lua/optics/localizer_calls.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace vitreo::lua::chain_calls {
namespace {

// Keys of the option `uncertainty`, each with its bound: far above what a bench can be off by, so
// that a number in mm in place of m is refused.
struct SigmaKey {
  const char* name;
  const char* unit;
  double optics::ChainSigmas::*value;
  double most;
  const char* help;
};

constexpr SigmaKey kSigmaKeys[] = {
    {"axial_length", "m", &optics::ChainSigmas::axial_length, 5e-3, "of the eye (0.1 mm)"},
    {"lens_axial", "m", &optics::ChainSigmas::lens_axial, 5e-3, "of the condensing lens (0.5 mm)"},
    {"lens_aside", "m", &optics::ChainSigmas::lens_aside, 5e-3, "x and y (0.5 mm)"},
    {"lens_tilt", "rad", &optics::ChainSigmas::lens_tilt, 0.3, "about x and y (2 degrees)"},
    {"eye_rotation", "rad", &optics::ChainSigmas::eye_rotation, 0.3, "about x and y (3 degrees)"},
    {"inner_lens_tilt", "rad", &optics::ChainSigmas::inner_lens_tilt, 0.3,
     "of the eye's own lens (3 degrees)"},
    {"inner_lens_aside", "m", &optics::ChainSigmas::inner_lens_aside, 5e-3, "x and y (0.2 mm)"},
    {"pupil_power", "1/m", &optics::ChainSigmas::pupil_power, 20,
     "of 1 / the microscope's pupil distance (2)"},
    {"microscope_tilt", "rad", &optics::ChainSigmas::microscope_tilt, 0.3,
     "about x and y (0.5 degrees)"},
    {"object_plane", "m", &optics::ChainSigmas::object_plane, 5e-3, "along the axis (0.5 mm)"},
    {"pixel", "", &optics::ChainSigmas::pixel, 0.3, "relative (0.005)"},
    {"center", "m", &optics::ChainSigmas::center, 5e-3, "of the aerial image, x and y (0.2 mm)"},
    {"robot_size", "", &optics::ChainSigmas::robot_size, 0.3,
     "relative, length and width each (0.01)"},
    {"dilation_px", "", &optics::ChainSigmas::dilation_px, 10, "px, of every outline (0.1)"},
    {"dilation_slope", "", &optics::ChainSigmas::dilation_slope, 1e4,
     "px per m of height (28.6: 0.1 px in 3.5 mm)"},
    {"axis_turn", "rad", &optics::ChainSigmas::axis_turn, 0.3,
     "of the robot's axis about x, y and z, alike in all looks (0)"},
    {"retina_depth", "m", &optics::ChainSigmas::retina_depth, 5e-3, "(0.3 mm)"},
    {"retina_tilt", "m", &optics::ChainSigmas::retina_tilt, 5e-3, "4 mm from the axis (0.1 mm)"},
    {"retina_curvature", "m", &optics::ChainSigmas::retina_curvature, 5e-3, "there (0.15 mm)"},
    {"retina_astigmatism", "m", &optics::ChainSigmas::retina_astigmatism, 5e-3, "there (0.1 mm)"},
};

/// Calls read(entry, where) for each table of the list option `name`.
// An entry with a key that is not known is refused with its number and the nearest key: a look
// whose `contact_sigma` was misspelled would be a frame of free flight.
template <class Read>
void each_entry(const Call& call, const char* name, const std::vector<std::string>& known,
                const Read& read) {
  if (call.push_option(name)) {
    const int list = lua_gettop(call.L);
    const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
    for (lua_Integer i = 1; i <= count; ++i) {
      const std::string where = std::string(name) + ": " + std::to_string(i) + ": ";
      if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
        throw std::invalid_argument(where + "wants a table");
      refuse_unknown(call.L, lua_gettop(call.L), where, known);
      read(OptionTable(call.L, lua_gettop(call.L)), where);
      lua_pop(call.L, 1);
    }
  }
  lua_pop(call.L, 1);
}

// Without a number there is no measurement; 0 would be one.
double wanted(const OptionTable& entry, const char* name, const std::string& where) {
  if (const auto value = entry.number(name)) return *value;
  throw std::invalid_argument(where + name + " is missing");
}

/// Semi-axes and angle as localizer:ellipse has them.
// The angle of a nearly round ellipse is noise: sigma / (a - b), with a - b not below a pixel.
optics::OutlineSeen outline_at(const OptionTable& entry, const std::string& where) {
  // px, of the center and of both semi-axes alike.
  const double sigma = entry.number("sigma").value_or(0.2);
  optics::OutlineSeen seen;
  seen.ellipse << wanted(entry, "u", where), wanted(entry, "v", where),
      wanted(entry, "semi_major", where), wanted(entry, "semi_minor", where),
      wanted(entry, "angle", where);
  const double difference = std::max(seen.ellipse[2] - seen.ellipse[3], 1.0);
  seen.covariance = sigma * sigma * optics::EllipseCovariance::Identity();
  seen.covariance(4, 4) = sigma * sigma / (difference * difference);
  // 0.035 rad are the two degrees within which a field holds a soft robot.
  seen.axis_sigma = entry.number("axis_sigma").value_or(0.035);
  seen.contour_sigma_px = std::max(0.0, entry.number("contour_sigma").value_or(0));
  if (!(sigma > 0) || !(seen.axis_sigma > 0))
    throw std::invalid_argument(where + "sigma and axis_sigma must be above 0");
  if (!(seen.ellipse[3] > 0 && seen.ellipse[2] >= seen.ellipse[3]))
    throw std::invalid_argument(where + "wants semi_major >= semi_minor > 0");
  return seen;
}

// A look is what is known of it: contact and position may both be given.
optics::ChainLook look_at(const OptionTable& entry, const std::string& where) {
  optics::ChainLook look;
  look.seen = outline_at(entry, where);
  const auto axis = entry.vector("axis");
  if (!axis || !(axis->norm() > 0)) throw std::invalid_argument(where + "axis is missing");
  look.axis = axis->normalized();
  look.contact_sigma = entry.number("contact_sigma").value_or(0);
  look.lying_height = entry.number("lying_height").value_or(0);
  if (const auto position = entry.vector("position")) {
    const auto sigma = entry.vector("position_sigma");
    if (!sigma) throw std::invalid_argument(where + "position wants position_sigma beside it");
    look.known = *position;
    // 0: not measured.
    for (int i = 0; i < 3; ++i)
      if ((*sigma)[i] > 0) look.known_sigma[i] = (*sigma)[i];
  }
  return look;
}

// Roots of the diagonal, with the sign of the share: where two parts were measured only together,
// one makes up for the other.
Eigen::Vector3d sigma_of(const Eigen::Matrix3d& share) {
  return share.diagonal().array().sign() * share.diagonal().array().abs().sqrt();
}

}  // namespace

Argument uncertainty_argument() {
  std::vector<Argument> keys{{.name = "eye",
                              .type = Type::text,
                              .optional = true,
                              .help = "how well its numbers are known (table_5_1)",
                              .choices = {"table_5_1", "known"}}};
  for (const SigmaKey& key : kSigmaKeys)
    keys.push_back(number_option(key.name, key.unit, 0, key.most, key.help));
  return {.name = "uncertainty",
          .type = Type::options,
          .optional = true,
          .help = "one sigma of what the chain is off by before it is measured; 0: as believed",
          .options = keys};
}

optics::ChainSigmas sigmas_option(const Call& call) {
  // An eye that is "known" has no parameters of table 5.1; the bench's own stay.
  optics::ChainSigmas sigmas;
  if (call.push_option("uncertainty")) {
    const OptionTable table(call.L, lua_gettop(call.L));
    if (table.text("eye").value_or("table_5_1") == "known") sigmas.eye.clear();
    for (const SigmaKey& key : kSigmaKeys)
      sigmas.*key.value = table.number(key.name).value_or(sigmas.*key.value);
  }
  lua_pop(call.L, 1);
  return sigmas;
}

// Lists of tables, checked entry by entry when they are read.
std::vector<Argument> session_arguments() {
  const auto list = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::list, .optional = true, .help = help};
  };
  return {
      list("looks",
           "{{u = , v = , semi_major = , semi_minor = , angle = , sigma = 0.2, axis = , axis_sigma "
           "= 0.035, contour_sigma = 0, contact_sigma = , lying_height = , position = , "
           "position_sigma = }, ...}: "
           "pictures of the robot; with contact_sigma it lies on the retina, with position it was "
           "measured (a sigma of 0: not in that direction)"),
      list("landmarks",
           "{{u = , v = , sigma = 0.5, x = , y = , place_sigma = 50 um}, ...}: of the retina"),
      list("numbers",
           "{{parameter = , off = , sigma = }, ...}: measured by themselves, from the nominal "
           "value, relative where the parameter is")};
}

optics::ChainSession session_options(const Call& call) {
  optics::ChainSession session;
  each_entry(call, "looks",
             {"u", "v", "semi_major", "semi_minor", "angle", "sigma", "axis", "axis_sigma",
              "contour_sigma", "contact_sigma", "lying_height", "position", "position_sigma"},
             [&](const OptionTable& entry, const std::string& where) {
               session.looks.push_back(look_at(entry, where));
             });
  each_entry(call, "landmarks", {"u", "v", "sigma", "x", "y", "place_sigma"},
             [&](const OptionTable& entry, const std::string& where) {
               optics::ChainLandmark one;
               one.pixel_px = {wanted(entry, "u", where), wanted(entry, "v", where)};
               one.sigma_px = entry.number("sigma").value_or(one.sigma_px);
               one.place = {wanted(entry, "x", where), wanted(entry, "y", where)};
               one.place_sigma = entry.number("place_sigma").value_or(one.place_sigma);
               session.landmarks.push_back(one);
             });
  each_entry(call, "numbers", {"parameter", "off", "sigma"},
             [&](const OptionTable& entry, const std::string& where) {
               const auto name = entry.text("parameter");
               if (!name) throw std::invalid_argument(where + "parameter is missing");
               session.numbers.push_back(
                   {*name, wanted(entry, "off", where), wanted(entry, "sigma", where)});
             });
  return session;
}

std::vector<ResultField> parameter_fields() {
  return {{"parameter", "", "name"},
          {"unit", "", "of its numbers; relative without one"},
          {"off", "", "from the nominal value, the most probable"},
          {"sigma", "", "of that"},
          {"prior_sigma", "", "before the measurements"},
          {"learned", "", "how much of its variance they took away"}};
}

std::vector<ResultField> position_fields() {
  const char* const share = "share of it, one sigma, negative where it makes up for another";
  return {{"position", "m", "in the eye frame of the nominal chain"},
          {"sigma", "m", "one sigma of all that is uncertain"},
          {"noise", "m", "of outline and axis: a new frame has another"},
          {"eye", "m", share},
          {"calibration", "m", share},
          {"height", "m", "above the retina at its middle, where the robot touched it"},
          {"height_sigma", "m", "does not hold the retina's depth"},
          {"height_noise", "m", "the part that averages away"},
          {"chi2", "", "of two degrees of freedom"},
          {"status", "", "found, or misfit: no place explains the ellipse"}};
}

// A misfit has a position all the same: the one nearest to what was seen, for a look at it.
int push_position(const Call& call, const Eigen::Vector3d& position, double height,
                  const optics::PositionDoubt& doubt) {
  ResultTable(call)
      .vector("position", position, "m")
      .vector("sigma", sigma_of(doubt.covariance), "m")
      .vector("noise", sigma_of(doubt.noise), "m")
      .vector("eye", sigma_of(doubt.eye), "m")
      .vector("calibration", sigma_of(doubt.calibration), "m")
      .number("height", height, "m")
      .number("height_sigma", std::sqrt(doubt.height_variance), "m")
      .number("height_noise", std::sqrt(doubt.height_noise), "m")
      .number("chi2", doubt.chi2)
      .text("status", doubt.chi2 > optics::kMisfitChi2 ? "misfit" : "found");
  return 1;
}

}  // namespace vitreo::lua::chain_calls
