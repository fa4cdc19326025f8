// Bindings of optical_system: first order, viewing (aperture, depth, field), third-order sums.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/aberrations.h"
#include "optics/analysis/viewing.h"
#include "optics/system/first_order.h"

#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::lua {
namespace {

/// Field of the result, member of the struct: result and row are made from this one list.
constexpr std::pair<const char*, double optics::CardinalPoints::*> kCardinalPoints[] = {
    {"focal_length", &optics::CardinalPoints::focal_length},
    {"front_focal_length", &optics::CardinalPoints::front_focal_length},
    {"back_focal_length", &optics::CardinalPoints::back_focal_length},
    {"first_principal_point", &optics::CardinalPoints::first_principal_point},
    {"second_principal_point", &optics::CardinalPoints::second_principal_point},
    {"front_focus", &optics::CardinalPoints::front_focus},
    {"back_focus", &optics::CardinalPoints::back_focus},
    {"first_nodal_point", &optics::CardinalPoints::first_nodal_point},
    {"second_nodal_point", &optics::CardinalPoints::second_nodal_point}};

/// Nothing for an afocal system, which has none of these points.
int first_order(Call& call) {
  const auto points = optics::cardinal_points(eye_of(call).system);
  if (!points) return 0;
  ResultTable table(call);
  for (const auto& [name, value] : kCardinalPoints) table.number(name, (*points).*value, "m");
  return 1;
}

/// First order: where rays near the axis meet. Nothing for an image at infinity.
int axial_image(Call& call) {
  const auto image = optics::axial_image(eye_of(call).system, call.has(0) ? call.number(0) : 0);
  if (!image) return 0;
  ResultTable(call)
      .number("distance", image->distance, "m")
      .number("magnification", image->magnification)
      .number("longitudinal", image->longitudinal);
  return 1;
}

/// Seen directly, from a pupil before the eye, or through lenses of a clear radius; nothing where
/// neither is asked for.
std::optional<optics::FieldOfView> field_of_view(const Call& call, const optics::System& system) {
  const auto radius = call.number_option("clear_radius"),
             distance = call.number_option("observer_distance"),
             surface = call.number_option("from_surface");
  if (radius && distance)
    throw std::invalid_argument("options: wants either observer_distance or clear_radius");
  if (surface && !radius) throw std::invalid_argument("from_surface: goes with clear_radius");
  if (distance) return optics::direct_field_of_view(system, *distance);
  if (!radius) return std::nullopt;
  return optics::vignetted_field_of_view(
      system, static_cast<int>(surface.value_or(system.size() - 1)), *radius);
}

/// What the optics let a viewer see. Several readings of one quantity stand side by side, because
/// the thesis mixes them (docs/optics.md).
int viewing(Call& call) {
  const optics::System& system = eye_of(call).system;
  const double confusion = call.number_option("confusion").value_or(6.4e-6);
  const auto aperture = optics::numerical_aperture(system);
  const auto focus = optics::depth_of_focus(system, confusion);
  const auto depth =
      optics::depth_of_field(system, confusion, call.number_option("range").value_or(5e-3));
  const auto field = field_of_view(call, system);
  ResultTable table(call);
  table
      .table("numerical_aperture",
             [&aperture](ResultTable& made) {
               made.number("oslo", aperture.oslo)
                   .number("object_beam", aperture.object_beam)
                   .number("image_beam", aperture.image_beam)
                   .number("object_stop", aperture.object_stop)
                   .number("image_stop", aperture.image_stop);
             })
      .table("depth_of_focus",
             [&focus](ResultTable& made) {
               made.number("thesis", focus.thesis, "m")
                   .number("image_side", focus.image_side, "m")
                   .number("object_side", focus.object_side, "m");
             })
      .table("depth_of_field", [&depth](ResultTable& made) {
        made.number("thesis", depth.thesis, "m")
            .number("at_retina", depth.at_retina, "m")
            .number("consistent", depth.consistent, "m");
      });
  if (field)
    table.table("field_of_view", [&field](ResultTable& made) {
      made.number("angle", field->angle, "rad").text("limit", field->limit);
    });
  return 1;
}

/// S_I to S_V, as lengths.
void set_sums(ResultTable& table, const optics::SeidelSums& sums) {
  table.number("spherical", sums.spherical, "m")
      .number("coma", sums.coma, "m")
      .number("astigmatism", sums.astigmatism, "m")
      .number("petzval", sums.petzval, "m")
      .number("distortion", sums.distortion, "m");
}

/// Third order: the sums of each surface, and what their total means at the paraxial image.
int seidel(Call& call) {
  const auto made = optics::third_order_aberrations(
      eye_of(call).system, call.number_option("object_height").value_or(5e-3),
      call.number_option("depth").value_or(0));
  ResultTable(call)
      .number("image_distance", made.image_distance, "m")
      .number("image_height", made.image_height, "m")
      .number("petzval_curvature", made.petzval_curvature, "1/m")
      .number("longitudinal_spherical", made.longitudinal_spherical(), "m")
      .number("tangential_field", made.tangential_field(), "m")
      .number("sagittal_field", made.sagittal_field(), "m")
      .number("distortion_height", made.distortion_height(), "m")
      .table("total", [&made](ResultTable& total) { set_sums(total, made.total); })
      .list("surfaces", made.surfaces.size(), [&made](ResultTable& surface, std::size_t i) {
        set_sums(surface, made.surfaces[i]);
        // The retina is the object and has no sum: the first entry is that of surface 2.
        surface.integer("surface", static_cast<lua_Integer>(i + 2));
      });
  return 1;
}

std::vector<ResultField> sum_fields() {
  std::vector<ResultField> fields;
  for (const char* name : {"spherical", "coma", "astigmatism", "petzval", "distortion"})
    fields.push_back({name, "m", ""});
  return fields;
}

Binding seidel_row() {
  std::vector<ResultField> of_surface = sum_fields();
  of_surface.push_back({"surface", "", "its number; the retina is 1"});
  return {"seidel",
          {options_of({length_option("object_height", 1e-9, 1, "of the field's edge (5 mm)"),
                       length_option("depth", 0, 1, "before the retina (0)")})},
          {"table",
           {{"total", "", "sums of the system", sum_fields()},
            {"surfaces", "", "those of each surface", of_surface},
            {"image_distance", "m", "from the last vertex"},
            {"image_height", "m", ""},
            {"petzval_curvature", "1/m", ""},
            {"longitudinal_spherical", "m", "at the image"},
            {"tangential_field", "m", "at the image"},
            {"sagittal_field", "m", "at the image"},
            {"distortion_height", "m", "at the image"}}},
          "third-order sums, and what they mean at the image",
          seidel,
          "eye:seidel { object_height = 5 * mm }"};
}

Binding viewing_row() {
  return {
      "viewing",
      {options_of(
          {length_option("confusion", 1e-9, 1e-2, "circle of confusion (6.4 µm)"),
           length_option("range", 1e-6, 1, "of the thesis' secant for the depth of field (5 mm)"),
           length_option("observer_distance", 1e-6, 10,
                         "for the field of view: observer's pupil before the eye"),
           length_option("clear_radius", 1e-6, 1,
                         "for the field of view through lenses: their clear radius"),
           {.name = "from_surface",
            .type = Type::integer,
            .optional = true,
            .min = 1,
            .max = 1000,
            .help = "which surfaces have that radius: those behind this one (the last lens)"}})},
      {"table",
       {{"numerical_aperture",
         "",
         "",
         {{"oslo", "", "the thesis' 0.159"},
          {"object_beam", "", ""},
          {"image_beam", "", ""},
          {"object_stop", "", ""},
          {"image_stop", "", ""}}},
        {"depth_of_focus",
         "",
         "by (4.1)",
         {{"thesis", "m", "its mixed reading"}, {"image_side", "m", ""}, {"object_side", "m", ""}}},
        {"depth_of_field",
         "",
         "the depth of focus as a depth in the eye",
         {{"thesis", "m", ""}, {"at_retina", "m", ""}, {"consistent", "m", ""}}},
        {.name = "field_of_view",
         .help = "how much of the retina is seen (3.1); with observer_distance or clear_radius",
         .fields = {{"angle", "rad", "full angle"}, {"limit", "", "what limits it"}},
         .optional = true}}},
      "aperture, depth of focus and of field, and the field of view",
      viewing,
      "eye:viewing { clear_radius = 10.5 * mm, from_surface = 5 }"};
}

}  // namespace

std::vector<Binding> system_first_order_rows() {
  std::vector<ResultField> points;
  for (const auto& [name, value] : kCardinalPoints) points.push_back({name, "m", ""});
  return {{"first_order",
           {},
           Returned("table", points).or_nil("when afocal"),
           "focal lengths, principal points, foci and nodal points",
           first_order,
           "eye:first_order()"},
          {"axial_image",
           {{.name = "depth",
             .type = Type::number,
             .unit = "m",
             .optional = true,
             .help = "before the retina (0)"}},
           Returned("table", std::vector<ResultField>{{"distance", "m", "from the last vertex"},
                                                      {"magnification", "", "lateral"},
                                                      {"longitudinal", "", "magnification"}})
               .or_nil("at infinity"),
           "where an object on the axis is imaged",
           axial_image,
           "eye:axial_image(2 * mm)"},
          seidel_row(),
          viewing_row()};
}

}  // namespace vitreo::lua
