// optical_system: rays, spots, field curves, the layout drawing.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/field_curves.h"
#include "optics/analysis/layout.h"
#include "optics/rays/spot.h"
#include "optics/rays/trace.h"
#include "optics/system/first_order.h"

#include <fmt/format.h>

#include <stdexcept>

namespace vitreo::lua {
namespace {

void set_vector(lua_State* L, const char* name, const Eigen::Vector3d& vector) {
  push_vector(L, vector);
  lua_setfield(L, -2, name);
}

void push_ray(lua_State* L, const optics::Ray& ray) {
  lua_newtable(L);
  set_vector(L, "origin", ray.origin);
  set_vector(L, "direction", ray.direction);
}

int trace(Call& call) {
  const Eigen::Vector3d direction = call.vector(1);
  if (!(direction.norm() > 0))
    throw std::invalid_argument("direction: wants a direction, got {0, 0, 0}");
  const optics::Ray ray{call.vector(0), direction.normalized()};
  const optics::System& system = eye_of(call).system;
  const auto found =
      direction.z() > 0 ? optics::trace_out(system, ray) : optics::trace_in(system, ray);
  push_ray(call.L, found.ray);
  lua_pushstring(call.L, optics::to_string(found.status));
  lua_setfield(call.L, -2, "status");
  if (found.surface > 0) {
    lua_pushinteger(call.L, found.surface);
    lua_setfield(call.L, -2, "surface");
  }
  return 1;
}

int isopixel_line(Call& call) {
  const std::vector<double> m = call.numbers(0);
  if (m.size() != 2) throw std::invalid_argument("m: wants two numbers {x, y}");
  const auto line = optics::isopixel_line(
      eye_of(call).system, microscope_option(call).value_or(optics::Microscope{}), {m[0], m[1]});
  if (!line) return 0;
  push_ray(call.L, *line);
  return 1;
}

int point_at_field(Call& call) {
  const auto point =
      optics::point_at_field(eye_of(call).system, call.number(0), call.has(1) ? call.number(1) : 0);
  if (!point) return 0;
  push_vector(call.L, *point);
  return 1;
}

void push_spot(Call& call, const optics::Spot& spot) {
  const optics::SpotMoments moments = spot.moments();
  const double distance = call.number_option("distance").value_or(moments.best_focus());
  std::vector<double> x, y;
  for (const Eigen::Vector2d& place : spot.at(distance))
    x.push_back(place.x()), y.push_back(place.y());
  const double total = spot.rays() + spot.lost;
  push_fields(call.L, {{"best_focus", moments.best_focus()},
                       {"tangential", moments.best_focus_along({1, 0})},
                       {"sagittal", moments.best_focus_along({0, 1})},
                       {"distance", distance},
                       {"rms", moments.rms(distance)},
                       {"transmitted", total > 0 ? spot.rays() / total : 0}});
  if (const auto frequency = call.number_option("frequency"))
    set_fields(call.L, {{"mtf_tangential", optics::geometric_mtf(spot, distance, {*frequency, 0})},
                        {"mtf_sagittal", optics::geometric_mtf(spot, distance, {0, *frequency})}});
  push_numbers(call.L, x);
  lua_setfield(call.L, -2, "x");
  push_numbers(call.L, y);
  lua_setfield(call.L, -2, "y");
}

int spot(Call& call) {
  const optics::System& system = eye_of(call).system;
  const optics::PupilTracer tracer(system, optics::Pupil::of_stop(system));
  const auto point = optics::point_at_field(system, call.number_option("angle").value_or(0),
                                            call.number_option("depth").value_or(0));
  optics::Spot made;
  if (!point || !tracer.trace(*point, optics::disc_samples(), made) || made.rays() < 3) return 0;
  push_spot(call, made);
  return 1;
}

int field_curvature(Call& call) {
  const optics::System& system = eye_of(call).system;
  const optics::PupilTracer tracer(system, optics::Pupil::of_stop(system));
  const auto curve = optics::field_curves(tracer, call.numbers(0), optics::disc_samples(),
                                          call.has(1) ? call.number(1) : 0);
  lua_newtable(call.L);
  for (std::size_t i = 0; i < curve.size(); ++i) {
    const optics::FieldPoint& p = curve[i];
    push_fields(call.L, {{"angle", p.angle}, {"transmitted", p.transmitted}});
    if (p.transmitted > 0)
      set_fields(call.L, {{"best_focus", p.best_focus},
                          {"tangential", p.tangential},
                          {"sagittal", p.sagittal},
                          {"chief_height", p.chief_height},
                          {"rms", p.rms},
                          {"distortion", p.distortion}});
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  lua_pushnumber(call.L, optics::field_curvature_span(curve));
  return 2;
}

/// A real image that lies near is what the drawing is about; else some room behind the last lens
/// will do.
double end_of_drawing(const optics::System& system, double depth, optics::LayoutOptions& options) {
  constexpr double kFarthest = 60e-3, kRoom = 12e-3;
  const double last = system.vertex(system.size());
  const auto image = optics::axial_image(system, depth);
  if (!image || image->distance <= 0 || image->distance > kFarthest) return last + kRoom;
  options.marks.push_back({last + image->distance, 4e-3, "aerial image"});
  return last + 1.25 * image->distance;
}

int layout(Call& call) {
  const optics::Prescription& eye = eye_of(call);
  optics::LayoutOptions options;
  options.title = call.text_option("title").value_or(eye.title);
  options.media = eye.media;
  std::vector<double> angles{0};
  if (call.push_option("angles")) angles = *to_numbers(call.L, -1);
  lua_pop(call.L, 1);
  const double depth = call.number_option("depth").value_or(0),
               end = end_of_drawing(eye.system, depth, options);
  const auto fans = optics::field_fans(
      eye.system, angles, end, static_cast<int>(call.number_option("rays").value_or(5)), depth);
  return call.result(optics::layout_svg(eye.system, fans, options));
}

Argument angle_option(const char* name, const char* help) {
  return {.name = name,
          .type = Type::number,
          .unit = "rad",
          .optional = true,
          .min = -1.5,
          .max = 1.5,
          .help = help};
}

std::vector<Binding> field_rows() {
  const Argument depth = length_option("depth", 0, 1, "before the retina (0)");
  const Argument angles{
      .name = "angles", .type = Type::numbers, .unit = "rad", .help = "at the pupil's center"};
  Argument angle = angle_option("angle", "of the field, at the pupil's center");
  angle.optional = false;
  Argument drawn = angles;
  drawn.optional = true;
  return {{"point_at_field",
           {angle, depth},
           "position in m, or nil",
           "the point of the retina at a field angle, or before it towards the pupil",
           point_at_field},
          {"spot",
           {options_of({angle_option("angle", "of the field (0)"),
                        depth,
                        length_option("distance", -10, 10, "from the last vertex (best focus)"),
                        {.name = "frequency",
                         .type = Type::number,
                         .unit = "1/m",
                         .optional = true,
                         .min = 0,
                         .max = 1e9,
                         .help = "for mtf_tangential, mtf_sagittal"}})},
           "table, or nil when no light comes through",
           "the bundle that fills the pupil: x, y, best_focus, tangential, sagittal, distance, rms "
           "in m, transmitted",
           spot},
          {"field_curvature",
           {angles, depth},
           "list of tables, span in m",
           "best_focus, tangential, sagittal, chief_height, rms in m, distortion, transmitted of "
           "each field angle",
           field_curvature},
          {"layout",
           {options_of({drawn,
                        {.name = "rays",
                         .type = Type::integer,
                         .optional = true,
                         .min = 1,
                         .max = 101,
                         .help = "a fan"},
                        depth,
                        {.name = "title", .type = Type::text, .optional = true}})},
           "SVG text",
           "draws surfaces and rays; put it into the report with run:drawing",
           layout}};
}

}  // namespace

std::vector<Binding> system_ray_rows() {
  std::vector<Binding> rows = {
      {"trace",
       {{.name = "origin",
         .type = Type::vector,
         .unit = "m",
         .help = "eye frame: z from the retina outwards"},
        {.name = "direction",
         .type = Type::vector,
         .help = "towards +z: out of the eye; towards -z: into it"}},
       "table",
       "follows a ray exactly: origin, direction, status (\"ok\" or why it was lost), surface "
       "where it was lost",
       trace},
      {"isopixel_line",
       {{.name = "m", .type = Type::numbers, .unit = "m", .help = "{x, y} in the plane in focus"},
        options_of({microscope_argument()})},
       "table, or nil when the ray is lost",
       "the line in the vitreous whose points a microscope sees at m: origin in m, direction",
       isopixel_line}};
  for (Binding& row : field_rows()) rows.push_back(std::move(row));
  return rows;
}

}  // namespace vitreo::lua
