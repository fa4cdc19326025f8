// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/opencv_camera/v4l2_controls.h"

#include "devices/time/error.h"

#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <linux/videodev2.h>
#include <sys/ioctl.h>
#include <unistd.h>
#include <utility>

namespace vitreo::opencv_camera {
namespace {

constexpr double kExposureUnit = 100e-6;  // s, of V4L2_CID_EXPOSURE_ABSOLUTE

/// Of the last call that failed.
std::string reason() { return errno == EINVAL ? "it has no control for it" : std::strerror(errno); }

}  // namespace

V4l2Controls::V4l2Controls(const std::string& node, std::string name)
    : node_(node), name_(std::move(name)), file_(::open(node.c_str(), O_RDWR | O_CLOEXEC)) {
  if (file_ < 0) refuse(std::string("cannot be opened: ") + std::strerror(errno));
}

V4l2Controls::~V4l2Controls() { ::close(file_); }

void V4l2Controls::refuse(const std::string& what) const {
  throw DeviceError(DeviceErrorKind::refused, name_, node_ + ": " + what);
}

std::optional<int> V4l2Controls::value(unsigned control) const {
  v4l2_control asked{control, 0};
  if (ioctl(file_, VIDIOC_G_CTRL, &asked) != 0) return std::nullopt;
  return asked.value;
}

bool V4l2Controls::set(unsigned control, int value) const {
  v4l2_control wanted{control, value};
  return ioctl(file_, VIDIOC_S_CTRL, &wanted) == 0;
}

// Manual first: while it is automatic the driver refuses the exposure, or takes it in silence.
double V4l2Controls::set_exposure(double seconds) const {
  if (!set(V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL) && value(V4L2_CID_EXPOSURE_AUTO))
    refuse("exposure: its automatic cannot be switched off");
  set(V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0);
  const int units = std::max(1, static_cast<int>(std::lround(seconds / kExposureUnit)));
  if (!set(V4L2_CID_EXPOSURE_ABSOLUTE, units))
    refuse("exposure: " + std::to_string(seconds) + " s is not taken: " + reason());
  const double taken = kExposureUnit * value(V4L2_CID_EXPOSURE_ABSOLUTE).value_or(units);
  if (std::abs(taken - seconds) > 0.05 * seconds + kExposureUnit / 2)
    refuse("exposure: it exposes for " + std::to_string(taken) + " s instead");
  return taken;
}

void V4l2Controls::set_gain(int gain) const {
  set(V4L2_CID_AUTOGAIN, 0);
  if (!set(V4L2_CID_GAIN, gain))
    refuse("gain: " + std::to_string(gain) + " is not taken: " + reason());
  const int taken = value(V4L2_CID_GAIN).value_or(gain);
  if (taken != gain) refuse("gain: it takes " + std::to_string(taken) + " instead");
}

void V4l2Controls::switch_automatics_off() const {
  set(V4L2_CID_AUTO_WHITE_BALANCE, 0);
  set(V4L2_CID_FOCUS_AUTO, 0);
}

}  // namespace vitreo::opencv_camera
