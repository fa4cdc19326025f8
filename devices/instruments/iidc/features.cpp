// SPDX-License-Identifier: Apache-2.0
#ifdef VITREO_HAVE_DC1394
#include "devices/instruments/iidc/features.h"

#include "devices/time/error.h"

#include <cmath>
#include <sstream>

namespace vitreo::iidc {
namespace {

/// How far a value that the camera rounds may be from the one that was asked for.
constexpr double kRounding = 0.1;
/// Of the limits, which the camera states in single precision.
constexpr double kPrecision = 1e-6;

}  // namespace

std::string text_of(double number) {
  std::ostringstream text;
  text << number;
  return text.str();
}

void Features::refuse(const std::string& what) const {
  throw DeviceError(DeviceErrorKind::refused, name_, what);
}

void Features::need(dc1394error_t code, const std::string& setting) const {
  if (code != DC1394_SUCCESS) refuse(setting + ": " + dc1394_error_get_string(code));
}

// A camera may fail the question for a register that it does not have.
bool Features::has(dc1394feature_t feature) const {
  dc1394bool_t present = DC1394_FALSE;
  return dc1394_feature_is_present(&camera_, feature, &present) == DC1394_SUCCESS &&
         present == DC1394_TRUE;
}

// Only this question tells: libdc1394 writes absolute values to a camera that has none without an
// error, and to a register of the bus itself (NODE_IDS).
bool Features::has_absolute(dc1394feature_t feature, const std::string& setting) const {
  dc1394bool_t absolute = DC1394_FALSE;
  need(dc1394_feature_has_absolute_control(&camera_, feature, &absolute), setting);
  return absolute == DC1394_TRUE;
}

void Features::make_manual(dc1394feature_t feature, const std::string& setting) {
  need(dc1394_feature_set_mode(&camera_, feature, DC1394_FEATURE_MODE_MANUAL), setting);
  dc1394feature_mode_t mode = DC1394_FEATURE_MODE_AUTO;
  need(dc1394_feature_get_mode(&camera_, feature, &mode), setting);
  if (mode != DC1394_FEATURE_MODE_MANUAL)
    refuse(setting + ": the camera sets it itself, and cannot be stopped");
}

// libdc1394 does not look whether a register took what was written: each is read again.
void Features::set_manual() {
  for (int i = DC1394_FEATURE_MIN; i <= DC1394_FEATURE_MAX; ++i) {
    const auto feature = static_cast<dc1394feature_t>(i);
    if (feature == DC1394_FEATURE_TRIGGER || !has(feature)) continue;
    dc1394feature_mode_t mode = DC1394_FEATURE_MODE_MANUAL;
    if (dc1394_feature_get_mode(&camera_, feature, &mode) == DC1394_SUCCESS &&
        mode != DC1394_FEATURE_MODE_MANUAL)
      make_manual(feature, dc1394_feature_get_string(feature));
  }
  if (!has(DC1394_FEATURE_TRIGGER)) return;
  need(dc1394_external_trigger_set_power(&camera_, DC1394_OFF), "trigger");
  dc1394switch_t on = DC1394_OFF;
  need(dc1394_external_trigger_get_power(&camera_, &on), "trigger");
  if (on == DC1394_ON) refuse("trigger: it cannot be switched off, and the camera waits for it");
}

double Features::set_shutter(double exposure, double unit) {
  if (!has(DC1394_FEATURE_SHUTTER)) refuse("exposure: the camera has no shutter to set");
  make_manual(DC1394_FEATURE_SHUTTER, "exposure");
  const bool absolute = has_absolute(DC1394_FEATURE_SHUTTER, "exposure");
  if (unit == 0 && absolute) return set_absolute(DC1394_FEATURE_SHUTTER, exposure, "exposure");
  if (unit == 0)
    refuse(
        "exposure: the camera's shutter takes counts, not seconds; shutter_unit must say how many "
        "s one is, from its manual");
  if (absolute)
    need(dc1394_feature_set_absolute_control(&camera_, DC1394_FEATURE_SHUTTER, DC1394_OFF),
         "exposure");
  return set_counts(DC1394_FEATURE_SHUTTER, exposure, unit, "exposure");
}

double Features::set_gain(double gain) {
  if (!has(DC1394_FEATURE_GAIN)) {
    if (gain != 0) refuse("gain: the camera has none to set");
    return 0;
  }
  make_manual(DC1394_FEATURE_GAIN, "gain");
  if (has_absolute(DC1394_FEATURE_GAIN, "gain"))
    return set_absolute(DC1394_FEATURE_GAIN, gain, "gain");
  gain_unit_ = "counts";
  if (gain != std::round(gain)) refuse("gain: the camera's is in whole counts");
  return set_counts(DC1394_FEATURE_GAIN, gain, 1, "gain");
}

double Features::set_absolute(dc1394feature_t feature, double value, const std::string& setting) {
  need(dc1394_feature_set_absolute_control(&camera_, feature, DC1394_ON), setting);
  float least = 0;
  float most = 0;
  need(dc1394_feature_get_absolute_boundaries(&camera_, feature, &least, &most), setting);
  const double slack = kPrecision * std::abs(most);
  if (!(value >= least - slack && value <= most + slack))
    refuse(setting + ": " + text_of(value) + ": the camera takes " + text_of(least) + " to " +
           text_of(most));
  need(dc1394_feature_set_absolute_value(&camera_, feature, static_cast<float>(value)), setting);
  float kept = 0;
  need(dc1394_feature_get_absolute_value(&camera_, feature, &kept), setting);
  if (!(std::abs(kept - value) <=
        kRounding * std::max(std::abs(value), 1e-6 + std::abs(most) / 100)))
    refuse(setting + ": " + text_of(value) + " became " + text_of(kept) + " in the camera");
  return kept;
}

// The limits are the register's own; the camera's manual may know narrower ones.
double Features::set_counts(dc1394feature_t feature, double value, double unit,
                            const std::string& setting) {
  std::uint32_t least = 0;
  std::uint32_t most = 0;
  need(dc1394_feature_get_boundaries(&camera_, feature, &least, &most), setting);
  const double counts = std::round(value / unit);
  if (!(counts >= least && counts <= most))
    refuse(setting + ": " + text_of(value) + " is " + text_of(counts) +
           " counts; the camera takes " + std::to_string(least) + " to " + std::to_string(most) +
           (unit == 1 ? "" : ", " + text_of(least * unit) + " to " + text_of(most * unit) + " s"));
  const auto wanted = static_cast<std::uint32_t>(counts);
  need(dc1394_feature_set_value(&camera_, feature, wanted), setting);
  std::uint32_t kept = 0;
  need(dc1394_feature_get_value(&camera_, feature, &kept), setting);
  if (kept != wanted)
    refuse(setting + ": " + std::to_string(wanted) + " counts became " + std::to_string(kept) +
           " in the camera");
  return kept * unit;
}

}  // namespace vitreo::iidc
#endif
