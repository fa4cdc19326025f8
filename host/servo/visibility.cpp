// SPDX-License-Identifier: Apache-2.0
#include "host/servo/visibility.h"

#include "host/servo/believed_view.h"
#include "optics/pose/pose.h"

#include <fmt/format.h>

#include <stdexcept>

namespace vitreo {
namespace {

/// Where a robot at positions (m, world) appears in the image.
class PathView {
 public:
  PathView(const RigModel& model, const SightedAs& sighted)
      : to_eye_(model.eye_in_world + sighted.offset),
        axis_(sighted.axis),
        plain_(model.plain_view),
        view_(pose_settings_of(model)) {
    view_.image.pixel *= sighted.image_scale;
  }
  // The aerial image m is inverted, a plain view's as any other (ImageScale).
  std::optional<Eigen::Vector2d> at(const Eigen::Vector3d& position) const {
    if (plain_) return view_.image.pixel_from_m(-position.head<2>());
    return optics::shown_at(view_, position - to_eye_);
  }
  // Through the eye both ends have to be shown too: without one a robot is not localized.
  bool whole_at(const Eigen::Vector3d& position) const {
    const Eigen::Vector3d in_eye = position - to_eye_, end = view_.robot.semi_axis * axis_;
    return plain_ ||
           (optics::shown_at(view_, in_eye + end) && optics::shown_at(view_, in_eye - end));
  }

 private:
  Eigen::Vector3d to_eye_;
  Eigen::Vector3d axis_;
  bool plain_;
  optics::PoseSettings view_;
};

}  // namespace

/// One position out of sight refuses the whole path, before anything moves.
void check_visible(const RigModel& model, const CameraInfo& camera, const SightedAs& sighted,
                   const control::Trajectory& path) {
  constexpr int kAsked = 200;  // positions along the way
  const PathView shown(model, sighted);
  // One that has drifted to where it is not shown whole may be led back.
  bool was_whole = false;
  for (int i = 0; i <= kAsked; ++i) {
    const Eigen::Vector3d position = path.at(path.duration() * i / kAsked).position;
    const auto pixel = shown.at(position);
    if (pixel && pixel->x() >= 0 && pixel->y() >= 0 && pixel->x() < camera.width_px &&
        pixel->y() < camera.height_px) {
      const bool whole = shown.whole_at(position);
      if (whole || !(was_whole || i == kAsked)) {
        was_whole = was_whole || whole;
        continue;
      }
    }
    throw std::invalid_argument(
        fmt::format("({:.2f}, {:.2f}, {:.2f}) mm is out of the top camera's sight",
                    position.x() * 1e3, position.y() * 1e3, position.z() * 1e3));
  }
}

}  // namespace vitreo
