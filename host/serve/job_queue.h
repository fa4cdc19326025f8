// Job queue: the jobs in their order, in a database that a power cut leaves whole.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "host/files/sqlite.h"
#include "host/serve/job.h"

#include <cstdint>
#include <filesystem>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

namespace vitreo::serve {

/// A message that is to be told through one channel, until that took it.
struct Message {
  std::int64_t id = 0;
  std::int64_t job = 0;
  std::string channel;     // its number in the settings, and its kind: "0 mail"
  std::string subject;     // one line
  std::string text;        // more lines
  int tries = 0;           // so far
  std::int64_t next = 0;   // of the next try, s since 1970
  std::int64_t added = 0;  // s since 1970
  std::int64_t told = 0;   // s since 1970; 0: not yet
  std::string error;       // of the last try
};

/// Any thread. What a function returned for is on the disk (SQLite, synchronous=FULL). Each change
/// counts in changes().
class JobQueue {
 public:
  static constexpr std::size_t kMostWaiting = 1000;

  /// Makes the file where there is none. Throws DatabaseError.
  explicit JobQueue(const std::filesystem::path& file);

  /// At the end, or before a job that waits. Returns its number, which is never used again. Throws
  /// ConfigError where too many wait, or `before` does not wait.
  std::int64_t add(const Job& job, std::optional<std::int64_t> before = {});
  /// Of those that wait. All four throw ConfigError for a job that does not wait (any more).
  void move(std::int64_t id, std::optional<std::int64_t> before);
  void remove(std::int64_t id);
  void set_request(std::int64_t id, const JobRequest& request);
  /// A person is there for it until then.
  void attend(std::int64_t id, std::int64_t until);
  void set_rehearsal(std::int64_t id, const nlohmann::json& rehearsal);

  void set_held(bool held, const std::string& why);
  bool held() const;
  std::string why_held() const;

  std::vector<Job> waiting() const;  // in their order
  std::optional<Job> running() const;
  /// Newest first.
  std::vector<Job> ended(std::size_t most) const;
  std::optional<Job> find(std::int64_t id) const;
  /// The first whose time has come, and that a person is there for where it needs one. Rehearsed
  /// ones only, unless a person is there.
  std::optional<Job> next(std::int64_t now) const;

  /// Written before its process is started: a job is never started twice.
  void begin(std::int64_t id, std::int64_t now);
  void set_process(std::int64_t id, int process);
  void set_run(std::int64_t id, const std::string& run);
  /// With the messages about it, in one transaction: no end is lost without having been told.
  void end(std::int64_t id, std::int64_t now, const std::string& outcome, const std::string& reason,
           const std::vector<Message>& messages);

  void add_messages(const std::vector<Message>& messages);
  /// Untold ones that are due.
  std::vector<Message> due_messages(std::int64_t now) const;
  void told(std::int64_t message, std::int64_t now);
  void failed(std::int64_t message, std::int64_t next, const std::string& error);
  /// The last ones, newest first.
  std::vector<Message> messages(std::size_t most) const;

  unsigned long changes() const;

 private:
  std::vector<Job> select(const std::string& condition, std::int64_t value, int most) const;
  void insert(const std::vector<Message>& messages);
  void require_waiting(std::int64_t id) const;
  double position_before(std::optional<std::int64_t> before) const;

  mutable std::mutex mutex_;
  mutable Database database_;
  unsigned long changes_ = 0;
};

nlohmann::json to_json(const Message& message);

}  // namespace vitreo::serve
