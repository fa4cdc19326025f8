// SPDX-License-Identifier: Apache-2.0
#include "host/runs/export_folder.h"

#include "host/files/posix_file.h"
#include "host/files/run_folder.h"

#include <algorithm>
#include <stdexcept>
#include <system_error>

namespace vitreo {
namespace {

namespace fs = std::filesystem;

}  // namespace

// The staging folder lies in the folder itself: a file is renamed within one file system.
ExportFolder::ExportFolder(const fs::path& folder, bool replace)
    : folder_(folder), replace_(replace), staging_(folder / (".export-" + random_hex(8))) {
  std::error_code error;
  if (fs::exists(folder, error) && !fs::is_directory(folder, error))
    throw std::runtime_error(folder.string() + ": is a file, not a folder for an export");
  made_ = !fs::exists(folder, error);
  fs::create_directories(staging_, error);
  if (error)
    throw std::runtime_error(folder.string() + ": cannot be written to: " + error.message());
}

ExportFolder::~ExportFolder() {
  // After publish() as well, which has moved the files out of it.
  std::error_code ignored;  // what cannot be removed is hidden, and no file of the export
  fs::remove_all(staging_, ignored);
  if (made_) fs::remove(folder_, ignored);  // only where it is empty
}

// Refused before it is written: an export of minutes should not fail at its end.
fs::path ExportFolder::add(const std::string& stem, const std::string& ending) {
  std::string name = stem + ending;
  for (int i = 2; std::find(names_.begin(), names_.end(), name) != names_.end(); ++i)
    name = stem + "_" + std::to_string(i) + ending;
  std::error_code error;
  if (!replace_ && fs::exists(folder_ / name, error))
    throw std::runtime_error((folder_ / name).string() +
                             ": is there already; --replace writes it anew, --into FOLDER beside");
  names_.push_back(name);
  return staging_ / name;
}

/// Errors of the writers name the staging folder, which is gone when they are read.
std::string ExportFolder::renamed(std::string text) const {
  const std::string part = staging_.string();
  for (std::size_t at = text.find(part); at != std::string::npos; at = text.find(part))
    text.replace(at, part.size(), folder_.string());
  return text;
}

// On the disk before it is named: a power cut must not leave an empty file under the name.
Files ExportFolder::publish() {
  Files files;
  for (const std::string& name : names_) {
    // Another export may have come first since add().
    if (std::error_code error; !replace_ && fs::exists(folder_ / name, error))
      throw std::runtime_error((folder_ / name).string() + ": was made meanwhile");
    const Descriptor file(open_existing_file(staging_ / name));
    sync_file(file.number(), staging_ / name);
  }
  // Each rename is atomic, all of them together are not: a kill in between leaves the first files,
  // each of them whole.
  for (const std::string& name : names_) {
    fs::rename(staging_ / name, folder_ / name);
    files.push_back(folder_ / name);
  }
  sync_folder(folder_);
  return files;
}

}  // namespace vitreo
