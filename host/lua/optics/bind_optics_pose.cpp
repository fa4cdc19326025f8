// Bindings of localizer: pose of a body of known shape, from its ellipse or from points on it.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/calculation.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/optics/bind_optics.h"
#include "host/lua/optics/classes.h"
#include "host/lua/optics/localizer_calls.h"
#include "optics/calibration/camera_calibration.h"
#include "optics/chain/eye_look.h"
#include "optics/pose/equivalent_ellipse.h"

#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace vitreo::lua {
namespace {

using namespace localizer_calls;

Localizer& localizer_of(const Call& call) { return call.self<Localizer>(); }

/// Thesis 5.3: the pose whose silhouette shows this ellipse. All is copied into the calculation,
/// which may last longer than the script's handles.
int locate_by_ellipse(const Call& call) {
  const Localizer& localizer = localizer_of(call);
  const OptionTable how(call, 0);
  auto settings = settings_at(how, localizer);
  settings.object = body_option(call);
  const SeenEllipse seen = ellipse_option(call);
  const optics::PoseStart start = start_at(how, localizer);
  return calculate(
      call, "locate",
      [settings, seen, start](const YieldPoint&) {
        optics::ObjectPose pose =
            optics::locate_object(settings, seen.ellipse, seen.covariance, start);
        judge_fit(settings, seen, pose);
        return pose;
      },
      [offset = localizer.offset](Call& done, const optics::ObjectPose& pose) {
        return push_pose(done, pose, offset);
      });
}

/// `locate`: a pose of copies alone. It may last longer than the script's handles.
template <class Locate>
int calculate_pose(const Call& call, const char* what, const Localizer& localizer, Locate locate) {
  return calculate(
      call, what, [locate](const YieldPoint&) { return locate(); },
      [offset = localizer.offset](Call& done, const optics::ObjectPose& pose) {
        return push_pose(done, pose, offset);
      });
}

/// The same by points known on the body, which show its orientation too.
int locate_by_points(const Call& call) {
  const Localizer& localizer = localizer_of(call);
  const OptionTable how(call, 0);
  const auto settings = settings_at(how, localizer);
  const auto points = points_option(call);
  const optics::PoseStart start = start_at(how, localizer);
  return calculate_pose(call, "locate points", localizer, [settings, points, start] {
    return optics::locate_points(settings, points, start);
  });
}

/// The same by the outline itself, which needs a body of convex parts.
int locate_by_outline(const Call& call) {
  const Localizer& localizer = localizer_of(call);
  const OptionTable how(call, 0);
  auto settings = settings_at(how, localizer);
  settings.object = body_option(call);
  const auto outline = outline_option(call);
  const optics::PoseStart start = start_at(how, localizer);
  return calculate_pose(call, "locate outline", localizer, [settings, outline, start] {
    return optics::locate_outline(settings, outline, start);
  });
}

/// By what is given: points with positions on the body need no body's shape, an ellipse does.
int locate(Call& call) {
  const auto given = [&call](const char* name) {
    const bool is_given = call.push_option(name);
    lua_pop(call.L, 1);
    return is_given;
  };
  // An empty list counts as given: the solver refuses it by name.
  const bool points = given("points");
  const bool outline = given("outline");
  if (points + outline + given("ellipse") != 1)
    throw std::invalid_argument("options: wants either ellipse, outline or points");
  if (points && given("body"))
    throw std::invalid_argument("body: goes with ellipse or outline, not points");
  if (points) return locate_by_points(call);
  return outline ? locate_by_outline(call) : locate_by_ellipse(call);
}

/// The forward way: what a tracker would measure of a body in that pose, by the projection that
/// locate inverts.
int ellipse(Call& call) {
  const Localizer& localizer = localizer_of(call);
  optics::ObjectPoseSettings settings = localizer.settings;
  settings.object = body_option(call);
  const OptionTable how(call, 0);
  const optics::PoseStart start = start_at(how, localizer);
  if (!start.orientation)
    throw std::invalid_argument("axis: is missing; wants axis or orientation");
  const auto shown = optics::project_object(settings, {*start.position_in_eye, *start.orientation},
                                            how.number("scale").value_or(1));
  if (!shown) return 0;
  ResultTable(call)
      .number("u", (*shown)[0])
      .number("v", (*shown)[1])
      .number("semi_major", (*shown)[2])
      .number("semi_minor", (*shown)[3])
      .number("angle", (*shown)[4], "rad");
  return 1;
}

/// The forward way of an outline.
int outline(Call& call) {
  const Localizer& localizer = localizer_of(call);
  optics::ObjectPoseSettings settings = localizer.settings;
  settings.object = body_option(call);
  const OptionTable how(call, 0);
  const optics::PoseStart start = start_at(how, localizer);
  if (!start.orientation)
    throw std::invalid_argument("axis: is missing; wants axis or orientation");
  constexpr double kUsualCount = 64;  // as many as a tracker has normals
  const auto shown =
      optics::project_outline(settings, {*start.position_in_eye, *start.orientation},
                              static_cast<int>(how.number("count").value_or(kUsualCount)));
  if (!shown) return 0;
  return push_result_list(call, shown->size(), [&](ResultTable& point, std::size_t i) {
    point.number("u", (*shown)[i].x()).number("v", (*shown)[i].y());
  });
}

/// Positions that a calibration has moved are moved back first: the projection knows only its own.
int pixel(Call& call) {
  const Localizer& localizer = localizer_of(call);
  const Eigen::Vector3d point = call.vector(0) - localizer.offset;
  const auto& exact = localizer.settings.exact;
  const auto m = exact ? exact->project(point) : localizer.settings.projection.project(point);
  if (!m) return 0;
  const Eigen::Vector2d at = localizer.settings.image.pixel_from_m(*m);
  ResultTable(call).number("u", at.x()).number("v", at.y());
  return 1;
}

/// The exact projection states its residual, the single viewpoint its place.
int info(Call& call) {
  const optics::ObjectPoseSettings& settings = localizer_of(call).settings;
  ResultTable table(call);
  table.number("pixel", settings.image.pixel, "m");
  if (settings.exact)
    table.number("max_m", settings.exact->max_m(), "m")
        .number("max_z", settings.exact->max_z(), "m")
        .number("max_residual", settings.exact->max_residual(), "m");
  else
    table.number("max_m", settings.projection.max_m, "m")
        .number("max_z", settings.projection.max_z, "m")
        .number("viewpoint", settings.projection.viewpoint, "m");
  return 1;
}

/// The thesis' two corrections: of the image's scale, or of the depth. A localizer that was
/// calibrated before adds its offset to what it finds, so its own projection has to find the height
/// less that.
optics::PoseCalibration by_thesis(const Localizer& before, const optics::PoseSettings& settings,
                                  const OptionTable& how, const SeenEllipse& seen) {
  for (const char* name : {"axis_sigma", "contour_sigma", "pixel_sigma", "size_sigma"})
    if (how.number(name))
      throw std::invalid_argument(std::string(name) + ": goes with the correction eye alone");
  return optics::calibrate_pose(
      settings, seen.ellipse, *how.vector("axis"), *how.number("known_z") - before.offset.z(),
      how.text("correction") == "additive_offset" ? optics::PoseCorrection::additive_offset
                                                  : optics::PoseCorrection::image_scale,
      {seen.covariance, how.number("known_z_sigma").value_or(0)});
}

/// The most probable eye, with its projections as far as those of before went. Returns the residual
/// along z at the known height, m: what the prior kept.
double take_eye(Localizer& view, const optics::PoseSettings& settings, const OptionTable& how,
                const SeenEllipse& seen) {
  constexpr double kRough = 0.01e-3;    // m, of a retina
  constexpr double kUsualAxis = 0.035;  // rad, as viewing_chain has it
  const optics::NominalChain nominal{view.eye, view.microscope, settings.image, settings.robot};
  const optics::EyeLook look{
      {seen.ellipse, seen.covariance, how.number("contour_sigma").value_or(0),
       how.number("axis_sigma").value_or(kUsualAxis)},
      how.vector("axis")->normalized(),
      *how.number("known_z") - view.offset.z(),
      how.number("known_z_sigma").value_or(kRough)};
  const optics::ProbableView made = optics::most_probable_view(
      nominal, look, {how.number("pixel_sigma").value_or(0), how.number("size_sigma").value_or(0)});
  view.eye = made.eye;
  view.eye_calibrated = true;
  view.robot_length = made.robot_length;
  view.robot_width = made.robot_width;
  view.settings.image.pixel *= made.pixel;
  const optics::System& system = view.eye.system;
  if (view.settings.exact)
    view.settings.exact.emplace(system, view.microscope, view.settings.exact->max_m());
  if (view.settings.projection.max_m > 0)
    view.settings.projection =
        optics::fit_single_viewpoint(system, view.microscope, view.settings.projection.max_m);
  optics::PoseSettings now = settings;
  now.projection = view.settings.projection;
  now.exact = view.settings.exact;
  now.image = view.settings.image;
  now.robot.semi_axis *= made.robot_length;
  now.robot.semi_radius *= made.robot_width;
  const auto start = optics::first_guess(now, seen.ellipse, look.axis);
  const auto found =
      start ? optics::locate(now, seen.ellipse, seen.covariance, look.axis, *start) : std::nullopt;
  if (!found) throw std::invalid_argument("ellipse: not explained by any eye of table 5.1");
  return found->position_in_eye.z() - look.known_z;
}

/// A cylinder's, as of the spheroid that the corrections know.
SeenEllipse spheroid_ellipse(const Localizer& view, const optics::ObjectModel& body,
                             const SeenEllipse& seen, const Eigen::Vector3d& axis) {
  if (body.ellipsoid()) return seen;
  optics::ObjectPoseSettings settings = view.settings;
  settings.object = body;
  SeenEllipse round = seen;
  const auto ellipse = optics::as_of_spheroid(settings, seen.ellipse, axis);
  if (!ellipse) throw std::invalid_argument("ellipse: lies outside of the projection");
  round.ellipse = *ellipse;
  return round;
}

/// One ellipse of a spheroid or a cylinder whose height is known: on the retina.
int calibrate(Call& call) {
  const Localizer before = localizer_of(call);
  const optics::ObjectModel body = body_option(call);
  const OptionTable how(call, 0);
  if (!body.round_about_z() || !body.parts.empty() || body.crossed)
    throw std::invalid_argument("shape: wants a spheroid or a cylinder");
  optics::PoseSettings settings;
  settings.projection = before.settings.projection;
  settings.image = before.settings.image;
  settings.exact = before.settings.exact;
  settings.robot = {body.semi_axes.z(), body.semi_axes.x()};
  const std::string correction = how.text("correction").value_or("image_scale");
  const SeenEllipse seen =
      spheroid_ellipse(before, body, ellipse_option(call), *how.vector("axis"));
  auto after = std::make_shared<Localizer>(before);
  optics::PoseCalibration made;
  if (correction == "eye")
    made.residual = take_eye(*after, settings, how, seen);
  else
    made = by_thesis(before, settings, how, seen);
  after->settings.image.pixel *= made.image_scale;
  if (correction == "eye")
    made.image_scale = after->settings.image.pixel / before.settings.image.pixel;
  after->offset += made.offset;
  settings.projection = after->settings.projection;
  settings.exact = after->settings.exact;
  settings.image = after->settings.image;
  if (const auto lay = optics::first_guess(settings, seen.ellipse, *how.vector("axis")))
    after->looked_at = *lay + after->offset;
  ResultTable table(call);
  push_handle(call.L, localizer_class(), after);
  table.top("localizer");
  push_system(call.L, after->eye);
  table.top("eye")
      .number("image_scale", made.image_scale)
      .number("image_scale_sigma", correction == "image_scale" ? made.sigma : 0)
      .number("offset_sigma", correction == "additive_offset" ? made.sigma : 0, "m")
      .number("robot_length", after->robot_length)
      .number("robot_width", after->robot_width)
      .number("residual", made.residual, "m")
      .vector("offset", made.offset, "m");
  return 1;
}

/// The projection is traced and fitted once, here; locating then only evaluates it. The thesis'
/// single viewpoint, (5.2) to (5.11), is fitted over a smaller image unless the script says
/// otherwise: far aside the lines do not meet in one point.
int make_localizer(Call& call) {
  const auto microscope = microscope_option(call).value_or(optics::Microscope{});
  const bool single = call.flag_option("single_viewpoint");
  const double max_m = call.number_option("max_m").value_or(single ? 7e-3 : 8e-3);
  optics::ImageScale image;
  image.pixel = call.number_option("pixel").value_or(image.pixel);
  if (call.push_option("center")) {
    const auto center = *to_numbers(call.L, -1);
    if (center.size() != 2) throw std::invalid_argument("center: wants two numbers {u, v}");
    image.center_px = {center[0], center[1]};
  }
  lua_pop(call.L, 1);
  const optics::Prescription eye = eye_of(call);
  return calculate(
      call, "projection",
      [=](const YieldPoint&) {
        const optics::System& system = eye.system;
        Localizer made;
        made.eye = eye;
        made.microscope = microscope;
        made.settings.image = image;
        if (single) {
          made.settings.projection = optics::fit_single_viewpoint(system, microscope, max_m);
        } else {
          made.settings.exact.emplace(system, microscope, max_m);
        }
        return made;
      },
      [](Call& done, const Localizer& made) {
        push_handle(done.L, localizer_class(), std::make_shared<Localizer>(made));
        return 1;
      });
}

Argument number_of(const char* name, const char* unit, bool optional, const char* help, double min,
                   double max) {
  return {.name = name,
          .type = Type::number,
          .unit = unit,
          .optional = optional,
          .min = min,
          .max = max,
          .help = help};
}

/// As localizer:ellipse and the servo's record have it: semi-axes, where vision's tracks have full
/// axes.
Argument ellipse_argument(bool optional) {
  constexpr double kLargest = 1e6;
  return {.name = "ellipse",
          .type = Type::options,
          .optional = optional,
          .help = "that a tracker saw, as localizer:ellipse has it",
          .options = {number_of("u", "", false, "center, px", -kLargest, kLargest),
                      number_of("v", "", false, "center, px", -kLargest, kLargest),
                      number_of("semi_major", "", false, "px", 1e-6, kLargest),
                      number_of("semi_minor", "", false, "px", 1e-6, kLargest),
                      number_of("angle", "rad", false, "from +u towards +v", -kLargest, kLargest),
                      number_of("sigma", "", true, "of center and axes, px (0.2)", 1e-6, kLargest),
                      {.name = "covariance",
                       .type = Type::numbers,
                       .optional = true,
                       .help = "25 numbers, row by row, instead of sigma"}}};
}

/// Where a body is, and how it lies: by the direction of its z, which says all of a round body, or
/// by a whole orientation.
std::vector<Argument> pose_options(bool position_needed, const char* position_help) {
  return {{.name = "position",
           .type = Type::vector,
           .unit = "m",
           .optional = !position_needed,
           .help = position_help},
          {.name = "axis", .type = Type::direction, .optional = true, .help = "the body's z"},
          {.name = "orientation",
           .type = Type::numbers,
           .optional = true,
           .help = "nine numbers, eye from body"}};
}

Binding ellipse_row() {
  std::vector<Argument> options = pose_options(true, "of its center, eye frame");
  options.insert(options.begin(), body_argument());
  options.push_back(number_of("scale", "", true, "of the body's size (1)", 1e-3, 1e3));
  return {"ellipse",
          {options_of(options)},
          Returned("table", std::vector<ResultField>{{"u", "", "center, px"},
                                                     {"v", "", "center, px"},
                                                     {"semi_major", "", "px"},
                                                     {"semi_minor", "", "px"},
                                                     {"angle", "rad", "from +u towards +v"}})
              .or_nil("outside"),
          "what a tracker would fit to the body's silhouette",
          ellipse,
          "view:ellipse { body = robot, position = { 0, 0, 2 * mm }, axis = { 1, 0, 0 } }"};
}

Binding outline_row() {
  std::vector<Argument> options = pose_options(true, "of its center, eye frame");
  options.insert(options.begin(), body_argument());
  options.push_back({.name = "count",
                     .type = Type::integer,
                     .optional = true,
                     .min = 3,
                     .max = 4096,
                     .help = "of points (64)"});
  return {"outline",
          {options_of(options)},
          Returned("list of tables", std::vector<ResultField>{{"u", "", "px"}, {"v", "", "px"}})
              .or_nil("outside"),
          "the body's outline in the image, points in order round it; not of a superquadric",
          outline,
          "view:outline { body = robot, position = { 0, 0, 2 * mm }, axis = { 1, 0, 0 } }"};
}

Binding locate_row() {
  const auto flag = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::flag, .optional = true, .help = help};
  };
  std::vector<Argument> options = {
      body_argument(true),
      ellipse_argument(true),
      {.name = "outline",
       .type = Type::list,
       .optional = true,
       .help =
           "instead of the ellipse: points in order round it, {{u = , v = , sigma = 0.2}, ...}, "
           "px"},
      {.name = "points",
       .type = Type::list,
       .optional = true,
       .help = "instead of these: known on the body, {{body = {x, y, z}, u = , v = , sigma = 0.2}, "
               "...}, px"}};
  for (Argument& one : pose_options(false, "where to start, eye frame"))
    options.push_back(std::move(one));
  options.insert(
      options.end(),
      {flag("rotate", "six degrees of freedom (false)"),
       number_of("orientation_sigma", "rad", true, "how well the orientation is known before", 1e-9,
                 10),
       number_of("roll_sigma", "rad", true, "the same about its axis, else alike", 1e-9, 1e6),
       number_of("scale_sigma", "", true, "how well the size is known, relative (0)", 0, 10),
       flag("unknown_size", "it is not known at all (false)"),
       number_of("max_residual_px", "", true, "above it: misfit (8)", 1e-9, 1e6)});
  return {"locate",
          {options_of(options)},
          pose_fields(),
          "pose from the ellipse that a tracker sees, weighted by its covariance, from the outline "
          "itself, or from points known on the body",
          locate,
          "view:locate { body = robot, ellipse = seen, axis = { 1, 0, 0 } }"};
}

Binding calibrate_row() {
  return {
      "calibrate",
      {options_of(
          {body_argument(),
           ellipse_argument(false),
           {.name = "axis", .type = Type::direction, .help = "the body's z"},
           number_of("known_z", "m", false, "height of its center over the retina's vertex", -1, 1),
           number_of("known_z_sigma", "m", true, "of that (0; 10 µm of an eye)", 0, 0.01),
           number_of("axis_sigma", "rad", true, "across it, of an eye (0.035)", 1e-6, 1),
           number_of("contour_sigma", "", true, "px, of each semi-axis, of an eye (0)", 0, 10),
           number_of("pixel_sigma", "", true, "relative, of the pixel beside the eye (0)", 0, 0.2),
           number_of("size_sigma", "", true, "relative, of the robot beside the eye (0)", 0, 0.2),
           {.name = "correction",
            .type = Type::text,
            .optional = true,
            .help = "what is put right (image_scale); eye: the most probable one of "
                    "table 5.1",
            .choices = {"image_scale", "additive_offset", "eye"}}})},
      {"table",
       {{"localizer", "", "the corrected one"},
        {"eye", "", "the optical_system that it sees through"},
        {"image_scale", "", "factor of the pixel"},
        {"image_scale_sigma", "", "by the ellipse's noise and known_z_sigma"},
        {"offset_sigma", "m", "the same of the offset, along z"},
        {"robot_length", "", "factor of the body's, which rig:servo takes over"},
        {"robot_width", "", "the same across"},
        {"offset", "m", "added to positions"},
        {"residual", "m", "left along z at the known height"}}},
      "calibrates by one ellipse of a spheroid on the known retina",
      calibrate,
      "view:calibrate { body = robot, ellipse = seen, axis = { 1, 0, 0 }, known_z = 2 * mm }"};
}

}  // namespace

std::vector<Binding> system_pose_rows() {
  return {{"localizer",
           {options_of({microscope_argument(),
                        {.name = "single_viewpoint",
                         .type = Type::flag,
                         .optional = true,
                         .help = "the thesis' projection (5.2) to (5.11) instead of the exact one"},
                        length_option("max_m", 1e-4, 1,
                                      "of the aerial image (8 mm; 7 mm by a single viewpoint)"),
                        length_option("pixel", 1e-9, 1e-3, "of aerial image (14.3 µm)"),
                        {.name = "center",
                         .type = Type::numbers,
                         .optional = true,
                         .help = "{u, v} of the image's axis, px ({0, 0})"}})},
           "localizer",
           "finds bodies by the ellipse or the points they show (5.3)",
           make_localizer,
           "eye:localizer { single_viewpoint = true }"}};
}

const Class& localizer_class() {
  static const Class kind{
      "localizer",
      "pose through the eye's optics (5.3); make one with optical_system:localizer",
      {{"pixel",
        {{.name = "point", .type = Type::vector, .unit = "m", .help = "eye frame"}},
        Returned("table", std::vector<ResultField>{{"u", "", "px"}, {"v", "", "px"}})
            .or_nil("outside"),
        "where the chain's chief ray shows a point",
        pixel,
        "view:pixel({ 0, 0, 2 * mm })"},
       ellipse_row(),
       outline_row(),
       {"info",
        {},
        {"table",
         {{"pixel", "m", "of aerial image"},
          {"max_m", "m", "of the aerial image"},
          {"max_z", "m", "before the retina"},
          {.name = "max_residual",
           .unit = "m",
           .help = "of the exact projection",
           .optional = true},
          {.name = "viewpoint", .unit = "m", .help = "of the single one", .optional = true}}},
        "scale and reach of the projection",
        info,
        "view:info()"},
       locate_row(),
       calibrate_row()},
      {}};
  return kind;
}

}  // namespace vitreo::lua
