// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_bodies.h"

#include "host/trials/reproduction.h"
#include "host/trials/soak.h"
#include "host/trials/sweep_plan.h"

namespace vitreo {
PointBody body_of(ScriptEngine& engine, const PointFolder& folder) {
  const std::string kind = folder.head().value("kind", "");
  if (kind == "sweep")
    return [&](const PlannedPoint& planned, std::size_t point, const SayLine&) {
      return run_sweep_point(engine, folder.head(), planned.what, folder.runs_of(point));
    };
  if (kind == kReproductionKind)
    return [&](const PlannedPoint& planned, std::size_t, const SayLine&) {
      return run_reproduction_point(engine, planned.what);
    };
  if (kind == kSoakKind)
    return [&](const PlannedPoint& planned, std::size_t, const SayLine& say) {
      return run_soak_point(engine, folder.head(), planned.what, say);
    };
  throw SweepError(folder.folder().string() +
                   ": its plan is of a kind that this program does not " + "know: '" + kind + "'");
}

void check_plan(ScriptEngine& engine, const PointFolder& folder) {
  if (folder.head().value("kind", "") == "sweep") check_unchanged(engine, folder.head());
}

}  // namespace vitreo
