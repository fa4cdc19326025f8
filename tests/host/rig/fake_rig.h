// A simulated rig for tests of the host, opened as the program opens it but without Lua.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/rig/open_rig.h"
#include "host/servo/observers.h"
#include "host/servo/servo.h"
#include "host/servo/servo_cameras.h"
#include "host/session/progress_listener.h"
#include "host/session/session.h"

#include <filesystem>
#include <memory>
#include <string>
#include <unistd.h>

namespace vitreo {

class SilentListener : public ProgressListener {
 public:
  void progress(double, const std::string&) override {}
  void message(const std::string&) override {}
};

inline RigDescription whole_rig() {
  RigDescription description;
  description.file = "test rig";
  for (const char* role :
       {"top_camera", "side_camera", "coils", "lens_mover", "pose_sensor", "sample"})
    description.table[role] = ConfigValue{ConfigTable{}};
  return description;
}

/// The same with a robot, cameras and an eye exactly as believed: for what is about the view of it.
/// A hundredth of the robot's size looks like 0.2 mm of depth.
inline RigDescription rig_of_known_size() {
  RigDescription description = whole_rig();
  ConfigTable truth;
  for (const char* sigma : {"size_sigma", "pixel_sigma", "tilt_sigma", "eye_sigma", "stamp_sigma"})
    truth[sigma] = ConfigValue{0.0};
  description.table["truth"] = ConfigValue{truth};
  return description;
}

/// A new folder that goes when the test ends.
class TemporaryFolder {
 public:
  TemporaryFolder() {
    std::string name = (std::filesystem::temp_directory_path() / "vitreo_test_XXXXXX").string();
    path_ = mkdtemp(name.data());
  }
  ~TemporaryFolder() { std::filesystem::remove_all(path_); }
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline RunStart start_of_test(std::uint64_t seed) {
  RunStart start;
  start.protocol_file = "test.lua";
  start.protocol_title = "test";
  start.parameters = start.rig = nlohmann::json::object();
  start.seed = seed;
  return start;
}

/// Clock, rig, record and session, as the run engine would have them.
struct TestBench {
  explicit TestBench(std::uint64_t seed = 1, const SimulationShifts& shifts = {},
                     const RigDescription& description = whole_rig())
      : clock(virtual_clock()),
        rig(open_rig(description, *clock, seed, shifts)),
        recorder(std::make_unique<Recorder>(folder.path(), start_of_test(seed))),
        session(std::make_unique<Session>(*clock, rig->rig(), *recorder, listener, seed)) {
    session->keep(observe_truth(*clock, *rig->laboratory(), 1 / 15.0, *recorder));
  }
  ~TestBench() { session.reset(); }
  Rig& roles() { return rig->rig(); }

  ServoCameras eyes() {
    vision::Background top = session->learn_background(4);
    return {std::move(top), session->side_observations()};
  }

  /// The robot in, held at the center for `seconds`.
  std::unique_ptr<Servo> held(double seconds, const ServoSettings& settings = {}) {
    rig->rig().sample->remove_robot();
    auto servo = std::make_unique<Servo>(*clock, rig->rig(), *recorder, eyes(), settings);
    servo->hold({0, 0, 0});
    rig->rig().sample->insert_robot({0, 0, 0});
    clock->sleep_for(from_seconds(seconds));
    return servo;
  }

  TemporaryFolder folder;
  SilentListener listener;
  std::unique_ptr<Clock> clock;
  std::unique_ptr<OpenRig> rig;
  std::unique_ptr<Recorder> recorder;
  std::unique_ptr<Session> session;
};

}  // namespace vitreo
