// USBTMC's framing against a stand-in from the specification's words, on the virtual clock.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/usbtmc_frames.h"
#include "devices/links/usbtmc_link.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"
#include "tests/devices/links/usbtmc_stand_in.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

// USBTMC 1.0, tables 3 and 4: "*IDN?" as a message, and the request for its answer.
TEST(UsbtmcFrames, AreThoseOfTheStandardsTables) {
  EXPECT_EQ(usbtmc::message_out(1, bytes("*IDN?"), true),
            (ByteString{1, 1, 0xFE, 0, 5, 0, 0, 0, 1, 0, 0, 0, '*', 'I', 'D', 'N', '?', 0, 0, 0}));
  EXPECT_EQ(usbtmc::request_in(2, 0x010203), (ByteString{2, 2, 0xFD, 0, 3, 2, 1, 0, 0, 0, 0, 0}));
  EXPECT_EQ(usbtmc::next_tag(1), 2);
  EXPECT_EQ(usbtmc::next_tag(255), 1);
  EXPECT_FALSE(usbtmc::parse_header(ByteString{2, 2, 0xFE, 0, 0, 0, 0, 0, 0, 0, 0, 0}));
  EXPECT_FALSE(usbtmc::parse_header(ByteString{2, 2, 0xFD, 0, 0, 0, 0, 0, 0, 0, 0}));
}

/// The stand-in's transfers without a bus: what it has to give comes at once, or not at all.
class DirectPipe final : public UsbtmcPipe {
 public:
  DirectPipe(UsbtmcStandIn& its, Clock& clock) : its_(its), clock_(clock) {}
  const std::string& address() const override { return address_; }
  std::uint8_t interface_number() const override { return 0; }
  std::uint8_t out_endpoint() const override { return 0x01; }
  std::uint8_t in_endpoint() const override { return 0x82; }
  void out(std::span<const std::uint8_t> transfer, Time) override {
    if (slow) throw DeviceError(DeviceErrorKind::timeout, address_, "it took only a part");
    if (!its_.take(transfer)) throw DeviceError(DeviceErrorKind::refused, address_, "it stalls");
  }
  In in(std::size_t most, Time timeout) override {
    if (rest_.empty()) {
      auto transfer = its_.give();
      if (!transfer) {
        clock_.sleep_for(timeout);
        return {};
      }
      rest_ = std::move(*transfer);
    }
    const std::size_t size = std::min({most, rest_.size(), piece});
    In come{{rest_.begin(), rest_.begin() + static_cast<std::ptrdiff_t>(size)}, false};
    rest_.erase(rest_.begin(), rest_.begin() + static_cast<std::ptrdiff_t>(size));
    come.over = rest_.empty();
    return come;
  }
  ByteString control(const UsbSetup& setup, std::uint16_t length, Time) override {
    auto answer = its_.control(setup, {}, length);
    if (!answer) throw DeviceError(DeviceErrorKind::refused, address_, "it stalls");
    return *answer;
  }
  void clear_halt(std::uint8_t endpoint) override { its_.control({0x02, 1, 0, endpoint}, {}, 0); }
  void reopen() override {}
  bool slow = false;
  std::size_t piece = 1 << 20;  // what comes before the deadline is looked at again

 private:
  const std::string address_ = "usbtmc:1bfa:0498";
  UsbtmcStandIn& its_;
  Clock& clock_;
  ByteString rest_;
};

struct UsbtmcTest : ::testing::Test {
  UsbtmcTest() {
    auto own = std::make_unique<DirectPipe>(instrument, *clock);
    pipe = own.get();
    link = usbtmc_link(std::move(own), *clock);
  }
  std::string failure_of(const std::function<void()>& work) {
    try {
      work();
    } catch (const DeviceError& error) {
      return error.what();
    }
    ADD_FAILURE() << "no error";
    return "";
  }
  bool was_asked(int request) const {
    return std::count(instrument.requests.begin(), instrument.requests.end(), request) > 0;
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  UsbtmcStandIn instrument;
  DirectPipe* pipe = nullptr;
  std::unique_ptr<MessageLink> link;
};

TEST_F(UsbtmcTest, CarriesMessagesOfAllLengths) {
  for (std::size_t size = 0; size < 20; ++size) {
    const ByteString message(size, static_cast<std::uint8_t>(size));
    link->write(message, 1s);
    ASSERT_EQ(instrument.heard.back(), message);
    ASSERT_EQ(link->read(99, 1s), message);
    instrument.fills_up = !instrument.fills_up;
  }
}

TEST_F(UsbtmcTest, SplitsWhatIsLongAndJoinsWhatComesInParts) {
  ByteString large(200000);
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<std::uint8_t>(i * 13);
  instrument.most_at_once = 30000;
  pipe->piece = 4096;
  link->write(large, 1s);
  EXPECT_EQ(instrument.heard.back(), large);
  EXPECT_EQ(link->read(300000, 1s), large);
  EXPECT_EQ(std::count(instrument.tags.begin(), instrument.tags.end(), 0), 0);
}

TEST_F(UsbtmcTest, TagsCountFromOneTo255) {
  for (int i = 0; i < 200; ++i) {
    link->write(bytes("a"), 1s);
    link->read(9, 1s);
  }
  for (std::size_t i = 0; i < instrument.tags.size(); ++i)
    ASSERT_EQ(instrument.tags[i], i % 255 + 1);
}

TEST_F(UsbtmcTest, AnAnswerThatIsLateIsTakenByTheNextRead) {
  instrument.silent = true;
  link->write(bytes("a?"), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  EXPECT_EQ(clock->now(), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  instrument.silent = false;
  EXPECT_EQ(link->read(9, 1s), bytes("a?"));
  EXPECT_EQ(instrument.tags.size(), 2U) << "it was asked for once";
}

// 4.2.1.4: a new message may not be sent while a read is under way.
TEST_F(UsbtmcTest, AWriteEndsAReadThatWasNotAnswered) {
  instrument.silent = true;
  instrument.pendings = 2;
  link->write(bytes("a?"), 1s);
  EXPECT_EQ(link->read(9, 1s), std::nullopt);
  link->write(bytes("b?"), 1s);
  EXPECT_TRUE(was_asked(3) && was_asked(4));
  instrument.silent = false;
  instrument.output.pop_front();  // the instrument has dropped the answer that was not read
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
}

TEST_F(UsbtmcTest, ClearsTheDevice) {
  link->write(bytes("a?"), 1s);
  instrument.pendings = 3;
  link->clear(1s);
  EXPECT_TRUE(was_asked(5) && was_asked(6) && was_asked(1)) << "and the halt is cleared";
  instrument.silent = true;
  EXPECT_EQ(link->read(9, 100ms), std::nullopt);
  instrument.silent = false;
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
  instrument.refuses_clear = true;
  EXPECT_EQ(failure_of([&] { link->clear(1s); }),
            "usbtmc:1bfa:0498: it refuses a device clear, with status 128 (refused)");
  instrument.refuses_clear = false;
  instrument.pendings = 1 << 20;
  EXPECT_EQ(failure_of([&] { link->clear(1s); }),
            "usbtmc:1bfa:0498: a device clear is not over in time (timeout)");
}

TEST_F(UsbtmcTest, TakesBackWhatTheInstrumentDoesNotTake) {
  pipe->slow = true;
  EXPECT_NE(failure_of([&] { link->write(bytes("a"), 1s); }).find("(timeout)"), std::string::npos);
  EXPECT_TRUE(was_asked(1) && was_asked(2));
  pipe->slow = false;
  instrument.halted = true;
  EXPECT_NE(failure_of([&] { link->write(bytes("a"), 1s); }).find("(refused)"), std::string::npos);
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
}

TEST_F(UsbtmcTest, TellsATransferThatAnswersSomethingElse) {
  instrument.wrong_tag = true;
  link->write(bytes("a?"), 1s);
  EXPECT_NE(failure_of([&] { link->read(9, 1s); }).find("a transfer that does not answer"),
            std::string::npos);
  instrument.wrong_tag = false;
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("b?"));
}

TEST_F(UsbtmcTest, DropsAMessageThatIsTooLong) {
  instrument.most_at_once = 10;
  link->write(ByteString(100, 'x'), 1s);
  EXPECT_EQ(failure_of([&] { link->read(50, 1s); }),
            "usbtmc:1bfa:0498: a message of 100 bytes, more than 50 (protocol)");
  link->write(bytes("b?"), 1s);
  EXPECT_EQ(link->read(50, 1s), bytes("b?"));
}

TEST(UsbtmcAddress, ThatIsNoneIsNamed) {
  const auto clock = virtual_clock();
  for (const char* bad : {"1bfa", "1bfa:498", "xxxx:0498", "usbtmc0"})
    EXPECT_THROW(open_usbtmc(bad, *clock), std::invalid_argument) << bad;
  EXPECT_THROW(usbtmc_link(nullptr, *clock), std::invalid_argument);
  try {
    open_usbtmc("/dev/usbtmc77", *clock);
    ADD_FAILURE();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::not_found);
    EXPECT_EQ(error.device, "usbtmc:/dev/usbtmc77");
  }
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
