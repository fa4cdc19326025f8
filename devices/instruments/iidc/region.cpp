// SPDX-License-Identifier: Apache-2.0
#ifdef VITREO_HAVE_DC1394
#include "devices/instruments/iidc/region.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>

namespace vitreo::iidc {
namespace {

/// libdc1394 describes eight packets to Linux at once, in 16 bits.
constexpr std::uint32_t kLargestPacket = 0xFFFF / 8;

struct Pixels {
  std::uint32_t x = 0;
  std::uint32_t y = 0;
};

/// The nearest multiples of a unit about a number: "640 or 644".
std::string multiples(std::uint32_t number, std::uint32_t unit) {
  const std::uint32_t below = number / unit * unit;
  return std::to_string(below) + " or " + std::to_string(below + unit);
}

// The steps of a position may be others than those of a size; 0 says that they are not.
void place_region(dc1394camera_t& camera, const Features& features, const Settings& settings,
                  Pixels corner, Pixels step) {
  std::uint32_t step_x = 0;
  std::uint32_t step_y = 0;
  if (dc1394_format7_get_unit_position(&camera, kMode, &step_x, &step_y) != DC1394_SUCCESS)
    step_x = step_y = 0;
  if (step_x == 0) step_x = step.x;
  if (step_y == 0) step_y = step.y;
  const auto x = static_cast<std::int32_t>(corner.x / step_x * step_x);
  const auto y = static_cast<std::int32_t>(corner.y / step_y * step_y);
  features.need(
      dc1394_format7_set_roi(&camera, kMode, DC1394_COLOR_CODING_MONO8, DC1394_USE_MAX_AVAIL, x, y,
                             settings.width_px, settings.height_px),
      "width_px, height_px");
  dc1394color_coding_t coding{};
  std::uint32_t packet = 0;
  Pixels at;
  Pixels size;
  features.need(
      dc1394_format7_get_roi(&camera, kMode, &coding, &packet, &at.x, &at.y, &size.x, &size.y),
      "width_px, height_px");
  if (coding != DC1394_COLOR_CODING_MONO8)
    features.refuse("the camera has no gray of 8 bits in Format 7, mode 0");
  if (static_cast<int>(size.x) != settings.width_px ||
      static_cast<int>(size.y) != settings.height_px)
    features.refuse("width_px, height_px: the camera kept " + std::to_string(size.x) + " x " +
                    std::to_string(size.y));
}

}  // namespace

void set_region(dc1394camera_t& camera, const Features& features, const Settings& settings) {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  features.need(dc1394_format7_get_max_image_size(&camera, kMode, &width, &height), "width_px");
  const auto x = static_cast<std::uint32_t>(settings.width_px);
  const auto y = static_cast<std::uint32_t>(settings.height_px);
  if (x > width || y > height)
    features.refuse("width_px, height_px: the sensor has " + std::to_string(width) + " x " +
                    std::to_string(height));
  std::uint32_t step_x = 0;
  std::uint32_t step_y = 0;
  features.need(dc1394_format7_get_unit_size(&camera, kMode, &step_x, &step_y), "width_px");
  step_x = std::max(1U, step_x);
  step_y = std::max(1U, step_y);
  if (x % step_x != 0)
    features.refuse("width_px: the camera takes multiples of " + std::to_string(step_x) + ": " +
                    multiples(x, step_x));
  if (y % step_y != 0)
    features.refuse("height_px: the camera takes multiples of " + std::to_string(step_y) + ": " +
                    multiples(y, step_y));
  place_region(camera, features, settings, {(width - x) / 2, (height - y) / 2}, {step_x, step_y});
}

double set_packets(dc1394camera_t& camera, const Features& features, const Settings& settings) {
  std::uint32_t unit = 0;
  std::uint32_t most = 0;
  features.need(dc1394_format7_get_packet_parameters(&camera, kMode, &unit, &most), "frame_rate");
  unit = std::max(1U, unit);
  most = std::min(most, kLargestPacket) / unit * unit;
  const double bytes = static_cast<double>(settings.width_px) * settings.height_px;
  const double cycles = std::floor(kCycles / settings.frame_rate);
  const double packet = std::ceil(bytes / std::max(1.0, cycles) / unit) * unit;
  if (!(cycles >= 1 && packet <= most))
    features.refuse("frame_rate: the bus carries this region " +
                    text_of(kCycles / std::ceil(bytes / std::max(1U, most))) +
                    " times a second at most");
  const auto wanted = static_cast<std::uint32_t>(packet);
  features.need(dc1394_format7_set_packet_size(&camera, kMode, wanted), "frame_rate");
  std::uint32_t kept = 0;
  std::uint32_t packets = 0;
  features.need(dc1394_format7_get_packet_size(&camera, kMode, &kept), "frame_rate");
  features.need(dc1394_format7_get_packets_per_frame(&camera, kMode, &packets), "frame_rate");
  if (kept != wanted)
    features.refuse("frame_rate: packets of " + std::to_string(wanted) + " bytes became " +
                    std::to_string(kept) + " in the camera");
  return packets / kCycles;
}

}  // namespace vitreo::iidc
#endif
