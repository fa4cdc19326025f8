// Commands `vitreo verify RUN`, `vitreo recover RUN`, `vitreo report RUN`.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/record/record_json.h"
#include "host/runs/run_care.h"

#include <fmt/format.h>

#include <ostream>

namespace vitreo {

// The problems come first and the verdict last, so that the verdict is the line that stays in view
// on a terminal.
int verify_command(const std::filesystem::path& folder, bool json, std::ostream& out) {
  const RunCheck verdict = verify_run(folder);
  const bool whole = verdict.problems.empty();
  if (json) {
    out << dumped({{"run", folder.filename().string()},
                   {"whole", whole},
                   {"problems", verdict.problems},
                   {"files", verdict.files},
                   {"samples", verdict.samples},
                   {"frames", verdict.frames}})
        << "\n";
  } else {
    for (const std::string& problem : verdict.problems) out << problem << "\n";
    out << fmt::format("{}: {} ({} files, {} samples, {} frames)\n", folder.string(),
                       whole ? "whole" : fmt::format("{} problems", verdict.problems.size()),
                       verdict.files, verdict.samples, verdict.frames);
  }
  return whole ? 0 : 1;
}

// Success, 0, also where the run had its end record: recovery is idempotent, and a second call is
// no mistake.
int recover_command(const std::filesystem::path& folder, bool json, std::ostream& out) {
  const Recovery recovery = recover_run(folder);
  if (json) {
    out << dumped({{"run", folder.filename().string()},
                   {"was_closed", recovery.was_closed},
                   {"frames_named", recovery.frames_named}})
        << "\n";
  } else {
    out << folder.string() << ": "
        << (recovery.was_closed
                ? "had its end record; its other files are made anew"
                : fmt::format("ended as lost; {} frames got their rows", recovery.frames_named))
        << "\n";
  }
  return 0;
}

// The path is all that is printed, so that it can be given to another program: a browser, say.
int report_command(const std::filesystem::path& folder, bool json, std::ostream& out) {
  report_run(folder);
  const std::string report = (folder / "report.html").string();
  out << (json ? dumped({{"report", report}}) : report) << "\n";
  return 0;
}

}  // namespace vitreo
