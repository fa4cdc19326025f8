// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/chunks.h"

#include "devices/instruments/genicam/latch.h"
#include "devices/time/error.h"

#include <algorithm>
#include <cmath>
#include <cstdint>

namespace vitreo::genicam {
namespace {

/// Version 2 of GigE Vision keeps an image an image when chunks follow it (payload type 0x4001);
/// before, the leader told no size. Register 0x0000 holds the version.
bool keeps_size_in_the_leader(ArvCamera* camera) {
  if (arv_camera_is_gv_device(camera) == FALSE) return true;
  guint32 version = 0;
  GError* error = nullptr;
  arv_device_read_register(arv_camera_get_device(camera), 0x0000, &version, &error);
  if (error != nullptr) g_error_free(error);
  return version >> 16 >= 2;
}

/// Switches one chunk on; whether it is.
bool enable(const Features& features, const char* chunk) {
  try {
    features.set("ChunkSelector", chunk);
    return features.set("ChunkEnable", "true") == "true";
  } catch (const DeviceError&) {
    return false;  // it has no such chunk
  }
}

}  // namespace

// ChunkModeActive first: with some makers the selector can be written only then.
Chunks::Chunks(ArvCamera* camera, const Features& features, const std::string& wanted) {
  if (!features.available("ChunkModeActive")) {
    if (wanted == "on") features.set("ChunkModeActive", "true");  // which throws
    return;
  }
  if (wanted == "off" || (wanted == "auto" && !keeps_size_in_the_leader(camera))) {
    features.set("ChunkModeActive", "false");
    return;
  }
  features.set("ChunkModeActive", "true");
  says_begin_ = enable(features, "Timestamp");
  says_exposure_ = enable(features, "ExposureTime");
  parser_.reset(arv_camera_create_chunk_parser(camera));
  // SFNC's clocks count ns; GigE Vision 1's, and what was made of it, ticks.
  units_ = {1};
  if (const double frequency = tick_frequency(camera, features); frequency > 0 && frequency != 1e9)
    units_.push_back(1e9 / frequency);
}

Chunks::Said Chunks::read(ArvBuffer* buffer, std::uint64_t leader) {
  if (!on() || arv_buffer_has_chunks(buffer) == FALSE) return {};
  return {begin(buffer, leader), exposure(buffer)};
}

/// In the unit in which it is nearer to the leader's stamp, which is in ns; SFNC states none.
std::optional<Time> Chunks::begin(ArvBuffer* buffer, std::uint64_t leader) {
  if (!says_begin_) return std::nullopt;
  GError* error = nullptr;
  const auto ticks = static_cast<double>(
      arv_chunk_parser_get_integer_value(parser_.get(), buffer, "ChunkTimestamp", &error));
  if (error != nullptr) {
    g_error_free(error);
    return std::nullopt;
  }
  const auto off = [&](double unit) {
    return std::abs(ticks * unit - static_cast<double>(leader));
  };
  const double unit = *std::min_element(units_.begin(), units_.end(),
                                        [&](double a, double b) { return off(a) < off(b); });
  if (off(unit) > 1e9) return std::nullopt;
  return Time(std::llround(ticks * unit));
}

/// SFNC: us.
std::optional<Time> Chunks::exposure(ArvBuffer* buffer) {
  if (!says_exposure_) return std::nullopt;
  GError* error = nullptr;
  const double exposed =
      arv_chunk_parser_get_float_value(parser_.get(), buffer, "ChunkExposureTime", &error);
  if (error != nullptr) g_error_free(error);
  if (error != nullptr || !(exposed > 0 && exposed < 1e9)) return std::nullopt;
  return from_seconds(exposed * 1e-6);
}

}  // namespace vitreo::genicam
