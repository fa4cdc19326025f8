// Configuration of a GenICam camera at its opening: what is set, in which order, and what it says
// back.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/aravis.h"
#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/genicam/features.h"

namespace vitreo::genicam {

/// Puts the settings into a camera that does not stream; reads all back. Outside the clock's baton.
/// Throws DeviceError{refused} naming the setting.
class Configuration {
 public:
  Configuration(ArvCamera* camera, const Settings& settings, const Features& features)
      : camera_(camera), settings_(settings), features_(features) {}
  void apply() const;
  /// What the camera made of it. Of the size nothing may differ: pixels would be taken for others;
  /// rate and exposure may by a twentieth.
  CameraInfo read_back() const;
  /// s; an automatic or a script may have changed it.
  double exposure() const;

 private:
  template <class Call>
  auto ask(const std::string& what, Call call) const;
  [[noreturn]] void refuse(const std::string& what) const;
  void make_neutral() const;
  void set_region() const;
  void set_timing() const;
  void set_lines() const;
  void join_ptp() const;
  void check_region(CameraInfo& info) const;
  void check_rate(CameraInfo& info) const;

  ArvCamera* const camera_;
  const Settings& settings_;
  const Features& features_;
};

/// "640 x 480", for errors.
std::string size_text(int width_px, int height_px);

/// Whether a feature decides what an image is, and is therefore the rig file's alone.
bool belongs_to_the_rig_file(const std::string& feature);

}  // namespace vitreo::genicam
