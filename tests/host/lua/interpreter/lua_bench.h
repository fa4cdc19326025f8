// Test bench of scripts on a made-up rig: a camera, coils, a lens mover and a sample handler that
// act at once.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/time/error.h"
#include "host/lua/engine/engine.h"
#include "host/record/recorder.h"
#include "host/safety/interlock.h"
#include "host/session/progress_listener.h"
#include "host/session/session.h"
#include "host/terminal/line_editor.h"
#include "tests/host/rig/fake_rig.h"

#include <gtest/gtest.h>

#include <fstream>
#include <functional>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

namespace vitreo {

class RememberingListener : public ProgressListener {
 public:
  void progress(double fraction, const std::string& label) override {
    fractions.push_back(fraction);
    labels.push_back(label);
  }
  void message(const std::string& line) override { lines.push_back(line); }
  std::vector<double> fractions;
  std::vector<std::string> labels, lines;
};

class TickingCamera : public Camera {
 public:
  explicit TickingCamera(Clock& clock) : clock_(clock) {}
  const CameraInfo& info() const override { return info_; }
  Frame grab(Time timeout) override {
    if (silent) {
      clock_.sleep_for(timeout);
      throw DeviceError(DeviceErrorKind::timeout, "top_camera", "no frame came");
    }
    clock_.sleep_for(from_seconds(info_.frame_period));
    return {cv::Mat(8, 10, CV_8UC1, cv::Scalar(7)), ++number_, clock_.now(), clock_.now()};
  }
  bool silent = false;

 private:
  Clock& clock_;
  CameraInfo info_{"ticking camera", 10, 8, 0.1, 1e-5};
  std::uint64_t number_ = 0;
};

class PlainCoils : public CoilAmplifier {
 public:
  std::string identity() const override { return "plain coils"; }
  int channels() const override { return 8; }
  double current_limit() const override { return 12; }
  void set_currents(std::span<const double> currents) override {
    if (currents.size() != currents_.size())
      throw std::invalid_argument("currents: wants 8 numbers");
    for (const double current : currents)
      if (std::abs(current) > 12)
        throw DeviceError(DeviceErrorKind::refused, "coils", "beyond the limit of 12 A");
    currents_.assign(currents.begin(), currents.end());
  }
  std::vector<double> currents() const override { return currents_; }
  std::optional<std::vector<double>> measured_currents() override { return currents_; }
  void make_safe() override { currents_.assign(8, 0.0); }

 private:
  std::vector<double> currents_ = std::vector<double>(8, 0.0);
};

class SlowLens : public LensMover {
 public:
  explicit SlowLens(Clock& clock) : clock_(clock) {}
  std::string identity() const override { return "slow lens"; }
  double position() const override { return position_; }
  void move_to(double position, Time) override {
    clock_.sleep_for(from_seconds(2));
    position_ = position;
  }
  double travel_min() const override { return -5e-3; }
  double travel_max() const override { return 5e-3; }
  bool homed() const override { return true; }
  void home(Time) override { position_ = 0; }
  void make_safe() override {}

 private:
  Clock& clock_;
  double position_ = 0;
};

/// What a script's end was.
struct Ended {
  std::string error;  // empty: it came to its end
  std::string trace;
  bool stopped = false;
  bool device_error = false;
};

class LuaBench : public ::testing::Test {
 protected:
  LuaBench() {
    rig.top_camera = &camera;
    rig.coils = &interlock;
    rig.lens_mover = &lens;
    std::filesystem::create_directories(folder.path() / "lib");
    engine = make_lua_engine({(folder.path() / "lib").string()});
  }

  std::string write(const std::string& name, const std::string& text) {
    const std::filesystem::path file = folder.path() / name;
    std::ofstream(file) << text;
    return file.string();
  }

  ProtocolDescription describe(const std::string& text) {
    return engine->describe(write("p.lua", text));
  }

  /// The body of run(rig, p, run), from the file's second line on.
  Ended run(const std::string& body, const std::string& parameters = "{}") {
    return run_file("return { title = 't', parameters = " + parameters +
                    ", run = function(rig, p, run)\n" + body + "\nend }");
  }

  Ended run_file(const std::string& text) {
    return ended([&] {
      const ProtocolDescription protocol = describe(text);
      engine->run(protocol, check_arguments(protocol, {}), session);
    });
  }

  static Ended ended(const std::function<void()>& body) {
    try {
      body();
      return {};
    } catch (const Stopped&) {
      return {"stopped", "", true, false};
    } catch (const DeviceError& error) {
      return {error.what(), "", false, true};
    } catch (const ScriptError& error) {
      return {error.what(), error.trace(), false, false};
    } catch (const std::exception& error) {
      return {std::string("another error: ") + error.what(), "", false, false};
    }
  }

  /// What the prompt shows for these lines.
  std::string prompt(const std::string& lines, bool interactive = false) {
    std::istringstream in(lines);
    std::ostringstream out;
    try {
      engine->prompt(session, *stream_lines(in, out, interactive), out, out);
    } catch (const ScriptError& error) {
      prompt_failed = error.what();
    }
    return out.str();
  }

  std::string prompt_failed;  // what a prompt in a pipe ends with

  std::string said(std::size_t line = 0) const {
    return line < listener.lines.size() ? listener.lines[line] : "(nothing)";
  }

  TemporaryFolder folder;
  std::unique_ptr<Clock> clock = virtual_clock();
  TickingCamera camera{*clock};
  PlainCoils coils;
  Interlock interlock{coils, {}};
  SlowLens lens{*clock};
  Rig rig;
  RememberingListener listener;
  Recorder recorder{folder.path(), start_of_test(1)};
  Session session{*clock, rig, recorder, listener, 7};
  std::unique_ptr<ScriptEngine> engine;
};

/// A message that holds all of these.
inline void expect_all(const std::string& text, const std::vector<std::string>& parts) {
  for (const std::string& part : parts)
    EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is not in: " << text;
}

}  // namespace vitreo
