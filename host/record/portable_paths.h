// Portable paths: file names in a record without the folders of the machine that made it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/run_data.h"

#include <string>
#include <utility>
#include <vector>

namespace vitreo {

/// A record is passed on: "protocols/hold.lua" says which protocol it was, and nothing of whose
/// account it stood in. Texts of scripts stay as they are, for their hashes. /dev, /sys and /proc
/// stay: they say at which port an instrument was.
class PortablePaths {
 public:
  /// Knows the present folder and the home.
  PortablePaths();
  /// A path: relative to a folder that is known; else its last two parts, and the folder above
  /// them is known from then on.
  std::string file(const std::string& path);
  /// A text with the folders that are known taken out of it.
  std::string text(std::string text) const;
  /// All of its texts and keys.
  nlohmann::json json(const nlohmann::json& value) const;
  /// The start record as it is written.
  RunStart start(RunStart start);

 private:
  void know(const std::string& folder, const std::string& instead);
  std::vector<std::pair<std::string, std::string>> folders_;  // "/home/ann/": "~/"; longest first
};

}  // namespace vitreo
