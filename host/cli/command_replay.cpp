// `vitreo replay RUN`: the recorded frames through today's tracker and localizer, and the
// difference from then.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/commands.h"
#include "host/cli/program.h"
#include "host/cli/replay.h"
#include "host/engine/installed_calibration.h"
#include "host/files/run_folder.h"
#include "host/record/record_json.h"
#include "host/rig/measured_chain.h"
#include "host/rig/rig_settings.h"
#include "host/runs/run_reader.h"
#include "host/session/script_engine.h"
#include "host/text/columns.h"

#include <fmt/format.h>

#include <cstdlib>
#include <filesystem>
#include <ostream>

namespace vitreo {
namespace {

// "" where the key is missing or no text: records of other versions are read too.
std::string text_of(const nlohmann::json& table, const char* key) {
  const auto found = table.is_object() ? table.find(key) : table.end();
  return found != table.end() && found->is_string() ? found->get<std::string>() : "";
}

/// The record's files of instruments, for a moment on this machine's disk.
class RecordedInstruments {
 public:
  /// Every role whose driver is one of them gets it from there.
  RecordedInstruments(const nlohmann::json& rig, RigDescription& description) {
    const nlohmann::json files = rig.value("instruments", nlohmann::json::array());
    if (files.empty()) return;
    std::string name =
        (std::filesystem::temp_directory_path() / "vitreo_instruments_XXXXXX").string();
    if (mkdtemp(name.data()) == nullptr) throw RecordError(name + ": cannot be made");
    folder_ = name;
    for (std::size_t i = 0; i < files.size(); ++i) {
      const std::filesystem::path file = text_of(files[i], "file");
      const std::string here = (folder_ / std::to_string(i)).string() + ".lua";
      write_file(here, text_of(files[i], "text"));
      for (auto& [role, value] : description.table)
        if (auto* const table = std::get_if<ConfigTable>(&value.value))
          if (const std::string driver = text_of(*table, "driver");
              !driver.empty() && (file.stem() == driver ||
                                  file.filename() == std::filesystem::path(driver).filename()))
            table->at("driver").value = here;
    }
  }
  ~RecordedInstruments() {
    std::error_code error;
    if (!folder_.empty()) std::filesystem::remove_all(folder_, error);
  }
  RecordedInstruments(const RecordedInstruments&) = delete;
  RecordedInstruments& operator=(const RecordedInstruments&) = delete;

 private:
  std::filesystem::path folder_;
};

/// A file of the record on this machine, for what stands beside it: records name files without the
/// machine's folders (host/record/portable_paths.h). From the present folder, the home, or the
/// program's own.
std::string file_here(const std::string& file) {
  std::error_code error;
  if (std::filesystem::exists(file, error)) return file;
  const char* const home = std::getenv("HOME");
  if (file.starts_with("~/") && home != nullptr) return home + file.substr(1);
  const std::string own = cli::Program::in_data_folder(file);
  return std::filesystem::exists(own, error) ? own : file;
}

/// The nominal model as the rig file of the run describes it; no instrument is opened.
/// The rig is read from the texts in the record, not from today's files, and the calibration from
/// what was in force then: the replay varies the program alone. The projection is fitted anew, as
/// when a rig is opened (host/rig/open_rig.cpp): the record has the settings, not what is computed
/// from them.
RigModel model_of(ScriptEngine& engine, const RunData& data) {
  const nlohmann::json& rig = data.start.rig;
  if (!rig.is_object() || !rig.contains("text") || !rig["text"].is_string())
    throw RecordError(data.folder.string() + ": its start record has no rig file");
  const auto source = [](const nlohmann::json& one) -> RigSource {
    return {file_here(text_of(one, "file")), text_of(one, "text")};
  };
  std::vector<RigSource> bases;
  for (const nlohmann::json& base : rig.value("bases", nlohmann::json::array()))
    bases.push_back(source(base));
  RigDescription description = engine.recorded_rig(source(rig), bases);
  const RecordedInstruments instruments(rig, description);
  take_recorded_calibration(description, rig.value("resolved", nlohmann::json()));
  ConfigReader reader(description);
  const RigSettings settings = read_rig_settings(reader);
  RigModel model = settings.model;
  // Its warnings were the run's.
  std::vector<std::string> warnings;
  if (const std::string chain = text_of(rig, "chain"); !chain.empty())
    if (auto measured = read_measured_chain(chain, model, warnings))
      use_measured_chain(model, std::move(measured));
  model.projection =
      optics::fit_single_viewpoint(model.eye, model.microscope, settings.projection_reach);
  if (settings.exact_projection)
    model.exact.emplace(model.eye, model.microscope, settings.projection_reach);
  return model;
}

/// Three cells, m; empty where the robot was not seen.
std::string position_text(const std::optional<Eigen::Vector3d>& position) {
  return position ? fmt::format("{},{},{}", position->x(), position->y(), position->z()) : ",,";
}

// CRLF and commas are RFC 4180's. An empty cell is "not seen", which a spreadsheet does not plot; a
// 0 would be a position.
std::string csv_of(const Replay& replayed) {
  std::string text =
      "number,t_ns,recorded_x (m),recorded_y (m),recorded_z (m),"
      "replayed_x (m),replayed_y (m),replayed_z (m),distance (m)\r\n";
  for (const ReplayedFrame& frame : replayed.frames) {
    const bool both = frame.recorded && frame.replayed;
    text += fmt::format("{},{},{},{},{}\r\n", frame.number, frame.exposed.count(),
                        position_text(frame.recorded), position_text(frame.replayed),
                        both ? fmt::format("{}", (*frame.replayed - *frame.recorded).norm()) : "");
  }
  return text;
}

}  // namespace

// Two runs of the same program on the same machine agree to the bit, so `same` below `compared`
// means that the tracker, the localizer or the compiler has changed since.
int replay_command(ScriptEngine& engine, const std::filesystem::path& folder,
                   const std::filesystem::path& csv, bool json, std::ostream& out) {
  const RunData data = read_run(folder);
  const Replay replayed = replay(data, model_of(engine, data));
  const ReplayStatistics s = replayed.statistics();
  if (!csv.empty()) write_file(csv, csv_of(replayed));
  if (json) {
    out << dumped({{"run", folder.filename().string()},
                   {"frames", s.frames},
                   {"background_frames", replayed.background_frames},
                   {"axis_known", replayed.axis_known},
                   {"compared", s.compared},
                   {"same", s.same},
                   {"only_recorded", s.only_recorded},
                   {"only_replayed", s.only_replayed},
                   {"rms", s.rms},
                   {"mean", s.mean},
                   {"max", s.max}})
        << "\n";
    return 0;
  }
  out << fmt::format("{}: {} frames of the servo loop, background of {} frames\n", folder.string(),
                     s.frames, replayed.background_frames);
  if (!replayed.axis_known) out << "the record does not name the robot's axis: +x is taken\n";
  out << fmt::format("seen then and now: {}, of which {} to the bit; only then: {}; only now: {}\n",
                     s.compared, s.same, s.only_recorded, s.only_replayed);
  const ShownColumn difference = show_column({s.rms, s.mean, s.max}, "m");
  out << fmt::format("difference: rms {0} {3}, mean {1} {3}, largest {2} {3}\n",
                     difference.numbers[0], difference.numbers[1], difference.numbers[2],
                     difference.unit);
  if (!csv.empty()) out << "frame by frame: " << csv.string() << "\n";
  return 0;
}

}  // namespace vitreo
