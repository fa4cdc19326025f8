// SPDX-License-Identifier: Apache-2.0
#include "host/servo/visibility.h"

#include <fmt/format.h>

#include <stdexcept>

namespace vitreo {
namespace {

/// Where a position (m, world) appears in the image: (5.13), u = K P(X), with the fitted single
/// viewpoint or the exact rays. Nothing outside the optics' validity.
std::optional<Eigen::Vector2d> pixel_of(const RigModel& model, double image_scale,
                                        const Eigen::Vector3d& position) {
  optics::ImageScale image = model.top_image;
  image.pixel *= image_scale;
  // The aerial image m is inverted, a plain view's as any other (ImageScale).
  if (model.plain_view) return image.pixel_from_m(-position.head<2>());
  const Eigen::Vector3d in_eye = position - model.eye_in_world;
  const auto m = model.exact ? model.exact->project(in_eye) : model.projection.project(in_eye);
  if (!m) return std::nullopt;
  return image.pixel_from_m(*m);
}

}  // namespace

/// One position out of sight refuses the whole path, before anything moves.
void check_visible(const RigModel& model, const CameraInfo& camera, double image_scale,
                   const control::Trajectory& path) {
  constexpr int kAsked = 200;  // positions along the way
  for (int i = 0; i <= kAsked; ++i) {
    const Eigen::Vector3d position = path.at(path.duration() * i / kAsked).position;
    const auto pixel = pixel_of(model, image_scale, position);
    if (pixel && pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() < camera.width_px &&
        pixel->y() < camera.height_px)
      continue;
    throw std::invalid_argument(
        fmt::format("({:.2f}, {:.2f}, {:.2f}) mm is out of the top camera's sight",
                    position.x() * 1e3, position.y() * 1e3, position.z() * 1e3));
  }
}

}  // namespace vitreo
