// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/localizer_calls.h"

#include "host/lua/interpreter/values.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace vitreo::lua::localizer_calls {
namespace {

constexpr double kUsualSigma = 0.2;  // px, of a tracker's center and axes, and of a point

/// One sigma of position (m), rotations about the body's axes (rad), logarithm of the size.
std::vector<double> sigmas_of(const optics::PoseCandidate& one) {
  const Eigen::VectorXd sigma = one.covariance.diagonal().cwiseSqrt();
  return {sigma.begin(), sigma.end()};
}

/// A pose as scripts have it: orientation row by row, eye from body, though Eigen keeps columns.
void set_candidate(ResultTable& table, const optics::PoseCandidate& one,
                   const Eigen::Vector3d& offset) {
  // One row a direction that is not observed; 0 x 7, so an empty list, where all are observed.
  Eigen::MatrixXd open(static_cast<Eigen::Index>(one.unobservable.size()), 7);
  for (Eigen::Index i = 0; i < open.rows(); ++i)
    open.row(i) = one.unobservable[static_cast<std::size_t>(i)];
  const Eigen::Matrix3d rows = one.pose.orientation.transpose();
  table.number("chi2", one.chi2)
      .number("residual_px", one.residual_px)
      .number("scale", one.scale)
      .vector("position", one.pose.position_in_eye + offset, "m")
      .vector("axis", one.pose.orientation.col(2), "")
      .numbers("orientation", {rows.data(), rows.data() + rows.size()})
      .matrix("covariance", one.covariance)
      .numbers("sigma", sigmas_of(one))
      .matrix("unobservable", open);
}

}  // namespace

/// Exponents as of a superquadric: 0 is a flat end or a square section, 1 an ellipsoid's, up
/// to 1.9; towards 2 the body becomes an octahedron, whose points have no normal.
Argument body_argument(bool optional) {
  const auto exponent = [](const char* name, const char* help) {
    return Argument{
        .name = name, .type = Type::number, .optional = true, .min = 0, .max = 1.9, .help = help};
  };
  return {
      .name = "body",
      .type = Type::options,
      .optional = optional,
      .help = "its shape and size, z along its axis",
      .options = {{.name = "shape",
                   .type = Type::text,
                   .help = "spheroid, ellipsoid, cylinder, superquadric, crossed_plates or "
                           "disc_with_needle"},
                  length_option("half_length", 1e-7, 0.1,
                                "of a spheroid, cylinder or plates, along the axis"),
                  length_option("radius", 1e-7, 0.1, "of a spheroid, cylinder, plates or disc"),
                  length_option("thickness", 1e-7, 0.1, "of plates or a disc"),
                  length_option("needle_length", 1e-7, 0.1, "from the disc's middle to its tip"),
                  length_option("needle_radius", 1e-7, 0.1, "of a needle"),
                  {.name = "semi_axes",
                   .type = Type::numbers,
                   .unit = "m",
                   .optional = true,
                   .help = "{a, b, c}"},
                  exponent("exponent_along", "of a superquadric: 0 flat ends, 1 round"),
                  exponent("exponent_across", "of its section: 0 square, 1 round")}};
}

/// A shape takes its own fields and must have them all: each has another meaning elsewhere.
optics::ObjectModel body_at(const OptionTable& table) {
  const std::string shape = *table.text("shape");
  const auto needed = [&](const char* name) {
    if (const auto value = table.number(name)) return *value;
    throw std::invalid_argument(std::string(name) + ": is missing; a " + shape + " has one");
  };
  optics::ObjectModel body;
  if (shape == "cylinder") {
    body = optics::cylinder(needed("half_length"), needed("radius"));
  } else if (shape == "spheroid") {
    const double radius = needed("radius");
    body = optics::ellipsoid({radius, radius, needed("half_length")});
  } else if (shape == "crossed_plates") {
    body = optics::crossed_plates(needed("half_length"), needed("radius"), needed("thickness"));
  } else if (shape == "disc_with_needle") {
    body = optics::disc_with_needle(needed("radius"), needed("thickness"), needed("needle_length"),
                                    needed("needle_radius"));
  } else if (shape == "ellipsoid" || shape == "superquadric") {
    const auto axes = table.numbers("semi_axes");
    if (!axes || axes->size() != 3)
      throw std::invalid_argument("semi_axes: wants three lengths {a, b, c}");
    body = optics::ellipsoid({(*axes)[0], (*axes)[1], (*axes)[2]});
    if (shape == "superquadric") {
      body.exponent_along = needed("exponent_along");
      body.exponent_across = needed("exponent_across");
    }
  } else {
    throw std::invalid_argument(
        "shape: wants spheroid, ellipsoid, cylinder, superquadric, crossed_plates or "
        "disc_with_needle, got " +
        shape);
  }
  body.check();
  return body;
}

/// The angle of a nearly round ellipse is noise: with semi-axes a, b known to s, its variance is
/// about s^2 / 2 / (a - b)^2, bounded where they are equal.
SeenEllipse seen_at(const OptionTable& table) {
  SeenEllipse seen;
  seen.ellipse << *table.number("u"), *table.number("v"), *table.number("semi_major"),
      *table.number("semi_minor"), *table.number("angle");
  if (const auto numbers = table.numbers("covariance")) {
    if (numbers->size() != 25)
      throw std::invalid_argument("covariance: wants 25 numbers, row by row");
    seen.covariance = Eigen::Map<const optics::EllipseCovariance>(numbers->data()).transpose();
    return seen;
  }
  const double sigma = table.number("sigma").value_or(kUsualSigma);
  const double difference = seen.ellipse[2] - seen.ellipse[3];
  seen.covariance = sigma * sigma * optics::EllipseCovariance::Identity();
  seen.covariance(4, 4) = sigma * sigma / 2 / std::max(difference * difference, 1e-6);
  return seen;
}

/// Where the row lets it be absent, the need for it follows from the other options.
optics::ObjectModel body_option(const Call& call) {
  if (!call.push_option("body")) throw std::invalid_argument("body: is missing");
  optics::ObjectModel body = body_at(OptionTable(call.L, lua_gettop(call.L)));
  lua_pop(call.L, 1);
  return body;
}

SeenEllipse ellipse_option(const Call& call) {
  if (!call.push_option("ellipse")) throw std::invalid_argument("ellipse: is missing");
  SeenEllipse seen = seen_at(OptionTable(call.L, lua_gettop(call.L)));
  lua_pop(call.L, 1);
  return seen;
}

/// Scripts see positions with the calibration's offset; the solver works without it.
optics::PoseStart start_at(const OptionTable& how, const Localizer& localizer) {
  optics::PoseStart start;
  if (const auto position = how.vector("position"))
    start.position_in_eye = *position - localizer.offset;
  if (const auto axis = how.vector("axis")) start.orientation = optics::orientation_along(*axis);
  if (const auto numbers = how.numbers("orientation")) {
    if (start.orientation)
      throw std::invalid_argument("orientation: wants either axis or orientation");
    if (numbers->size() != 9)
      throw std::invalid_argument("orientation: wants nine numbers, row by row");
    start.orientation = Eigen::Map<const Eigen::Matrix3d>(numbers->data()).transpose();
  }
  return start;
}

/// An infinite sigma of the size means that it is fitted without any prior.
optics::ObjectPoseSettings settings_at(const OptionTable& how, const Localizer& localizer) {
  optics::ObjectPoseSettings settings = localizer.settings;
  settings.rotate = how.flag("rotate");
  settings.orientation_sigma = how.number("orientation_sigma").value_or(settings.orientation_sigma);
  settings.roll_sigma = how.number("roll_sigma");
  settings.scale_sigma = how.number("scale_sigma").value_or(0);
  if (how.flag("unknown_size")) settings.scale_sigma = std::numeric_limits<double>::infinity();
  settings.max_residual_px = how.number("max_residual_px").value_or(settings.max_residual_px);
  return settings;
}

std::vector<optics::SeenPoint> points_option(const Call& call) {
  std::vector<optics::SeenPoint> points;
  call.push_option("points");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = "points: " + std::to_string(i) + ": ";
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + "wants a table");
    const OptionTable point(call.L, lua_gettop(call.L));
    refuse_unknown(call.L, lua_gettop(call.L), where, {"body", "u", "v", "sigma"});
    const auto body = point.vector("body");
    const auto u = point.number("u"), v = point.number("v");
    if (!body || !u || !v)
      throw std::invalid_argument(where + "wants {body = {x, y, z}, u = , v = }");
    const double sigma = point.number("sigma").value_or(kUsualSigma);
    points.push_back({*body, {*u, *v}, sigma * sigma * Eigen::Matrix2d::Identity()});
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
  return points;
}

std::vector<optics::OutlinePoint> outline_option(const Call& call) {
  std::vector<optics::OutlinePoint> outline;
  call.push_option("outline");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = "outline: " + std::to_string(i) + ": ";
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + "wants a table");
    const OptionTable point(call.L, lua_gettop(call.L));
    refuse_unknown(call.L, lua_gettop(call.L), where, {"u", "v", "sigma"});
    const auto u = point.number("u"), v = point.number("v");
    if (!u || !v) throw std::invalid_argument(where + "wants {u = , v = }");
    outline.push_back({{*u, *v}, point.number("sigma").value_or(kUsualSigma)});
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
  return outline;
}

/// Five numbers less three of the position, less two of a free axis and one of a free size: what is
/// known beforehand is measured once and free once. Quantiles of chi2 at 99.5 % (1 and 2 degrees).
void judge_fit(const optics::ObjectPoseSettings& settings, const SeenEllipse& seen,
               optics::ObjectPose& pose) {
  constexpr double kOutline_px = 0.15;  // of plates against an ellipsoid (docs/figures.md)
  constexpr double kQuantiles[] = {7.88, 10.6};
  if (pose.candidates.empty() || pose.status == optics::PoseStatus::not_converged) return;
  int spare = 2;
  if (!std::isfinite(settings.orientation_sigma) && settings.rotate) spare -= 2;
  if (!std::isfinite(settings.scale_sigma)) --spare;
  if (spare < 1) return;
  const double noise = seen.covariance.diagonal().segment<2>(2).minCoeff();
  const double chi2 = pose.candidates.front().chi2 * noise / (noise + kOutline_px * kOutline_px);
  if (chi2 > kQuantiles[spare - 1]) pose.status = optics::PoseStatus::misfit;
}

/// Only a pose that was found is the position: of two that fit equally, scripts must choose among
/// the candidates, best first.
int push_pose(const Call& call, const optics::ObjectPose& pose, const Eigen::Vector3d& offset) {
  ResultTable table(call);
  table.text("status", optics::to_string(pose.status))
      .list("candidates", pose.candidates.size(), [&](ResultTable& candidate, std::size_t i) {
        set_candidate(candidate, pose.candidates[i], offset);
      });
  if (pose.status == optics::PoseStatus::found)
    table.vector("position", pose.candidates[0].pose.position_in_eye + offset, "m")
        .numbers("sigma", sigmas_of(pose.candidates[0]));
  return 1;
}

/// Seven numbers a covariance: position, rotation, logarithm of the size. What was held is 0 in it,
/// what cannot be told infinite.
Returned pose_fields() {
  const char* const seven = "position in m, rotations about the body's axes in rad, log of size";
  return {"table",
          {{"status", "", "found, ambiguous, misfit, not_converged or outside"},
           {.name = "position", .unit = "m", .help = "when found", .optional = true},
           {.name = "sigma", .help = seven, .optional = true},
           {"candidates",
            "",
            "the poses that fit",
            {{"position", "m", "eye frame"},
             {"axis", "", "direction of the body's z"},
             {"orientation", "", "nine numbers, eye from body, row by row"},
             {"scale", "", "of the body's size"},
             {"covariance", "", seven},
             {"sigma", "", seven},
             {"unobservable", "", "directions in which nothing is known, in the same seven"},
             {"chi2", "", ""},
             {"residual_px", "", ""}}}}};
}

}  // namespace vitreo::lua::localizer_calls
