// Age and origin of a rig's calibrations: the table `calibrations` of the rig file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"

#include <nlohmann/json.hpp>

#include <map>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// calibrations.field = { file = "octomag.yaml", date = "2026-10-01", valid_days = 180,
///                        devices = { coils = "1A2B3C" } }
struct Calibration {
  // file: empty where its numbers stand in the rig file itself
  std::string name;
  std::string file;
  std::string date;  // "2026-10-01"
  int valid_days = 365;
  /// Role: what its identity must hold, such as a serial number.
  std::map<std::string, std::string> devices;
  /// What the rig file itself says, where an installed value replaces it.
  std::optional<double> instead_of;
};

/// calibrations.installed = { file = "octomag.json", valid_days = 180 }: the file that
/// `calibrate_rig` writes and the next start reads (host/engine/installed_calibration.h).
struct InstalledCalibration {
  std::string file;
  int valid_days = 365;
};

struct Calibrations {
  bool refuse_stale = false;  // when_stale = "refuse"; else a warning
  std::optional<InstalledCalibration> installed;
  std::vector<Calibration> list;

  /// Throws ConfigError with file and line: a date that is none, or later than today; a device that
  /// the rig has not.
  static Calibrations read(ConfigReader& rig);
  static Calibrations of(const RigDescription& rig);
  /// One line for each that is older than it may be; `today` as "2026-11-21".
  std::vector<std::string> out_of_date(const std::string& today) const;
  /// One line for each that was made with another instrument than the one that is there;
  /// `identities`: role: text.
  std::vector<std::string> of_others(const nlohmann::json& identities) const;
};

/// The day here: "2026-11-21".
std::string today_text();

}  // namespace vitreo
