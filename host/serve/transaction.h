// Transaction: changes of a database that are made together or not at all.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/files/sqlite.h"

namespace vitreo::serve {

/// Rolled back unless it was finished. IMMEDIATE: the lock for writing is taken at once, since
/// SQLite does not wait where a transaction that has read begins to write.
class Transaction {
 public:
  explicit Transaction(Database& database) : database_(database) {
    database_.execute("BEGIN IMMEDIATE");
  }
  ~Transaction() {
    if (finished_) return;
    try {
      database_.execute("ROLLBACK");
    } catch (const DatabaseError&) {  // SQLite has done it
    }
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void finish() {
    database_.execute("COMMIT");
    finished_ = true;
  }

 private:
  Database& database_;
  bool finished_ = false;
};

}  // namespace vitreo::serve
