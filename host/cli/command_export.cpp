// Command `vitreo export RUN --csv|--mcap|--tiff|--mkv|--hdf5`.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/record/record_json.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <map>
#include <ostream>
#include <stdexcept>

namespace vitreo {

int export_command(const std::filesystem::path& folder, const std::string& format,
                   const std::filesystem::path& into, bool json, std::ostream& out) {
  // One row a format; the word is the flag of the command line without its dashes.
  static const std::map<std::string, Files (*)(const RunData&, const std::filesystem::path&)>
      kFormats = {{"csv", export_csv},
                  {"mcap", export_mcap},
                  {"tiff", export_tiff},
                  {"mkv", export_mkv},
                  {"hdf5", export_hdf5}};
  const auto found = kFormats.find(format);
  if (found == kFormats.end())
    throw std::invalid_argument(format + ": is no format; csv, mcap, tiff, mkv and hdf5 are");
  // Read before the folder is made: a run that cannot be exported leaves no empty export/ behind.
  const RunData data = read_run(folder);
  if (data.frames.empty() && (format == "tiff" || format == "mkv"))
    throw RecordError(folder.string() +
                      ": has no recorded frames; vitreo run --frames top_camera records some");
  // In the run's own folder by default, where the manifest does not list it: an export is made anew
  // at any time, so it is no part of what `vitreo verify` vouches for.
  const std::filesystem::path target = into.empty() ? folder / "export" : into;
  std::filesystem::create_directories(target);
  nlohmann::json names = nlohmann::json::array();
  for (const std::filesystem::path& file : found->second(data, target)) {
    names.push_back(file.string());
    if (!json) out << file.string() << "\n";
  }
  if (json) out << dumped({{"run", folder.filename().string()}, {"files", names}}) << "\n";
  return 0;
}

}  // namespace vitreo
