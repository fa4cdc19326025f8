// A made-up servo run for the tests of the record and the report: small, seeded, and with something
// of everything.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/record/recorder.h"
#include "host/runs/report.h"

#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>

namespace vitreo::test {

/// A new folder that goes when it does.
class TemporaryFolder {
 public:
  TemporaryFolder();
  ~TemporaryFolder();
  TemporaryFolder(const TemporaryFolder&) = delete;
  TemporaryFolder& operator=(const TemporaryFolder&) = delete;
  const std::filesystem::path& path() const { return path_; }

 private:
  std::filesystem::path path_;
};

inline std::string read_file(const std::filesystem::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// What a run of servo_square is asked.
RunStart servo_start();

/// A minute at 15 Hz: streams "truth" and "servo", currents, plots, pictures, tables, results,
/// events. Not finished.
void record_servo_run(Recorder& recorder);

/// A recorder whose runs end with a report, as the engine's do.
class ReportedRecorder : public Recorder {
 public:
  explicit ReportedRecorder(const std::filesystem::path& parent, const RunStart& start,
                            const RecordLimits& limits = {})
      : Recorder(parent, start, limits) {
    set_report([](const RunData& data) { return report_html(data); });
  }
};

/// Whether a text is balanced markup: every element closed, attributes quoted, entities known.
/// `what` says what is not.
bool well_formed(const std::string& markup, std::string* what);

}  // namespace vitreo::test
