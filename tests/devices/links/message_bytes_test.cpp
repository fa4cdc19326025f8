// Byte link over a message link: an answer is read only when one is due.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/message_bytes.h"

#include "devices/links/dialogue.h"

#include <gtest/gtest.h>

#include <deque>
#include <string>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

/// Counts what is asked of it; says what is put into it.
struct Counted final : MessageLink {
  const std::string& address() const override { return name; }
  void write(std::span<const std::uint8_t> message, Time) override {
    heard.emplace_back(message.begin(), message.end());
  }
  std::optional<ByteString> read(std::size_t, Time) override {
    ++reads;
    if (says.empty()) return std::nullopt;
    const std::string first = says.front();
    says.pop_front();
    return ByteString(first.begin(), first.end());
  }
  void clear(Time) override { ++clears; }
  void reopen() override {}
  std::string name = "usbtmc:1bfa:0498";
  std::vector<std::string> heard;
  std::deque<std::string> says;
  int reads = 0, clears = 0;
};

TEST(MessageBytes, NothingIsReadFromTheInstrumentBeforeItWasAsked) {
  const auto clock = virtual_clock();
  auto owned = std::make_unique<Counted>();
  Counted& bus = *owned;
  Dialogue dialogue(message_bytes(std::move(owned), "\n", *clock), "probe", *clock);
  dialogue.settle(50ms);
  dialogue.discard();
  EXPECT_EQ(bus.reads, 0);
  bus.says = {"0.125"};
  dialogue.send("FETC?\n");
  EXPECT_EQ(dialogue.line('\n', 100, clock->now() + 1s), "0.125");
  EXPECT_EQ(bus.reads, 1);
  dialogue.settle(50ms);
  EXPECT_EQ(bus.reads, 1) << "its answer has come";
  EXPECT_EQ(bus.heard, std::vector<std::string>{"FETC?\n"});
  bus.says = {"1\n"};
  dialogue.send("A?\n");
  EXPECT_EQ(dialogue.line('\n', 100, clock->now() + 1s), "1") << "one line's end, not two";
}

TEST(MessageBytes, AnAnswerThatDidNotComeIsCalledBackBeforeTheNextQuestion) {
  const auto clock = virtual_clock();
  auto owned = std::make_unique<Counted>();
  Counted& bus = *owned;
  const auto link = message_bytes(std::move(owned), "\n", *clock);
  const std::string question = "A?\n";
  const ByteString sent(question.begin(), question.end());
  link->write(sent, 1s);
  EXPECT_TRUE(link->read(100, 1s).empty());
  EXPECT_EQ(bus.clears, 0);
  link->write(sent, 1s);
  EXPECT_EQ(bus.clears, 1);
  bus.says = {"2"};
  EXPECT_EQ(link->read(1, 1s), ByteString{'2'});
  EXPECT_EQ(link->read(100, 0s), ByteString{'\n'});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
