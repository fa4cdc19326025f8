// Guardian, the host's side, against a double of its process: what is said, when, and in which
// order with what goes to the outputs.
// SPDX-License-Identifier: Apache-2.0
#include "tests/guardian_double/guardian_unit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <fcntl.h>
#include <filesystem>
#include <fstream>
#include <pthread.h>
#include <signal.h>
#include <string>
#include <sys/wait.h>
#include <thread>
#include <unistd.h>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

TEST_F(GuardianUnit, GetsEveryOutputBeforeAnythingElseInASessionOfItsOwn) {
  const auto guardian = make();
  const auto all = heard();
  ASSERT_EQ(all.size(), 2u);
  EXPECT_EQ(all[0].text, "for " + std::to_string(getpid()) + " in a session");
  EXPECT_EQ(all[1].text,
            "Ousb3103\thid:09db:009c\tenable_line=3|kepco_bop\tserial:/dev/a, serial:/dev/b|");
  EXPECT_TRUE(is_there(guardian->process()));
  EXPECT_FALSE(guardian->shares_group());
  EXPECT_FALSE(guardian->lost());
}

/// Numbers of the descriptors that a process holds.
std::vector<int> descriptors_of(pid_t process) {
  std::vector<int> found;
  for (const auto& entry :
       std::filesystem::directory_iterator("/proc/" + std::to_string(process) + "/fd"))
    found.push_back(std::stoi(entry.path().filename()));
  return found;
}

TEST_F(GuardianUnit, HoldsNoDescriptorOfTheHostsButItsSocket) {
  // From 4 on, the number behind its socket's, some that a program which is started would inherit.
  std::vector<int> inherited;
  for (int k = 0; k < 8; ++k) inherited.push_back(::fcntl(STDERR_FILENO, F_DUPFD, 4));
  const auto guardian = make();
  const std::vector<int> its = descriptors_of(guardian->process());
  for (const int one : inherited) ::close(one);
  // Of its own it has the file that it writes, in the lowest free place.
  const auto above = std::count_if(its.begin(), its.end(), [](int one) { return one > 3; });
  EXPECT_EQ(above, 1);
}

TEST_F(GuardianUnit, IsStartedWithNoSignalBlocked) {
  sigset_t blocked, before;
  sigemptyset(&blocked);
  for (const int signal : {SIGTERM, SIGUSR1, SIGCHLD}) sigaddset(&blocked, signal);
  pthread_sigmask(SIG_BLOCK, &blocked, &before);
  const auto guardian = make();
  pthread_sigmask(SIG_SETMASK, &before, nullptr);
  std::ifstream status("/proc/" + std::to_string(guardian->process()) + "/status");
  std::string line, mask;
  while (std::getline(status, line))
    if (line.rfind("SigBlk:", 0) == 0)
      mask = line.substr(line.find_first_of("0123456789abcdef", 7));
  EXPECT_EQ(mask, "0000000000000000");
}

TEST_F(GuardianUnit, SaysWhetherItSharesTheHostsControlGroup) {
  mode("shared");
  EXPECT_TRUE(make()->shares_group());
}

TEST_F(GuardianUnit, ThatCannotGuardAnOutputIsRefusedInItsWords) {
  mode("refuse");
  try {
    make();
    FAIL();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::refused);
    EXPECT_NE(std::string(error.what()).find("a toaster cannot be brought to zero"),
              std::string::npos)
        << error.what();
  }
  EXPECT_EQ(::waitpid(-1, nullptr, WNOHANG), -1) << "it is left behind";
}

TEST_F(GuardianUnit, ThatDoesNotGetReadyIsWaitedForFiveSecondsAndNotStarted) {
  for (const char* word : {"leaves", "mute"}) {
    mode(word);
    const auto began = Steady::now();
    try {
      make();
      FAIL() << word;
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::refused);
      EXPECT_NE(std::string(error.what()).find("it did not get ready"), std::string::npos);
    }
    const auto took = Steady::now() - began;
    if (std::string(word) == "mute") {
      EXPECT_GE(took, 4900ms);
      EXPECT_LT(took, 13s) << "twice, where a scope of systemd's was tried first";
    } else {
      EXPECT_LT(took, 4s);
    }
  }
}

TEST_F(GuardianUnit, HearsHeartbeatsFromArmedToZeroAndNoLonger) {
  const auto guardian = make();
  std::this_thread::sleep_for(100ms);
  EXPECT_EQ(count("b"), 0u) << "nothing is energized";
  guardian->arm("coils");
  ASSERT_TRUE(hears("a"));
  ASSERT_TRUE(hears("b", 20));
  std::vector<double> beats;
  for (const Heard& one : heard())
    if (one.text == "b") beats.push_back(one.time);
  // One each 20 ms; a loaded machine makes single ones late, and the next gap short.
  std::vector<double> gaps;
  for (std::size_t i = 1; i < 20; ++i) gaps.push_back(beats[i] - beats[i - 1]);
  std::sort(gaps.begin(), gaps.end());
  EXPECT_GT(gaps[9], 0.018);
  EXPECT_LT(gaps[5], 0.035);
  guardian->disarm("coils");
  ASSERT_TRUE(hears("d"));
  const std::size_t before = count("b");
  std::this_thread::sleep_for(150ms);
  EXPECT_EQ(count("b"), before);
  EXPECT_EQ(heard().back().text, "d") << "no beat follows the last zero";
  EXPECT_EQ(order(), "ad");
}

TEST_F(GuardianUnit, IsArmedByTheFirstOutputAndDisarmedByTheLast) {
  const auto guardian = make();
  guardian->disarm("coils");
  guardian->arm("coils");
  guardian->arm("coils");
  guardian->arm("lamp");
  guardian->disarm("coils");
  guardian->disarm("coils");
  ASSERT_TRUE(hears("b", 3));
  EXPECT_EQ(order(), "a") << "the lamp still shines";
  guardian->disarm("pump");
  guardian->disarm("lamp");
  ASSERT_TRUE(hears("d"));
  guardian->arm("lamp");
  ASSERT_TRUE(hears("a", 2));
  guardian->disarm("lamp");
  ASSERT_TRUE(hears("d", 2));
  EXPECT_EQ(order(), "adad");
}

TEST_F(GuardianUnit, HearsNothingFromAHostThatDoesNotMove) {
  const auto guardian = make();
  guardian->arm("coils");
  ASSERT_TRUE(hears("b", 2));
  healthy = false;
  std::this_thread::sleep_for(60ms);
  const std::size_t before = count("b");
  std::this_thread::sleep_for(200ms);
  EXPECT_EQ(count("b"), before);
  healthy = true;
  EXPECT_TRUE(hears("b", before + 3));
}

TEST_F(GuardianUnit, IsSentAwayAndWaitedForWhenAllIsAtZero) {
  auto guardian = make();
  const pid_t process = guardian->process();
  guardian->arm("coils");
  guardian->disarm("coils");
  guardian.reset();
  EXPECT_EQ(order(), "adq");
  EXPECT_FALSE(is_there(process)) << "its end is seen";
}

TEST_F(GuardianUnit, IsLeftToItsWorkWhereSomethingMayStillBeEnergized) {
  mode("lingers");
  auto guardian = make();
  const pid_t process = guardian->process();
  guardian->arm("coils");
  const auto began = Steady::now();
  guardian.reset();
  EXPECT_LT(Steady::now() - began, 600ms) << "it is not waited for";
  EXPECT_TRUE(hears("x"));
  EXPECT_EQ(order(), "ax");
  ::waitpid(process, nullptr, 0);
}

TEST_F(GuardianUnit, ThatIsGoneIsMissedWithAndWithoutACurrent) {
  for (const bool armed : {false, true}) {
    const auto guardian = make();
    if (armed) guardian->arm("coils");
    EXPECT_FALSE(guardian->lost());
    ::kill(guardian->process(), SIGKILL);
    const auto began = Steady::now();
    while (!guardian->lost() && Steady::now() - began < 5s) std::this_thread::sleep_for(1ms);
    EXPECT_LT(Steady::now() - began, 1s) << armed;
    try {
      guardian->arm("lamp");
      FAIL() << "a current without a guardian";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.kind, DeviceErrorKind::lost);
    }
    EXPECT_THROW(guardian->arm("coils"), DeviceError) << "armed before, and of no use now";
  }
}

TEST_F(GuardianUnit, IsArmedBeforeACurrentAndDisarmedAfterTheZero) {
  const auto guardian = make();
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  coils->set_currents(Currents{0, 0, 0});
  EXPECT_EQ(amplifier.by_then, "");
  coils->set_currents(Currents{0, 0, -1});
  EXPECT_EQ(amplifier.by_then, "a") << "before it flowed";
  EXPECT_EQ(amplifier.now, (Currents{0, 0, -1}));
  coils->set_currents(Currents{1, 0, 0});
  coils->set_currents(Currents{0, 0, 0});
  EXPECT_EQ(amplifier.by_then, "a") << "still armed while the zero was on its way";
  EXPECT_TRUE(hears("d"));
  coils->set_currents(Currents{1, 1, 1});
  EXPECT_EQ(amplifier.by_then, "ada");
  coils->make_safe();
  EXPECT_EQ(amplifier.by_then, "ada");
  EXPECT_EQ(amplifier.made_safe, 1);
  EXPECT_TRUE(hears("d", 2));
  EXPECT_EQ(coils->identity(), "asking");
  EXPECT_EQ(coils->channels(), 3);
  EXPECT_EQ(coils->current_limit(), 7);
  EXPECT_EQ(coils->currents(), (Currents{1, 1, 1}));
  EXPECT_EQ(coils->measured_currents(), (Currents{1, 2, 3}));
  EXPECT_EQ(coils->link_state().owed, 5ms);
  EXPECT_EQ(coils->enable_line(), nullptr);
}

TEST_F(GuardianUnit, StaysArmedWhereTheZeroWasNotTaken) {
  const auto guardian = make();
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  coils->set_currents(Currents{1, 1, 1});
  amplifier.gone = true;
  EXPECT_THROW(coils->set_currents(Currents{0, 0, 0}), DeviceError);
  EXPECT_THROW(coils->make_safe(), DeviceError);
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(order(), "a");
  amplifier.gone = false;
  coils->make_safe();
  EXPECT_TRUE(hears("d"));
}

TEST_F(GuardianUnit, ThatIsGoneLetsNoCurrentThroughButAZero) {
  const auto guardian = make();
  AskingCoils amplifier(*this);
  const auto coils = guarded(amplifier, *guardian);
  ::kill(guardian->process(), SIGKILL);
  const auto began = Steady::now();
  while (!guardian->lost() && Steady::now() - began < 5s) std::this_thread::sleep_for(1ms);
  EXPECT_THROW(coils->set_currents(Currents{1, 0, 0}), DeviceError);
  EXPECT_TRUE(amplifier.now.empty()) << "it never reached the amplifier";
  coils->set_currents(Currents{0, 0, 0});
  EXPECT_EQ(amplifier.now, (Currents{0, 0, 0}));
  coils->make_safe();
  EXPECT_EQ(amplifier.made_safe, 1);
}

class AskingLamp : public Lamp {
 public:
  explicit AskingLamp(GuardianUnit& test) : test_(test) {}
  std::string identity() const override { return "a lamp"; }
  void set_level(double level) override {
    std::this_thread::sleep_for(50ms);
    by_then = test_.order();
    level_ = level;
  }
  double level() const override { return level_; }
  void ask() override { ++asked; }
  void make_safe() override { set_level(0); }
  LinkState link_state() const override {
    LinkState state;
    state.owed = 7ms;
    return state;
  }
  std::string by_then;
  int asked = 0;

 private:
  GuardianUnit& test_;
  double level_ = 0;
};

TEST_F(GuardianUnit, IsArmedBeforeALightAndDisarmedInTheDark) {
  const auto guardian = make();
  AskingLamp bulb(*this);
  const auto lamp = guarded(bulb, *guardian);
  lamp->set_level(0);
  EXPECT_EQ(bulb.by_then, "");
  lamp->set_level(0.5);
  EXPECT_EQ(bulb.by_then, "a");
  EXPECT_EQ(lamp->level(), 0.5);
  lamp->set_level(0);
  EXPECT_EQ(bulb.by_then, "a");
  EXPECT_TRUE(hears("d"));
  lamp->set_level(1);
  lamp->make_safe();
  EXPECT_EQ(bulb.by_then, "ada");
  EXPECT_EQ(bulb.level(), 0);
  EXPECT_TRUE(hears("d", 2));
  lamp->ask();
  EXPECT_EQ(bulb.asked, 1);
  EXPECT_EQ(lamp->identity(), "a lamp");
  EXPECT_EQ(lamp->link_state().owed, 7ms);
  EXPECT_EQ(lamp->enable_line(), nullptr);
}

class AskingPump : public Instrument {
 public:
  explicit AskingPump(GuardianUnit& test) : test_(test) { info_.kind = "pump"; }
  const InstrumentInfo& info() const override { return info_; }
  QuantitySample read(std::size_t index, Time) override {
    return {.quantity = index, .value = 4.0};
  }
  void set(std::size_t index, const QuantityValue&) override {
    act("set " + std::to_string(index));
  }
  void command(std::size_t index, const std::vector<QuantityValue>&) override {
    act("command " + std::to_string(index));
  }
  Latest latest(std::size_t) const override { return {.fault = "none yet"}; }
  void on_poll(PollListener listener) override { listener(9, {}); }
  void make_safe() override { act("make_safe"); }
  std::string did, by_then;

 private:
  void act(const std::string& what) {
    std::this_thread::sleep_for(50ms);
    did = what;
    by_then = test_.order();
  }
  GuardianUnit& test_;
  InstrumentInfo info_;
};

TEST_F(GuardianUnit, IsArmedBeforeAFreeInstrumentIsSetOrCommandedUntilItIsSafe) {
  const auto guardian = make();
  AskingPump machine(*this);
  const auto pump = guarded(machine, *guardian, "pump");
  EXPECT_EQ(pump->read(2, 1s).quantity, 2u);
  EXPECT_EQ(pump->latest(0).fault, "none yet");
  std::size_t polled = 0;
  pump->on_poll([&](std::size_t index, const Instrument::Latest&) { polled = index; });
  EXPECT_EQ(polled, 9u);
  EXPECT_EQ(pump->info().kind, "pump");
  EXPECT_EQ(order(), "") << "to read energizes nothing";
  for (int i = 0; i < 2; ++i) {
    if (i == 0)
      pump->set(1, 0.0);
    else
      pump->command(3, {});
    EXPECT_EQ(machine.did, i == 0 ? "set 1" : "command 3");
    EXPECT_EQ(machine.by_then, i == 0 ? "a" : "ada");
    pump->make_safe();
    EXPECT_EQ(machine.did, "make_safe");
    EXPECT_EQ(machine.by_then, i == 0 ? "a" : "ada");
    EXPECT_TRUE(hears("d", static_cast<std::size_t>(i + 1)));
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
