// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/configuration.h"

#include "devices/instruments/genicam/pixels.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace vitreo::genicam {
namespace {

/// Read back into the record of a run, in this order.
constexpr std::array kRecorded = {"DeviceFirmwareVersion",
                                  "PixelFormat",
                                  "Width",
                                  "Height",
                                  "OffsetX",
                                  "OffsetY",
                                  "ExposureTime",
                                  "ExposureTimeAbs",
                                  "ExposureAuto",
                                  "Gain",
                                  "GainRaw",
                                  "GainAuto",
                                  "BlackLevel",
                                  "BlackLevelRaw",
                                  "Gamma",
                                  "BalanceWhiteAuto",
                                  "AcquisitionFrameRate",
                                  "AcquisitionFrameRateAbs",
                                  "TriggerMode",
                                  "TriggerSource",
                                  "TriggerActivation",
                                  "TriggerDelay",
                                  "LineSource",
                                  "ReverseX",
                                  "ReverseY",
                                  "PtpEnable",
                                  "PtpStatus",
                                  "PtpOffsetFromMaster",
                                  "GevIEEE1588",
                                  "GevIEEE1588Status",
                                  "ChunkModeActive",
                                  "GevSCPSPacketSize",
                                  "DeviceTemperature"};

}  // namespace

std::string size_text(int width_px, int height_px) {
  return std::to_string(width_px) + " x " + std::to_string(height_px);
}

bool belongs_to_the_rig_file(const std::string& feature) {
  constexpr std::array kOfTheImage = {"Width",
                                      "Height",
                                      "OffsetX",
                                      "OffsetY",
                                      "PixelFormat",
                                      "UserSetLoad",
                                      "DeviceReset",
                                      "AcquisitionStart",
                                      "AcquisitionStop",
                                      "ReverseX",
                                      "ReverseY",
                                      "BinningHorizontal",
                                      "BinningVertical",
                                      "DecimationHorizontal",
                                      "DecimationVertical",
                                      "TriggerMode",
                                      "TLParamsLocked",
                                      "ChunkModeActive"};
  return std::find(kOfTheImage.begin(), kOfTheImage.end(), feature) != kOfTheImage.end();
}

void Configuration::refuse(const std::string& what) const {
  throw DeviceError(DeviceErrorKind::refused, settings_.name, what);
}

/// Calls Aravis; its error is thrown under the name of the setting.
/// Aravis reports by a GError that the caller owns; with one the returned value means nothing.
template <class Call>
auto Configuration::ask(const std::string& what, Call call) const {
  GError* error = nullptr;
  if constexpr (std::is_void_v<decltype(call(&error))>) {
    call(&error);
    if (error != nullptr) refuse(what + ": " + text_and_free(error));
  } else {
    auto result = call(&error);
    if (error != nullptr) refuse(what + ": " + text_and_free(error));
    return result;
  }
}

// In the order in which they bound each other: the region limits the rate, and the rate the
// exposure.
void Configuration::apply() const {
  // A camera that still streams, for a host that died, may refuse settings.
  ask("stop", [this](GError** e) { arv_camera_stop_acquisition(camera_, e); });
  make_neutral();
  set_region();
  set_timing();
  if (arv_camera_is_gv_device(camera_) != FALSE)
    ask("packet_size",
        [this](GError** e) { arv_camera_gv_set_packet_size(camera_, settings_.packet_size, e); });
  set_lines();
  for (const auto& [feature, value] : settings_.features) features_.set(feature, value);
  join_ptp();
}

/// What was left in a camera must not be in a measurement: an automatic exposure changes the
/// picture in mid-run, a trigger without a source stops it.
void Configuration::make_neutral() const {
  if (!settings_.user_set.empty() && features_.available("UserSetLoad")) {
    features_.set_where_available("UserSetSelector", settings_.user_set);
    features_.set("UserSetLoad", "");
  }
  for (const char* const automatic : {"ExposureAuto", "GainAuto", "BalanceWhiteAuto"})
    features_.set_where_available(automatic, "Off");
  features_.set_where_available("Gamma", "1");
  if (features_.available("TriggerMode"))
    ask("trigger", [this](GError** e) { arv_camera_clear_triggers(camera_, e); });
}

/// The offsets' bounds depend on the size: they are at zero while it is set.
void Configuration::set_region() const {
  features_.set("PixelFormat", settings_.pixel_format);
  features_.set_where_available("OffsetX", "0");
  features_.set_where_available("OffsetY", "0");
  int least = 0;
  int widest = 0;
  int highest = 0;
  ask("width_px", [&](GError** e) { arv_camera_get_width_bounds(camera_, &least, &widest, e); });
  ask("height_px", [&](GError** e) { arv_camera_get_height_bounds(camera_, &least, &highest, e); });
  if (settings_.width_px > widest || settings_.height_px > highest)
    refuse("width_px, height_px: it makes images of up to " + size_text(widest, highest));
  if (settings_.offset_x_px + settings_.width_px > widest ||
      settings_.offset_y_px + settings_.height_px > highest)
    refuse("offset_x_px, offset_y_px: an image of " +
           size_text(settings_.width_px, settings_.height_px) + " at (" +
           std::to_string(settings_.offset_x_px) + ", " + std::to_string(settings_.offset_y_px) +
           ") is beyond its sensor of " + size_text(widest, highest));
  ask("width_px, height_px, offset_x_px, offset_y_px", [&](GError** e) {
    arv_camera_set_region(camera_, settings_.offset_x_px, settings_.offset_y_px, settings_.width_px,
                          settings_.height_px, e);
  });
}

void Configuration::set_timing() const {
  if (settings_.trigger.empty())
    ask("frame_rate",
        [this](GError** e) { arv_camera_set_frame_rate(camera_, settings_.frame_rate, e); });
  ask("exposure",
      [this](GError** e) { arv_camera_set_exposure_time(camera_, settings_.exposure * 1e6, e); });
  if (arv_camera_is_gain_available(camera_, nullptr) != FALSE)
    ask("gain", [this](GError** e) { arv_camera_set_gain(camera_, settings_.gain, e); });
}

/// Trigger in, exposure out.
void Configuration::set_lines() const {
  if (!settings_.trigger.empty()) {
    ask("trigger",
        [this](GError** e) { arv_camera_set_trigger(camera_, settings_.trigger.c_str(), e); });
    if (settings_.trigger != "Software")
      features_.set_where_available(
          "TriggerActivation", settings_.trigger_edge == "falling" ? "FallingEdge" : "RisingEdge");
    if (settings_.trigger_delay > 0)
      features_.set(features_.available("TriggerDelay") ? "TriggerDelay" : "TriggerDelayAbs",
                    std::to_string(settings_.trigger_delay * 1e6));
  }
  if (!settings_.exposure_output.empty()) {
    features_.set("LineSelector", settings_.exposure_output);
    features_.set_where_available("LineMode", "Output");
    features_.set("LineSource", "ExposureActive");
  }
}

/// The clock steps when it begins to follow a master: before the first frame, then. IEEE 1588:
/// SLAVE follows one, MASTER is one itself; by SFNC's names, or by those before.
void Configuration::join_ptp() const {
  if (!settings_.ptp) return;
  const bool by_sfnc = features_.available("PtpEnable");
  const char* const status = by_sfnc ? "PtpStatus" : "GevIEEE1588Status";
  features_.set(by_sfnc ? "PtpEnable" : "GevIEEE1588", "true");
  constexpr int kTurns = 10;  // a second
  const auto turns = static_cast<int>(std::ceil(settings_.ptp_timeout * kTurns));
  std::string said;
  for (int i = 0; i <= turns; ++i) {
    features_.set_where_available("PtpDataSetLatch", "");
    said = features_.value(status);
    if (said == "Slave" || said == "Master") return;
    g_usleep(1000000 / kTurns);
  }
  refuse("ptp: its clock is " + said + " after " + std::to_string(settings_.ptp_timeout) +
         " s: is there a master (ptp4l) on its network?");
}

double Configuration::exposure() const {
  return 1e-6 *
         ask("exposure", [this](GError** e) { return arv_camera_get_exposure_time(camera_, e); });
}

CameraInfo Configuration::read_back() const {
  CameraInfo info;
  const auto text = [](const char* said) { return std::string(said == nullptr ? "?" : said); };
  info.identity = text(arv_camera_get_vendor_name(camera_, nullptr)) + " " +
                  text(arv_camera_get_model_name(camera_, nullptr)) + ", serial " +
                  text(arv_camera_get_device_serial_number(camera_, nullptr));
  check_region(info);
  check_rate(info);
  const double exposed = exposure();
  if (std::abs(exposed - settings_.exposure) > 0.05 * settings_.exposure + 10e-6)
    refuse("exposure: it exposes for " + std::to_string(exposed) + " s instead");
  info.effective_pixel = settings_.effective_pixel;
  const PixelFormat& format = *format_of(settings_.pixel_format);
  info.bits = format.pattern.empty() ? format.bits : 8;  // color is delivered with 8
  for (const char* const feature : kRecorded)
    if (const auto value = features_.value_of(feature)) info.settings.emplace_back(feature, *value);
  for (const auto& [feature, set] : settings_.features)
    if (const auto value = features_.value_of(feature)) info.settings.emplace_back(feature, *value);
  return info;
}

void Configuration::check_region(CameraInfo& info) const {
  ask("region", [&](GError** e) {
    arv_camera_get_region(camera_, &info.offset_x_px, &info.offset_y_px, &info.width_px,
                          &info.height_px, e);
  });
  if (info.width_px != settings_.width_px || info.height_px != settings_.height_px)
    refuse("width_px, height_px: it makes images of " + size_text(info.width_px, info.height_px) +
           " instead");
  if (info.offset_x_px != settings_.offset_x_px || info.offset_y_px != settings_.offset_y_px)
    refuse("offset_x_px, offset_y_px: it takes (" + std::to_string(info.offset_x_px) + ", " +
           std::to_string(info.offset_y_px) + ") instead");
  const std::string format = features_.value("PixelFormat");
  if (format != settings_.pixel_format) refuse("pixel_format: it gives " + format + " instead");
}

void Configuration::check_rate(CameraInfo& info) const {
  info.frame_period = 1 / settings_.frame_rate;
  if (!settings_.trigger.empty()) return;  // the trigger's
  const double rate =
      ask("frame_rate", [this](GError** e) { return arv_camera_get_frame_rate(camera_, e); });
  if (std::abs(rate - settings_.frame_rate) > 0.05 * settings_.frame_rate)
    refuse("frame_rate: it runs at " + std::to_string(rate) + " Hz instead");
  info.frame_period = 1 / rate;
}

}  // namespace vitreo::genicam
