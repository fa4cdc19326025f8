// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/identification.h"

#include "devices/instruments/genicam/aravis.h"

#include <cmath>
#include <utility>

namespace vitreo::genicam {
namespace {

/// Nothing where the camera does not tell it: a table may lack it, and the driver finds out.
std::vector<ProposedSetting> settings_of(ArvCamera* camera) {
  const auto failed = [](GError* error) {
    if (error != nullptr) g_error_free(error);
    return error != nullptr;
  };
  std::vector<ProposedSetting> settings;
  int least = 0;
  int width = 0;
  int height = 0;
  GError* error = nullptr;
  arv_camera_get_width_bounds(camera, &least, &width, &error);
  if (!failed(std::exchange(error, nullptr)))
    settings.push_back({"width_px", std::to_string(width)});
  arv_camera_get_height_bounds(camera, &least, &height, &error);
  if (!failed(std::exchange(error, nullptr)))
    settings.push_back({"height_px", std::to_string(height)});
  const double rate = arv_camera_get_frame_rate(camera, &error);
  if (!failed(std::exchange(error, nullptr)) && rate >= 1)
    settings.push_back({"frame_rate", std::to_string(static_cast<int>(std::floor(rate)))});
  return settings;
}

}  // namespace

std::vector<ProposedRole> proposed_roles(const Found& camera) {
  const std::string note =
      "effective_pixel must be given: m of the observed plane per pixel, by a ruled slide there";
  GError* error = nullptr;
  const Object<ArvCamera> opened(arv_camera_new(camera.identity.c_str(), &error));
  if (error != nullptr) g_error_free(error);
  const std::vector<ProposedSetting> settings =
      opened ? settings_of(opened.get()) : std::vector<ProposedSetting>{};
  return {{"top_camera", settings, note}, {"side_camera", settings, note}};
}

}  // namespace vitreo::genicam
