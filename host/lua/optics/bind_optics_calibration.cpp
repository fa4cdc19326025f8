// Calibration: cameras, the retina's shape, the law of depth on the axis, and the eye itself
// (thesis 4.3, 4.4).
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "optics/calibration/calibration.h"
#include "optics/calibration/camera_calibration.h"
#include "optics/calibration/eye_estimation.h"
#include "optics/calibration/retina_shape.h"

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

namespace vitreo::lua {
namespace {

/// Calls `read` with each entry of the list, a table with none but the `known` keys.
void each_entry(const Call& call, const std::string& name, const std::vector<std::string>& known,
                const std::function<void(const OptionTable&, const std::string& where)>& read) {
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, call.index(0)));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = name + ": " + std::to_string(i) + ": ";
    if (lua_rawgeti(call.L, call.index(0), i) != LUA_TTABLE)
      throw std::invalid_argument(where + "wants a table, got " + kind_of(call.L, -1));
    refuse_unknown(call.L, lua_gettop(call.L), where, known);
    read(OptionTable(call.L, lua_gettop(call.L)), where);
    lua_pop(call.L, 1);
  }
}

Eigen::Vector2d pair(const OptionTable& entry, const char* name, const std::string& where) {
  const auto numbers = entry.numbers(name);
  if (!numbers || numbers->size() != 2)
    throw std::invalid_argument(where + name + ": wants two numbers");
  return {(*numbers)[0], (*numbers)[1]};
}

int camera_calibration(Call& call) {
  std::vector<optics::PointPair> pairs;
  each_entry(call, "points", {"m", "pixel"},
             [&](const OptionTable& entry, const std::string& where) {
               pairs.push_back({pair(entry, "m", where), pair(entry, "pixel", where)});
             });
  const optics::CameraFit fit = optics::fit_camera(pairs);
  push_fields(call.L, {{"pixel", fit.image.pixel},
                       {"rotation", fit.rotation},
                       {"rms_residual_px", fit.rms_residual_px},
                       {"max_residual_px", fit.max_residual_px},
                       {"pixel_sigma", fit.scale_sigma},
                       {"rotation_sigma", fit.rotation_sigma}});
  push_numbers(call.L, {fit.image.center_px.x(), fit.image.center_px.y()});
  lua_setfield(call.L, -2, "center");
  push_numbers(call.L, {fit.center_sigma_px.x(), fit.center_sigma_px.y()});
  lua_setfield(call.L, -2, "center_sigma_px");
  return 1;
}

int retina_shape(Call& call) {
  std::vector<Eigen::Vector3d> points;
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, call.index(0)));
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(call.L, call.index(0), i);
    const auto point = to_vector(call.L, -1);
    if (!point)
      throw std::invalid_argument("points: " + std::to_string(i) +
                                  ": wants a position {x, y, z} in m");
    points.push_back(*point);
    lua_pop(call.L, 1);
  }
  optics::RetinaFitOptions options;
  if (const auto conic = call.number_option("conic")) {
    options.conic = *conic;
    options.fit_conic = false;
  }
  options.fit_center = !call.flag_option("on_axis");
  const optics::RetinaFit fit = optics::fit_retina(points, options);
  push_fields(call.L, {{"radius", fit.radius},
                       {"conic", fit.conic},
                       {"rms_residual", fit.rms_residual},
                       {"max_residual", fit.max_residual}});
  push_vector(call.L, fit.vertex);
  lua_setfield(call.L, -2, "vertex");
  const Eigen::VectorXd sigma = fit.covariance.diagonal().cwiseSqrt();
  push_fields(call.L, {{"x", sigma[0]},
                       {"y", sigma[1]},
                       {"z", sigma[2]},
                       {"radius", sigma[3]},
                       {"conic", sigma[4]}});
  lua_setfield(call.L, -2, "sigma");
  return 1;
}

struct AxisLaw {
  optics::OnAxisLaw law;
  double vitreous = 0;  // m, from the retina to surface 2
};
const AxisLaw& law_of(const Call& call) { return call.self<AxisLaw>(); }

void push_law(lua_State* L, const AxisLaw& law) {
  push_handle(L, axis_law_class(), std::make_shared<AxisLaw>(law));
}

int axis_law(Call& call) {
  const optics::System& system = eye_of(call).system;
  push_law(call.L, {optics::on_axis_law(system), system.surfaces.front().thickness});
  return 1;
}

int law_depth(Call& call) {
  const AxisLaw& law = law_of(call);
  const auto object = law.law.object_from_sensor(call.number(0));
  if (!object || *object > 0 || *object < -law.vitreous) return 0;
  return call.result(*object + law.vitreous);
}

int law_distance(Call& call) {
  const AxisLaw& law = law_of(call);
  const auto sensor = law.law.sensor_from_object(call.number(0) - law.vitreous);
  if (!sensor) return 0;
  return call.result(*sensor);
}

int law_values(Call& call) {
  const optics::OnAxisLaw& law = law_of(call).law;
  push_fields(call.L, {{"focal_length", law.focal_length},
                       {"first_principal_point", law.first_principal_point},
                       {"second_principal_point", law.second_principal_point},
                       {"object_index", law.object_index},
                       {"sensor_shift", law.sensor_shift},
                       {"object_shift", law.object_shift}});
  return 1;
}

int law_on_retina(Call& call) {
  AxisLaw law = law_of(call);
  const std::string method = call.text_option("method").value_or("sensor_shift");
  if (method != "sensor_shift" && method != "minimum_norm")
    throw std::invalid_argument("method: wants sensor_shift or minimum_norm, got " + method);
  const auto fit =
      optics::calibrate_biometric(law.law, {call.number(0), -law.vitreous},
                                  method == "sensor_shift" ? optics::BiometricMethod::sensor_shift
                                                           : optics::BiometricMethod::minimum_norm);
  law.law = fit.law;
  push_law(call.L, law);
  return 1;
}

int law_fitted(Call& call) {
  AxisLaw law = law_of(call);
  std::vector<optics::OnAxisPoint> points;
  each_entry(call, "points", {"depth", "distance"},
             [&](const OptionTable& entry, const std::string& where) {
               const auto depth = entry.number("depth"), distance = entry.number("distance");
               if (!depth || !distance)
                 throw std::invalid_argument(where + "wants {depth = , distance = } in m");
               points.push_back({*distance, *depth - law.vitreous});
             });
  const optics::OnAxisFit fit = optics::fit_on_axis(law.law, points);
  law.law = fit.law;
  push_law(call.L, law);
  const Eigen::Vector3d sigma = fit.covariance.diagonal().cwiseSqrt();
  push_fields(call.L, {{"rms_residual", fit.rms_residual},
                       {"max_residual", fit.max_residual},
                       {"focal_length_sigma", sigma[0]},
                       {"first_principal_point_sigma", sigma[1]},
                       {"second_principal_point_sigma", sigma[2]}});
  return 2;
}

int push_estimate(Call& call, const optics::EyeEstimate& estimate) {
  push_system(call.L, estimate.eye);
  lua_newtable(call.L);
  for (std::size_t i = 0; i < estimate.parameters.size(); ++i) {
    const optics::EstimatedParameter& one = estimate.parameters[i];
    push_fields(call.L, {{"value", one.value},
                         {"sigma", one.sigma},
                         {"prior_sigma", one.prior_sigma},
                         {"learned", one.learned}});
    lua_pushstring(call.L, one.name.c_str());
    lua_setfield(call.L, -2, "parameter");
    lua_rawseti(call.L, -2, static_cast<lua_Integer>(i + 1));
  }
  push_fields(call.L,
              {{"chi2", estimate.chi2}, {"iterations", static_cast<double>(estimate.iterations)}});
  return 3;
}

/// The eye that most probably has these foci on its axis, given table 5.1.
int estimated(Call& call) {
  std::vector<double> depths, distances, sigmas;
  each_entry(
      call, "foci", {"depth", "distance", "sigma"},
      [&](const OptionTable& entry, const std::string& where) {
        const auto depth = entry.number("depth"), distance = entry.number("distance");
        if (!depth || !distance)
          throw std::invalid_argument(where + "wants {depth = , distance = , sigma = } in m");
        depths.push_back(*depth), distances.push_back(*distance);
        sigmas.push_back(entry.number("sigma").value_or(20e-6));
      });
  if (depths.empty()) throw std::invalid_argument("foci: wants at least one");
  const optics::Prescription eye = eye_of(call);
  return calculate(
      call, "eye estimation",
      [=](const YieldPoint&) {
        const auto as_vector = [](const std::vector<double>& values) {
          return Eigen::VectorXd(Eigen::Map<const Eigen::VectorXd>(
              values.data(), static_cast<Eigen::Index>(values.size())));
        };
        return optics::estimate_eye(eye, optics::applicable(optics::table_5_1(), eye),
                                    optics::on_axis_model(depths), as_vector(distances),
                                    as_vector(sigmas));
      },
      push_estimate);
}

Argument list_argument(const char* name, const char* help) {
  return {.name = name, .type = Type::list, .help = help};
}

}  // namespace

std::vector<Binding> calibration_functions() {
  return {{"optics.camera_calibration",
           {list_argument("points", "{{m = {x, y}, pixel = {u, v}}, ...}: aerial image in m, px")},
           "table: pixel in m, center, rotation in rad, rms_residual_px, max_residual_px, "
           "pixel_sigma in m, "
           "center_sigma_px, rotation_sigma in rad",
           "a camera's scale (m of aerial image per px), center and rotation, by least squares",
           camera_calibration},
          {"optics.retina_shape",
           {list_argument("points", "positions on the retina, m"),
            options_of({{.name = "conic",
                         .type = Type::number,
                         .optional = true,
                         .min = -100,
                         .max = 100,
                         .help = "holds the conic constant there (fitted)"},
                        {.name = "on_axis",
                         .type = Type::flag,
                         .optional = true,
                         .help = "holds the vertex on the eye's axis (false)"}})},
           "table: vertex in m, radius in m, conic, rms_residual in m, max_residual in m, sigma",
           "the conicoid through points on the retina (4.4.2, 4.4.4)",
           retina_shape}};
}

std::vector<Binding> system_calibration_rows() {
  return {{"axis_law",
           {},
           "axis_law",
           "depth from focus on the axis by first order, (4.10) to (4.12)",
           axis_law},
          {"estimated",
           {list_argument("foci",
                          "{{depth = , distance = , sigma = 20 um}, ...}: objects on the axis, m")},
           "optical_system; list of parameter, value, sigma, prior_sigma, learned; table: chi2, "
           "iterations",
           "the most probable eye given table 5.1 and where objects on its axis are in focus",
           estimated}};
}

const Class& axis_law_class() {
  static const Class kind{
      "axis_law",
      "depth on the axis from focus (4.10) to (4.12); make one with optical_system:axis_law",
      {{"depth",
        {{.name = "distance",
          .type = Type::number,
          .unit = "m",
          .help = "d_ls, where the object was sharp"}},
        "number in m, or nil outside of the vitreous",
        "how far before the retina the object is",
        law_depth},
       {"distance",
        {{.name = "depth", .type = Type::number, .unit = "m", .help = "before the retina"}},
        "number in m, or nil",
        "where an object is in focus, from the last vertex",
        law_distance},
       {"values",
        {},
        "table in m",
        "focal_length, first_principal_point, second_principal_point, object_index, sensor_shift, "
        "object_shift",
        law_values},
       {"on_retina",
        {{.name = "distance",
          .type = Type::number,
          .unit = "m",
          .help = "d_ls at which the retina was sharp"},
         options_of({{.name = "method",
                      .type = Type::text,
                      .optional = true,
                      .help = "how the shifts are found (sensor_shift); minimum_norm as the thesis",
                      .choices = {"sensor_shift", "minimum_norm"}}})},
        "axis_law",
        "biometric calibration on the eye's own retina (4.3)",
        law_on_retina},
       {"fitted",
        {list_argument("points", "{{depth = , distance = }, ...}, three or more, m")},
        "axis_law, table: rms_residual, max_residual, and sigmas with more than three points",
        "full calibration on the axis (4.4.4)",
        law_fitted}},
      {}};
  return kind;
}

}  // namespace vitreo::lua
