// Commands about closed runs: `vitreo runs`, `show`, `verify`, `recover`, `report`, `export` and
// `replay`. Each prints to `out` and returns the program's exit code; RecordError
// and std::runtime_error leave it with a message. `json`: one JSON document, SI units.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <iosfwd>
#include <string>
#include <vector>

namespace vitreo {

class ScriptEngine;

struct RunFilter {
  std::string protocol;              // a part of the protocol's file or title
  std::string operator_name;         // a part of the name
  std::string state;                 // "completed", "lost", ...
  std::string since;                 // "2026-11-21", "2026-11-21T14:30": the beginning of a time
  int newest = 0;                    // only so many; 0: all
  std::string where;                 // an expression: host/runs/run_query.h
  std::vector<std::string> columns;  // names of values beside the usual ones
  std::vector<std::string> sort;     // names of values, with "-" before one: the largest first
};

enum class ListFormat { text, json, csv };

int list_runs(const std::filesystem::path& parent, const RunFilter& filter, ListFormat format,
              std::ostream& out);
int show_run(const std::filesystem::path& folder, bool json, std::ostream& out);
/// What passed on the links of a run that was traced; `role`: of that role alone, empty: of all.
/// Throws RecordError where there is none.
int show_links(const std::filesystem::path& folder, const std::string& role, bool json,
               std::ostream& out);
/// 0: whole; 1: problems, which are listed.
int verify_command(const std::filesystem::path& folder, bool json, std::ostream& out);
int recover_command(const std::filesystem::path& folder, bool json, std::ostream& out);
int report_command(const std::filesystem::path& folder, bool json, std::ostream& out);

struct ExportRequest {
  std::vector<std::string> formats;  // of export_formats(), once or more
  std::filesystem::path into;        // a folder; empty: export/ in the run's own
  bool replace = false;              // what is there already
  bool json = false;
};
/// Throws ConfigError for no format, and for one that there is not.
void check_export_formats(const std::vector<std::string>& words);
/// All of the formats or, after an error, none of them.
int export_command(const std::filesystem::path& folder, const ExportRequest& request,
                   std::ostream& out);

/// The recorded frames through today's tracker and localizer. `csv`: a file for the differences
/// frame by frame; may be empty. 0: replayed, whatever the differences.
int replay_command(ScriptEngine& engine, const std::filesystem::path& folder,
                   const std::filesystem::path& csv, bool json, std::ostream& out);

}  // namespace vitreo
