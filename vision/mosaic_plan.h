// Mosaic plan: the views' poses in one plane and the links between them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "vision/registration.h"

#include <Eigen/Geometry>

#include <optional>
#include <vector>

namespace vitreo::vision {

struct MosaicSettings {
  RegistrationSettings registration;
  /// Views that overlap by this share are linked, neighbors in time or not.
  double link_overlap = 0.25;
  int links_per_view = 6;   ///< of those the ones with the largest overlap
  double max_pixels = 4e7;  ///< of the mosaic
  void check() const;       ///< throws std::invalid_argument naming the setting
};

struct MosaicLink {
  int first = 0;   ///< view
  int second = 0;  ///< view, later than first
  Registration registration;
  /// Between the views' adjusted poses and this registration, over the overlap.
  double rms_px = 0;
  bool used = true;  ///< false: contradicts the others, and was left out
};

struct MosaicPlan {
  /// Nothing for a view that could not be joined to the largest group.
  std::vector<std::optional<Eigen::Affine2d>> mosaic_from_view;
  std::vector<MosaicLink> links;
  /// Redundant links, beyond a spanning tree: with none, rms_px is 0 and carries no information.
  int spare_links = 0;
  double rms_px = 0;    ///< of the used links: how well the views agree on one plane
  double worst_px = 0;  ///< of one used link
  double sigma_px = 0;  ///< of one registration, from the noise, root mean square
  int joined() const;
};

}  // namespace vitreo::vision
