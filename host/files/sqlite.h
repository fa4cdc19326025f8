// Owners of SQLite databases and statements: released by scope, errors name the file.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sqlite3.h>

#include <cstdint>
#include <memory>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <vector>

namespace vitreo {

/// `"name"`, safe as a table's or column's name. Throws std::invalid_argument for an empty one or
/// one with a NUL byte.
std::string quoted_identifier(std::string_view name);

/// An error of SQLite's; the text names the file.
class DatabaseError : public std::runtime_error {
 public:
  DatabaseError(const std::string& what, int code) : std::runtime_error(what), code_(code) {}
  int code() const { return code_; }
  /// The file is not what was expected: damaged, no database, or with other tables. Not: locked, no
  /// room, no right, an error of the disk.
  bool damaged() const;

 private:
  int code_;
};

/// A prepared statement. Bindings count from 1; text is copied. Errors throw DatabaseError.
class Statement {
 public:
  Statement(sqlite3* database, const std::string& sql);
  Statement& bind(int index, std::int64_t value);
  Statement& bind(int index, double value);  // a NaN becomes NULL, as SQLite has it
  Statement& bind(int index, std::string_view text);
  Statement& bind(int index, std::span<const std::uint8_t> bytes);  // a BLOB, copied
  Statement& bind_null(int index);
  /// Runs to the next row; false at the end, and the statement is ready again.
  bool step();
  /// Runs it once, for statements without rows.
  void run();
  std::int64_t integer(int column) const { return sqlite3_column_int64(handle_.get(), column); }
  double real(int column) const { return sqlite3_column_double(handle_.get(), column); }
  bool is_null(int column) const {
    return sqlite3_column_type(handle_.get(), column) == SQLITE_NULL;
  }
  std::string text(int column) const;
  std::vector<std::uint8_t> bytes(int column) const;

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  std::unique_ptr<sqlite3_stmt, Finalize> handle_;
};

class Database {
 public:
  enum class Mode { create, read_write, read_only };
  Database(const std::string& file, Mode mode);
  void execute(const std::string& sql);
  Statement prepare(const std::string& sql) { return {handle_.get(), sql}; }
  /// Writes everything into the one file; throws DatabaseError when something still uses the
  /// database.
  void close();

 private:
  struct Close {
    void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
  };
  std::unique_ptr<sqlite3, Close> handle_;
};

}  // namespace vitreo
