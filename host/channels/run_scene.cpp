// SPDX-License-Identifier: Apache-2.0
#include "host/channels/run_scene.h"

#include <cmath>
#include <numbers>

namespace vitreo {
namespace {

using nlohmann::json;

json vector_json(const Eigen::Vector3d& v) { return {{"x", v.x()}, {"y", v.y()}, {"z", v.z()}}; }

/// foxglove.SpherePrimitive; `diameters` in m, along the axes of the pose.
json sphere(const json& pose, const Eigen::Vector3d& diameters, const json& painted) {
  return {{"pose", pose}, {"size", vector_json(diameters)}, {"color", painted}};
}

json unmoved() { return pose_json(Eigen::Vector3d::Zero(), Eigen::Quaterniond::Identity()); }

/// A closed line on screen, 1 px wide: `scale_invariant` has the thickness in px and not in m.
json loop(const json& points) {
  constexpr int kLoop = 1;  // LINE_LOOP
  return {{"type", kLoop},           {"pose", unmoved()},
          {"thickness", 1.0},        {"scale_invariant", true},
          {"points", points},        {"color", color_json(0.85, 0.35, 0.25, 0.8)},
          {"colors", json::array()}, {"indices", json::array()}};
}

/// Circles of latitude on the retina's sphere (thesis table 3.1), from its vertex up to the height
/// of its center.
json retina_lines(const Eigen::Vector3d& center, double radius) {
  constexpr int kCircles = 6;
  constexpr int kPoints = 48;
  json lines = json::array();
  for (int circle = 1; circle <= kCircles; ++circle) {
    const double polar = circle * std::numbers::pi / 2 / kCircles;
    json points = json::array();
    for (int i = 0; i < kPoints; ++i) {
      const double around = i * 2 * std::numbers::pi / kPoints;
      points.push_back(vector_json(
          center + radius * Eigen::Vector3d(std::sin(polar) * std::cos(around),
                                            std::sin(polar) * std::sin(around), -std::cos(polar))));
    }
    lines.push_back(loop(points));
  }
  return lines;
}

}  // namespace

json color_json(double red, double green, double blue, double alpha) {
  return {{"r", red}, {"g", green}, {"b", blue}, {"a", alpha}};
}

json pose_json(const Eigen::Vector3d& position, const Eigen::Quaterniond& orientation) {
  return {{"position", vector_json(position)},
          {"orientation",
           {{"x", orientation.x()},
            {"y", orientation.y()},
            {"z", orientation.z()},
            {"w", orientation.w()}}}};
}

Eigen::Quaterniond along(const Eigen::Vector3d& axis) {
  return Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d::UnitX(), axis);
}

RunScene::RunScene(const json& geometry, UtcClock clock)
    : geometry_(geometry.is_object() ? geometry : json::object()), clock_(clock) {}

// A record may come from elsewhere: what is no number is as if it were not there.
double RunScene::number(const char* name, double otherwise) const {
  const auto found = geometry_.find(name);
  return found != geometry_.end() && found->is_number() ? found->get<double>() : otherwise;
}

/// An entity without primitives. Its lifetime of zero is without end, and one of the same id takes
/// its place.
json RunScene::entity(Time time, const std::string& id) const {
  json made = {
      {"timestamp", clock_.stamp(time)},       {"frame_id", "world"},  {"id", id},
      {"lifetime", {{"sec", 0}, {"nsec", 0}}}, {"frame_locked", true}, {"metadata", json::array()}};
  // The schema requires every list, empty ones too.
  for (const char* kind :
       {"arrows", "cubes", "spheres", "cylinders", "lines", "triangles", "texts", "models"})
    made[kind] = json::array();
  return made;
}

// The retina is a sphere through the eye's origin, its center a radius above it.
std::optional<json> RunScene::eye(Time time) const {
  const double radius = number("retina_radius", 0);
  if (!(radius > 0)) return {};
  const Eigen::Vector3d center(number("eye_x", 0), number("eye_y", 0), number("eye_z", 0) + radius);
  json whole = entity(time, "eye");
  whole["spheres"].push_back(sphere(pose_json(center, Eigen::Quaterniond::Identity()),
                                    Eigen::Vector3d::Constant(2 * radius),
                                    color_json(0.9, 0.9, 0.95, 0.12)));
  json retina = entity(time, "retina");
  retina["lines"] = retina_lines(center, radius);
  json lens = entity(time, "lens");
  constexpr double kLensDiameter = 9e-3;  // m, of the human lens; drawn as a disc
  lens["cylinders"].push_back(
      {{"pose", pose_json({center.x(), center.y(), number("lens_z", center.z() + radius)},
                          Eigen::Quaterniond::Identity())},
       {"size", vector_json({kLensDiameter, kLensDiameter, 1e-4})},
       {"bottom_scale", 1.0},
       {"top_scale", 1.0},
       {"color", color_json(0.6, 0.8, 1, 0.3)}});
  return json{{"deletions", json::array()}, {"entities", {whole, retina, lens}}};
}

/// A body whose axis is not recorded is drawn as the sphere that it fits into: no orientation is
/// made up. Around it the ellipsoid of three standard deviations.
json RunScene::robot(Time time, const SceneRow& row) const {
  json made = entity(time, "robot");
  // Without a geometry in the record a body of 1 mm.
  const double length = 2 * number("robot_semi_axis", 0.5e-3);
  const double width = 2 * number("robot_semi_radius", 0.5e-3);
  const Eigen::Vector3d size =
      row.axis ? Eigen::Vector3d(length, width, width) : Eigen::Vector3d::Constant(length);
  made["spheres"].push_back(
      sphere(pose_json(*row.robot, row.axis ? along(*row.axis) : Eigen::Quaterniond::Identity()),
             size, color_json(0.2, 0.6, 1, row.axis ? 1 : 0.6)));
  if (row.sigma)
    made["spheres"].push_back(sphere(pose_json(*row.robot, Eigen::Quaterniond::Identity()),
                                     6 * *row.sigma, color_json(0.2, 0.6, 1, 0.2)));
  made["metadata"].push_back(
      {{"key", "orientation"}, {"value", row.axis ? "as recorded" : "not recorded"}});
  return made;
}

json RunScene::row(Time time, const SceneRow& row) const {
  json update = {{"deletions", json::array()}, {"entities", json::array()}};
  // An entity stays until it is replaced by one of its id, or deleted: a robot that is lost must
  // not seem to stand still.
  const auto gone = [&](const char* id) {
    constexpr int kMatchingId = 0;
    update["deletions"].push_back(
        {{"timestamp", clock_.stamp(time)}, {"type", kMatchingId}, {"id", id}});
  };
  if (row.robot)
    update["entities"].push_back(robot(time, row));
  else
    gone("robot");
  if (!row.target) {
    gone("target");
    return update;
  }
  json target = entity(time, "target");
  constexpr double kMark = 0.3e-3;  // m
  target["spheres"].push_back(sphere(pose_json(*row.target, Eigen::Quaterniond::Identity()),
                                     Eigen::Vector3d::Constant(kMark),
                                     color_json(1, 0.75, 0.1, 0.9)));
  update["entities"].push_back(target);
  return update;
}

json RunScene::transforms(Time time) const {
  json list = json::array();
  const auto add = [&](const char* child, const Eigen::Vector3d& at, const Eigen::Quaterniond& q) {
    const json pose = pose_json(at, q);
    // foxglove.FrameTransform: the axes of the child, in those of the parent.
    list.push_back({{"timestamp", clock_.stamp(time)},
                    {"parent_frame_id", "world"},
                    {"child_frame_id", child},
                    {"translation", pose["position"]},
                    {"rotation", pose["orientation"]}});
  };
  const Eigen::Vector3d eye(number("eye_x", 0), number("eye_y", 0), number("eye_z", 0));
  add("eye", eye, Eigen::Quaterniond::Identity());
  // Half a turn about x: the camera looks down (z), image rows go against the world's y.
  add("top_camera", {eye.x(), eye.y(), number("lens_z", 0)}, {0, 1, 0, 0});
  // A quarter turn about x: it looks along +y, image rows go against the world's z.
  constexpr double kHalf = std::numbers::sqrt2 / 2;
  add("side_camera", Eigen::Vector3d::Zero(), {kHalf, -kHalf, 0, 0});
  return {{"transforms", list}};
}

}  // namespace vitreo
