// Point bodies: what is done at a point, by the kind of its plan.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/session/script_engine.h"
#include "host/trials/point_runner.h"

namespace vitreo {

/// Of the kinds sweep, reproduction and soak. Borrows both. Throws SweepError for another kind.
PointBody body_of(ScriptEngine& engine, const PointFolder& folder);

/// What the plan names is still what it was when the plan was made. Throws SweepError.
void check_plan(ScriptEngine& engine, const PointFolder& folder);

}  // namespace vitreo
