// wide_angle_map: where an intraocular point is imaged sharply, and back; isofocus surfaces and
// isopixel curves.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "optics/maps/thesis_curves.h"
#include "optics/maps/wide_angle_map.h"

#include <algorithm>
#include <cmath>

namespace vitreo::lua {
namespace {

using optics::WideAngleMap;

int make_map(Call& call) {
  optics::WideAngleSettings settings;
  settings.microscope = microscope_option(call);
  settings.lens_distance = call.number_option("lens_distance");
  settings.max_angle = call.number_option("max_angle").value_or(settings.max_angle);
  settings.max_depth = call.number_option("max_depth").value_or(settings.max_depth);
  return calculate(
      call, "wide-angle map",
      [settings, system = eye_of(call).system](const YieldPoint&) {
        return std::make_shared<WideAngleMap>(system, settings);
      },
      [](Call& done, const std::shared_ptr<WideAngleMap>& map) {
        push_handle(done.L, wide_angle_map_class(), map);
        return 1;
      });
}

const WideAngleMap& map_of(const Call& call) { return call.self<WideAngleMap>(); }

int push_aerial(Call& call, const std::optional<optics::AerialPoint>& aerial) {
  if (!aerial) return 0;
  return call.result(Eigen::Vector3d(aerial->m.x(), aerial->m.y(), aerial->focus), "m");
}

int image(Call& call) { return push_aerial(call, map_of(call).image(call.vector(0))); }
int traced_image(Call& call) {
  return push_aerial(call, map_of(call).traced_image(call.vector(0)));
}

int point(Call& call) {
  const Eigen::Vector3d aerial = call.vector(0);
  const auto found = map_of(call).point({aerial.head<2>(), aerial.z()});
  if (!found) return 0;
  return call.result(*found, "m");
}

/// Localization by focus (figure 4.1): the isopixel curve meets the isofocus surface. Its
/// covariance by differences of the map's inverse.
int locate_in_map(Call& call) {
  const WideAngleMap& map = map_of(call);
  const Eigen::Vector3d aerial = call.vector(0);
  const double sideways = call.number_option("image_sigma").value_or(10e-6);
  const Eigen::Vector3d sigmas(sideways, sideways,
                               call.number_option("focus_sigma").value_or(50e-6));
  const auto at = [&](const Eigen::Vector3d& place) {
    return map.point({place.head<2>(), place.z()});
  };
  const auto found = at(aerial);
  if (!found) return 0;
  Eigen::Matrix3d root;
  for (int i = 0; i < 3; ++i) {
    constexpr double kStep = 1e-6;  // m
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
    const auto more = at(aerial + step), less = at(aerial - step);
    if (!more && !less) return 0;
    const double width = (more ? kStep : 0) + (less ? kStep : 0);  // one-sided on the map's edge
    root.col(i) = (more.value_or(*found) - less.value_or(*found)) * (sigmas[i] / width);
  }
  const Eigen::Matrix3d covariance = root * root.transpose();
  push_fields(call.L, {});
  push_vector(call.L, *found);
  lua_setfield(call.L, -2, "position");
  push_vector(call.L, covariance.diagonal().cwiseSqrt());
  lua_setfield(call.L, -2, "sigma");
  lua_newtable(call.L);
  for (int i = 0; i < 3; ++i) {
    push_numbers(call.L, {covariance(i, 0), covariance(i, 1), covariance(i, 2)});
    lua_rawseti(call.L, -2, i + 1);
  }
  lua_setfield(call.L, -2, "covariance");
  return 1;
}

int map_limits(Call& call) {
  const WideAngleMap& map = map_of(call);
  push_fields(
      call.L,
      {{"max_angle", map.max_angle()}, {"max_depth", map.max_depth()}, {"tail", map.tail()}});
  lua_pushboolean(call.L, map.symmetric());
  lua_setfield(call.L, -2, "symmetric");
  return 1;
}

/// Pushes r and z of those places of a curve that lie in the map; a curve may enter and leave it.
int push_curve(Call& call, const std::vector<std::optional<WideAngleMap::FieldPosition>>& places) {
  std::vector<double> r, z;
  for (const auto& place : places) {
    if (!place) continue;
    const WideAngleMap::Plane there = map_of(call).plane_point(*place);
    r.push_back(there.r), z.push_back(there.z);
  }
  push_numbers(call.L, r);
  push_numbers(call.L, z);
  return 2;
}

std::size_t count_of(const Call& call) {
  return call.has(1) ? static_cast<std::size_t>(call.number(1)) : 41;
}

/// The field angle is what the curve runs along; of each, the depth whose image is in focus, by
/// bisection: the image moves out monotonously as the object leaves the retina.
int isofocus(Call& call) {
  const WideAngleMap& map = map_of(call);
  const double focus = call.number(0);
  const std::size_t count = count_of(call);
  std::vector<std::optional<WideAngleMap::FieldPosition>> places;
  for (std::size_t i = 0; i < count; ++i) {
    const double angle = map.max_angle() * static_cast<double>(i) / static_cast<double>(count - 1);
    const auto excess = [&](double depth) {
      const auto there = map.at({angle, depth});
      return there ? there->focus - focus : std::nan("");
    };
    double near = 0, far = map.max_depth();
    if (!(excess(near) <= 0 && excess(far) >= 0)) continue;
    for (int step = 0; step < 50; ++step) {
      const double middle = (near + far) / 2;
      (excess(middle) < 0 ? near : far) = middle;
    }
    places.push_back(WideAngleMap::FieldPosition{angle, far});
  }
  return push_curve(call, places);
}

int isopixel(Call& call) {
  const WideAngleMap& map = map_of(call);
  const auto nearest = map.at({0, 0}), farthest = map.at({0, map.max_depth()}),
             edge = map.at({map.max_angle(), 0});
  std::vector<std::optional<WideAngleMap::FieldPosition>> places;
  if (!nearest || !farthest || !edge) return push_curve(call, places);
  const double height = std::copysign(call.number(0), edge->height);
  const double from = std::min(nearest->focus, edge->focus), step = farthest->focus - from;
  const std::size_t count = count_of(call);
  for (std::size_t i = 0; i < count; ++i)
    places.push_back(
        map.find(from + step * static_cast<double>(i) / static_cast<double>(count - 1), height));
  return push_curve(call, places);
}

void push_cubic(lua_State* L, const char* name, const optics::Cubic& cubic) {
  push_numbers(L, {cubic.c.begin(), cubic.c.end()});
  set_fields(L, {{"from", cubic.from}, {"to", cubic.to}, {"max_residual", cubic.max_residual}});
  lua_setfield(L, -2, name);
}

template <class Curve, class Fields>
void push_list(lua_State* L, const char* name, const std::vector<Curve>& curves, Fields fields) {
  lua_newtable(L);
  for (std::size_t i = 0; i < curves.size(); ++i) {
    push_fields(L, fields(curves[i]));
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
  lua_setfield(L, -2, name);
}

int thesis_curves(Call& call) {
  const optics::ThesisCurves curves = optics::fit_thesis_curves(map_of(call));
  lua_newtable(call.L);
  push_cubic(call.L, "radius", curves.radius);
  push_cubic(call.L, "pole", curves.pole);
  push_cubic(call.L, "slope", curves.slope);
  push_cubic(call.L, "intercept", curves.intercept);
  push_list(call.L, "surfaces", curves.surfaces, [](const optics::IsofocusSurface& one) {
    return std::vector<Field>{{"focus", one.focus},
                              {"radius", one.radius},
                              {"pole", one.pole},
                              {"max_residual", one.max_residual}};
  });
  push_list(call.L, "curves", curves.curves, [](const optics::IsopixelCurve& one) {
    return std::vector<Field>{{"height", one.height},
                              {"slope", one.slope},
                              {"intercept", one.intercept},
                              {"max_residual", one.max_residual}};
  });
  return 1;
}

std::vector<Binding> curve_rows() {
  const Argument count{.name = "count",
                       .type = Type::integer,
                       .optional = true,
                       .min = 2,
                       .max = 10000,
                       .help = "of points (41)"};
  return {
      {"isofocus",
       {{.name = "focus", .type = Type::number, .unit = "m", .help = "d_ls"}, count},
       "list of r, list of z, in m",
       "the surface whose points are all in focus at one distance from the last vertex, as far as "
       "the map reaches",
       isofocus},
      {"isopixel",
       {{.name = "height", .type = Type::number, .unit = "m", .min = 0, .max = 1, .help = "|d_op|"},
        count},
       "list of r, list of z, in m",
       "the curve whose points are all imaged at one distance from the axis, as far as the map "
       "reaches",
       isopixel},
      {"thesis_curves",
       {},
       "table",
       "the thesis' fits: cubics radius, pole, slope, intercept {c0, c1, c2, c3}; lists surfaces, "
       "curves",
       thesis_curves}};
}

}  // namespace

std::vector<Binding> system_map_rows() {
  const double right_angle = 1.5;
  return {{"wide_angle_map",
           {options_of(
               {{.name = "max_angle",
                 .type = Type::number,
                 .unit = "rad",
                 .optional = true,
                 .min = 0.01,
                 .max = right_angle,
                 .help = "field, at the pupil's center (35 deg)"},
                length_option("max_depth", 1e-4, 1, "before the retina (8 mm)"),
                length_option("lens_distance", 0, 1, "from eye to condensing lens (as prescribed)"),
                microscope_argument()})},
           "wide_angle_map",
           "the whole image formation as a table, for a bare sensor or a microscope",
           make_map}};
}

const Class& wide_angle_map_class() {
  static const Class kind = [] {
    const Argument inside{.name = "point", .type = Type::vector, .unit = "m", .help = "eye frame"};
    Class made{"wide_angle_map",
               "image formation (3.2); make one with optical_system:wide_angle_map. An image place "
               "is {x, y, d_ls}: x, "
               "y of the eye frame, d_ls from the last vertex",
               {{"image",
                 {inside},
                 Returned("position", "m").or_nil("outside"),
                 "where a point is imaged sharply",
                 image},
                {"point",
                 {{.name = "image", .type = Type::vector, .unit = "m", .help = "{x, y, d_ls}"}},
                 Returned("position", "m").or_nil("outside"),
                 "the point that is imaged there",
                 point},
                {"locate",
                 {{.name = "image", .type = Type::vector, .unit = "m", .help = "{x, y, d_ls}"},
                  options_of({length_option("image_sigma", 1e-12, 1, "of x and y (10 um)"),
                              length_option("focus_sigma", 1e-12, 1, "of d_ls (50 um)")})},
                 "table: position in m, sigma in m, covariance in m^2; nil outside",
                 "localizes by focus: as point, with its covariance",
                 locate_in_map},
                {"traced_image",
                 {inside},
                 Returned("position", "m").or_nil("outside"),
                 "as image, by tracing the bundle instead of the table",
                 traced_image},
                {"limits",
                 {},
                 "table",
                 "max_angle in rad, max_depth in m, tail in m (the table's error); symmetric",
                 map_limits}},
               {}};
    for (Binding& row : curve_rows()) made.methods.push_back(std::move(row));
    return made;
  }();
  return kind;
}

}  // namespace vitreo::lua
