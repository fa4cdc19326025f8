// SPDX-License-Identifier: Apache-2.0
#include "host/files/sqlite.h"

#include <stdexcept>

namespace vitreo {
namespace {

// The message belongs to the last call on this connection: it is asked before anything else is done
// with it.
[[noreturn]] void fail(sqlite3* database) {
  const char* file = database ? sqlite3_db_filename(database, "main") : nullptr;
  const char* reason = database ? sqlite3_errmsg(database) : "out of memory";
  throw DatabaseError(std::string(file ? file : "SQLite") + ": " + reason,
                      database ? sqlite3_errcode(database) : SQLITE_NOMEM);
}

}  // namespace

// SQLITE_ERROR is that of a statement for which the file has no table.
bool DatabaseError::damaged() const {
  const int primary = code_ & 0xFF;  // extended codes keep it in the low byte
  return primary == SQLITE_CORRUPT || primary == SQLITE_NOTADB || primary == SQLITE_ERROR ||
         primary == SQLITE_FORMAT || primary == SQLITE_SCHEMA || primary == SQLITE_MISMATCH;
}

// SQL's double quotes, inner ones doubled; SQLite would end the name at a NUL.
std::string quoted_identifier(std::string_view name) {
  if (name.empty()) throw std::invalid_argument("a name is empty");
  if (name.find('\0') != std::string_view::npos)
    throw std::invalid_argument("a name has a NUL byte");
  std::string quoted = "\"";
  for (char c : name) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

// sqlite3_prepare_v2 and not _prepare: its statements give the true error from step() at once, and
// are compiled anew by themselves after the schema has changed.
Statement::Statement(sqlite3* database, const std::string& sql) {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr) != SQLITE_OK)
    fail(database);
  handle_.reset(statement);
}

Statement& Statement::bind(int index, std::int64_t value) {
  if (sqlite3_bind_int64(handle_.get(), index, value) != SQLITE_OK)
    fail(sqlite3_db_handle(handle_.get()));
  return *this;
}

Statement& Statement::bind(int index, double value) {
  if (sqlite3_bind_double(handle_.get(), index, value) != SQLITE_OK)
    fail(sqlite3_db_handle(handle_.get()));
  return *this;
}

// SQLITE_TRANSIENT: SQLite copies the text at once, since the view may be gone before step().
Statement& Statement::bind(int index, std::string_view text) {
  const auto size = static_cast<sqlite3_uint64>(text.size());
  const char* data = text.empty() ? "" : text.data();  // a null pointer would bind NULL
  if (sqlite3_bind_text64(handle_.get(), index, data, size, SQLITE_TRANSIENT, SQLITE_UTF8) !=
      SQLITE_OK) {
    fail(sqlite3_db_handle(handle_.get()));
  }
  return *this;
}

Statement& Statement::bind(int index, std::span<const std::uint8_t> bytes) {
  const void* data = bytes.empty() ? static_cast<const void*>("") : bytes.data();  // null: NULL
  if (sqlite3_bind_blob64(handle_.get(), index, data, bytes.size(), SQLITE_TRANSIENT) != SQLITE_OK)
    fail(sqlite3_db_handle(handle_.get()));
  return *this;
}

Statement& Statement::bind_null(int index) {
  if (sqlite3_bind_null(handle_.get(), index) != SQLITE_OK) fail(sqlite3_db_handle(handle_.get()));
  return *this;
}

// Resets at the end and after an error, so that the statement can run again and holds no lock.
// Bindings survive the reset: an insert that runs again keeps what is not bound anew.
bool Statement::step() {
  const int result = sqlite3_step(handle_.get());
  if (result == SQLITE_ROW) return true;
  sqlite3* database = sqlite3_db_handle(handle_.get());
  if (result != SQLITE_DONE) {
    try {
      fail(database);  // first the message: a reset may change it
    } catch (...) {
      sqlite3_reset(handle_.get());
      throw;
    }
  }
  sqlite3_reset(handle_.get());
  return false;
}

void Statement::run() {
  while (step()) continue;
}

// In this order: sqlite3_column_text() may convert the value, and sqlite3_column_bytes() then gives
// the length of the converted one.
std::string Statement::text(int column) const {
  const auto* data = reinterpret_cast<const char*>(sqlite3_column_text(handle_.get(), column));
  return data ? std::string(data,
                            static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column)))
              : "";
}

std::vector<std::uint8_t> Statement::bytes(int column) const {
  const auto* data = static_cast<const std::uint8_t*>(sqlite3_column_blob(handle_.get(), column));
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(handle_.get(), column));
  return data != nullptr ? std::vector<std::uint8_t>(data, data + size)
                         : std::vector<std::uint8_t>();
}

// PRIVATECACHE whatever the process' default is: with a shared cache two connections of this
// process would lock each other's tables.
Database::Database(const std::string& file, Mode mode) {
  constexpr int kFlags[] = {SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE, SQLITE_OPEN_READWRITE,
                            SQLITE_OPEN_READONLY};
  const int flags = kFlags[static_cast<std::size_t>(mode)];
  sqlite3* database = nullptr;
  const int result =
      sqlite3_open_v2(file.c_str(), &database, flags | SQLITE_OPEN_PRIVATECACHE, nullptr);
  // Also after an error SQLite hands out a connection, and it must be closed.
  handle_.reset(database);
  if (result != SQLITE_OK) throw DatabaseError(file + ": " + sqlite3_errstr(result), result);
  // ms. In WAL mode readers never hold up a writer, but for its last checkpoint.
  sqlite3_busy_timeout(database, 250);
}

void Database::execute(const std::string& sql) {
  if (sqlite3_exec(handle_.get(), sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    fail(handle_.get());
}

// sqlite3_close refuses while statements are open, unlike the deleter's close: a leak is an error.
void Database::close() {
  if (handle_ && sqlite3_close(handle_.get()) != SQLITE_OK) fail(handle_.get());
  static_cast<void>(handle_.release());
}

}  // namespace vitreo
