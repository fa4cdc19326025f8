// Command words about recorded runs (docs/records.md); commands.h has what they do.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/commands.h"
#include "host/cli/program.h"
#include "host/config/config.h"
#include "host/runs/export.h"
#include "host/runs/report_files.h"
#include "host/runs/run_reader.h"

#include <iostream>

namespace vitreo::cli {
namespace {

// One set of variables for all commands about records: a line has one command, so the others keep
// their defaults.
struct RecordWords {
  std::string run = "last";
  std::string parent = "runs";
  std::string into;
  std::vector<std::string> formats;
  std::string csv;
  std::string plots;
  RunFilter filter;
  bool json = false;
  bool as_csv = false;
  bool png = false;
  bool links = false;
  bool replace = false;
  std::string role;
  // When the action runs, not while the line is parsed: --runs may stand behind the run's name.
  std::filesystem::path folder() const { return find_run(run, parent); }
};

// Writes each plot of the report as a file of its own, for a paper: the report has them inside
// HTML.
int plots(const RecordWords& wanted) {
  nlohmann::json files = nlohmann::json::array();
  const PlotFiles kind = wanted.png ? PlotFiles::png : PlotFiles::svg;
  for (const auto& file : write_plots(read_run(wanted.folder()), wanted.plots, kind))
    files.push_back(file.string());
  if (wanted.json) std::cout << files.dump() << "\n";
  for (const auto& file : files)
    if (!wanted.json) std::cout << file.get<std::string>() << "\n";
  return 0;
}

}  // namespace

void add_records(CommandLine& line, Program& program) {
  const auto wanted = std::make_shared<RecordWords>();
  const auto add = [&line, wanted](const std::string& name, const std::string& help,
                                   CommandLine::Action action) {
    Command command = line.command(name, help, std::move(action));
    command.option("--runs", wanted->parent, "the folder in which the runs are (default: runs)");
    command.flag("--json", wanted->json, "one JSON document, SI units");
    return command;
  };
  const auto add_one = [&add, wanted](const std::string& name, const std::string& help,
                                      CommandLine::Action action) {
    Command command = add(name, help, std::move(action));
    command.option("run", wanted->run, "a run's folder, its name or the beginning of it, or last")
        .required();
    return command;
  };
  const RecordWords& w = *wanted;  // kept by the actions' own copy of the pointer
  Command runs = add("runs", "the recorded runs, newest last", [wanted, &w] {
    if (w.json && w.as_csv) throw ConfigError("--json, --as-csv: one of them");
    const ListFormat format = w.json     ? ListFormat::json
                              : w.as_csv ? ListFormat::csv
                                         : ListFormat::text;
    return list_runs(w.parent, w.filter, format, std::cout);
  });
  runs.option("--where", wanted->filter.where,
              "only those that fulfil this, such as 'speed > 0.3mm/s and path_error_rms < 150um'");
  runs.option("--columns", wanted->filter.columns,
              "also these parameters, results, tags and sample fields: speed,tag.batch,sample.eye")
      .delimiter(',');
  runs.option("--sort", wanted->filter.sort, "by these, the largest first: --sort=-path_error_rms")
      .delimiter(',');
  runs.flag("--as-csv", wanted->as_csv, "as CSV, numbers in SI units, which the head names");
  runs.option("--protocol", wanted->filter.protocol, "only those with this in protocol or title");
  runs.option("--operator", wanted->filter.operator_name,
              "only those with this in the operator's name");
  runs.option("--outcome", wanted->filter.state,
              "only completed, failed, stopped, aborted, lost, running or unreadable");
  runs.option("--since", wanted->filter.since,
              "only from this time on: 2026-11-21, 2026-11-21T14:30");
  runs.option("--newest", wanted->filter.newest, "only so many").between(1, 1000000);
  runs.examples({"vitreo runs --protocol servo_square --newest 5",
                 "vitreo runs --outcome failed --json",
                 "vitreo runs --where 'speed > 0.3mm/s and path_error_rms < 150um' --columns speed",
                 "vitreo runs --where 'tag.batch = a1 or text ~ gel' --sort=-path_error_rms"});
  Command shown =
      add_one("show", "what a run was asked, what came out, what is recorded", [wanted, &w] {
        return w.links ? show_links(w.folder(), w.role, w.json, std::cout)
                       : show_run(w.folder(), w.json, std::cout);
      });
  shown.flag("--links", wanted->links,
             "instead: what passed between the host and its instruments, of a run with "
             "--trace-links");
  shown.option("--role", wanted->role, "with --links: of this role alone").needs("--links");
  shown.examples({"vitreo show last", "vitreo show last --links --role stage"});
  add_one("verify", "whether a run's record is whole: hashes, counts, every frame", [wanted, &w] {
    return verify_command(w.folder(), w.json, std::cout);
  }).examples({"vitreo verify last"});
  add_one("recover", "ends the record of a run whose program died", [wanted, &w] {
    return recover_command(w.folder(), w.json, std::cout);
  }).examples({"vitreo recover 2026-11-21T1830"});
  Command report = add_one("report", "makes a run's report anew from its record", [wanted, &w] {
    if (w.plots.empty() && w.png)
      throw ConfigError("--png: says how --plots writes, which wants a folder");
    return w.plots.empty() ? report_command(w.folder(), w.json, std::cout) : plots(w);
  });
  report.option("--plots", wanted->plots,
                "a folder: writes each plot there as an SVG file instead");
  report.flag("--png", wanted->png,
              "with --plots: PNG files, by the program rsvg-convert (Debian: librsvg2-bin)");
  report.examples({"vitreo report last", "vitreo report last --plots figures",
                   "vitreo report last --plots figures --png"});
  Command exported = add_one("export", "a run in the formats of other programs", [wanted, &w] {
    check_export_formats(w.formats);  // before a run is looked for
    return export_command(w.folder(), {w.formats, w.into, w.replace, w.json}, std::cout);
  });
  exported.option("--as", wanted->formats, "formats, with commas: csv,mcap,tiff,ome,mkv,hdf5")
      .one_word_each()
      .delimiter(',');
  std::vector<std::pair<std::string, std::string>> formats;
  for (const ExportFormat& format : export_formats())
    formats.emplace_back(format.name, "--as " + format.name + ": " + format.help);
  exported.flags(formats, wanted->formats);
  exported.option("--into", wanted->into, "a folder (default: export/ in the run's own)");
  exported.flag("--replace", wanted->replace, "instead of files that are there already");
  exported.examples({"vitreo export last --as csv", "vitreo export last --as mcap,mkv,ome",
                     "vitreo export last --mcap --into /tmp/shared"});
  Command replayed =
      add_one("replay", "the recorded frames through today's tracker and localizer",
              [&program, wanted, &w] {
                return replay_command(program.engine(), w.folder(), w.csv, w.json, std::cout);
              });
  replayed.option("--csv", wanted->csv, "a file for the differences frame by frame");
  replayed.examples({"vitreo replay last --csv differences.csv"});
}

}  // namespace vitreo::cli
