// Protocol tests: a protocol put to the tests it declares (ProtocolTest): it completes; it fails as
// it should; stopped at moments drawn by chance it always ends safe. Every run is on the simulated
// rig, in this process.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo {

struct ProtocolTrial {
  std::string what;     // "stop 7 at 3.21 s"
  std::string problem;  // empty: passed
};

/// The tests of a protocol that declares none.
std::vector<ProtocolTest> usual_tests();

/// One test; `base` has file, rig, seed and out, and the arguments and answers where the test says
/// none; `report` is called after each run. Throws as run_protocol for a request that makes no
/// sense, but for a test that must fail.
void try_protocol(ScriptEngine& engine, const RunRequest& base, const ProtocolTest& test,
                  const std::function<void(const ProtocolTrial&)>& report);

}  // namespace vitreo
