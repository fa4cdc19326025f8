// Installed calibration: the file of accepted values that replace the rig file's own from the next
// start on.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/config/config.h"
#include "host/record/run_data.h"

#include <nlohmann/json.hpp>

#include <filesystem>
#include <map>
#include <string>

namespace vitreo {

/// What a calibration found for keys of the rig file, such as top_camera.effective_pixel.
struct AcceptedCalibration {
  std::map<std::string, double> values;  // SI
  /// Names in the run's folder, of keys that name a file: model.calibration.
  std::map<std::string, std::string> files;
};

/// Path of the rig file's `calibrations.installed.file`: beside the runs, so that the right to
/// measure is the right to install.
std::filesystem::path installed_calibration_file(const std::string& name,
                                                 const std::filesystem::path& runs);

/// The values of the file that `calibrations.installed` names replace the rig file's own, and each
/// becomes an entry of `calibrations`, by whose rules its date and its devices are judged. Nothing
/// is changed where the rig names no file or none is there yet. Throws ConfigError naming the file
/// and the key for one that is broken.
void take_installed_calibration(RigDescription& rig, const std::filesystem::path& runs);

/// The same from a run's record: what was in force then, whatever is installed now.
void take_recorded_calibration(RigDescription& rig, const nlohmann::json& resolved);

/// Installs what the run with this start record and folder accepted; what the file had for other
/// keys stays in force with its own date. The file before is kept beside it, by its name,
/// "_before_" and the run's. Returns the file, or "" where the rig names none or nothing was
/// accepted. Throws std::invalid_argument for a key that no calibration sets, std::runtime_error
/// naming the file that cannot be written; the one in force is then as it was.
std::filesystem::path install_calibration(const AcceptedCalibration& accepted,
                                          const RunStart& start,
                                          const std::filesystem::path& run_folder);

}  // namespace vitreo
