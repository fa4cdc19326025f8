// Catalog of a folder's runs: their heads with parameters, results, tags and sample, by an index in
// SQLite that is made anew from the folders at any time. docs/records.md has its tables, which the
// Python package shares.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/files/sqlite.h"
#include "host/runs/run_query.h"
#include "host/runs/run_reader.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace vitreo {

/// SQLite's user_version of the index; python/vitreo/catalog.py has the same layout.
inline constexpr int kCatalogLayout = 2;

/// A value of a run under a name.
struct CatalogValue {
  std::optional<double> number;  // SI
  std::string text;              // "" for a number
  std::string unit;              // SI
};

struct CatalogRequest {
  std::string where;                 // see translate_query(); empty: all
  std::vector<std::string> columns;  // names as in a query
  std::vector<std::string> sort;     // names, with "-" before one: the largest first
  std::size_t newest = 0;            // so many of them; 0: all
};

struct CatalogRow {
  RunHead head;
  std::vector<std::optional<CatalogValue>> columns;  // as requested
};

class Catalog {
 public:
  /// Brings the index up to date: closed runs whose run.sqlite has another inode, size or time of
  /// change than the index knows are read, those that go on or cannot be read each time. An index
  /// that is locked, damaged, of another program, or that the disk has no room for costs time only.
  /// `index`: its file; empty: file_of(parent). Throws RecordError where `parent` cannot be listed.
  explicit Catalog(const std::filesystem::path& parent, std::filesystem::path index = {});

  /// Oldest first, unless the request sorts. `also`: another condition that is to hold; empty:
  /// none. Throws ConfigError for what is wrong in the request.
  std::vector<CatalogRow> find(const CatalogRequest& request, const std::string& also = "");

  /// In $XDG_CACHE_HOME/vitreo (~/.cache/vitreo), a name made of the folder's; empty where there is
  /// no home.
  static std::filesystem::path file_of(const std::filesystem::path& parent);
  /// Of the runs that were read from their folders, not from the index.
  std::size_t read() const { return read_; }

 private:
  struct Fresh;
  struct Changes;
  struct Found;
  struct SortKey;
  void open(const std::filesystem::path& index);
  void prepare();
  void update();
  void keep(Changes& changes);
  std::vector<KnownValue> known_values(const std::string& name, char kind);
  Vocabulary vocabulary();
  RunHead head_of(const Statement& row) const;
  std::vector<std::optional<CatalogValue>> cells_of(const QueryName& column,
                                                    const std::vector<Found>& found);
  std::vector<CatalogRow> sorted(std::vector<Found> found, const std::vector<SortKey>& keys);

  std::filesystem::path parent_;
  std::optional<Database> database_;
  bool in_memory_ = false;
  std::size_t read_ = 0;
};

}  // namespace vitreo
