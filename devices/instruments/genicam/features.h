// Features of a GenICam camera by name, as its own description (GenApi XML) has them.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/aravis.h"

#include <optional>
#include <string>

namespace vitreo::genicam {

/// Outside the clock's baton, as every call of Aravis that asks the camera. `camera` outlives it.
/// Its errors are DeviceError{refused} of `name`, naming the feature.
class Features {
 public:
  /// From here on Aravis checks bounds and access before it writes: by default a width of 99999
  /// would be written to the camera.
  Features(ArvCamera* camera, std::string name);
  /// Whether the camera has it, and it can be read or written at present.
  bool available(const std::string& feature) const;
  /// As text: "On", "12.5", "true". Throws where there is none, or none that can be read.
  std::string value(const std::string& feature) const;
  /// Nothing where the camera has none that can be read.
  std::optional<std::string> value_of(const std::string& feature) const;
  /// A number, a word of its list, true or false; of a command the empty text. Returns what the
  /// camera reads back.
  std::string set(const std::string& feature, const std::string& value) const;
  /// The same where the camera has it; else nothing is done.
  void set_where_available(const std::string& feature, const std::string& value) const;

 private:
  ArvGcNode* node(const std::string& feature) const;
  void write(ArvGcNode* node, const std::string& feature, const std::string& value,
             GError** error) const;
  [[noreturn]] void fail(const std::string& feature, const std::string& why) const;

  ArvCamera* const camera_;
  ArvDevice* const device_;
  const std::string name_;
};

}  // namespace vitreo::genicam
