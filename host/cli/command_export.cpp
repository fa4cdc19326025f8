// Command `vitreo export RUN --as csv,mcap,...`.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/config/config.h"
#include "host/record/record_json.h"
#include "host/runs/export.h"
#include "host/runs/run_reader.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <ostream>
#include <stdexcept>

namespace vitreo {
namespace {

/// The formats asked for, each once, in the order of the table.
std::vector<ExportFormat> formats_of(const std::vector<std::string>& words) {
  std::vector<std::string> known;
  for (const ExportFormat& format : export_formats()) known.push_back(format.name);
  if (words.empty())
    throw ConfigError(
        fmt::format("export: wants --as with one or more of {}", fmt::join(known, ",")));
  for (const std::string& word : words) {
    if (std::find(known.begin(), known.end(), word) != known.end()) continue;
    const std::string near = nearest(word, known);
    throw ConfigError(fmt::format("--as {}: is no format; {}", word,
                                  near.empty() ? fmt::format("there are {}", fmt::join(known, ","))
                                               : "did you mean " + near + "?"));
  }
  std::vector<ExportFormat> wanted;
  for (const ExportFormat& format : export_formats())
    if (std::find(words.begin(), words.end(), format.name) != words.end()) wanted.push_back(format);
  return wanted;
}

}  // namespace

void check_export_formats(const std::vector<std::string>& words) { formats_of(words); }

int export_command(const std::filesystem::path& folder, const ExportRequest& request,
                   std::ostream& out) {
  const std::vector<ExportFormat> formats = formats_of(request.formats);
  // Read before the folder is made: a run that cannot be exported leaves no empty export/ behind.
  // By its whole path, since the folder's name is the run's.
  const RunData data = read_run(std::filesystem::weakly_canonical(folder));
  for (const ExportFormat& format : formats)
    if (format.of_frames && data.frames.empty())
      throw RecordError(folder.string() +
                        ": has no recorded frames; vitreo run --frames top_camera records some");
  // In the run's own folder by default, where the manifest does not list it: an export is made anew
  // at any time, so it is no part of what `vitreo verify` vouches for.
  ExportFolder target(request.into.empty() ? folder / "export" : request.into, request.replace);
  try {
    for (const ExportFormat& format : formats) format.write(data, target);
  } catch (const RecordError&) {
    throw;
  } catch (const std::runtime_error& error) {
    // The writers know the staging folder; the reader of the message knows the export's.
    throw std::runtime_error(target.renamed(error.what()));
  }
  nlohmann::json names = nlohmann::json::array();
  for (const std::filesystem::path& file : target.publish()) {
    names.push_back(file.string());
    if (!request.json) out << file.string() << "\n";
  }
  if (request.json)
    out << dumped({{"run", data.folder.filename().string()}, {"files", names}}) << "\n";
  return 0;
}

}  // namespace vitreo
