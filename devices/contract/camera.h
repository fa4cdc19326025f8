// Contract suite of Camera: the duties of the role, checked alike on emulators and real
// instruments.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/roles/camera.h"
#include "devices/time/clock.h"

#include <functional>
#include <string>
#include <vector>

namespace vitreo::contract {

struct CameraCheck {
  int frames = 12;          ///< how many are grabbed in a row
  bool may_drop = true;     ///< numbers may have gaps
  bool may_repeat = false;  ///< two frames may be the same image (a frozen scene without noise)
  /// What is wrong with a frame, where that can be known from what it shows; else null. An empty
  /// text: it is right.
  std::function<std::string(const Frame&)> content;
};

/// Grabs frames and examines them. Returns one sentence for each duty that the camera fails; none
/// is good. Lets Stopped pass; takes every other exception as a finding.
std::vector<std::string> check(Camera& camera, Clock& clock, const CameraCheck& how = {});

}  // namespace vitreo::contract
