// Ctrl-C pressed twice at any moment of the built program's run: its record is closed all the same.
// SPDX-License-Identifier: Apache-2.0
#include "tests/long_form.h"
#include "tests/program/program.h"

#include <gtest/gtest.h>

#include <chrono>
#include <csignal>
#include <random>
#include <spawn.h>
#include <thread>

extern char** environ;

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// `vitreo run body.lua` beside the test.
class Running {
 public:
  explicit Running(const Workplace& place) {
    std::string shell = "sh", option = "-c",
                script = "cd '" + place.folder().string() +
                         "' && exec '" VITREO_PROGRAM
                         "' run body.lua --rig bare.lua --real-time >out 2>err </dev/null";
    char* words[] = {shell.data(), option.data(), script.data(), nullptr};
    posix_spawnp(&child_, "sh", nullptr, nullptr, words, environ);
  }
  ~Running() { end(); }
  Running(const Running&) = delete;
  Running& operator=(const Running&) = delete;
  void signal(int number) const { ::kill(child_, number); }
  /// The status of its end, as of waitpid().
  int end() {
    if (child_ > 0) waitpid(child_, &status_, 0);
    child_ = 0;
    return status_;
  }

 private:
  pid_t child_ = 0;
  int status_ = 0;
};

/// The end of one run whose alarms make its closing long: two signals, the first `after` its folder
/// was made, the second `apart` later. False where it ended before the first.
void press_twice(const Workplace& place, int number, std::chrono::microseconds after,
                 std::chrono::microseconds apart) {
  std::filesystem::remove_all(place.folder() / "runs");
  Running running(place);
  for (int i = 0; i < 20000 && place.runs() == 0; ++i) std::this_thread::sleep_for(1ms);
  std::this_thread::sleep_for(after);
  running.signal(number);
  std::this_thread::sleep_for(apart);
  running.signal(number);
  const int status = running.end();
  const std::string moment = std::to_string(after.count()) + " us after the folder, " +
                             std::to_string(apart.count()) + " us apart: " + place.read("err");
  if (place.runs() == 0) {  // stopped before there was a record
    EXPECT_TRUE(WIFEXITED(status)) << "killed, " << moment;
    return;
  }
  // What prints the report of a closed record may be ended as any other program; until then no
  // signal ends it, so that the record of a process that was killed is whole too.
  EXPECT_TRUE(WIFEXITED(status) || WTERMSIG(status) == number) << moment;
  EXPECT_EQ(place.vitreo("verify last").exit_code, 0) << moment;
}

TEST(Interrupts, TwoAtAnyMomentLoseNoRecord) {
  const Workplace place;
  place.write("bare.lua", "return { title = 'bare' }");
  place.write("body.lua",
              "return { title = 'b', run = function(rig, p, run)\n"
              "for i = 1, 3000 do run:alarm { name = 'a' .. i, priority = 'low', text = 'x' } end\n"
              "run:wait(100) end }");
  std::mt19937 random(20261124);
  const int trials = long_or_short(500, 3);
  for (int trial = 0; trial < trials; ++trial)
    for (const int number : {SIGINT, SIGQUIT})
      press_twice(place, number, std::chrono::microseconds(random() % 400'000),
                  std::chrono::microseconds(random() % 250'000));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
