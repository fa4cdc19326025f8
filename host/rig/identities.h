// Identities of the instruments and hashes of the files of a rig, for the start record of a run.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/rig/rig.h"

#include <nlohmann/json.hpp>

namespace vitreo {

/// {"top_camera": "identity", ...} of the roles that are there.
nlohmann::json identities(const Rig& rig);

/// {"path": "SHA-256"} of every text in the rig as resolved that is the path of a file, as it
/// stands or from where the rig file is: calibrations, photographs, prescriptions.
nlohmann::json hashes_of_files(const nlohmann::json& rig);

/// Whether a driver of any role in the program itself has that name: it goes before a file's.
bool is_built_in(const std::string& driver);

}  // namespace vitreo
