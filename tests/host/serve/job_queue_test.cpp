// Queue of the workbench: order, due times, persons, and what a kill leaves of it.
// SPDX-License-Identifier: Apache-2.0
#include "host/serve/job_queue.h"

#include "host/config/config.h"
#include "host/files/run_folder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <csignal>
#include <fcntl.h>
#include <sys/wait.h>
#include <unistd.h>

namespace vitreo::serve {
namespace VITREO_TEST_FILE {

struct Folder {
  Folder() : path(std::filesystem::temp_directory_path() / ("vitreo_queue_" + random_hex(8))) {
    std::filesystem::create_directory(path);
  }
  ~Folder() { std::filesystem::remove_all(path); }
  std::filesystem::path file() const { return path / "queue.sqlite"; }
  const std::filesystem::path path;
};

Job job_named(const std::string& protocol) {
  Job job;
  job.request.protocol = protocol;
  job.rehearsal = nlohmann::json{{"passed", true}, {"asks", nlohmann::json::array()}};
  return job;
}

std::string order_of(const JobQueue& queue) {
  std::string names;
  for (const Job& job : queue.waiting()) names += job.request.protocol;
  return names;
}

TEST(JobQueue, KeepsTheOrderThatAPersonMadeOverMovesAndARestart) {
  const Folder folder;
  std::int64_t a = 0, c = 0;
  {
    JobQueue queue(folder.file());
    a = queue.add(job_named("a"));
    const std::int64_t b = queue.add(job_named("b"));
    c = queue.add(job_named("c"));
    queue.move(c, a);
    EXPECT_EQ(order_of(queue), "cab");
    queue.add(job_named("d"), b);
    EXPECT_EQ(order_of(queue), "cadb");
    queue.move(a, std::nullopt);
    EXPECT_EQ(order_of(queue), "cdba");
    queue.remove(b);
  }
  JobQueue again(folder.file());
  EXPECT_EQ(order_of(again), "cda");
  EXPECT_GT(again.add(job_named("e")), c) << "a number is never given again";
  EXPECT_EQ(order_of(again), "cdae");
}

// A distance that is halved at each move is nothing after some fifty of them.
TEST(JobQueue, TakesAnyNumberOfMovesToTheSamePlace) {
  const Folder folder;
  JobQueue queue(folder.file());
  const std::int64_t a = queue.add(job_named("a"));
  std::int64_t x = queue.add(job_named("x"));
  std::int64_t y = queue.add(job_named("y"));
  for (int i = 0; i < 120; ++i) {
    queue.move(y, x);
    ASSERT_EQ(order_of(queue), i % 2 == 0 ? "ayx" : "axy") << i;
    std::swap(x, y);
  }
  queue.move(y, a);
  EXPECT_EQ(order_of(queue).back(), 'x');
}

TEST(JobQueue, NothingStartsBeforeItsTimeOrWithoutThePersonThatItNeeds) {
  const Folder folder;
  JobQueue queue(folder.file());
  Job late = job_named("late");
  late.request.due = 1000;
  queue.add(late);
  Job person = job_named("person");
  person.request.person = true;
  const std::int64_t needs = queue.add(person);
  Job asks = job_named("asks");
  asks.rehearsal["asks"] = {"Is the eye fixed? (yes or no): yes"};
  queue.add(asks);
  Job unrehearsed = job_named("unrehearsed");
  unrehearsed.rehearsal = nullptr;
  const std::int64_t fresh = queue.add(unrehearsed);
  EXPECT_FALSE(queue.next(500)) << "whether it asks is not known before it was rehearsed";
  queue.add(job_named("free"));
  EXPECT_EQ(queue.next(500)->request.protocol, "free");
  EXPECT_EQ(queue.next(1000)->request.protocol, "late");
  queue.attend(needs, 900);
  EXPECT_EQ(queue.next(500)->request.protocol, "person");
  EXPECT_EQ(queue.next(901)->request.protocol, "free") << "the person is taken to have left";
  queue.set_rehearsal(fresh, {{"passed", true}, {"asks", nlohmann::json::array()}});
  EXPECT_EQ(queue.next(901)->request.protocol, "unrehearsed");
}

TEST(JobQueue, AJobBeginsOnceAndOnlyWhatWaitsCanBeChanged) {
  const Folder folder;
  JobQueue queue(folder.file());
  const std::int64_t id = queue.add(job_named("a"));
  queue.begin(id, 7);
  EXPECT_THROW(queue.begin(id, 8), ConfigError);
  EXPECT_THROW(queue.remove(id), ConfigError);
  EXPECT_THROW(queue.move(id, std::nullopt), ConfigError);
  EXPECT_THROW(queue.add(job_named("b"), id), ConfigError) << "before what does not wait";
  EXPECT_THROW(queue.remove(99), ConfigError);
  EXPECT_EQ(queue.running()->id, id);
  Message message;
  message.job = id;
  message.channel = "{}";
  message.added = 10;
  queue.end(id, 10, "failed", "why", {message});
  EXPECT_FALSE(queue.running());
  EXPECT_EQ(queue.ended(5).at(0).reason, "why");
  ASSERT_EQ(queue.due_messages(10).size(), 1U);
  queue.failed(queue.due_messages(10)[0].id, 25, "no");
  EXPECT_TRUE(queue.due_messages(24).empty());
  ASSERT_EQ(queue.due_messages(25).size(), 1U);
  queue.told(queue.due_messages(25)[0].id, 26);
  EXPECT_TRUE(queue.due_messages(1000).empty());
}

TEST(JobQueue, RefusesMoreThanAThousandThatWait) {
  const Folder folder;
  JobQueue queue(folder.file());
  // The limit alone is of interest: the rows come in one statement.
  {
    Database database(folder.file().string(), Database::Mode::read_write);
    database.execute(
        "WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n WHERE i < 999) INSERT INTO "
        "job(position, state, request, title, added) SELECT i, 0, '{\"protocol\":\"a\"}', '', 0 "
        "FROM n");
  }
  queue.add(job_named("b"));
  EXPECT_THROW(queue.add(job_named("c")), ConfigError);
}

// A child adds jobs and says each number after add() has returned; it is killed in the midst.
TEST(JobQueue, WhatWasAddedIsThereAfterAKill) {
  const Folder folder;
  int pipe_ends[2];
  ASSERT_EQ(pipe(pipe_ends), 0);
  const pid_t child = fork();
  ASSERT_GE(child, 0);
  if (child == 0) {
    JobQueue queue(folder.file());
    for (;;) {
      const std::int64_t id = queue.add(job_named("a"));
      if (write(pipe_ends[1], &id, sizeof id) != sizeof id) _exit(1);
    }
  }
  std::int64_t last = 0;
  for (int i = 0; i < 25; ++i) ASSERT_EQ(read(pipe_ends[0], &last, sizeof last), 8);
  kill(child, SIGKILL);
  waitpid(child, nullptr, 0);
  fcntl(pipe_ends[0], F_SETFL, O_NONBLOCK);
  for (std::int64_t more = 0; read(pipe_ends[0], &more, sizeof more) == sizeof more;) last = more;
  close(pipe_ends[0]);
  close(pipe_ends[1]);
  JobQueue again(folder.file());
  EXPECT_GE(static_cast<std::int64_t>(again.waiting().size()), last);
  EXPECT_GE(last, 25);
}

TEST(Job, RefusesWhatIsNoJobInWordsThatSayWhatToDo) {
  const auto refused = [](const nlohmann::json& json, const std::string& why) {
    try {
      request_of(json);
      ADD_FAILURE() << json << " was taken";
    } catch (const ConfigError& error) {
      EXPECT_NE(std::string(error.what()).find(why), std::string::npos) << error.what();
    }
  };
  refused(nlohmann::json::array(), "wants an object");
  refused({{"protocol", "a"}, {"argument", "b"}}, "did you mean arguments?");
  refused({{"protocol", 7}}, "protocol: wants a text");
  refused({{"protocol", "a\nb"}}, "control characters");
  refused({{"protocol", std::string(2000, 'a')}}, "at most 1000");
  refused({{"protocol", "a"}, {"seed", -1}}, "seed: wants a whole number");
  refused({{"protocol", "a"}, {"seed", 1.5}}, "seed: wants a whole number");
  refused({{"protocol", "a"}, {"repeats", 1e9}}, "repeats");
  refused({{"protocol", "a"}, {"person", "yes"}}, "person: wants true or false");
  refused({{"protocol", "a"}, {"tags", {"no sign"}}}, "tags: ");
  refused({{"arguments", nlohmann::json::array()}}, "protocol: is missing");
}

TEST(Job, NoTextOfARequestBecomesAnOptionOfTheCommand) {
  Job job;
  job.id = 3;
  job.request.protocol = "--version";
  job.request.arguments = {"--rig=/etc/passwd", "-x"};
  job.request.operator_name = "--json";
  const std::vector<std::string> words = words_of(job, {"/runs", "/sweeps/a", "/token"});
  const auto end = std::find(words.begin(), words.end(), "--");
  ASSERT_NE(end, words.end());
  EXPECT_EQ(std::vector<std::string>(end + 1, words.end()),
            (std::vector<std::string>{"--version", "--rig=/etc/passwd", "-x"}));
  EXPECT_NE(std::find(words.begin(), end, "--operator=--json"), end);
}

TEST(Job, ACommandCanBeTypedAsItIsShown) {
  JobRequest request{"hold", {"speed=1mm/s", "text=it's so"}};
  EXPECT_EQ(command_of(request), "vitreo run hold speed=1mm/s 'text=it'\\''s so'");
  request.sweep = true;
  request.repeats = 3;
  EXPECT_EQ(command_of(request).substr(0, 17), "vitreo sweep hold");
  EXPECT_NE(command_of(request).find("--repeat 3"), std::string::npos);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::serve
