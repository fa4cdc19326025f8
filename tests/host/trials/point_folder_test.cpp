// SPDX-License-Identifier: Apache-2.0
#include "host/trials/point_folder.h"

#include "host/files/published_file.h"
#include "host/trials/point_owner.h"
#include "host/trials/point_runner.h"

#include <gtest/gtest.h>

#include <atomic>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>

namespace vitreo {
namespace VITREO_TEST_FILE {

namespace fs = std::filesystem;

class PointFolderTest : public testing::Test {
 protected:
  PointFolderTest() {
    std::string name = (fs::temp_directory_path() / "vitreo_points_XXXXXX").string();
    place_ = mkdtemp(name.data());
  }
  ~PointFolderTest() override { fs::remove_all(place_); }

  static PointPlan plan(std::size_t points, int of = 0) {
    PointPlan made{{{"kind", "test"}}, {}};
    for (std::size_t i = 0; i < points; ++i) {
      const nlohmann::json what = {{"number", i}, {"of", of}};
      made.points.push_back({point_key(what), what});
    }
    return made;
  }
  PointFolder folder(std::size_t points) const {
    return PointFolder::create(place_ / "sweep", plan(points));
  }
  std::string error_of(const std::function<void()>& action) const {
    try {
      action();
    } catch (const SweepError& error) {
      return error.what();
    }
    return "";
  }
  static nlohmann::json completed() { return {{"outcome", "completed"}}; }

  fs::path place_;
};

TEST_F(PointFolderTest, APlanIsReadBackAsItWasWritten) {
  folder(2500);
  const PointFolder again(place_ / "sweep");
  ASSERT_EQ(again.points().size(), 2500U);
  EXPECT_EQ(again.points()[2499].what["number"], 2499);
  EXPECT_EQ(again.points()[2499].key, plan(2500).points[2499].key);
  EXPECT_EQ(again.head()["kind"], "test");
  EXPECT_EQ(again.unfinished().size(), 2500U);
}

TEST_F(PointFolderTest, ForeignDamagedAndHalfCopiedFoldersAreRefusedBySayingWhatToDo) {
  EXPECT_NE(error_of([&] { PointFolder{place_}; }).find("is no sweep"), std::string::npos);
  std::ofstream(place_ / "thesis.txt") << "mine";
  EXPECT_NE(error_of([&] { PointFolder::create(place_, plan(3)); }).find("thesis.txt is in it"),
            std::string::npos);
  EXPECT_TRUE(fs::exists(place_ / "thesis.txt"));
  folder(3);
  const fs::path sweep = place_ / "sweep";
  fs::path list;
  for (const auto& entry : fs::directory_iterator(sweep))
    if (entry.path().extension() == ".jsonl") list = entry.path();
  fs::resize_file(list, fs::file_size(list) - 5);
  EXPECT_NE(error_of([&] { PointFolder{sweep}; }).find("copy the whole folder again"),
            std::string::npos);
  fs::remove(list);
  EXPECT_NE(error_of([&] { PointFolder{sweep}; }).find("is missing"), std::string::npos);
  std::ofstream(sweep / "plan.json") << "{\"version\": 99, \"points_sha256\": \"\"}";
  EXPECT_NE(error_of([&] { PointFolder{sweep}; }).find("has version 99"), std::string::npos);
  std::ofstream(sweep / "plan.json") << "{\"vers";
  EXPECT_NE(error_of([&] { PointFolder{sweep}; }).find("damaged"), std::string::npos);
}

TEST_F(PointFolderTest, ASecondSweepInTheFolderIsRefusedAndTheSameOneIsToldToResume) {
  folder(3);
  EXPECT_NE(error_of([&] { PointFolder::create(place_ / "sweep", plan(3)); }).find("--resume"),
            std::string::npos);
  EXPECT_NE(error_of([&] {
              PointFolder::create(place_ / "sweep", plan(3, 1));
            }).find("holds another sweep"),
            std::string::npos);
}

TEST_F(PointFolderTest, APlanWhoseTwoPointsAreTheSameIsRefused) {
  PointPlan twice = plan(2);
  twice.points[1] = twice.points[0];
  EXPECT_NE(error_of([&] { PointFolder::create(place_ / "sweep", twice); }).find("the same"),
            std::string::npos);
}

TEST_F(PointFolderTest, AClaimExcludesOthersUntilItIsGivenBack) {
  const PointFolder points = folder(2);
  auto claim = points.claim(0);
  ASSERT_TRUE(claim);
  EXPECT_EQ(claim->attempt(), 1);
  EXPECT_FALSE(points.claim(0));
  EXPECT_TRUE(points.claim(1));
  claim.reset();
  claim = points.claim(0);
  ASSERT_TRUE(claim);
  EXPECT_EQ(claim->attempt(), 2);
  EXPECT_TRUE(points.mark(0, completed()));
  claim.reset();
  EXPECT_FALSE(points.claim(0)) << "it is finished";
}

TEST_F(PointFolderTest, OfManyThatMarkAPointExactlyOneCounts) {
  const PointFolder points = folder(1);
  std::atomic<int> counted{0};
  std::vector<std::thread> threads;
  for (int i = 0; i < 8; ++i)
    threads.emplace_back([&, i] {
      counted += points.mark(0, {{"outcome", "completed"}, {"by", i}});
    });
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(counted, 1);
  EXPECT_EQ(points.result(0)->at("outcome"), "completed");
  EXPECT_FALSE(points.mark(0, {{"outcome", "failed"}}));
  EXPECT_EQ(points.result(0)->at("outcome"), "completed");
  for (const auto& entry : fs::recursive_directory_iterator(place_))
    EXPECT_FALSE(entry.is_regular_file() && entry.path().filename().string().starts_with("."))
        << "a draft was left: " << entry.path();
}

TEST_F(PointFolderTest, OfManyProcessesExactlyOneClaimsAPointWhoseOwnerWasKilled) {
  const PointFolder points = folder(1);
  const pid_t owner = fork();
  if (owner == 0) {
    const auto claim = points.claim(0);
    raise(SIGKILL);
  }
  waitpid(owner, nullptr, 0);
  std::vector<pid_t> rivals;
  for (int i = 0; i < 8; ++i) {
    rivals.push_back(fork());
    if (rivals.back() != 0) continue;
    auto claim = points.claim(0);
    const bool mine = claim != nullptr;
    if (claim) sleep(1), claim->keep();  // the others must find it alive
    _exit(mine ? 1 : 0);
  }
  int claimed = 0;
  for (const pid_t rival : rivals) {
    int status = 0;
    waitpid(rival, &status, 0);
    claimed += WEXITSTATUS(status);
  }
  EXPECT_EQ(claimed, 1);
}

TEST_F(PointFolderTest, AnOwnerOnAnotherMachineLivesAsLongAsItGivesSignsOfLife) {
  const PointFolder points = folder(1);
  nlohmann::json far = this_owner();
  far["host"] = "elsewhere";
  fs::create_directories(place_ / "sweep/claims/0000");
  const fs::path claim = place_ / "sweep/claims/0000/000000.1";
  publish(claim, far.dump());
  EXPECT_FALSE(points.claim(0));
  const auto lease = std::chrono::seconds(static_cast<int>(PointClaim::kLease) + 5);
  fs::last_write_time(claim, fs::file_time_type::clock::now() - lease);
  EXPECT_TRUE(points.claim(0));
}

TEST_F(PointFolderTest, AMarkThatIsBrokenOrForeignIsNamed) {
  const PointFolder points = folder(1);
  points.mark(0, completed());
  const fs::path mark = place_ / "sweep/done/0000/000000.json";
  std::ofstream(mark) << "{\"outcome\": \"comp";
  EXPECT_NE(error_of([&] { points.result(0); }).find("000000.json: is damaged"), std::string::npos);
  std::ofstream(mark) << R"({"outcome": "completed", "key": "0123456789abcdef"})";
  EXPECT_NE(error_of([&] { points.result(0); }).find("another sweep"), std::string::npos);
}

/// Counts how often each point was begun, by a file a try.
PointBody counting_body(const fs::path& place,
                        const std::function<nlohmann::json(std::size_t)>& act) {
  return [place, act](const PlannedPoint&, std::size_t point, const SayLine& say) {
    std::ofstream(place / ("begun_" + std::to_string(point)), std::ios::app) << "x";
    say("at " + std::to_string(point));
    return act(point);
  };
}

TEST_F(PointFolderTest, TheRunnerDoesEachPointOnceAndPassesOnWhatItSays) {
  const PointFolder points = folder(20);
  int said = 0;
  int finished = 0;
  RunnerOptions options;
  options.jobs = 3;
  options.said = [&said](std::size_t, const std::string&) { ++said; };
  options.finished = [&finished](std::size_t, const nlohmann::json&) { ++finished; };
  const auto end =
      run_points(points, counting_body(place_, [](std::size_t) { return completed(); }), options);
  EXPECT_EQ(end, RunnerEnd::all_done);
  EXPECT_EQ(said, 20);
  EXPECT_EQ(finished, 20);
  for (int i = 0; i < 20; ++i)
    EXPECT_EQ(fs::file_size(place_ / ("begun_" + std::to_string(i))), 1U);
}

TEST_F(PointFolderTest, APointWhoseProcessDiesIsTriedAgainAndThenLost) {
  const PointFolder points = folder(3);
  std::vector<std::string> notes;
  RunnerOptions options;
  options.note = [&notes](const std::string& text) { notes.push_back(text); };
  run_points(points,
             counting_body(place_,
                           [](std::size_t point) {
                             // A sanitizer has a handler of its own, which does not die of it.
                             std::signal(SIGSEGV, SIG_DFL);
                             if (point == 1) raise(SIGSEGV);
                             return completed();
                           }),
             options);
  EXPECT_EQ(fs::file_size(place_ / "begun_1"), 2U);
  EXPECT_EQ(points.result(1)->at("outcome"), "lost");
  EXPECT_NE(points.result(1)->at("reason").get<std::string>().find("signal 11"), std::string::npos);
  EXPECT_EQ(points.result(2)->at("outcome"), "completed");
  EXPECT_EQ(notes.size(), 2U);
}

TEST_F(PointFolderTest, AStopIsPassedOnAndWhatItCutShortIsDoneLater) {
  const PointFolder points = folder(4);
  const pid_t here = getpid();
  const PointBody stopped = counting_body(place_, [here](std::size_t) -> nlohmann::json {
    static std::atomic<bool> told{false};
    std::signal(SIGTERM, [](int) { told = true; });
    kill(here, SIGINT);
    while (!told) usleep(1000);
    return {{"outcome", "stopped"}};
  });
  EXPECT_EQ(run_points(points, stopped, {}), RunnerEnd::stopped);
  EXPECT_EQ(points.unfinished().size(), 4U);
  run_points(points, counting_body(place_, [](std::size_t) { return completed(); }), {});
  EXPECT_TRUE(points.unfinished().empty());
}

TEST_F(PointFolderTest, TheRunnersOfTwoProcessesShareThePoints) {
  const PointFolder points = folder(40);
  const PointBody body = counting_body(place_, [](std::size_t) {
    usleep(2000);
    return completed();
  });
  const pid_t other = fork();
  if (other == 0) _exit(run_points(points, body, {.offset = 20}) == RunnerEnd::all_done ? 0 : 1);
  EXPECT_EQ(run_points(points, body, {}), RunnerEnd::all_done);
  int status = 0;
  waitpid(other, &status, 0);
  EXPECT_EQ(status, 0);
  for (int i = 0; i < 40; ++i)
    EXPECT_EQ(fs::file_size(place_ / ("begun_" + std::to_string(i))), 1U) << i;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
