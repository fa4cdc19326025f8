// Test bench of a run's control: a run of a few lines of Lua, its record and messages, and the
// control socket's words.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/engine/run_engine.h"
#include "host/lua/engine/engine.h"
#include "host/view/control_client.h"
#include "host/view/control_socket.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <sstream>

namespace vitreo {

using namespace std::chrono_literals;

constexpr double kZeroVolts = 2e-4;  // half a count of the converter

/// Hears what the script prints; the test acts on it.
struct Ear : SilentListener {
  void message(const std::string& line) override {
    said += line + ";";
    if (on_message) on_message(line);
  }
  std::optional<std::string> typed() override {
    if (lines.empty()) return std::nullopt;
    const std::string line = lines.front();
    lines.erase(lines.begin());
    return line;
  }
  std::string said;
  std::function<void(const std::string&)> on_message;
  std::vector<std::string> lines;
};

/// The operator's desk of the run that is going on.
struct DeskFace : Face {
  void begin(Session& session) override { desk = &session.desk; }
  void end(const std::string&) override { desk = nullptr; }
  OperatorDesk* desk = nullptr;
};

/// A desk without a run.
struct LoneDesk {
  std::unique_ptr<Clock> clock = virtual_clock();
  RunControl control;
  Questions questions;
  Alarms alarms{*clock};
  OperatorTargets targets;
  OperatorDesk desk{control, questions, alarms, targets};
};

struct RunControlTest : testing::Test {
  RunControlTest() { request.how.faces = {&face}; }
  RunResult run(const std::string& body) {
    const std::string file = (folder.path() / "protocol.lua").string();
    std::ofstream(file)
        << "local units = require 'units'\nlocal s, mm = units.s, units.mm\n"
           "return { title = 'test', needs = { 'coils' }, run = function(rig, p, run)\n"
        << body << "\nend }";
    request.what.protocol_file = file;
    request.where.rig_file = VITREO_SOURCE_DIR "/scripts/rigs/simulated.lua";
    request.where.out = (folder.path() / "runs").string();
    return run_protocol(*engine, request, ear, [&](const Recorder& recorder, OpenRig& rig) {
      for (const double volts : rig.laboratory()->coil_outputs().outputs())
        EXPECT_NEAR(volts, 0, kZeroVolts);
      std::ostringstream text;
      for (const Event& event : recorder.events()) text << event.kind << ":" << event.text << ";";
      events = text.str();
      experiment_time = recorder.end()->experiment_time;
      script_place =
          recorder.end()->location.substr(recorder.end()->location.find_last_of('/') + 1);
    });
  }
  /// The words of the control socket, said from another thread while the script runs.
  void say(const std::string& word, const std::string& more = "") {
    const std::string line = "{\"do\": \"" + word + "\"" + (more.empty() ? "" : ", " + more) + "}";
    reply = answer_request(line, *face.desk);
  }

  TemporaryFolder folder;
  Ear ear;
  RunRequest request;
  DeskFace face;
  nlohmann::json reply;
  std::string events, script_place;
  double experiment_time = 0;
  std::unique_ptr<ScriptEngine> engine = make_lua_engine({VITREO_SOURCE_DIR "/scripts"});
};

}  // namespace vitreo
