// SPDX-License-Identifier: Apache-2.0
#include "optics/design/lens_design.h"

#include "optics/design/designer.h"

#include <utility>

namespace vitreo::optics {
namespace {

/// Whether a design is to be preferred: whole bundles, then kept constraints, then merit; that it
/// settled counts last.
bool better(const LensDesign& one, const LensDesign& other) {
  if (one.after.lost_fields != other.after.lost_fields)
    return one.after.lost_fields < other.after.lost_fields;
  const bool keeps = one.status != DesignStatus::constraint_violated;
  if (keeps != (other.status != DesignStatus::constraint_violated)) return keeps;
  return one.after.merit < other.after.merit;
}

}  // namespace

/// A local optimizer from one start: four continuation paths, the best end counts.
/// A Designer keeps the state of its rounds, so each path has its own, from the same start. Of
/// equal ends the earlier path is kept.
LensDesign design_lens(const Prescription& start, const LensDesignOptions& options) {
  LensDesign best = detail::Designer(start, options).run({false, false});
  for (const detail::Path& path :
       {detail::Path{true, false}, detail::Path{false, true}, detail::Path{true, true}}) {
    LensDesign other = detail::Designer(start, options).run(path);
    if (better(other, best)) best = std::move(other);
  }
  return best;
}

}  // namespace vitreo::optics
