// Region and packets of an IIDC camera in Format 7.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/iidc/driver.h"
#include "devices/instruments/iidc/features.h"

#include <dc1394/dc1394.h>

namespace vitreo::iidc {

/// Format 7 is the one of free regions; its mode 0 has the sensor's full resolution.
constexpr dc1394video_mode_t kMode = DC1394_VIDEO_MODE_FORMAT7_0;
/// Isochronous cycles a second of IEEE 1394, each with one packet of the camera.
constexpr double kCycles = 8000;

/// Of the settings' size in the sensor's middle, in the camera's own steps, gray of 8 bits.
/// Throws DeviceError{refused} naming the setting.
void set_region(dc1394camera_t& camera, const Features& features, const Settings& settings);

/// In Format 7 the packets set the frame rate: an image takes as many cycles as it has packets.
/// The smallest that reach the settings' rate. Returns s from the first to the last packet of an
/// image; throws DeviceError{refused}.
double set_packets(dc1394camera_t& camera, const Features& features, const Settings& settings);

}  // namespace vitreo::iidc
