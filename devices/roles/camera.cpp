// SPDX-License-Identifier: Apache-2.0
#include "devices/roles/camera.h"

#include "devices/time/error.h"

namespace vitreo {
namespace {

[[noreturn]] void refuse(const CameraInfo& info, const std::string& what) {
  throw DeviceError(DeviceErrorKind::refused, info.identity, what);
}

}  // namespace

std::string Camera::feature(const std::string& name) {
  refuse(info(), "feature " + name + ": its driver knows no features by name");
}

std::string Camera::set_feature(const std::string& name, const std::string&) {
  refuse(info(), "feature " + name + ": its driver knows no features by name");
}

}  // namespace vitreo
