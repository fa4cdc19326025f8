// Controls of a V4L2 camera by their numbers: exposure, gain, and the automatics that are in the
// way.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

namespace vitreo::opencv_camera {

/// A second opening of the node, beside the one that streams: V4L2 lets any opening set controls.
/// Throws DeviceError{refused} of `name`, naming the node.
class V4l2Controls {
 public:
  V4l2Controls(const std::string& node, std::string name);
  ~V4l2Controls();
  V4l2Controls(const V4l2Controls&) = delete;
  V4l2Controls& operator=(const V4l2Controls&) = delete;

  /// Manual exposure of `seconds`, to 100 us as UVC has it; the frame rate no longer gives way to
  /// it. Returns what the camera reads back, s. Throws where it has no such control, or takes
  /// another value than a twentieth away.
  double set_exposure(double seconds) const;
  /// In the camera's own unit. Throws as set_exposure().
  void set_gain(int gain) const;
  /// White balance and focus, where the camera has automatics for them.
  void switch_automatics_off() const;

 private:
  std::optional<int> value(unsigned control) const;
  bool set(unsigned control, int value) const;
  [[noreturn]] void refuse(const std::string& what) const;

  std::string node_;
  std::string name_;
  int file_ = -1;
};

}  // namespace vitreo::opencv_camera
