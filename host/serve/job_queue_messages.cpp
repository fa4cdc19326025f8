// The messages in the job queue: kept until their channel took them.
// SPDX-License-Identifier: Apache-2.0
#include "host/serve/job_queue.h"
#include "host/serve/transaction.h"

namespace vitreo::serve {
namespace {

constexpr const char* kMessageColumns =
    "id, job, channel, subject, text, tries, next, added, told, error";

// In the order of kMessageColumns.
Message message_of(const Statement& row) {
  return {row.integer(0), row.integer(1), row.text(2),
          row.text(3),    row.text(4),    static_cast<int>(row.integer(5)),
          row.integer(6), row.integer(7), row.integer(8),
          row.text(9)};
}

}  // namespace

// Of a transaction of the caller's.
void JobQueue::insert(const std::vector<Message>& messages) {
  for (const Message& one : messages)
    database_
        .prepare(
            "INSERT INTO message(job, channel, subject, text, next, added) VALUES(?, ?, ?, "
            "?, ?, ?)")
        .bind(1, one.job)
        .bind(2, one.channel)
        .bind(3, one.subject)
        .bind(4, one.text)
        .bind(5, one.added)
        .bind(6, one.added)
        .run();
}

// All or none: a person is not told by mail of what the webhook never learns.
void JobQueue::add_messages(const std::vector<Message>& messages) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  insert(messages);
  transaction.finish();
  ++changes_;
}

// In the order in which they were made: an alarm is told before the end that it led to.
std::vector<Message> JobQueue::due_messages(std::int64_t now) const {
  const std::lock_guard lock(mutex_);
  Statement rows = database_.prepare(std::string("SELECT ") + kMessageColumns +
                                     " FROM message WHERE told = 0 AND next <= ? ORDER BY id");
  rows.bind(1, now);
  std::vector<Message> found;
  while (rows.step()) found.push_back(message_of(rows));
  return found;
}

// A kill between the channel taking it and this makes it be told twice, never not at all.
void JobQueue::told(std::int64_t message, std::int64_t now) {
  const std::lock_guard lock(mutex_);
  database_.prepare("UPDATE message SET told = ?, tries = tries + 1, error = '' WHERE id = ?")
      .bind(1, now)
      .bind(2, message)
      .run();
  ++changes_;
}

// The error stays with the message: the page shows why nothing came.
void JobQueue::failed(std::int64_t message, std::int64_t next, const std::string& error) {
  const std::lock_guard lock(mutex_);
  database_.prepare("UPDATE message SET next = ?, tries = tries + 1, error = ? WHERE id = ?")
      .bind(1, next)
      .bind(2, error)
      .bind(3, message)
      .run();
  ++changes_;
}

std::vector<Message> JobQueue::messages(std::size_t most) const {
  const std::lock_guard lock(mutex_);
  Statement rows = database_.prepare(std::string("SELECT ") + kMessageColumns +
                                     " FROM message ORDER BY id DESC LIMIT ?");
  rows.bind(1, static_cast<std::int64_t>(most));
  std::vector<Message> found;
  while (rows.step()) found.push_back(message_of(rows));
  return found;
}

// Without the channel, whose address may be a secret: channel_text() says what may be shown of it.
nlohmann::json to_json(const Message& message) {
  return {{"job", message.job},     {"channel", message.channel}, {"subject", message.subject},
          {"text", message.text},   {"added", message.added},     {"told", message.told},
          {"tries", message.tries}, {"error", message.error}};
}

}  // namespace vitreo::serve
