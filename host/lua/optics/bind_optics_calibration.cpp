// Bindings of calibration: cameras, the retina's shape, the law of depth on the axis, the eye
// itself (thesis 4.3, 4.4).
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "optics/calibration/calibration.h"
#include "optics/calibration/camera_calibration.h"
#include "optics/calibration/eye_estimation.h"
#include "optics/calibration/microscope_calibration.h"
#include "optics/calibration/retina_shape.h"

#include <cmath>
#include <functional>
#include <stdexcept>
#include <string>

namespace vitreo::lua {
namespace {

/// Calls `read` with each entry of the option `name`, a list of tables with none but the `known`
/// keys.
void each_entry(const Call& call, const std::string& name, const std::vector<std::string>& known,
                const std::function<void(const OptionTable&, const std::string& where)>& read) {
  call.push_option(name);
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    const std::string where = name + ": " + std::to_string(i) + ": ";
    if (lua_rawgeti(call.L, list, i) != LUA_TTABLE)
      throw std::invalid_argument(where + "wants a table, got " + kind_of(call.L, -1));
    refuse_unknown(call.L, lua_gettop(call.L), where, known);
    read(OptionTable(call.L, lua_gettop(call.L)), where);
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
}

/// Two numbers of an entry; `where` names the entry in the error.
Eigen::Vector2d pair(const OptionTable& entry, const char* name, const std::string& where) {
  const auto numbers = entry.numbers(name);
  if (!numbers || numbers->size() != 2)
    throw std::invalid_argument(where + name + ": wants two numbers");
  return {(*numbers)[0], (*numbers)[1]};
}

/// Two pairs determine the four numbers of scale, rotation and center, and leave nothing over to
/// judge them by: a sigma of 0 would claim that they are exact.
constexpr std::size_t kLeastPairs = 2;

int fit_camera(Call& call) {
  std::vector<optics::PointPair> pairs;
  // m counts in the aerial image, which is inverted; the fit finds the rotation that is left over.
  each_entry(call, "points", {"m", "pixel"},
             [&](const OptionTable& entry, const std::string& where) {
               pairs.push_back({pair(entry, "m", where), pair(entry, "pixel", where)});
             });
  const optics::CameraFit fit = optics::fit_camera(pairs);
  ResultTable table(call);
  table.number("pixel", fit.image.pixel, "m")
      .numbers("center", {fit.image.center_px.x(), fit.image.center_px.y()})
      .number("rotation", fit.rotation, "rad")
      .number("rms_residual_px", fit.rms_residual_px)
      .number("max_residual_px", fit.max_residual_px);
  if (pairs.size() > kLeastPairs)
    table.number("pixel_sigma", fit.scale_sigma, "m")
        .numbers("center_sigma_px", {fit.center_sigma_px.x(), fit.center_sigma_px.y()})
        .number("rotation_sigma", fit.rotation_sigma, "rad");
  return 1;
}

int fit_microscope(Call& call) {
  std::vector<optics::TargetPoint> points;
  each_entry(
      call, "points", {"position", "pixel"},
      [&](const OptionTable& entry, const std::string& where) {
        const auto position = entry.vector("position");
        if (!position)
          throw std::invalid_argument(where + "position: wants three numbers {x, y, z} in m");
        points.push_back({*position, pair(entry, "pixel", where)});
      });
  const optics::MicroscopeFit fit = optics::fit_microscope(points);
  ResultTable(call)
      .number("pixel", fit.pixel, "m")
      .number("pixel_sigma", fit.pixel_sigma, "m")
      .number("pupil_power", fit.pupil_power, "1/m")
      .number("pupil_power_sigma", fit.pupil_power_sigma, "1/m")
      .numbers("tilt", {fit.tilt.x(), fit.tilt.y()}, "rad")
      .numbers("tilt_sigma", {fit.tilt_sigma.x(), fit.tilt_sigma.y()}, "rad")
      .numbers("center", {fit.center_px.x(), fit.center_px.y()})
      .numbers("center_sigma_px", {fit.center_sigma_px.x(), fit.center_sigma_px.y()})
      .number("rotation", fit.rotation, "rad")
      .number("rotation_sigma", fit.rotation_sigma, "rad")
      .number("rms_residual_px", fit.rms_residual_px)
      .number("max_residual_px", fit.max_residual_px);
  return 1;
}

/// A conicoid through points: vertex, radius and conic, of which the last or the vertex' way aside
/// may be held where the points tell too little of them.
int fit_retina(Call& call) {
  std::vector<Eigen::Vector3d> points;
  call.push_option("points");
  const int list = lua_gettop(call.L);
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, list));
  for (lua_Integer i = 1; i <= count; ++i) {
    lua_rawgeti(call.L, list, i);
    const auto point = to_vector(call.L, -1);
    if (!point)
      throw std::invalid_argument("points: " + std::to_string(i) +
                                  ": wants a position {x, y, z} in m");
    points.push_back(*point);
    lua_pop(call.L, 1);
  }
  optics::RetinaFitOptions options;
  // Given means held: a fit of the conic needs points far aside of the axis.
  if (const auto conic = call.number_option("conic")) {
    options.conic = *conic;
    options.fit_conic = false;
  }
  options.fit_center = !call.flag_option("on_axis");
  const optics::RetinaFit fit = optics::fit_retina(points, options);
  const Eigen::VectorXd sigma = fit.covariance.diagonal().cwiseSqrt();
  ResultTable(call)
      .vector("vertex", fit.vertex, "m")
      .number("radius", fit.radius, "m")
      .number("conic", fit.conic)
      .number("rms_residual", fit.rms_residual, "m")
      .number("max_residual", fit.max_residual, "m")
      .table("sigma", [&sigma](ResultTable& of) {
        constexpr std::pair<const char*, const char*> kSigmas[] = {
            {"x", "m"}, {"y", "m"}, {"z", "m"}, {"radius", "m"}, {"conic", ""}};
        for (Eigen::Index i = 0; i < 5; ++i)
          if (sigma[i] > 0)  // 0: held, or no spare points
            of.number(kSigmas[i].first, sigma[i], kSigmas[i].second);
      });
  return 1;
}

/// The law counts objects from surface 2 into the vitreous, so negative, (4.12); scripts count
/// depth from the retina towards the lens. The vitreous' length leads from the one to the other.
struct AxisLaw {
  optics::OnAxisLaw law;
  double vitreous = 0;  // m, from the retina to surface 2
};
const AxisLaw& law_of(const Call& call) { return call.self<AxisLaw>(); }

void push_law(lua_State* L, const AxisLaw& law) {
  push_handle(L, axis_law_class(), std::make_shared<AxisLaw>(law));
}

/// By first order alone; what the eye is in truth comes in by axis_law:calibrate.
int axis_law(Call& call) {
  const optics::System& system = eye_of(call).system;
  push_law(call.L, {optics::on_axis_law(system), system.surfaces.front().thickness});
  return 1;
}

/// Depth of what is sharp at d_ls. Nothing at the law's pole (4.11), nor behind the retina or
/// before the lens: there the law has a number, but the eye has no vitreous.
int law_depth(Call& call) {
  const AxisLaw& law = law_of(call);
  const auto object = law.law.object_from_sensor(call.number(0));
  if (!object || *object > 0 || *object < -law.vitreous) return 0;
  return call.result(*object + law.vitreous, "m");
}

/// The inverse; nothing only where the image lies at infinity.
int law_distance(Call& call) {
  const AxisLaw& law = law_of(call);
  const auto sensor = law.law.sensor_from_object(call.number(0) - law.vitreous);
  if (!sensor) return 0;
  return call.result(*sensor, "m");
}

/// (4.10) to (4.12) by their letters: f, [O1,PP1], [O2,PP2], n_v, e_dls, e_do.
int law_info(Call& call) {
  const optics::OnAxisLaw& law = law_of(call).law;
  ResultTable(call)
      .number("focal_length", law.focal_length, "m")
      .number("first_principal_point", law.first_principal_point, "m")
      .number("second_principal_point", law.second_principal_point, "m")
      .number("object_index", law.object_index)
      .number("sensor_shift", law.sensor_shift, "m")
      .number("object_shift", law.object_shift, "m");
  return 1;
}

/// On the eye's own retina (4.3): one equation for the law's two shifts. sensor_shift solves it
/// exactly by the one of the sensor alone; minimum_norm moves both, as little as possible.
int calibrate_on_retina(const Call& call, double distance) {
  AxisLaw law = law_of(call);
  const std::string method = call.text_option("method").value_or("sensor_shift");
  const auto fit =
      optics::calibrate_biometric(law.law, {distance, -law.vitreous},
                                  method == "sensor_shift" ? optics::BiometricMethod::sensor_shift
                                                           : optics::BiometricMethod::minimum_norm);
  law.law = fit.law;
  ResultTable table(call);
  push_law(call.L, law);
  table.top("law");
  return 1;
}

/// By points at known depths (4.4.4). Three of them determine the law and leave nothing over to
/// judge it by: no sigma then, where the fit's covariance is zero.
int calibrate_by_points(const Call& call) {
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
  const Eigen::Vector3d sigma = fit.covariance.diagonal().cwiseSqrt();
  ResultTable table(call);
  push_law(call.L, law);
  table.top("law")
      .number("rms_residual", fit.rms_residual, "m")
      .number("max_residual", fit.max_residual, "m");
  if (points.size() > 3)
    table.number("focal_length_sigma", sigma[0], "m")
        .number("first_principal_point_sigma", sigma[1], "m")
        .number("second_principal_point_sigma", sigma[2], "m");
  return 1;
}

/// The two ways to calibrate exclude one another: the fit takes the shifts of the retina into its
/// principal points, and would undo the other.
int law_calibrate(Call& call) {
  const auto retina = call.number_option("retina");
  const bool by_points = call.push_option("points");
  lua_pop(call.L, 1);
  if (retina.has_value() == by_points)
    throw std::invalid_argument("options: wants either retina or points");
  if (by_points && call.text_option("method"))
    throw std::invalid_argument("method: is for the calibration on the retina alone");
  return by_points ? calibrate_by_points(call) : calibrate_on_retina(call, *retina);
}

/// `learned` is 1 - (sigma / prior_sigma)^2: 0 where the foci say nothing about a parameter.
int push_estimate(const Call& call, const optics::EyeEstimate& estimate) {
  ResultTable table(call);
  push_system(call.L, estimate.eye);
  table.top("eye")
      .number("chi2", estimate.chi2)
      .number("iterations", estimate.iterations)
      .list("parameters", estimate.parameters.size(),
            [&estimate](ResultTable& entry, std::size_t i) {
              const optics::EstimatedParameter& one = estimate.parameters[i];
              entry.text("parameter", one.name)
                  .number("value", one.value)
                  .number("sigma", one.sigma)
                  .number("prior_sigma", one.prior_sigma)
                  .number("learned", one.learned);
            });
  return 1;
}

/// The eye that most probably has these foci on its axis, given table 5.1.
int estimate(Call& call) {
  std::vector<double> depths, distances, sigmas;
  each_entry(
      call, "foci", {"depth", "distance", "sigma"},
      [&](const OptionTable& entry, const std::string& where) {
        const auto depth = entry.number("depth"), distance = entry.number("distance");
        if (!depth || !distance)
          throw std::invalid_argument(where + "wants {depth = , distance = , sigma = } in m");
        depths.push_back(*depth), distances.push_back(*distance);
        // 20 µm where the script does not say how well a focus was found.
        sigmas.push_back(entry.number("sigma").value_or(20e-6));
      });
  if (depths.empty()) throw std::invalid_argument("foci: wants at least one");
  // By value: the calculation may outlive the script's handle when a stop comes.
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
  const auto plain = [](const char* name, const char* unit, const char* help) {
    return ResultField{name, unit, help};
  };
  const auto of_spare = [](const char* name, const char* unit, const char* help) {
    return ResultField{.name = name, .unit = unit, .help = help, .optional = true};
  };
  return {
      {"optics.fit_camera",
       {options_of({list_argument("points",
                                  "{{m = {x, y}, pixel = {u, v}}, ...}: aerial image in m, px")})},
       {"table",
        {plain("pixel", "m", "of aerial image"), plain("center", "", "{u, v}, px"),
         plain("rotation", "rad", ""), plain("rms_residual_px", "", ""),
         plain("max_residual_px", "", ""), of_spare("pixel_sigma", "m", "of three points or more"),
         of_spare("center_sigma_px", "", "{u, v}; likewise"),
         of_spare("rotation_sigma", "rad", "likewise")}},
       "a camera's scale, center and rotation from points, by least squares",
       fit_camera,
       "optics.fit_camera { points = pixels }"},
      {"optics.fit_microscope",
       {options_of({list_argument("points",
                                  "{{position = {x, y, z}, pixel = {u, v}}, ...}: of a target, m "
                                  "(z along the light from the plane in focus), px")})},
       {"table",
        {plain("pixel", "m", "of the plane in focus"), plain("pixel_sigma", "m", ""),
         plain("pupil_power", "1/m", "1 / the pupil's distance from that plane; 0: telecentric"),
         plain("pupil_power_sigma", "1/m", ""), plain("tilt", "rad", "about {x, y}"),
         plain("tilt_sigma", "rad", ""), plain("center", "", "{u, v} of its axis there, px"),
         plain("center_sigma_px", "", "{u, v}"),
         plain("rotation", "rad", "of the image; half a turn where it is inverted"),
         plain("rotation_sigma", "rad", ""), plain("rms_residual_px", "", ""),
         plain("max_residual_px", "", "")}},
       "a microscope's pupil, tilt, scale and center from a target at several heights without an "
       "eye, by least squares",
       fit_microscope,
       "optics.fit_microscope { points = target_points }"},
      {"optics.fit_retina",
       {options_of({list_argument("points", "positions on the retina, m"),
                    {.name = "conic",
                     .type = Type::number,
                     .optional = true,
                     .min = -100,
                     .max = 100,
                     .help = "holds the conic constant there (fitted)"},
                    {.name = "on_axis",
                     .type = Type::flag,
                     .optional = true,
                     .help = "holds the vertex on the eye's axis (false)"}})},
       {"table",
        {plain("vertex", "m", ""),
         plain("radius", "m", ""),
         plain("conic", "", ""),
         plain("rms_residual", "m", ""),
         plain("max_residual", "m", ""),
         {"sigma",
          "",
          "of the vertex and the shape, of what is fitted with points to spare",
          {of_spare("x", "m", ""), of_spare("y", "m", ""), of_spare("z", "m", ""),
           of_spare("radius", "m", ""), of_spare("conic", "", "")}}}},
       "the conicoid through points on the retina (4.4.2, 4.4.4)",
       fit_retina,
       "optics.fit_retina { points = on_retina, conic = 0 }"}};
}

std::vector<Binding> system_calibration_rows() {
  return {{"axis_law",
           {},
           "axis_law",
           "depth from focus on the axis by first order, (4.10) to (4.12)",
           axis_law,
           "eye:axis_law()"},
          {"estimate",
           {options_of({list_argument(
               "foci", "{{depth = , distance = , sigma = 20 µm}, ...}: objects on the axis, m")})},
           {"table",
            {{"eye", "", "the optical_system that was found"},
             {"parameters",
              "",
              "those of table 5.1, in SI",
              {{"parameter", "", "name"},
               {"value", "", ""},
               {"sigma", "", "after the measurements"},
               {"prior_sigma", "", "and before"},
               {"learned", "", "how much of its variance the measurements took away"}}},
             {"chi2", "", "of the measurements"},
             {"iterations", "", ""}}},
           "the most probable eye given table 5.1 and where objects on its axis are in focus",
           estimate,
           "eye:estimate { foci = { { depth = 0, distance = 7.9 * mm } } }"}};
}

const Class& axis_law_class() {
  const auto of_points = [](const char* name, const char* help) {
    return ResultField{.name = name, .unit = "m", .help = help, .optional = true};
  };
  Argument points =
      list_argument("points", "instead: {{depth = , distance = }, ...}, three or more, m");
  points.optional = true;
  static const Class kind{
      "axis_law",
      "depth on the axis from focus (4.10) to (4.12); make one with optical_system:axis_law",
      {{"depth",
        {{.name = "distance",
          .type = Type::number,
          .unit = "m",
          .help = "d_ls, where the object was sharp"}},
        Returned("number", "m").or_nil("outside of the vitreous"),
        "how far before the retina the object is",
        law_depth,
        "law:depth(9 * mm)"},
       {"distance",
        {{.name = "depth", .type = Type::number, .unit = "m", .help = "before the retina"}},
        Returned("number", "m").or_nil("at infinity"),
        "where an object is in focus, from the last vertex",
        law_distance,
        "law:distance(2 * mm)"},
       {"info",
        {},
        {"table",
         {{"focal_length", "m", ""},
          {"first_principal_point", "m", ""},
          {"second_principal_point", "m", ""},
          {"object_index", "", "of the vitreous"},
          {"sensor_shift", "m", "of the calibration"},
          {"object_shift", "m", "of the calibration"}}},
        "the law's constants",
        law_info,
        "law:info()"},
       {"calibrate",
        {options_of({{.name = "retina",
                      .type = Type::number,
                      .unit = "m",
                      .optional = true,
                      .help = "d_ls at which the eye's own retina was sharp (4.3)"},
                     {.name = "method",
                      .type = Type::text,
                      .optional = true,
                      .help = "how the shifts are found on the retina (sensor_shift); minimum_norm "
                              "as the thesis",
                      .choices = {"sensor_shift", "minimum_norm"}},
                     points})},
        {"table",
         {{"law", "", "the axis_law that was found"},
          of_points("rms_residual", "of points"),
          of_points("max_residual", "of points"),
          of_points("focal_length_sigma", "of more than three points"),
          of_points("first_principal_point_sigma", "of more than three points"),
          of_points("second_principal_point_sigma", "of more than three points")}},
        "calibrates on the eye's own retina (4.3), or by points at known depths (4.4.4)",
        law_calibrate,
        "law:calibrate { retina = 8 * mm }"}},
      {}};
  return kind;
}

}  // namespace vitreo::lua
