// Bindings of wide_angle_map: image positions of intraocular points and back, isofocus surfaces,
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

/// Some hundred traced bundles, so on a task of its own; the map copies the system.
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

/// By the table, or by the bundle itself where the table's own error is asked about.
int image(Call& call) {
  const Eigen::Vector3d point = call.vector(0);
  const auto aerial =
      call.flag_option("traced") ? map_of(call).traced_image(point) : map_of(call).image(point);
  if (!aerial) return 0;
  return call.result(Eigen::Vector3d(aerial->m.x(), aerial->m.y(), aerial->focus), "m");
}

/// Localization by focus (figure 4.1): the isopixel curve meets the isofocus surface. Its
/// covariance by differences of the map's inverse.
int locate_in_map(Call& call) {
  const WideAngleMap& map = map_of(call);
  const Eigen::Vector3d aerial = call.vector(0);
  const double sideways = call.number_option("image_sigma").value_or(10e-6);
  const Eigen::Vector3d sigmas(sideways, sideways,
                               call.number_option("focus_sigma").value_or(50e-6));
  // {x, y, d_ls}, as scripts have it, back into the eye.
  const auto at = [&](const Eigen::Vector3d& place) {
    return map.point({place.head<2>(), place.z()});
  };
  const auto found = at(aerial);
  if (!found) return 0;
  Eigen::Matrix3d root;
  for (int i = 0; i < 3; ++i) {
    constexpr double kStep = 1e-6;  // m
    // A column of the derivative of the point by the image place, times that coordinate's sigma:
    // the covariance G S S G^T is the product of these columns, its root, with its transpose.
    const Eigen::Vector3d step = kStep * Eigen::Vector3d::Unit(i);
    const auto more = at(aerial + step), less = at(aerial - step);
    // Neither neighbor lies in the map: no derivative, so no covariance, so no answer.
    if (!more && !less) return 0;
    const double width = (more ? kStep : 0) + (less ? kStep : 0);  // one-sided on the map's edge
    root.col(i) = (more.value_or(*found) - less.value_or(*found)) * (sigmas[i] / width);
  }
  const Eigen::Matrix3d covariance = root * root.transpose();
  ResultTable(call)
      .vector("position", *found, "m")
      .vector("sigma", covariance.diagonal().cwiseSqrt(), "m")
      .matrix("covariance", covariance, "m^2");
  return 1;
}

/// How far the map reaches, which may be less than was asked: it ends where bundles are vignetted.
int map_info(Call& call) {
  const WideAngleMap& map = map_of(call);
  ResultTable(call)
      .number("max_angle", map.max_angle(), "rad")
      .number("max_depth", map.max_depth(), "m")
      .number("tail", map.tail(), "m")
      .flag("symmetric", map.symmetric());
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
  ResultTable(call).numbers("r", r, "m").numbers("z", z, "m");
  return 1;
}

/// Points of a curve, the second argument.
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
    // Along this angle nothing is in focus there; NaN, outside of the map, fails too.
    if (!(excess(near) <= 0 && excess(far) >= 0)) continue;
    // Halved 50 times, 8 mm become 7e-18 m: rounding.
    for (int step = 0; step < 50; ++step) {
      const double middle = (near + far) / 2;
      (excess(middle) < 0 ? near : far) = middle;
    }
    places.push_back(WideAngleMap::FieldPosition{angle, far});
  }
  return push_curve(call, places);
}

/// What is imaged at one distance from the axis: for each focus from the nearest to the farthest
/// the place is found by the map's inverse. A map that folds or ends gives fewer points.
int isopixel(Call& call) {
  const WideAngleMap& map = map_of(call);
  const auto nearest = map.at({0, 0}), farthest = map.at({0, map.max_depth()}),
             edge = map.at({map.max_angle(), 0});
  std::vector<std::optional<WideAngleMap::FieldPosition>> places;
  if (!nearest || !farthest || !edge) return push_curve(call, places);
  // Scripts give |d_op|; the map's heights are negative where the image is inverted.
  const double height = std::copysign(call.number(0), edge->height);
  const double from = std::min(nearest->focus, edge->focus), step = farthest->focus - from;
  const std::size_t count = count_of(call);
  for (std::size_t i = 0; i < count; ++i)
    places.push_back(
        map.find(from + step * static_cast<double>(i) / static_cast<double>(count - 1), height));
  return push_curve(call, places);
}

/// The coefficients as a list, with the range and the residual as its fields.
void push_cubic(lua_State* L, const optics::Cubic& cubic) {
  push_numbers(L, {cubic.c.begin(), cubic.c.end()});
  set_number(L, "from", cubic.from);
  set_number(L, "to", cubic.to);
  set_number(L, "max_residual", cubic.max_residual);
}

/// Figure 3.6: spheres fitted to isofocus surfaces, lines to isopixel curves, and cubics to how
/// their parameters change with d_ls and |d_op|. With their ranges: a cubic says nothing beyond.
int thesis_curves(Call& call) {
  const optics::ThesisCurves curves = optics::fit_thesis_curves(map_of(call));
  ResultTable table(call);
  const auto cubic = [&](const char* name, const optics::Cubic& fit) {
    push_cubic(call.L, fit);
    table.top(name);
  };
  cubic("radius", curves.radius);
  cubic("pole", curves.pole);
  cubic("slope", curves.slope);
  cubic("intercept", curves.intercept);
  table
      .list("surfaces", curves.surfaces.size(),
            [&curves](ResultTable& one, std::size_t i) {
              const optics::IsofocusSurface& surface = curves.surfaces[i];
              one.number("focus", surface.focus, "m")
                  .number("radius", surface.radius, "m")
                  .number("pole", surface.pole, "m")
                  .number("max_residual", surface.max_residual, "m");
            })
      .list("curves", curves.curves.size(), [&curves](ResultTable& one, std::size_t i) {
        const optics::IsopixelCurve& curve = curves.curves[i];
        one.number("height", curve.height, "m")
            .number("slope", curve.slope)
            .number("intercept", curve.intercept, "m")
            .number("max_residual", curve.max_residual, "m");
      });
  return 1;
}

std::vector<Binding> imaging_rows() {
  return {{"image",
           {{.name = "point", .type = Type::vector, .unit = "m", .help = "eye frame"},
            options_of({{.name = "traced",
                         .type = Type::flag,
                         .optional = true,
                         .help = "by tracing the bundle instead of the table (false)"}})},
           Returned("position", "m").or_nil("outside"),
           "where a point is imaged sharply",
           image,
           "map:image({ 0, 0, 2 * mm })"},
          {"locate",
           {{.name = "image", .type = Type::vector, .unit = "m", .help = "{x, y, d_ls}"},
            options_of({length_option("image_sigma", 1e-12, 1, "of x and y (10 µm)"),
                        length_option("focus_sigma", 1e-12, 1, "of d_ls (50 µm)")})},
           Returned("table", std::vector<ResultField>{{"position", "m", "the point imaged there"},
                                                      {"sigma", "m", "of x, y and z"},
                                                      {"covariance", "m^2", "list of its rows"}})
               .or_nil("outside"),
           "localizes by focus: the point that is imaged at a place, with its covariance",
           locate_in_map,
           "map:locate(map:image({ 0, 0, 2 * mm }))"},
          {"info",
           {},
           {"table",
            {{"max_angle", "rad", "of the field"},
             {"max_depth", "m", "before the retina"},
             {"tail", "m", "the table's error"},
             {"symmetric", "", "whether the system is, about its axis"}}},
           "how far the map reaches",
           map_info,
           "map:info()"}};
}

std::vector<Binding> curve_rows() {
  const Argument count{.name = "count",
                       .type = Type::integer,
                       .optional = true,
                       .min = 2,
                       .max = 10000,
                       .help = "of points (41)"};
  const Returned curve{
      "table",
      {{"r", "m", "of each point, from the axis"}, {"z", "m", "of each point, eye frame"}}};
  const char* const cubic = "cubic {c0, c1, c2, c3}, with from, to and max_residual; SI";
  return {
      {"isofocus",
       {{.name = "focus", .type = Type::number, .unit = "m", .help = "d_ls"}, count},
       curve,
       "the surface whose points are all in focus at one distance from the last vertex, as far as "
       "the map reaches",
       isofocus,
       "map:isofocus(10 * mm)"},
      {"isopixel",
       {{.name = "height", .type = Type::number, .unit = "m", .min = 0, .max = 1, .help = "|d_op|"},
        count},
       curve,
       "the curve whose points are all imaged at one distance from the axis, as far as the map "
       "reaches",
       isopixel,
       "map:isopixel(3 * mm)"},
      {"thesis_curves",
       {},
       {"table",
        {{"radius", "", cubic},
         {"pole", "", cubic},
         {"slope", "", cubic},
         {"intercept", "", cubic},
         {"surfaces",
          "",
          "spheres fitted to isofocus surfaces",
          {{"focus", "m", ""}, {"radius", "m", ""}, {"pole", "m", ""}, {"max_residual", "m", ""}}},
         {"curves",
          "",
          "lines fitted to isopixel curves",
          {{"height", "m", ""},
           {"slope", "", ""},
           {"intercept", "m", ""},
           {"max_residual", "m", ""}}}}},
       "the thesis' fits of isofocus surfaces and isopixel curves",
       thesis_curves,
       "map:thesis_curves()"}};
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
           make_map,
           "eye:wide_angle_map { max_angle = 30 * deg }"}};
}

const Class& wide_angle_map_class() {
  static const Class kind = [] {
    Class made{"wide_angle_map",
               "image formation (3.2); make one with optical_system:wide_angle_map. An image place "
               "is {x, y, d_ls}: x, y of the eye frame, d_ls from the last vertex",
               imaging_rows(),
               {}};
    for (Binding& row : curve_rows()) made.methods.push_back(std::move(row));
    return made;
  }();
  return kind;
}

}  // namespace vitreo::lua
