// Bindings of optical_system: rays, spots, field curves, the layout drawing.
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

/// A point of the ray and its unit direction, eye frame.
ResultTable& set_ray(ResultTable& table, const optics::Ray& ray) {
  return table.vector("origin", ray.origin, "m").vector("direction", ray.direction, "");
}

/// The way follows from the direction: rays towards +z start in the vitreous and leave the eye,
/// rays towards -z come from outside. A lost ray is a result: where, and why.
int trace(Call& call) {
  const Eigen::Vector3d direction = call.direction(1);
  const optics::Ray ray{call.vector(0), direction};
  const optics::System& system = eye_of(call).system;
  const auto found =
      direction.z() > 0 ? optics::trace_out(system, ray) : optics::trace_in(system, ray);
  ResultTable table(call);
  set_ray(table, found.ray).text("status", optics::to_string(found.status));
  if (found.surface > 0) table.integer("surface", found.surface);
  return 1;
}

/// The field angle counts at the pupil's center. Nothing where the chief ray is lost on its way.
int point_at_field(Call& call) {
  const auto point =
      optics::point_at_field(eye_of(call).system, call.number(0), call.has(1) ? call.number(1) : 0);
  if (!point) return 0;
  return call.result(*point, "m");
}

/// Best foci are in closed form from the moments of the bundle; points, radius and MTF belong to
/// the distance asked for, or to the best focus.
void push_spot(Call& call, const optics::Spot& spot) {
  const optics::SpotMoments moments = spot.moments();
  const double distance = call.number_option("distance").value_or(moments.best_focus());
  std::vector<double> x, y;
  for (const Eigen::Vector2d& place : spot.at(distance))
    x.push_back(place.x()), y.push_back(place.y());
  const double total = spot.rays() + spot.lost;
  ResultTable table(call);
  table.number("best_focus", moments.best_focus(), "m")
      .number("tangential", moments.best_focus_along({1, 0}), "m")
      .number("sagittal", moments.best_focus_along({0, 1}), "m")
      .number("distance", distance, "m")
      .number("rms", moments.rms(distance), "m")
      .number("transmitted", total > 0 ? spot.rays() / total : 0)
      .numbers("x", x, "m")
      .numbers("y", y, "m");
  if (const auto frequency = call.number_option("frequency"))
    table.number("mtf_tangential", optics::geometric_mtf(spot, distance, {*frequency, 0}))
        .number("mtf_sagittal", optics::geometric_mtf(spot, distance, {0, *frequency}));
}

/// Fewer than three rays have no spread to speak of: as no light.
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

/// Where no light comes through, an angle keeps its entry, so that the list stays parallel to the
/// angles that were asked for, but has no numbers.
int field_curvature(Call& call) {
  const optics::System& system = eye_of(call).system;
  const optics::PupilTracer tracer(system, optics::Pupil::of_stop(system));
  const auto curve = optics::field_curves(tracer, call.numbers(0), optics::disc_samples(),
                                          call.has(1) ? call.number(1) : 0);
  ResultTable(call)
      .number("span", optics::field_curvature_span(curve), "m")
      .list("points", curve.size(), [&curve](ResultTable& point, std::size_t i) {
        const optics::FieldPoint& p = curve[i];
        point.number("angle", p.angle, "rad").number("transmitted", p.transmitted);
        if (p.transmitted > 0)
          point.number("best_focus", p.best_focus, "m")
              .number("tangential", p.tangential, "m")
              .number("sagittal", p.sagittal, "m")
              .number("chief_height", p.chief_height, "m")
              .number("rms", p.rms, "m")
              .number("distortion", p.distortion);
      });
  return 1;
}

/// A real image that lies near is what the drawing is about; else some room behind the last lens
/// will do.
double end_of_drawing(const optics::System& system, double depth, optics::LayoutOptions& options) {
  constexpr double kFarthest = 60e-3, kRoom = 12e-3;
  const double last = system.vertex(system.size());
  const auto image = optics::axial_image(system, depth);
  if (!image || image->distance <= 0 || image->distance > kFarthest) return last + kRoom;
  // Distance from the last vertex; the mark's half length makes it visible beside the rays.
  options.marks.push_back({last + image->distance, 4e-3, "aerial image"});
  return last + 1.25 * image->distance;
}

/// The drawing as SVG text: the script decides where it goes.
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
  const auto lit = [](const char* name, const char* unit, const char* help) {
    return ResultField{.name = name, .unit = unit, .help = help, .optional = true};
  };
  return {
      {"point_at_field",
       {angle, depth},
       Returned("position", "m").or_nil("where the chief ray is lost"),
       "the point of the retina at a field angle, or before it towards the pupil",
       point_at_field,
       "eye:point_at_field(20 * deg)"},
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
       Returned("table",
                std::vector<ResultField>{{"x", "m", "of the rays at the distance, from their mean"},
                                         {"y", "m", ""},
                                         {"best_focus", "m", "from the last vertex"},
                                         {"tangential", "m", "its focus in x"},
                                         {"sagittal", "m", "its focus in y"},
                                         {"distance", "m", "of the spot from the last vertex"},
                                         {"rms", "m", "radius"},
                                         {"transmitted", "", "part of the rays that comes through"},
                                         lit("mtf_tangential", "", "at the frequency"),
                                         lit("mtf_sagittal", "", "at the frequency")})
           .or_nil("when no light comes through"),
       "the bundle that fills the pupil",
       spot,
       "eye:spot { angle = 20 * deg, frequency = 5e4 }"},
      {"field_curvature",
       {angles, depth},
       {"table",
        {{"span", "m", "of the best foci along the axis"},
         {"points",
          "",
          "one of each field angle; only angle and transmitted where no light comes through",
          {{"angle", "rad", ""},
           {"transmitted", "", "part of the rays that comes through"},
           lit("best_focus", "m", "from the last vertex"),
           lit("tangential", "m", ""),
           lit("sagittal", "m", ""),
           lit("chief_height", "m", "of the chief ray"),
           lit("rms", "m", "radius of the spot"),
           lit("distortion", "", "relative")}}}},
       "the aerial image of the retina, or of what lies before it, along the field",
       field_curvature,
       "eye:field_curvature({ 0, 15 * deg, 30 * deg })"},
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
       "string",
       "draws surfaces and rays as SVG, for run:picture",
       layout,
       "eye:layout { angles = { 0, 20 * deg } }"}};
}

}  // namespace

std::vector<Binding> system_ray_rows() {
  const ResultField origin{"origin", "m", "a point of the ray"},
      direction{"direction", "", "of length 1"};
  std::vector<Binding> rows = {
      {"trace",
       {{.name = "origin",
         .type = Type::vector,
         .unit = "m",
         .help = "eye frame: z from the retina outwards"},
        {.name = "direction",
         .type = Type::direction,
         .help = "towards +z: out of the eye; towards -z: into it"}},
       {"table",
        {origin,
         direction,
         {"status", "", "\"ok\", or why it was lost"},
         {.name = "surface", .help = "where it was lost", .optional = true}}},
       "follows a ray exactly",
       trace,
       "eye:trace({ 0, 0, 0 }, { 0, 0, 1 })"}};
  for (Binding& row : field_rows()) rows.push_back(std::move(row));
  return rows;
}

}  // namespace vitreo::lua
