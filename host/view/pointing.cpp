// SPDX-License-Identifier: Apache-2.0
#include "host/view/pointing.h"

#include "host/servo/servo.h"
#include "host/servo/servo_record.h"

#include <Eigen/LU>

#include <cmath>
#include <stdexcept>

namespace vitreo::view {
namespace {

/// The list as `count` numbers. Throws std::invalid_argument.
Eigen::VectorXd numbers(const nlohmann::json& list, int count, const std::string& what) {
  if (!list.is_array() || static_cast<int>(list.size()) != count)
    throw std::invalid_argument(what + " wants " + std::to_string(count) + " numbers");
  Eigen::VectorXd values(count);
  for (int i = 0; i < count; ++i) {
    if (!list[static_cast<std::size_t>(i)].is_number())
      throw std::invalid_argument(what + " wants numbers");
    values[i] = list[static_cast<std::size_t>(i)];
  }
  return values;
}

/// A field of the message, m. Throws std::invalid_argument.
double meters(const nlohmann::json& message, const std::string& name) {
  const auto found = message.find(name);
  if (found == message.end() || !found->is_number())
    throw std::invalid_argument("target wants " + name + ", in m");
  return *found;
}

}  // namespace

// Once a run: the page draws the retina and the lens from it without knowing the eye's model.
nlohmann::json Pointing::to_json() const {
  const auto& retina = model_.eye.surfaces.front();
  // Scale of the top image at the workspace's center, over 0.1 mm: the projection is not linear.
  const auto middle = pixel_of({0, 0, 0});
  const auto beside = pixel_of({1e-4, 0, 0});
  return {
      {"top_px_per_m",
       middle && beside ? nlohmann::json((*beside - *middle).norm() / 1e-4) : nullptr},
      {"side_pixel", model_.side_pixel},
      {"side_center", {model_.side_center_px.x(), model_.side_center_px.y()}},
      {"retina", {{"z", model_.eye_in_world.z()}, {"radius", retina.radius}}},
      {"margin", model_.keep_out.margin},
      {"body", {{"semi_axis", model_.robot.semi_axis}, {"semi_radius", model_.robot.semi_radius}}},
      {"lens_z", model_.eye_in_world.z() + model_.eye.vertex(2)}};
}

std::optional<Eigen::Vector2d> Pointing::pixel_of(const Eigen::Vector3d& position) const {
  // From the eye's frame to m in the image, then to px.
  const auto m = model_.projection.project(position - model_.eye_in_world);
  if (!m) return {};
  return model_.top_image.pixel_from_m(*m);
}

// Starts on the optical axis. 30 steps of at most 2 mm lead across an eye, and near the solution
// each step squares the error; what has not converged by then is taken for a point that does not
// show.
Eigen::Vector3d Pointing::at_height(const Eigen::Vector2d& pixel, double z) const {
  constexpr double kStep = 1e-6;       // m, of the difference quotients
  constexpr double kConverged = 1e-9;  // m
  Eigen::Vector3d position(0, 0, z);
  for (int step = 0; step < 30; ++step) {
    const auto here = pixel_of(position);
    const auto right = pixel_of(position + Eigen::Vector3d(kStep, 0, 0));
    const auto up = pixel_of(position + Eigen::Vector3d(0, kStep, 0));
    if (!here || !right || !up) break;
    // Newton: J (x, y)' = pixel - projected pixel, with J by forward differences, px/m.
    Eigen::Matrix2d per_m;
    per_m << (*right - *here) / kStep, (*up - *here) / kStep;
    Eigen::Vector2d move = per_m.inverse() * (pixel - *here);
    if (!move.allFinite()) break;
    if (move.norm() < kConverged) return position;
    // At most 2 mm a step: far from the solution the linearization may leave the eye.
    position.head<2>() += move.norm() > 2e-3 ? Eigen::Vector2d(2e-3 * move.normalized()) : move;
  }
  throw std::invalid_argument("nothing at that height shows there");
}

std::vector<Eigen::Vector3d> Pointing::positions(const nlohmann::json& message,
                                                 const ClearanceBelief& belief) const {
  std::vector<Eigen::Vector3d> found;
  // Typed in as a position, or pointed at in one of the two images.
  if (message.contains("place")) {
    found.emplace_back(numbers(message["place"], 3, "place"));
  } else {
    const std::string camera = message.value("camera", "");
    if (camera != "top_camera" && camera != "side_camera")
      throw std::invalid_argument("target wants a place, or a camera and points");
    const nlohmann::json points = message.value("points", nlohmann::json::array());
    if (!points.is_array() || points.empty() || points.size() > 1000)
      throw std::invalid_argument("points wants 1 to 1000 of them");
    for (const auto& point : points) {
      const Eigen::Vector2d pixel = numbers(point, 2, "a point");
      if (camera == "top_camera") {
        found.push_back(at_height(pixel, meters(message, "z")));
        continue;
      }
      // The side camera shows x to the right and z up, at one scale; image rows go down.
      const Eigen::Vector2d off = (pixel - model_.side_center_px) * model_.side_pixel;
      found.emplace_back(off.x(), meters(message, "y"), -off.y());
    }
  }
  const RobotClearance surface(model_, belief);
  for (const Eigen::Vector3d& position : found) {
    // A target outside is refused here, where the operator sees why.
    const control::Trajectory there = control::Trajectory::hold_at(position);
    check_reach(model_, there);
    surface.check(there);
  }
  return found;
}

nlohmann::json Pointing::where(const nlohmann::json& message) const {
  constexpr std::size_t kMost = 100;
  const nlohmann::json points = message.value("points", nlohmann::json::array());
  if (message.value("camera", "") != "top_camera" || !points.is_array() || points.size() > kMost)
    throw std::invalid_argument("where wants the top camera and 1 to 100 points");
  const double z = meters(message, "z");
  nlohmann::json places = nlohmann::json::array();
  for (const auto& point : points) {
    const Eigen::Vector2d pixel = numbers(point, 2, "a point");
    try {
      const Eigen::Vector3d found = at_height(pixel, z);
      places.push_back({found.x(), found.y(), found.z()});
    } catch (const std::invalid_argument&) {  // beyond the eye's edge
      places.push_back(nullptr);
    }
  }
  return places;
}

// In the order of ServoRecord's stream, from its ninth column on.
ClearanceBelief Pointing::belief(const std::vector<double>& clearance) {
  if (clearance.size() < 14) return {};
  return {{clearance[8], clearance[9], clearance[10]},
          clearance[11],
          clearance[12] != 0,
          clearance[13] != 0};
}

// The row of the stream "servo" begins with x, y, z of the robot and of the target.
nlohmann::json Pointing::marks(const std::vector<double>& servo) const {
  nlohmann::json marks = nlohmann::json::object();
  const Eigen::Vector3d target = Eigen::Map<const Eigen::Vector3d>(servo.data() + 3);
  if (!target.allFinite()) return marks;
  if (const auto pixel = pixel_of(target)) marks["target_px"] = {pixel->x(), pixel->y()};
  return marks;
}

// The row begins with the field's x, y, z.
nlohmann::json Pointing::field(const std::vector<double>& command) {
  const Eigen::Vector3d b = Eigen::Map<const Eigen::Vector3d>(command.data());
  const double size = b.norm();
  if (!(size > 0)) return nullptr;
  return {{"tesla", size}, {"direction", {b.x() / size, b.y() / size, b.z() / size}}};
}

}  // namespace vitreo::view
