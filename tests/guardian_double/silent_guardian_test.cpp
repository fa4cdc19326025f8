// Guardian, the host's side, when its process is there and does not answer: it is frozen, or
// acknowledges late, a while, or never (docs/safety.md, "the host watches the guardian").
// SPDX-License-Identifier: Apache-2.0
#include "tests/guardian_double/guardian_unit.h"
#include "tests/host/safety/guardian/frozen.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdio>
#include <exception>
#include <functional>
#include <memory>
#include <optional>
#include <signal.h>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <utility>

namespace vitreo {
namespace VITREO_TEST_FILE {

using Milliseconds = std::chrono::duration<double, std::milli>;

/// Beyond every patience of the host's, also on a machine that is busy otherwise.
constexpr auto kHard = 2s;
/// A machine may itself keep a process waiting that long: then the same once more, so often.
constexpr int kAttempts = 10;

double ms(Steady::duration time) { return Milliseconds(time).count(); }

/// When it is lost, looked at every millisecond; nothing when it is not lost within `patience`.
std::optional<Steady::time_point> lost_at(const Guardian& guardian, Steady::duration patience) {
  for (const auto until = Steady::now() + patience; Steady::now() < until;) {
    if (guardian.lost()) return Steady::now();
    std::this_thread::sleep_for(1ms);
  }
  return std::nullopt;
}

bool is_there_again(const Guardian& guardian) {
  for (const auto until = Steady::now() + 5s; guardian.lost() && Steady::now() < until;)
    std::this_thread::sleep_for(1ms);
  return !guardian.lost();
}

/// The refusal; nothing where it is armed.
std::optional<DeviceError> refusal(const std::function<void()>& arm) {
  try {
    arm();
  } catch (const DeviceError& error) {
    return error;
  }
  return std::nullopt;
}

void expect_lost(const std::function<void()>& arm, const std::string& what) {
  const std::optional<DeviceError> error = refusal(arm);
  ASSERT_TRUE(error.has_value()) << what << ": a current without a guardian";
  EXPECT_EQ(error->kind, DeviceErrorKind::lost) << what;
}

/// How long the host takes to let go of it. One that never does is helped, so that the other tests
/// run.
Steady::duration let_go(std::unique_ptr<Guardian> guardian) {
  const pid_t process = guardian->process();
  std::atomic<bool> back{false};
  std::thread help([&] {
    for (const auto until = Steady::now() + 8s; !back && Steady::now() < until;)
      std::this_thread::sleep_for(5ms);
    if (!back) ::kill(process, SIGKILL);
  });
  const auto began = Steady::now();
  guardian.reset();
  const auto took = Steady::now() - began;
  back = true;
  help.join();
  return took;
}

TEST_F(GuardianUnit, ThatIsFrozenForAMomentIsNotLost) {
  const auto guardian = make();
  guardian->arm("coils");
  for (int attempt = 1;; ++attempt) {
    ASSERT_LE(attempt, kAttempts) << "lost each time, or the machine never kept to the time";
    Frozen frozen(guardian->process());
    const auto began = Steady::now();
    const std::size_t before = count("b");
    bool lost = lost_at(*guardian, 40ms).has_value();
    frozen.thaw();
    EXPECT_TRUE(hears("b", before + 1));
    lost = lost || guardian->lost();
    const auto took = Steady::now() - began;
    EXPECT_TRUE(hears("b", before + 8)) << "what was said meanwhile does not get lost";
    if (!lost && took < 80ms) break;
    ASSERT_FALSE(lost && took < 80ms) << "after " << ms(took) << " ms";
    ASSERT_TRUE(is_there_again(*guardian));
  }
  EXPECT_NO_THROW(guardian->arm("coils"));
  EXPECT_NO_THROW(guardian->arm("lamp"));
}

// Several times, for a busy machine makes single ones late: the rule shows in the fastest.
TEST_F(GuardianUnit, ThatIsFrozenIsNotArmedAndIsThereAgainAfterwards) {
  const auto guardian = make();
  auto fastest = Steady::duration::max();
  for (std::size_t i = 0; i < 3; ++i) {
    Frozen frozen(guardian->process());
    const auto began = Steady::now();
    expect_lost([&] { guardian->arm("coils"); }, "the first output");
    const auto took = Steady::now() - began;
    fastest = std::min(fastest, took);
    std::printf("an arming is refused after %.0f ms\n", ms(took));
    EXPECT_GE(took, 80ms) << "five turns of 20 ms are waited for";
    EXPECT_LT(took, kHard);
    EXPECT_TRUE(lost_at(*guardian, kHard)) << "it does not answer";
    frozen.thaw();
    ASSERT_TRUE(is_there_again(*guardian));
    EXPECT_NO_THROW(guardian->arm("coils"));
    EXPECT_FALSE(guardian->lost());
    guardian->disarm("coils");
    ASSERT_TRUE(hears("d", 2 * (i + 1)));
  }
  EXPECT_LT(fastest, 500ms);
}

TEST_F(GuardianUnit, ThatNeverAcknowledgesLetsNoFirstCurrentThrough) {
  mode("deaf");
  const auto guardian = make();
  EXPECT_FALSE(guardian->lost()) << "nothing was said to it yet";
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  const std::optional<DeviceError> error = refusal([&] { coils->set_currents(Currents{1, 0, 0}); });
  EXPECT_TRUE(amplifier.now.empty()) << "it reached the amplifier";
  ASSERT_TRUE(error.has_value());
  EXPECT_EQ(error->kind, DeviceErrorKind::lost);
  EXPECT_NE(std::string(error->what()).find("does not answer"), std::string::npos) << error->what();
  EXPECT_TRUE(guardian->lost());
  EXPECT_THROW(coils->set_currents(Currents{0, 1, 0}), DeviceError) << "nor a second one";
  EXPECT_TRUE(amplifier.now.empty());
  coils->set_currents(Currents{0, 0, 0});
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0})) << "a zero goes through";
  coils->make_safe();
  EXPECT_EQ(amplifier.made_safe, 1);
}

TEST_F(GuardianUnit, ThatDiesOfTheFirstArmingLetsNoCurrentThrough) {
  mode("dies");
  const auto guardian = make();
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  expect_lost([&] { coils->set_currents(Currents{1, 0, 0}); }, "dies");
  EXPECT_TRUE(amplifier.now.empty()) << "it reached the amplifier";
  EXPECT_TRUE(lost_at(*guardian, kHard));
}

// A thawed guardian that is left armed would wait for heartbeats, and kill a host at rest.
TEST_F(GuardianUnit, ThatWasNotArmedIsToldThatAllIsAtZero) {
  const auto guardian = make();
  Frozen frozen(guardian->process());
  expect_lost([&] { guardian->arm("coils"); }, "frozen");
  frozen.thaw();
  ASSERT_TRUE(hears("d"));
  std::this_thread::sleep_for(150ms);
  EXPECT_EQ(order(), "ad");
  const auto all = heard();
  ASSERT_FALSE(all.empty());
  EXPECT_EQ(all.back().text, "d") << "no beat follows";
}

TEST_F(GuardianUnit, ThatStopsAcknowledgingWhileArmedIsLost) {
  mode("tires");
  const auto guardian = make();
  guardian->arm("coils");
  const auto lost = lost_at(*guardian, kHard + 300ms);
  ASSERT_TRUE(lost) << "a current flows without a guardian";
  std::vector<double> said;  // s
  for (const Heard& one : heard())
    if (one.text == "a" || one.text == "b") said.push_back(one.time);
  ASSERT_GE(said.size(), 10u) << "lost before its tenth acknowledgement, the last";
  const double took = std::chrono::duration<double>(lost->time_since_epoch()).count() - said[9];
  std::printf("lost %.0f ms after its last acknowledgement\n", took * 1e3);
  EXPECT_GE(took, 0.08) << "five turns of 20 ms";
  EXPECT_LT(took, 2);
  EXPECT_THROW(guardian->arm("coils"), DeviceError) << "armed before, and of no use now";
  EXPECT_THROW(guardian->arm("lamp"), DeviceError);
  std::this_thread::sleep_for(300ms);
  EXPECT_TRUE(guardian->lost()) << "and so it stays";
}

TEST_F(GuardianUnit, ThatIsFrozenWhileArmedIsLostAndLetsTheZeroThrough) {
  const auto guardian = make();
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  coils->set_currents(Currents{1, 0, 0});
  ASSERT_EQ(amplifier.now, (Currents{1, 0, 0}));
  Frozen frozen(guardian->process());
  const auto began = Steady::now();
  const auto lost = lost_at(*guardian, kHard);
  ASSERT_TRUE(lost) << "a current flows without a guardian";
  std::printf("lost %.0f ms after it was frozen\n", ms(*lost - began));
  expect_lost([&] { coils->set_currents(Currents{2, 0, 0}); }, "the next set-point");
  EXPECT_EQ(amplifier.now, (Currents{1, 0, 0}));
  coils->set_currents(Currents{0, 0, 0});
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
  EXPECT_TRUE(guardian->lost());
  frozen.thaw();
  EXPECT_TRUE(hears("d"));
  ASSERT_TRUE(is_there_again(*guardian));
  coils->set_currents(Currents{3, 0, 0});
  EXPECT_EQ(amplifier.by_then, "ada");
  EXPECT_EQ(amplifier.now, (Currents{3, 0, 0}));
  EXPECT_TRUE(hears("b", count("b") + 3)) << "and it is fed again";
  EXPECT_FALSE(guardian->lost());
}

// Three turns late: in every turn one acknowledgement comes, of an earlier message. That of a beat,
// or of the last zero, is none of the arming.
TEST_F(GuardianUnit, ThatAcknowledgesLateIsWaitedForAndNotLost) {
  mode("slow");
  const auto guardian = make();
  const auto succeeds = [&] {
    for (const auto pause : {1000ms, 70ms, 0ms}) {
      const auto began = Steady::now();
      if (refusal([&] { guardian->arm("coils"); })) return false;
      EXPECT_GE(Steady::now() - began, 60ms) << "a current before its acknowledgement";
      if (lost_at(*guardian, pause)) return false;
      EXPECT_NO_THROW(guardian->arm("lamp"));
      guardian->disarm("lamp");
      guardian->disarm("coils");
    }
    return true;
  };
  int attempt = 1;
  for (; attempt < kAttempts && !succeeds(); ++attempt) {
    guardian->disarm("coils");
    ASSERT_TRUE(is_there_again(*guardian));
  }
  EXPECT_LT(attempt, kAttempts) << "lost each time";
}

TEST_F(GuardianUnit, ThatIsToldNothingOwesNothing) {
  const auto guardian = make();
  guardian->arm("coils");
  ASSERT_TRUE(hears("b", 2));
  healthy = false;
  std::this_thread::sleep_for(100ms);  // what was said before is acknowledged
  Frozen frozen(guardian->process());
  EXPECT_FALSE(lost_at(*guardian, 500ms)) << "the host was silent itself";
  healthy = true;
  EXPECT_TRUE(lost_at(*guardian, kHard)) << "now it is asked, and does not answer";
  frozen.thaw();
  EXPECT_TRUE(is_there_again(*guardian));
}

TEST_F(GuardianUnit, ThatIsFrozenAtRestIsNotAskedAndNotLost) {
  const auto guardian = make();
  guardian->arm("coils");
  guardian->disarm("coils");
  ASSERT_TRUE(hears("d"));
  std::this_thread::sleep_for(100ms);
  const Frozen frozen(guardian->process());
  EXPECT_FALSE(lost_at(*guardian, 500ms)) << "nothing is energized, nothing is said";
}

// The host counts its own turns, not a clock: a suspend, or a machine without a processor to give.
TEST_F(GuardianUnit, OnAMachineThatStoodStillAsAWholeIsNotAccused) {
  for (int attempt = 1;; ++attempt) {
    int tell[2];
    ASSERT_EQ(::pipe(tell), 0);
    const pid_t host = ::fork();
    ASSERT_GE(host, 0);
    if (host == 0) {
      int code = 2;
      try {
        const auto guardian = make();
        guardian->arm("coils");
        const pid_t process = guardian->process();
        if (::write(tell[1], &process, sizeof process) == sizeof process)
          code = lost_at(*guardian, 1500ms) ? 1 : 0;
      } catch (const std::exception&) {
        code = 3;
      }
      ::_exit(code);
    }
    ::close(tell[1]);
    pid_t process = -1;
    const bool told = ::read(tell[0], &process, sizeof process) == sizeof process;
    ::close(tell[0]);
    std::this_thread::sleep_for(100ms);
    // An acknowledgement is owed when all stands still: the guardian is a moment the first, and the
    // last.
    auto began = Steady::now();
    auto alone = Steady::duration::zero();
    if (told) {
      Frozen frozen(process);
      std::this_thread::sleep_for(30ms);
      Frozen frozen_host(host);
      alone = Steady::now() - began;
      std::this_thread::sleep_for(500ms);
      began = Steady::now();
      frozen_host.thaw();
      std::this_thread::sleep_for(5ms);
      frozen.thaw();
      alone += Steady::now() - began;
    }
    int status = 0;
    ASSERT_EQ(::waitpid(host, &status, 0), host);
    ASSERT_TRUE(told);
    ASSERT_TRUE(WIFEXITED(status));
    if (WEXITSTATUS(status) == 0) break;
    ASSERT_EQ(WEXITSTATUS(status), 1);
    ASSERT_LT(attempt, kAttempts) << "accused each time";
    std::printf("accused; the guardian stood still alone for %.0f ms\n", ms(alone));
  }
}

// The host asks more often than it is answered: the kernel keeps some hundred messages, and what
// is written to a full socket waits.
TEST_F(GuardianUnit, IsNotBuriedInMessagesWhileItDoesNotAnswer) {
  const auto guardian = make();
  int armed = 0, tried = 0;
  {
    const Frozen frozen(guardian->process());
    for (const auto until = Steady::now() + 20s; tried < 10'000 && Steady::now() < until; ++tried) {
      if (!refusal([&] { guardian->arm("coils"); })) ++armed;
      guardian->disarm("coils");
    }
  }
  std::size_t before = 0;
  do {
    before = heard().size();
    std::this_thread::sleep_for(300ms);
  } while (heard().size() > before);
  std::printf("%d armings of a frozen one: it has heard %zu messages\n", tried, before - 2);
  EXPECT_EQ(armed, 0);
  EXPECT_LE(before - 2, 60u) << "beside its start and its outputs";
  EXPECT_TRUE(is_there_again(*guardian));
}

// Five turns: what it had not acknowledged when it froze is one of the five messages.
TEST_F(GuardianUnit, ThatIsFrozenHasFiveMessagesWaitingWhenItIsLost) {
  const auto guardian = make();
  guardian->arm("coils");
  ASSERT_TRUE(hears("b", 3));
  Frozen frozen(guardian->process());
  const std::size_t before = count("b");
  ASSERT_TRUE(lost_at(*guardian, kHard));
  healthy = false;  // nothing more is said when it goes on
  frozen.thaw();
  ASSERT_TRUE(hears("b", before + 5));
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(count("b"), before + 5);
}

TEST_F(GuardianUnit, ThatAcknowledgesMoreThanItWasToldIsMissedAllTheSame) {
  mode("eager");
  const auto guardian = make();
  guardian->arm("coils");
  ASSERT_TRUE(hears("b", 20));
  const Frozen frozen(guardian->process());
  EXPECT_TRUE(lost_at(*guardian, kHard));
}

TEST_F(GuardianUnit, ThatDiesIsSaidToBeGone) {
  for (const bool armed : {false, true}) {
    const auto guardian = make();
    if (armed) guardian->arm("coils");
    std::this_thread::sleep_for(60ms);
    ::kill(guardian->process(), SIGKILL);
    ASSERT_TRUE(lost_at(*guardian, kHard)) << armed;
    EXPECT_EQ(guardian->trouble(), "the process that guards the outputs is gone") << armed;
  }
}

TEST_F(GuardianUnit, ThatIsFrozenAtTheEndIsKilled) {
  auto guardian = make();
  const pid_t process = guardian->process();
  const Frozen frozen(process);
  std::this_thread::sleep_for(1s);
  const auto took = let_go(std::move(guardian));
  std::printf("a frozen one is let go after %.0f ms\n", ms(took));
  EXPECT_LT(took, 5s);
  EXPECT_TRUE(has_ended(process));
  EXPECT_FALSE(is_there(process)) << "its end is seen";
}

TEST_F(GuardianUnit, ThatDoesNotAnswerIsKilledAtTheEndWithoutDelay) {
  auto guardian = make();
  const pid_t process = guardian->process();
  const Frozen frozen(process);
  expect_lost([&] { guardian->arm("coils"); }, "frozen");
  const auto took = let_go(std::move(guardian));
  std::printf("one that does not answer is let go after %.0f ms\n", ms(took));
  EXPECT_LT(took, 1500ms) << "it was known";
  EXPECT_FALSE(is_there(process));
}

TEST_F(GuardianUnit, ThatDoesNotLeaveIsKilledAfterTwoSeconds) {
  mode("stays");
  auto guardian = make();
  const pid_t process = guardian->process();
  guardian->arm("coils");
  guardian->disarm("coils");
  const auto took = let_go(std::move(guardian));
  std::printf("one that stays is let go after %.0f ms\n", ms(took));
  EXPECT_EQ(order(), "adq");
  EXPECT_GE(took, 1900ms);
  EXPECT_LT(took, 5s);
  EXPECT_FALSE(is_there(process));
}

TEST_F(GuardianUnit, ThatNeedsASecondToLeaveIsLeftIt) {
  mode("dawdles");
  auto guardian = make();
  const pid_t process = guardian->process();
  EXPECT_LT(let_go(std::move(guardian)), 5s);
  EXPECT_EQ(count("left"), 1u) << "killed while it was leaving";
  EXPECT_FALSE(is_there(process));
}

// It is all that still can bring them to zero, so it is asked to go on.
TEST_F(GuardianUnit, ThatIsFrozenIsWokenAndNotKilledWhereSomethingMayStillBeEnergized) {
  auto guardian = make();
  const pid_t process = guardian->process();
  guardian->arm("coils");
  ::kill(process, SIGSTOP);
  lost_at(*guardian, 300ms);
  EXPECT_LT(let_go(std::move(guardian)), 5s);
  EXPECT_TRUE(hears("x")) << "what it has to do";
  int status = 0;
  ::waitpid(process, &status, 0);
  EXPECT_TRUE(WIFEXITED(status)) << "it was killed";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
