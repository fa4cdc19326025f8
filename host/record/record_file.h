// Record file: run.sqlite with the tables of a run, one writer. In SQLite's write-ahead log (WAL)
// mode while it grows, one plain file once closed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/files/sqlite.h"
#include "host/record/run_data.h"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// Errors throw std::runtime_error naming the file. What was given is committed after 1000 rows, or
/// 100 ms where commit_if_due() is called; events, start and end at once.
class RecordFile {
 public:
  /// Creates the file with the start record, on the disk when this returns.
  RecordFile(const std::filesystem::path& file, const RunStart& start);

  void add_stream(const StreamInfo& info);
  /// `row` counts from 0; the table's seq is one more.
  void sample(std::size_t stream, std::size_t row, Time time, std::span<const double> values);
  // Everything below counts from 0 too, and what is there already under that number stays.
  /// Committed at once; an alarm is on the disk when this returns.
  void event(std::size_t number, const Event& event);
  void result(const StatedResult& result);
  void plot(std::size_t number, const Plot& plot);
  void drawing(std::size_t number, const SvgDrawing& drawing);
  void table(std::size_t number, const Table& table);
  void picture(std::size_t number, const Picture& picture);
  /// Tags and sample as they are from now on.
  void labels(const nlohmann::json& tags, const nlohmann::json& sample);
  void module(const Module& module);
  void link(std::size_t number, const LinkRow& row);
  void camera(const RecordedCameraInfo& info);
  void frame(std::size_t number, const FrameRow& row);
  /// Commits what has waited for 100 ms, and waits for the disk where commits did for 400 ms: at a
  /// power cut nothing is lost that is a second old.
  void commit_if_due();
  void commit();
  /// The end record, on the disk when this returns. Unless all is `whole`, what a failed commit
  /// took along is written again from `data` and `frames`; where that fails too the end record
  /// still stands, and the error is thrown after.
  void end(const RunEnd& end, const RunData& data, const std::vector<FrameRow>& frames, bool whole);
  /// Leaves one file, unless another program reads it right now: then a later opening does.
  void close();
  std::uint64_t bytes() const { return bytes_; }  // written so far, about

 private:
  void write_meanings();
  void write_start(const RunStart& start);
  void write_again(const RunData& data, const std::vector<FrameRow>& frames);
  void write_end(const RunEnd& end, const RunData& data);
  void begin();
  template <class Row>
  void write(Row row);
  void row_written();
  void abandon();
  void sync();

  std::filesystem::path wal_;  // where commits go first
  Database database_;
  std::vector<Statement> inserts_;        // one a stream
  std::vector<std::size_t> widths_;       // its channels
  std::optional<Statement> link_insert_;  // with the first row, and its table
  bool in_transaction_ = false;
  bool lost_rows_ = false;
  bool unsynced_ = false;  // a commit may not be on the disk yet
  int pending_ = 0;
  std::uint64_t bytes_ = 0;
  std::chrono::steady_clock::time_point begun_;
  std::chrono::steady_clock::time_point unsynced_since_;
};

}  // namespace vitreo
