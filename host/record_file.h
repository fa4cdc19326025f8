// run.sqlite: the tables of a run (docs: facts B2), one writer. WAL while it grows, one plain file once closed.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/recorder.h"
#include "host/sqlite.h"

#include <chrono>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

namespace vitreo {

/// Errors throw std::runtime_error naming the file. What was given is committed after 100 ms or 1000 rows, at the next
/// call then; events, start and end at once.
class RecordFile {
 public:
  /// Creates the file with the start record, on the disk when this returns.
  RecordFile(const std::filesystem::path& file, const RunStart& start);

  void add_stream(const StreamInfo& info);
  /// `row` counts from 0; the table's seq is one more.
  void sample(std::size_t stream, std::size_t row, Time time, std::span<const double> values);
  void event(const Event& event);
  void figure(const Figure& figure);
  void table(const Table& table);
  void picture(const Picture& picture, const std::string& file);
  /// The end record, on the disk when this returns. Rows that a failed commit took along are written again from
  /// `streams`; where that fails too the end record still stands, and the error is thrown after.
  void end(const RunEnd& end, const std::vector<Stream>& streams);
  void close();

 private:
  void create_tables();
  void write_start(const RunStart& start);
  void write_again(const std::vector<Stream>& streams);
  void write_end(const RunEnd& end, const std::vector<Stream>& streams);
  void begin();
  void row_written();
  void commit();
  void abandon();

  Database database_;
  std::vector<Statement> inserts_;  // one a stream
  bool in_transaction_ = false, lost_rows_ = false;
  int pending_ = 0;
  std::chrono::steady_clock::time_point begun_;
};

}  // namespace vitreo
