// A dialogue over a byte link: whole replies within a deadline, one exchange at a time, errors
// under the device's name.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/dialogue.h"

#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct DialogueTest : ::testing::Test {
  Time in(Time time) const { return clock->now() + time; }
  DeviceErrorKind kind_of(const std::function<void()>& work, const std::string& saying = "") {
    try {
      work();
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "focus");
      EXPECT_NE(std::string(error.what()).find(saying), std::string::npos) << error.what();
      return error.kind;
    }
    ADD_FAILURE() << "no error";
    return DeviceErrorKind::refused;
  }

  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
  EchoPeer peer;
  Dialogue dialogue{memory_byte_link(peer, *clock, {0ms, 1ms}, &faults), "focus", *clock};
};

TEST_F(DialogueTest, TakesABlockOfAFixedLengthWhateverIsInIt) {
  dialogue.send("a\r\nb\rc");
  EXPECT_EQ(dialogue.take(5, in(1s)), bytes("a\r\nb\r"));
  EXPECT_EQ(dialogue.take(1, in(1s)), bytes("c"));
}

TEST_F(DialogueTest, TakesALineAndLeavesTheNextOne) {
  dialogue.send("one\ntwo\n");
  EXPECT_EQ(dialogue.line('\n', 80, in(1s)), "one");
  EXPECT_EQ(dialogue.line('\n', 80, in(1s)), "two");
}

TEST_F(DialogueTest, SaysHowMuchOfAReplyCame) {
  EXPECT_EQ(kind_of([&] { dialogue.take(3, in(1s)); }, "says nothing"), DeviceErrorKind::timeout);
  EXPECT_EQ(clock->now(), 1s);
  dialogue.send("ab");
  EXPECT_EQ(kind_of([&] { dialogue.take(3, in(1s)); }, "only 2 of 3 bytes came in time: ab"),
            DeviceErrorKind::timeout);
  dialogue.send("ab\x01");
  EXPECT_EQ(kind_of([&] { dialogue.line('\n', 80, in(1s)); }, "ab\\x01"), DeviceErrorKind::timeout);
}

TEST_F(DialogueTest, NamesTheQuestionThatHasNoAnswerAndItsOwnNameForIt) {
  faults.silent = true;
  dialogue.send("*IDN?\n");
  EXPECT_EQ(kind_of([&] { dialogue.line('\n', 80, in(500ms)); },
                    "focus: emulated says nothing to \"*IDN?\" within 0.5 s (timeout)"),
            DeviceErrorKind::timeout);
  dialogue.send("c\r", "get position");
  EXPECT_EQ(kind_of([&] { dialogue.take(13, in(2s)); },
                    "emulated says nothing to \"get position\" within 2 s (timeout)"),
            DeviceErrorKind::timeout);
}

TEST_F(DialogueTest, SaysInTheNextErrorThatTheLastAnswerCameLate) {
  faults.late = 800ms;
  dialogue.send("c\r", "get position");
  EXPECT_EQ(kind_of([&] { dialogue.take(2, in(500ms)); }, "within 0.5 s (timeout)"),
            DeviceErrorKind::timeout);
  clock->sleep_for(500ms);
  faults = {.silent = true};
  dialogue.send("s\r", "get status");
  dialogue.discard();
  EXPECT_EQ(kind_of([&] { dialogue.take(2, in(500ms)); },
                    "says nothing to \"get status\" within 0.5 s; \"c\\x0D\" came within 1 s of "
                    "\"get position\", and not within 0.5 s (timeout)"),
            DeviceErrorKind::timeout);
  // An answer in time ends that.
  faults = {};
  dialogue.send("s\r");
  EXPECT_EQ(dialogue.take(2, in(500ms)), bytes("s\r"));
  faults.silent = true;
  dialogue.send("s\r");
  EXPECT_EQ(kind_of([&] { dialogue.take(2, in(500ms)); }, "to \"s\" within 0.5 s (timeout)"),
            DeviceErrorKind::timeout);
}

TEST_F(DialogueTest, SaysWhatCameInPlaceOfTheRestOfAnAnswer) {
  dialogue.send("\r\n");
  EXPECT_EQ(dialogue.line('\n', 80, in(1s)), "\r");
  EXPECT_EQ(kind_of([&] { dialogue.line('\n', 80, in(1s)); },
                    "says \"\\x0D\\x0A\" to \"\" and no more within"),
            DeviceErrorKind::timeout);
}

TEST_F(DialogueTest, NamesThePartOfItsDeviceInEveryError) {
  Dialogue part(memory_byte_link(peer, *clock, {}, &faults), "focus", *clock, "channel 3");
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { part.send("a"); }, "focus: channel 3: emulated: is gone (lost)"),
            DeviceErrorKind::lost);
  EXPECT_EQ(kind_of([&] { part.send("a"); }, "focus: channel 3: emulated was lost (lost)"),
            DeviceErrorKind::lost);
}

TEST_F(DialogueTest, EndsALineThatHasNoEnd) {
  dialogue.send(std::string(100, 'x'));
  EXPECT_EQ(kind_of([&] { dialogue.line('\n', 80, in(1s)); }, "xxx..."), DeviceErrorKind::protocol);
}

TEST_F(DialogueTest, ThrowsAwayUntilThereIsSilence) {
  dialogue.send("abc");
  dialogue.discard();  // nothing has arrived yet
  dialogue.settle(10ms);
  EXPECT_EQ(dialogue.next(in(1s)), std::nullopt);
}

TEST_F(DialogueTest, DoesNotWaitForeverForSilence) {
  const auto babble = clock->spawn("babble", [&] {
    for (;; clock->sleep_for(5ms)) peer.receive(bytes("x"), clock->now());
  });
  dialogue.settle(10ms);
  EXPECT_LE(clock->now(), 600ms);
}

TEST_F(DialogueTest, StaysLostUntilItIsReopened) {
  faults.unplugged = true;
  EXPECT_EQ(kind_of([&] { dialogue.send("a"); }), DeviceErrorKind::lost);
  EXPECT_TRUE(dialogue.lost());
  EXPECT_EQ(kind_of([&] { dialogue.reopen(); }), DeviceErrorKind::lost);
  faults.unplugged = false;
  EXPECT_EQ(kind_of([&] { dialogue.send("b"); }), DeviceErrorKind::lost);
  EXPECT_TRUE(peer.heard.empty());
  dialogue.reopen();
  dialogue.send("c");
  clock->sleep_for(10ms);  // of a byte on the line
  EXPECT_EQ(peer.heard, bytes("c"));
}

TEST_F(DialogueTest, LetsOneTaskTalkAtATime) {
  ByteString first, second;
  const auto talk = [&](const char* text, ByteString& answer) {
    const Dialogue::Turn turn(dialogue);
    dialogue.send(text);
    answer = dialogue.take(3, in(1s));
  };
  const auto a = clock->spawn("a", [&] { talk("abc", first); });
  const auto b = clock->spawn("b", [&] { talk("xyz", second); });
  a->join();
  b->join();
  EXPECT_EQ(first, bytes("abc"));
  EXPECT_EQ(second, bytes("xyz"));
}

TEST_F(DialogueTest, FinishesAnExchangeBeforeItsTaskIsStopped) {
  ByteString answer;
  bool stopped = false;
  const auto task = clock->spawn("task", [&] {
    try {
      {
        const Dialogue::Turn turn(dialogue);
        dialogue.send("abc");
        answer = dialogue.take(3, in(1s));
      }
      clock->sleep_for(1s);
    } catch (const Stopped&) {
      stopped = true;
      throw;
    }
  });
  clock->sleep_for(1ms);
  task->request_stop();
  task->join();
  EXPECT_EQ(answer, bytes("abc"));
  EXPECT_TRUE(stopped);
}

TEST_F(DialogueTest, WantsALink) {
  EXPECT_THROW(Dialogue(nullptr, "focus", *clock), std::invalid_argument);
}

TEST(Printable, ShowsWhatCannotBePrintedAsHexAndCutsWhatIsLong) {
  EXPECT_EQ(printable("a\r\xFF"), "a\\x0D\\xFF");
  EXPECT_EQ(printable(std::string(41, 'x')), std::string(40, 'x') + "...");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
