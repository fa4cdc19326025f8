// SPDX-License-Identifier: Apache-2.0
#include "optics/chain/chain_layout.h"

#include "optics/numerics/preconditions.h"

#include <Eigen/Geometry>

#include <cmath>
#include <map>

namespace vitreo::optics::detail {
namespace {

/// About x first, then about y, as Microscope turns.
Eigen::Matrix3d turned_about(double x, double y) {
  return (Eigen::AngleAxisd(y, Eigen::Vector3d::UnitY()) *
          Eigen::AngleAxisd(x, Eigen::Vector3d::UnitX()))
      .toRotationMatrix();
}

/// The axis of symmetry and the vertex of a surface that turned with its group.
struct Placement {
  Eigen::Vector3d vertex;
  Eigen::Vector3d axis;
  void turn(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& about) {
    vertex = about + rotation * (vertex - about);
    axis = rotation * axis;
  }
};

/// Where the eye ends: the first surface with air behind it.
std::size_t last_of_eye(const std::vector<Surface>& surfaces) {
  for (std::size_t i = 1; i < surfaces.size(); ++i)
    if (std::abs(surfaces[i].index - 1) < 1e-3) return i;
  return surfaces.size() - 1;
}

}  // namespace

// The surfaces with their own numbers off, and all other parameters by name; one that is not among
// the chain's parameters is 0.
struct ChainLayout::Values {
  std::vector<Surface> surfaces;
  std::map<std::string, double> own;
  double operator[](const char* name) const {
    const auto found = own.find(name);
    return found == own.end() ? 0 : found->second;
  }
};

/// Throws std::invalid_argument for a system without refracting surfaces.
ChainLayout::ChainLayout(const NominalChain& nominal, const std::vector<ChainParameter>& parameters)
    : nominal_(nominal) {
  nominal_.prescription.check();
  nominal_.microscope.check();
  nominal_.image.check();
  require(surfaces().size() > 1, "prescription: wants surfaces before the retina");
  first_outside_ = last_of_eye(surfaces()) + 1;
  for (const std::string& name : nominal_.prescription.surfaces)
    inner_lens_.push_back(name.starts_with("lens."));
  for (const ChainParameter& one : parameters) find(one);
}

// A parameter is a surface's radius, a medium's thickness or index, or one of the chain's own.
void ChainLayout::find(const ChainParameter& parameter) {
  Target target{Kind::own, 0, parameter.sigma, parameter.name};
  const Prescription& eye = nominal_.prescription;
  for (std::size_t i = 0; i < eye.surfaces.size(); ++i) {
    if (parameter.name == eye.surfaces[i] + ".radius") target.kind = Kind::radius;
    if (parameter.name == eye.media[i] + ".thickness") target.kind = Kind::thickness;
    if (parameter.name == eye.media[i] + ".index") target.kind = Kind::index;
    if (target.kind == Kind::own) continue;
    target.surface = i;
    break;
  }
  targets_.push_back(target);
}

// Table 5.1's are relative, so they multiply. A thickness moves all that lies behind it, as in a
// prescription: the microscope stands on the same bench as the eye.
void ChainLayout::set(Values& values, const Target& target, double off) const {
  Surface& surface = values.surfaces[target.surface];
  switch (target.kind) {
    case Kind::radius:
      surface.radius *= 1 + off;
      break;
    case Kind::thickness:
      surface.thickness *= 1 + off;
      break;
    case Kind::index:
      surface.index *= 1 + off;
      break;
    case Kind::own:
      values.own[target.name] = off;
  }
}

/// The groups move in this order: the eye's own lens in the eye, the eye about the center of the
/// retina, the condensing lens by itself.
void ChainLayout::place_surfaces(const Values& values, PlacedChain& placed) const {
  const auto& all = values.surfaces;
  const Eigen::Matrix3d inner =
      turned_about(values["inner_lens_tilt_x"], values["inner_lens_tilt_y"]);
  const Eigen::Vector3d inner_aside(values["inner_lens_aside_x"], values["inner_lens_aside_y"], 0);
  const Eigen::Matrix3d eye = turned_about(values["eye_rotation_x"], values["eye_rotation_y"]);
  const Eigen::Vector3d eye_center(0, 0, surfaces().front().radius);
  const Eigen::Matrix3d lens = turned_about(values["lens_tilt_x"], values["lens_tilt_y"]);
  const Eigen::Vector3d lens_aside(values["lens_aside_x"], values["lens_aside_y"],
                                   values["lens_axial"]);
  // Vertices along the axis first; then each group moves as a rigid body.
  double z = all.front().thickness + values["axial_length"];
  Eigen::Vector3d inner_vertex(0, 0, z);
  Eigen::Vector3d lens_vertex(0, 0, z);
  for (std::size_t i = 1; i < all.size(); ++i) {
    Placement at{{0, 0, z}, {0, 0, 1}};
    if (i == first_outside_) lens_vertex = at.vertex;
    if (i < first_outside_) {
      // About the vertex of the first refracting surface, so that a tilt is not a shift as well.
      if (inner_lens_[i]) {
        at.turn(inner, inner_vertex);
        at.vertex += inner_aside;
      }
      at.turn(eye, eye_center);
    } else {
      at.turn(lens, lens_vertex);
      at.vertex += lens_aside;
    }
    SurfaceNumbers numbers;
    // R = R_y R_x takes z to (sin y cos x, -sin x, cos y cos x).
    numbers << at.vertex, std::asin(-at.axis.y()), std::atan2(at.axis.x(), at.axis.z()),
        1 / all[i].radius, all[i].index / all[i - 1].index;
    placed.surfaces.push_back(numbers);
    if (i + 1 < all.size()) z += all[i].thickness;
  }
  const Microscope& microscope = nominal_.microscope;
  placed.microscope << microscope.decenter, z + microscope.focus + values["object_plane"],
      microscope.tilt.x() + values["microscope_tilt_x"],
      microscope.tilt.y() + values["microscope_tilt_y"],
      1 / microscope.pupil_distance + values["pupil_power"],
      nominal_.image.pixel * (1 + values["pixel"]);
}

PlacedChain ChainLayout::place(const Eigen::VectorXd& theta) const {
  Values values{surfaces(), {}};
  // Linear in theta but for radii, whose curvature is 1 / R, and for turns.
  for (std::size_t i = 0; i < targets_.size(); ++i)
    set(values, targets_[i], targets_[i].sigma * theta[static_cast<Eigen::Index>(i)]);
  PlacedChain placed;
  placed.surfaces.reserve(surfaces().size() - 1);
  place_surfaces(values, placed);
  // The image's center: m = 0 falls `center` aside of the microscope's axis.
  placed.microscope.head<2>() += Eigen::Vector2d(values["center_x"], values["center_y"]);
  placed.robot_length = 1 + values["robot_length"];
  placed.robot_width = 1 + values["robot_width"];
  placed.dilation_px = values["dilation"];
  placed.dilation_slope = values["dilation_slope"];
  placed.retina << values["retina_depth"], values["retina_tilt_x"], values["retina_tilt_y"],
      values["retina_curvature"], values["retina_astigmatism_x"], values["retina_astigmatism_y"];
  return placed;
}

}  // namespace vitreo::optics::detail
