// Check of a designed lens against its constraints, on the lens itself instead of the solver's
// penalties.
// SPDX-License-Identifier: Apache-2.0
#include "optics/design/designer.h"

#include <algorithm>
#include <cmath>
#include <sstream>

namespace vitreo::optics::detail {
namespace {

constexpr double kGivesWay = 1e-6;  // m, of a constraint; the penalty leaves much less

std::string in_mm(double value) {
  std::ostringstream text;
  text << value * 1e3 << " mm";
  return text.str();
}

}  // namespace

/// The sag must exist and be monotone out to where rays or the aperture reach.
/// Empty when it is kept, else the sentence for the user. Tested at the positions at which the
/// merit has its penalties.
std::string Designer::violated_profile(std::size_t surface) const {
  const Surface& s = now_.system.surfaces[surface];
  const double reach = problem_.reach[surface];
  const double rim = s.sag(reach);
  if (!std::isfinite(rim))
    return start_.surfaces[surface] + " does not reach out to " + in_mm(reach);
  double last = 0;
  for (int k = 1; k <= DesignProblem::kChecks; ++k) {
    const double sag = s.sag(reach * k / DesignProblem::kChecks);
    if ((sag - last) * (rim < 0 ? -1 : 1) < -kGivesWay) {
      return start_.surfaces[surface] + " turns at " + in_mm(reach * k / DesignProblem::kChecks);
    }
    last = sag;
  }
  return {};
}

/// Thickness of glass or air between two surfaces out to the larger of their reaches.
/// The gap may be air, whose surfaces must not cross, or glass, whose rim must be thick enough to
/// be made.
std::string Designer::violated_gap(std::size_t i) const {
  const Surface& front = now_.system.surfaces[i];
  const Surface& behind = now_.system.surfaces[i + 1];
  const double reach = std::max(problem_.reach[i], problem_.reach[i + 1]);
  const double least = front.index > kGlass ? options_.min_edge_thickness : 0;
  for (int k = 1; k <= DesignProblem::kChecks; ++k) {
    const double r = reach * k / DesignProblem::kChecks;
    const double gap = front.thickness + behind.sag(r) - front.sag(r);
    if (gap < least - kGivesWay)
      return start_.media[i] + " is " + in_mm(gap) + " thick at " + in_mm(r);
  }
  if (problem_.thickness_is_variable(i) &&
      front.thickness < options_.min_center_thickness - kGivesWay) {
    return start_.media[i] + " is " + in_mm(front.thickness) + " thick on the axis";
  }
  return {};
}

/// The first constraint that is not kept, with its figures; empty when all are.
/// In the order of their weight for the user: what was to be kept, the spots, then the surfaces
/// from the eye outwards.
std::string Designer::violated() const {
  const LensImage image = lens_image(now_.system, options_);
  if (options_.keeps == DesignKeeps::image_distance &&
      std::abs(image.image_distance - problem_.kept) > kGivesWay) {
    return "image_distance is " + in_mm(image.image_distance) + " instead of " +
           in_mm(problem_.kept);
  }
  // Relative; as DesignKeeps states.
  constexpr double kFocal = 1e-4;
  if (options_.keeps == DesignKeeps::focal_length &&
      std::abs(image.focal_length / problem_.kept - 1) > kFocal) {
    return "focal_length is " + in_mm(image.focal_length) + " instead of " + in_mm(problem_.kept);
  }
  if (image.max_spot > options_.max_spot + kGivesWay) {
    return "max_spot: a spot of " + in_mm(image.max_spot) + " is left, " +
           in_mm(options_.max_spot) + " asked";
  }
  for (std::size_t i = 1; i < now_.system.surfaces.size(); ++i) {
    std::string profile = problem_.is_variable(i) ? violated_profile(i) : "";
    if (!profile.empty()) return profile;
    const bool gap = i + 1 < now_.system.surfaces.size() && problem_.gap_is_variable(i);
    std::string thin = gap ? violated_gap(i) : "";
    if (!thin.empty()) return thin;
  }
  return {};
}

}  // namespace vitreo::optics::detail
