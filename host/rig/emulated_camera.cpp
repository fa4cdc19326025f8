// The camera among the parts of emulated instruments.
// SPDX-License-Identifier: Apache-2.0
#include "devices/sim/spoiled_picture.h"
#include "host/rig/emulated_parts.h"

#include <opencv2/imgproc.hpp>

#include <atomic>
#include <utility>

namespace vitreo {
namespace {

/// A GigE Vision camera in software. Its server draws in a thread of its own, so it is ended
/// without any lock.
class StreamedCamera final : public EmulatedPart {
 public:
  StreamedCamera(EmulatedWorld& world, genicam::ServerSettings settings, CameraView view)
      : world_(world), settings_(std::move(settings)), view_(std::move(view)) {
    serve_camera();
  }
  const char* type() const override { return "camera"; }
  bool touched() const override { return touched_; }

  void set(const Fault& fault, double by, bool on) override {
    const std::string& kind = fault.kind;
    if (kind == "unplugged" || kind == "power_cycled") {
      if (on) return server_.reset();
      if (!server_) serve_camera();
      return;
    }
    if (set_stream(kind, by, on)) {
      if (server_) server_->set_faults(faults_);
      return;
    }
    world_.with([&] { set_picture(kind, by, on); });
  }
  void exchange(EmulatedPart& other) override {
    world_.with([&] { std::swap(view_, dynamic_cast<StreamedCamera&>(other).view_); });
  }

 private:
  void serve_camera() {
    server_ = genicam::serve_camera(settings_, [this](const genicam::Exposure& exposure,
                                                      cv::Mat& image) { draw(exposure, image); });
    server_->set_faults(faults_);
  }
  void draw(const genicam::Exposure& exposure, cv::Mat& image) {
    touched_ = true;
    Time exposed{};
    sim::Picture picture;
    sim::PictureFaults spoils;
    world_.with([&] {
      exposed = world_.clock().now() - from_seconds(exposure.age);
      picture = view_(exposed, exposure.number);
      spoils = picture_;
    });
    // A picture takes some 20 ms and on a busy machine ten times as long, a new view of the eye
    // more: no instrument's answer waits for that.
    const cv::Mat seen = sim::spoiled(picture(), spoils, exposed);
    cv::resize(seen, image, image.size());  // where the client asked for another size
  }
  /// False for a fault of what it sees.
  bool set_stream(const std::string& kind, double by, bool on) {
    const int count = on ? static_cast<int>(by) : 0;
    if (kind == "silent") return faults_.silent = on, true;
    if (kind == "frozen") return faults_.frozen = on, true;
    if (kind == "late") return faults_.late = on ? by : 0, true;
    if (kind == "drops") return faults_.drops = count, true;
    if (kind == "torn") return faults_.torn = count, true;
    if (kind == "packets") return faults_.lost_packets = on ? 1 / by : 0, true;
    return false;
  }
  void set_picture(const std::string& kind, double by, bool on) {
    const int count = on ? static_cast<int>(by) : 0;
    if (kind == "overexposed") picture_.light = on ? by : 1;
    if (kind == "dark") picture_.light = on ? 1 / by : 1;
    if (kind == "defocused") picture_.blur_px = count;
    if (kind != "floater") return;
    picture_.floater_px = count;
    picture_.floater_since = world_.clock().now();
  }

  EmulatedWorld& world_;
  const genicam::ServerSettings settings_;
  CameraView view_;
  genicam::ServerFaults faults_;
  sim::PictureFaults picture_;
  std::atomic<bool> touched_{false};
  std::unique_ptr<genicam::CameraServer> server_;  // last: its thread draws until it is gone
};

}  // namespace

std::unique_ptr<EmulatedPart> make_camera(EmulatedWorld& world,
                                          const genicam::ServerSettings& settings,
                                          CameraView view) {
  return std::make_unique<StreamedCamera>(world, settings, std::move(view));
}

}  // namespace vitreo
