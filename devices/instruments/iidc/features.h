// Features of an IIDC camera (shutter, gain, trigger ...): set by hand, in their own units or in
// counts of their registers, and read back.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <dc1394/dc1394.h>
#include <string>

namespace vitreo::iidc {

/// Throws DeviceError{refused}, naming the setting, for whatever the camera does not take or does
/// not keep.
class Features {
 public:
  Features(dc1394camera_t& camera, std::string name) : camera_(camera), name_(std::move(name)) {}

  /// The camera sets nothing itself, and waits for no trigger.
  void set_manual();
  /// s -> s as read back. `unit`: s of a count of the register; 0: by the camera's absolute values.
  double set_shutter(double exposure, double unit);
  /// In dB where the camera has absolute values, else in counts; as read back.
  double set_gain(double gain);
  /// "dB" or "counts".
  const char* gain_unit() const { return gain_unit_; }

  [[noreturn]] void refuse(const std::string& what) const;
  /// libdc1394's error, under the name of the setting.
  void need(dc1394error_t code, const std::string& setting) const;

 private:
  bool has(dc1394feature_t feature) const;
  bool has_absolute(dc1394feature_t feature, const std::string& setting) const;
  void make_manual(dc1394feature_t feature, const std::string& setting);
  double set_absolute(dc1394feature_t feature, double value, const std::string& setting);
  double set_counts(dc1394feature_t feature, double value, double unit, const std::string& setting);

  dc1394camera_t& camera_;
  const std::string name_;
  const char* gain_unit_ = "dB";
};

/// As in an error: 0.0819, 2e-05.
std::string text_of(double number);

}  // namespace vitreo::iidc
