// optical_system: first order, light, depth, field, third-order sums.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/optics/bind_optics.h"
#include "optics/analysis/aberrations.h"
#include "optics/analysis/viewing.h"
#include "optics/system/first_order.h"

#include <stdexcept>

namespace vitreo::lua {
namespace {

int first_order(Call& call) {
  const auto points = optics::cardinal_points(eye_of(call).system);
  if (!points) return 0;
  push_fields(call.L, {{"focal_length", points->focal_length},
                       {"front_focal_length", points->front_focal_length},
                       {"back_focal_length", points->back_focal_length},
                       {"first_principal_point", points->first_principal_point},
                       {"second_principal_point", points->second_principal_point},
                       {"front_focus", points->front_focus},
                       {"back_focus", points->back_focus},
                       {"first_nodal_point", points->first_nodal_point},
                       {"second_nodal_point", points->second_nodal_point}});
  return 1;
}

int axial_image(Call& call) {
  const auto image = optics::axial_image(eye_of(call).system, call.has(0) ? call.number(0) : 0);
  if (!image) return 0;
  push_fields(call.L, {{"distance", image->distance},
                       {"magnification", image->magnification},
                       {"longitudinal", image->longitudinal}});
  return 1;
}

int numerical_aperture(Call& call) {
  const auto aperture = optics::numerical_aperture(eye_of(call).system);
  push_fields(call.L, {{"oslo", aperture.oslo},
                       {"object_beam", aperture.object_beam},
                       {"image_beam", aperture.image_beam},
                       {"object_stop", aperture.object_stop},
                       {"image_stop", aperture.image_stop}});
  return 1;
}

double confusion_of(const Call& call) { return call.number_option("confusion").value_or(6.4e-6); }

int depth_of_focus(Call& call) {
  const auto depth = optics::depth_of_focus(eye_of(call).system, confusion_of(call));
  push_fields(call.L, {{"thesis", depth.thesis},
                       {"image_side", depth.image_side},
                       {"object_side", depth.object_side}});
  return 1;
}

int depth_of_field(Call& call) {
  const auto depth = optics::depth_of_field(eye_of(call).system, confusion_of(call),
                                            call.number_option("range").value_or(5e-3));
  push_fields(
      call.L,
      {{"thesis", depth.thesis}, {"at_retina", depth.at_retina}, {"consistent", depth.consistent}});
  return 1;
}

int field_of_view(Call& call) {
  const optics::System& system = eye_of(call).system;
  const auto radius = call.number_option("clear_radius"),
             distance = call.number_option("observer_distance");
  if (radius.has_value() == distance.has_value())
    throw std::invalid_argument("options: wants either observer_distance or clear_radius");
  const int from = static_cast<int>(call.number_option("from_surface").value_or(system.size() - 1));
  const optics::FieldOfView field = radius ? optics::vignetted_field_of_view(system, from, *radius)
                                           : optics::direct_field_of_view(system, *distance);
  lua_pushnumber(call.L, field.angle);
  lua_pushstring(call.L, field.limit.c_str());
  return 2;
}

std::vector<Field> sums(const optics::SeidelSums& sums) {
  return {{"spherical", sums.spherical},
          {"coma", sums.coma},
          {"astigmatism", sums.astigmatism},
          {"petzval", sums.petzval},
          {"distortion", sums.distortion}};
}

int seidel(Call& call) {
  const auto made = optics::third_order_aberrations(
      eye_of(call).system, call.number_option("object_height").value_or(5e-3),
      call.number_option("depth").value_or(0));
  push_fields(call.L, {{"image_distance", made.image_distance},
                       {"image_height", made.image_height},
                       {"petzval_curvature", made.petzval_curvature},
                       {"longitudinal_spherical", made.longitudinal_spherical()},
                       {"tangential_field", made.tangential_field()},
                       {"sagittal_field", made.sagittal_field()},
                       {"distortion_height", made.distortion_height()}});
  push_fields(call.L, sums(made.total));
  lua_setfield(call.L, -2, "total");
  lua_newtable(call.L);
  for (std::size_t i = 0; i < made.surfaces.size(); ++i) {
    push_fields(call.L, sums(made.surfaces[i]));
    lua_pushinteger(call.L, static_cast<lua_Integer>(i + 2));
    lua_setfield(call.L, -2, "surface");
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  lua_setfield(call.L, -2, "surfaces");
  return 1;
}

std::vector<Binding> viewing_rows() {
  const Argument confusion = length_option("confusion", 1e-9, 1e-2, "circle of confusion (6.4 um)");
  return {
      {"numerical_aperture",
       {},
       "table",
       "oslo (the thesis' 0.159), object_beam, image_beam, object_stop, image_stop",
       numerical_aperture},
      {"depth_of_focus",
       {options_of({confusion})},
       "table in m",
       "by (4.1): thesis (its mixed reading), image_side, object_side",
       depth_of_focus},
      {"depth_of_field",
       {options_of({confusion, length_option("range", 1e-6, 1, "of the thesis' secant (5 mm)")})},
       "table in m",
       "that as a depth in the eye: thesis, at_retina, consistent",
       depth_of_field},
      {"field_of_view",
       {options_of(
           {length_option("observer_distance", 1e-6, 10, "direct: observer's pupil before the eye"),
            length_option("clear_radius", 1e-6, 1, "through lenses: their clear radius"),
            {.name = "from_surface",
             .type = Type::integer,
             .optional = true,
             .min = 1,
             .max = 1000,
             .help = "which surfaces have that radius: those behind this one (the last lens)"}})},
       "full angle in rad, what limits it",
       "how much of the retina is seen (3.1)",
       field_of_view}};
}

}  // namespace

std::vector<Binding> system_first_order_rows() {
  std::vector<Binding> rows = {
      {"first_order",
       {},
       "table in m, or nil when afocal",
       "focal_length, front_ and back_focal_length, first_ and second_principal_point, foci, nodal "
       "points",
       first_order},
      {"axial_image",
       {{.name = "depth",
         .type = Type::number,
         .unit = "m",
         .optional = true,
         .help = "before the retina (0)"}},
       "table, or nil at infinity",
       "where an object on the axis is imaged: distance in m from the last vertex, magnification, "
       "longitudinal",
       axial_image},
      {"seidel",
       {options_of({length_option("object_height", 1e-9, 1, "of the field's edge (5 mm)"),
                    length_option("depth", 0, 1, "before the retina (0)")})},
       "table",
       "third-order sums in m: total, surfaces (a list), and what they mean at the image",
       seidel}};
  for (Binding& row : viewing_rows()) rows.push_back(std::move(row));
  return rows;
}

}  // namespace vitreo::lua
