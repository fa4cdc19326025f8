// SPDX-License-Identifier: Apache-2.0
#include "host/serve/job_queue.h"

#include "host/config/config.h"
#include "host/serve/transaction.h"

#include <fmt/format.h>

namespace vitreo::serve {
namespace {

constexpr int kLayout = 1;  // user_version
// `position` orders those that wait; a job that is moved gets a number between its neighbours.
constexpr const char* kTables = R"(
CREATE TABLE IF NOT EXISTS job(id INTEGER PRIMARY KEY AUTOINCREMENT, position REAL, state INTEGER,
  request TEXT, title TEXT, added INTEGER, started INTEGER DEFAULT 0, ended INTEGER DEFAULT 0,
  process INTEGER DEFAULT 0, attended INTEGER DEFAULT 0, run TEXT DEFAULT '',
  outcome TEXT DEFAULT '', reason TEXT DEFAULT '', rehearsal TEXT DEFAULT 'null');
CREATE INDEX IF NOT EXISTS job_state ON job(state, position);
CREATE TABLE IF NOT EXISTS message(id INTEGER PRIMARY KEY AUTOINCREMENT, job INTEGER, channel TEXT,
  subject TEXT, text TEXT, tries INTEGER DEFAULT 0, next INTEGER, added INTEGER,
  told INTEGER DEFAULT 0, error TEXT DEFAULT '');
CREATE INDEX IF NOT EXISTS message_told ON message(told, next);
CREATE TABLE IF NOT EXISTS setting(name TEXT PRIMARY KEY, value TEXT);
)";
constexpr const char* kColumns =
    "id, state, request, title, added, started, ended, process, attended, run, outcome, reason, "
    "rehearsal";

Job job_of(const Statement& row) {
  Job job;
  job.id = row.integer(0);
  job.state = static_cast<JobState>(row.integer(1));
  job.request = request_of(nlohmann::json::parse(row.text(2)));
  job.title = row.text(3);
  job.added = row.integer(4);
  job.started = row.integer(5);
  job.ended = row.integer(6);
  job.process = static_cast<int>(row.integer(7));
  job.attended_until = row.integer(8);
  job.run = row.text(9);
  job.outcome = row.text(10);
  job.reason = row.text(11);
  job.rehearsal = nlohmann::json::parse(row.text(12));
  return job;
}

std::string dumped(const nlohmann::json& json) {
  return json.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace);
}

}  // namespace

// FULL: a commit is on the disk before it returns, also when the power goes.
JobQueue::JobQueue(const std::filesystem::path& file) : database_(file, Database::Mode::create) {
  database_.execute("PRAGMA journal_mode=WAL");
  database_.execute("PRAGMA synchronous=FULL");
  database_.execute("PRAGMA busy_timeout=5000");
  Statement version = database_.prepare("PRAGMA user_version");
  version.step();
  const std::int64_t layout = version.integer(0);
  version.step();
  // An older program must not sort the queue of a newer one by rules that it does not know.
  if (layout > kLayout)
    throw ConfigError(file.string() + ": is the queue of a newer program; start that one");
  database_.execute(kTables);
  database_.execute(fmt::format("PRAGMA user_version={}", kLayout));
}

// The condition is one of ours, with one value bound: no text of a request is part of an SQL text.
std::vector<Job> JobQueue::select(const std::string& condition, std::int64_t value,
                                  int most) const {
  Statement rows = database_.prepare(std::string("SELECT ") + kColumns + " FROM job WHERE " +
                                     condition + " LIMIT " + std::to_string(most));
  rows.bind(1, value);
  std::vector<Job> jobs;
  while (rows.step()) jobs.push_back(job_of(rows));
  return jobs;
}

// Within the lock, and within the transaction of the change that it allows: what waited a moment
// ago may run by now.
void JobQueue::require_waiting(std::int64_t id) const {
  const std::vector<Job> found = select("id = ?", id, 1);
  if (found.empty()) throw ConfigError(fmt::format("there is no job {}", id));
  if (found[0].state != JobState::waiting)
    throw ConfigError(
        fmt::format("job {} does not wait any more: it is {}", id, to_string(found[0].state)));
}

/// Between `before` and the one ahead of it; behind all others without `before`.
double JobQueue::position_before(std::optional<std::int64_t> before) const {
  // Of all jobs, ended ones too: a position is never smaller than one that was given before.
  if (!before) {
    Statement last = database_.prepare("SELECT coalesce(max(position), 0) FROM job");
    last.step();
    return last.real(0) + 1;
  }
  // Half way to the one ahead of it, or two less than the first where there is none.
  require_waiting(*before);
  Statement place = database_.prepare(
      "SELECT position, coalesce((SELECT max(position) FROM job AS ahead WHERE ahead.state = 0 AND "
      "ahead.position < job.position), job.position - 2) FROM job WHERE id = ?");
  place.bind(1, *before).step();
  return (place.real(0) + place.real(1)) / 2;
}

// Count, position and row in one transaction: two requests at once cannot both be the thousandth.
std::int64_t JobQueue::add(const Job& job, std::optional<std::int64_t> before) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  Statement count = database_.prepare("SELECT count(*) FROM job WHERE state = 0");
  count.step();
  if (count.integer(0) >= static_cast<std::int64_t>(kMostWaiting))
    throw ConfigError(fmt::format("{} jobs wait already; remove some first", kMostWaiting));
  const double position = position_before(before);
  database_
      .prepare(
          "INSERT INTO job(position, state, request, title, added, attended, rehearsal) "
          "VALUES(?, 0, ?, ?, ?, ?, ?)")
      .bind(1, position)
      .bind(2, dumped(to_json(job.request)))
      .bind(3, job.title)
      .bind(4, job.added)
      .bind(5, job.attended_until)
      .bind(6, dumped(job.rehearsal))
      .run();
  // AUTOINCREMENT: a number is not given again after a job was removed, since its folder may be
  // there.
  Statement made = database_.prepare("SELECT last_insert_rowid()");
  made.step();
  const std::int64_t id = made.integer(0);
  transaction.finish();
  ++changes_;
  return id;
}

// Numbered anew each time: halving a distance of doubles ends after fifty moves to the same place.
void JobQueue::move(std::int64_t id, std::optional<std::int64_t> before) {
  const std::lock_guard lock(mutex_);
  if (before && *before == id) return;
  Transaction transaction(database_);
  require_waiting(id);
  const double position = position_before(before);
  Statement place = database_.prepare("UPDATE job SET position = ? WHERE id = ?");
  place.bind(1, position).bind(2, id).run();
  std::int64_t number = 0;
  for (const Job& job :
       select("state = ? ORDER BY position, id", 0, static_cast<int>(kMostWaiting)))
    place.bind(1, ++number).bind(2, job.id).run();
  transaction.finish();
  ++changes_;
}

void JobQueue::remove(std::int64_t id) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  require_waiting(id);
  database_.prepare("DELETE FROM job WHERE id = ?").bind(1, id).run();
  transaction.finish();
  ++changes_;
}

// Rehearsed anew: what it asks, and whether it would be let, may be different now.
void JobQueue::set_request(std::int64_t id, const JobRequest& request) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  require_waiting(id);
  database_.prepare("UPDATE job SET request = ?, rehearsal = 'null' WHERE id = ?")
      .bind(1, dumped(to_json(request)))
      .bind(2, id)
      .run();
  transaction.finish();
  ++changes_;
}

// Not in a transaction of its own: one statement is one.
void JobQueue::attend(std::int64_t id, std::int64_t until) {
  const std::lock_guard lock(mutex_);
  require_waiting(id);
  database_.prepare("UPDATE job SET attended = ? WHERE id = ?").bind(1, until).bind(2, id).run();
  ++changes_;
}

// The job may have begun or gone meanwhile; then this changes nothing that counts.
void JobQueue::set_rehearsal(std::int64_t id, const nlohmann::json& rehearsal) {
  const std::lock_guard lock(mutex_);
  database_.prepare("UPDATE job SET rehearsal = ? WHERE id = ?")
      .bind(1, dumped(rehearsal))
      .bind(2, id)
      .run();
  ++changes_;
}

// On the disk, too: a queue that a person held must not start by itself after a restart.
void JobQueue::set_held(bool held, const std::string& why) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  for (const auto& [name, value] :
       {std::pair<const char*, std::string>{"held", held ? "1" : "0"}, {"why_held", why}})
    database_.prepare("INSERT OR REPLACE INTO setting(name, value) VALUES(?, ?)")
        .bind(1, name)
        .bind(2, value)
        .run();
  transaction.finish();
  ++changes_;
}

bool JobQueue::held() const {
  const std::lock_guard lock(mutex_);
  Statement row = database_.prepare("SELECT value FROM setting WHERE name = 'held'");
  return row.step() && row.text(0) == "1";
}

std::string JobQueue::why_held() const {
  const std::lock_guard lock(mutex_);
  Statement row = database_.prepare("SELECT value FROM setting WHERE name = 'why_held'");
  return row.step() ? row.text(0) : "";
}

std::vector<Job> JobQueue::waiting() const {
  const std::lock_guard lock(mutex_);
  return select("state = ? ORDER BY position, id", 0, static_cast<int>(kMostWaiting));
}

// At most one: the dispatcher begins none while there is one.
std::optional<Job> JobQueue::running() const {
  const std::lock_guard lock(mutex_);
  const std::vector<Job> found = select("state = ?", 1, 1);
  return found.empty() ? std::nullopt : std::optional(found[0]);
}

std::vector<Job> JobQueue::ended(std::size_t most) const {
  const std::lock_guard lock(mutex_);
  return select("state = ? ORDER BY ended DESC, id DESC", 2, static_cast<int>(most));
}

std::optional<Job> JobQueue::find(std::int64_t id) const {
  const std::lock_guard lock(mutex_);
  const std::vector<Job> found = select("id = ?", id, 1);
  return found.empty() ? std::nullopt : std::optional(found[0]);
}

// Not simply the first: one that waits for its time or for a person lets those behind it go ahead.
std::optional<Job> JobQueue::next(std::int64_t now) const {
  for (const Job& job : waiting()) {
    if (job.request.due > now) continue;
    if (job.attended_until >= now) return job;
    // A sweep has no terminal and no face: its questions are answered in advance.
    const bool rehearsed = job.request.sweep || !job.rehearsal.is_null();
    if (rehearsed && !needs_person(job)) return job;
  }
  return std::nullopt;
}

// Before the process is started. After a kill between the two the job counts as lost and is not
// started again: on a real rig running twice is worse than not at all.
void JobQueue::begin(std::int64_t id, std::int64_t now) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  require_waiting(id);
  database_.prepare("UPDATE job SET state = 1, started = ? WHERE id = ?")
      .bind(1, now)
      .bind(2, id)
      .run();
  transaction.finish();
  ++changes_;
}

// For signals alone; whether the job is alive is asked from the lock that its process holds.
void JobQueue::set_process(std::int64_t id, int process) {
  const std::lock_guard lock(mutex_);
  database_.prepare("UPDATE job SET process = ? WHERE id = ?")
      .bind(1, static_cast<std::int64_t>(process))
      .bind(2, id)
      .run();
  ++changes_;
}

void JobQueue::set_run(std::int64_t id, const std::string& run) {
  const std::lock_guard lock(mutex_);
  database_.prepare("UPDATE job SET run = ? WHERE id = ?").bind(1, run).bind(2, id).run();
  ++changes_;
}

// The condition on the state keeps the first end where two servers come to judge the same job.
void JobQueue::end(std::int64_t id, std::int64_t now, const std::string& outcome,
                   const std::string& reason, const std::vector<Message>& messages) {
  const std::lock_guard lock(mutex_);
  Transaction transaction(database_);
  database_
      .prepare(
          "UPDATE job SET state = 2, ended = ?, outcome = ?, reason = ?, process = 0 WHERE "
          "id = ? AND state = 1")
      .bind(1, now)
      .bind(2, outcome)
      .bind(3, reason)
      .bind(4, id)
      .run();
  insert(messages);
  transaction.finish();
  ++changes_;
}

// A counter and not a callback: who shows the queue looks when it has time, and holds up no change.
unsigned long JobQueue::changes() const {
  const std::lock_guard lock(mutex_);
  return changes_;
}

}  // namespace vitreo::serve
