// Export folder: the files of one export, which get their names together once all are whole.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace vitreo {

using Files = std::vector<std::filesystem::path>;

class ExportFolder {
 public:
  /// Makes the folder where there is none. `replace`: files that are there already are given up for
  /// the new ones. Throws std::runtime_error naming the folder.
  explicit ExportFolder(const std::filesystem::path& folder, bool replace = false);
  /// Without publish() nothing is left of the export.
  ~ExportFolder();
  ExportFolder(const ExportFolder&) = delete;
  ExportFolder& operator=(const ExportFolder&) = delete;

  /// Where the file is to be written that will be `stem` and `ending`, or "stem_2" ... where this
  /// export has one of that name. Throws std::runtime_error for a file that is there already.
  std::filesystem::path add(const std::string& stem, const std::string& ending);
  /// A text with the files under the names that they would have got: for errors.
  std::string renamed(std::string text) const;
  /// Names the files, all or none, and returns them in the order in which they were added.
  Files publish();

 private:
  const std::filesystem::path folder_;
  const bool replace_;
  bool made_ = false;              // the folder was not there before
  std::filesystem::path staging_;  // a folder beside the files to come
  std::vector<std::string> names_;
};

}  // namespace vitreo
