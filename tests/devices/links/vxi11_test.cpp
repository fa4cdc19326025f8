// VXI-11 against a stand-in from the specification's words, on the virtual clock: messages in
// parts, time-outs, locks, device clear, junk.
// SPDX-License-Identifier: Apache-2.0
#include "devices/links/onc_rpc.h"
#include "devices/links/vxi11_link.h"
#include "devices/time/error.h"
#include "tests/devices/links/echo_peer.h"

#include <gtest/gtest.h>

#include <deque>
#include <functional>
#include <optional>
#include <stdexcept>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

struct Failure {
  DeviceErrorKind kind = DeviceErrorKind::not_found;
  std::string text;
};
Failure failure_of(const std::function<void()>& work) {
  try {
    work();
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.device, "vxi11:10.0.0.7");
    return {error.kind, error.text};
  }
  ADD_FAILURE() << "no error";
  return {};
}

// RFC 4506, chapter 4: four bytes a word, the length before the bytes, zeros behind.
TEST(Xdr, IsThatOfTheStandard) {
  XdrWriter writer;
  writer.word(0x01020304).text("hello").opaque({});
  EXPECT_EQ(writer.bytes(),
            (ByteString{1, 2, 3, 4, 0, 0, 0, 5, 'h', 'e', 'l', 'l', 'o', 0, 0, 0, 0, 0, 0, 0}));
  XdrReader reader(writer.bytes());
  EXPECT_EQ(reader.word(), 0x01020304U);
  EXPECT_EQ(reader.opaque(), bytes("hello"));
  EXPECT_EQ(reader.opaque(), ByteString{});
  EXPECT_THROW(reader.word(), std::out_of_range);
  XdrReader wrong(std::span(writer.bytes()).first(10).subspan(4));
  EXPECT_THROW(wrong.opaque(), std::out_of_range);
}

// RFC 5531, chapter 11: bit 31 of the head marks the last fragment.
TEST(Xdr, RecordsComeInFragments) {
  ByteString stream{0, 0, 0, 2, 'a', 'b', 0x80, 0, 0, 1, 'c', 0x80, 0, 0, 1};
  EXPECT_EQ(onc_rpc::take_record(stream, 99), bytes("abc"));
  EXPECT_EQ(onc_rpc::take_record(stream, 99), std::nullopt);
  stream.push_back('d');
  EXPECT_EQ(onc_rpc::take_record(stream, 99), bytes("d"));
  ByteString endless{0x7F, 0xFF, 0xFF, 0xFF};
  EXPECT_THROW(onc_rpc::take_record(endless, 99), std::length_error);
}

/// An instrument that echoes whole messages; its calls are carried out one after another.
struct Instrument {
  struct Said {
    Time at;
    ByteString bytes;
  };
  Time delay{};  // from a message to its echo
  std::size_t write_size = 1024;
  std::size_t read_size = 1 << 20;  // what one read brings at most
  bool knows_locks = true;
  bool locked_by_other = false;
  bool answers = true;
  std::uint32_t write_error = 0;
  int port = 1024;  // of the port mapper's answer
  std::vector<ByteString> heard;
  ByteString coming;
  std::deque<Said> output;
  int links = 0;
  int clears = 0;
  bool locked = false;
};

class CorePeer final : public BytePeer {
 public:
  explicit CorePeer(Instrument& its) : its_(its) {}
  void receive(std::span<const std::uint8_t> come, Time now) override {
    stream_.insert(stream_.end(), come.begin(), come.end());
    while (const auto record = onc_rpc::take_record(stream_, 1 << 20)) calls_.push_back(*record);
    serve(now);
  }
  std::vector<TimedBytes> say(Time now) override {
    serve(now);
    std::vector<TimedBytes> said;
    if (its_.answers) said.swap(replies_);
    return said;
  }
  Time next() const override {
    if (!replies_.empty() && its_.answers) return replies_.front().at;
    if (!reading_) return kForever;
    return its_.output.empty() ? reading_->until
                               : std::min(reading_->until, its_.output.front().at);
  }

 private:
  struct Read {
    std::uint32_t id;
    std::uint32_t size;
    Time until;
  };
  void serve(Time now) {
    for (;;) {
      if (reading_ && !finish_read(now)) return;
      if (calls_.empty()) return;
      const ByteString record = calls_.front();
      calls_.pop_front();
      XdrReader reader(record);
      carry_out(onc_rpc::parse_call(reader), reader, now);
    }
  }
  void reply(std::uint32_t id, const XdrWriter& results, Time at) {
    replies_.push_back({at, onc_rpc::record(onc_rpc::success(id, results.bytes()))});
  }
  bool finish_read(Time now) {
    const bool there = !its_.output.empty() && its_.output.front().at <= now;
    if (!there && reading_->until > now) return false;
    XdrWriter results;
    if (!there) {
      reply(reading_->id, results.word(vxi11::io_timeout).word(0).opaque({}), reading_->until);
    } else {
      auto& front = its_.output.front();
      const std::size_t size =
          std::min({front.bytes.size(), its_.read_size, static_cast<std::size_t>(reading_->size)});
      const bool last = size == front.bytes.size();
      results.word(0).word(last ? 4 : 1).opaque(std::span(front.bytes).first(size));
      reply(reading_->id, results, now);
      front.bytes.erase(front.bytes.begin(),
                        front.bytes.begin() + static_cast<std::ptrdiff_t>(size));
      if (last) its_.output.pop_front();
    }
    reading_.reset();
    return true;
  }
  void carry_out(const onc_rpc::Call& call, XdrReader& reader, Time now) {
    XdrWriter results;
    if (call.program == vxi11::kMapper) {
      EXPECT_EQ(call.procedure, vxi11::kGetPort);
      EXPECT_EQ(reader.word(), vxi11::kCore);
      return reply(call.id, results.word(static_cast<std::uint32_t>(its_.port)), now);
    }
    EXPECT_EQ(call.program, vxi11::kCore);
    if (call.procedure == vxi11::create_link) {
      reader.word();
      const bool lock = reader.word() != 0;
      reader.word();
      const ByteString device = reader.opaque();
      std::uint32_t error = device == bytes("inst0") ? 0 : 3;
      if (error == 0 && lock && !its_.knows_locks) error = 8;
      if (error == 0 && lock && its_.locked_by_other) error = 11;
      if (error == 0) ++its_.links;
      its_.locked = lock && error == 0;
      return reply(
          call.id,
          results.word(error).word(77).word(1025).word(static_cast<std::uint32_t>(its_.write_size)),
          now);
    }
    EXPECT_EQ(reader.word(), 77U);
    if (call.procedure == vxi11::device_write) {
      reader.word();
      reader.word();
      const bool last = (reader.word() & 8) != 0;
      const ByteString data = reader.opaque();
      EXPECT_LE(data.size(), its_.write_size);
      its_.coming.insert(its_.coming.end(), data.begin(), data.end());
      if (its_.write_error == 0 && last) {
        its_.heard.push_back(its_.coming);
        its_.output.push_back({later(now, its_.delay), std::exchange(its_.coming, {})});
      }
      return reply(call.id,
                   results.word(its_.write_error).word(static_cast<std::uint32_t>(data.size())),
                   now);
    }
    if (call.procedure == vxi11::device_read) {
      const std::uint32_t size = reader.word();
      reading_ = {call.id, size, later(now, std::chrono::milliseconds(reader.word()))};
      return;
    }
    if (call.procedure == vxi11::device_clear) {
      its_.output.clear();
      ++its_.clears;
    }
    if (call.procedure == vxi11::destroy_link) --its_.links;
    reply(call.id, results.word(0), now);
  }

  Instrument& its_;
  ByteString stream_;
  std::deque<ByteString> calls_;
  std::optional<Read> reading_;
  std::vector<TimedBytes> replies_;
};

struct Vxi11Test : ::testing::Test {
  std::unique_ptr<MessageLink> open(const std::string& device = "inst0", int port = 0) {
    return open_vxi11_on(
        "vxi11:10.0.0.7", {"10.0.0.7", device, port},
        [this](int to) {
          ports.push_back(to);
          peers.push_back(std::make_unique<CorePeer>(instrument));
          return memory_byte_link(*peers.back(), *clock, {}, &faults);
        },
        *clock);
  }
  std::unique_ptr<Clock> clock = virtual_clock();
  LinkFaults faults;
  Instrument instrument;
  std::vector<int> ports;
  std::vector<std::unique_ptr<CorePeer>> peers;
};

TEST_F(Vxi11Test, AsksThePortMapperAndLocksTheDevice) {
  const auto link = open();
  EXPECT_EQ(ports, (std::vector<int>{111, 1024}));
  EXPECT_TRUE(instrument.locked);
  EXPECT_EQ(link->description(), "vxi11:10.0.0.7");
}

TEST_F(Vxi11Test, CarriesMessagesWholeInPartsEitherWay) {
  instrument.read_size = 700;
  const auto link = open();
  ByteString large(5000);
  for (std::size_t i = 0; i < large.size(); ++i) large[i] = static_cast<std::uint8_t>(i * 7);
  for (const ByteString& one : {bytes("*IDN?\n"), large, ByteString{}}) {
    link->write(one, 1s);
    EXPECT_EQ(instrument.heard.back(), one);
    EXPECT_EQ(link->read(10000, 1s), one);
  }
  EXPECT_EQ(clock->now(), 0s);
}

TEST_F(Vxi11Test, SaysNothingAtTheTimeOutAndGoesOn) {
  instrument.delay = 3s;
  const auto link = open();
  link->write(bytes("slow?"), 1s);
  EXPECT_EQ(link->read(99, 1s), std::nullopt);
  EXPECT_EQ(clock->now(), 1s);
  EXPECT_EQ(link->read(99, 0s), std::nullopt);
  EXPECT_EQ(link->read(99, 5s), bytes("slow?"));
  EXPECT_EQ(clock->now(), 3s);
}

// The instrument is deaf to its own time-out: the read ends all the same, and the call stays open.
TEST_F(Vxi11Test, ACallWithoutAnAnswerIsTakenUpAgain) {
  const auto link = open();
  link->write(bytes("a"), 1s);
  instrument.answers = false;
  EXPECT_EQ(link->read(99, 1s), std::nullopt);
  EXPECT_LE(clock->now(), 2s);
  const Failure silent = failure_of([&] { link->write(bytes("b"), 1s); });
  EXPECT_EQ(silent.kind, DeviceErrorKind::timeout);
  EXPECT_EQ(silent.text, "it does not answer a read of before");
  instrument.answers = true;
  EXPECT_EQ(link->read(99, 1s), bytes("a"));
  link->write(bytes("b"), 1s);
  EXPECT_EQ(link->read(99, 1s), bytes("b"));
}

TEST_F(Vxi11Test, AStoppedReadLosesNothing) {
  instrument.delay = 100ms;
  const auto link = open();
  link->write(bytes("a"), 1s);
  const auto task = clock->spawn("task", [&] { link->read(99, 1s); });
  clock->sleep_for(50ms);
  task->request_stop();
  task->join();
  EXPECT_EQ(link->read(99, 1s), bytes("a"));
}

TEST_F(Vxi11Test, ClearsTheDevice) {
  instrument.delay = 100ms;
  const auto link = open();
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(99, 50ms), std::nullopt);
  link->clear(1s);
  EXPECT_EQ(instrument.clears, 1);
  EXPECT_EQ(link->read(99, 1s), std::nullopt);
  link->write(bytes("b"), 1s);
  EXPECT_EQ(link->read(99, 1s), bytes("b"));
}

TEST_F(Vxi11Test, DropsAMessageThatIsTooLong) {
  instrument.read_size = 10;
  const auto link = open();
  link->write(ByteString(100, 'x'), 1s);
  link->write(bytes("b"), 1s);
  const Failure found = failure_of([&] { link->read(50, 1s); });
  EXPECT_EQ(found.kind, DeviceErrorKind::protocol);
  EXPECT_EQ(found.text, "a message of 100 bytes, more than 50");
  EXPECT_EQ(link->read(50, 1s), bytes("b"));
}

TEST_F(Vxi11Test, HasOneOwnerWhereTheDeviceKnowsLocks) {
  instrument.locked_by_other = true;
  const Failure owned = failure_of([&] { open(); });
  EXPECT_EQ(owned.kind, DeviceErrorKind::refused);
  EXPECT_EQ(owned.text, "another program has it open");
  instrument.knows_locks = false;
  EXPECT_EQ(open()->description(), "vxi11:10.0.0.7 (which knows no locks)");
}

TEST_F(Vxi11Test, NamesTheErrorsOfTheStandard) {
  const Failure nowhere = failure_of([&] { open("inst9"); });
  EXPECT_EQ(nowhere.kind, DeviceErrorKind::not_found);
  EXPECT_EQ(nowhere.text, "it answers the opening of \"inst9\" with \"device not accessible\" (3)");
  const auto link = open();
  for (const auto& [code, kind, name] :
       {std::tuple{15U, DeviceErrorKind::timeout, "I/O timeout"},
        std::tuple{17U, DeviceErrorKind::protocol, "I/O error"},
        std::tuple{9U, DeviceErrorKind::refused, "out of resources"},
        std::tuple{4U, DeviceErrorKind::lost, "invalid link identifier"}}) {
    instrument.write_error = code;
    const Failure found = failure_of([&] { link->write(bytes("a"), 1s); });
    EXPECT_EQ(found.kind, kind) << name;
    EXPECT_NE(found.text.find(name), std::string::npos) << found.text;
  }
  EXPECT_EQ(failure_of([&] { link->read(9, 1s); }).kind, DeviceErrorKind::lost);
}

TEST_F(Vxi11Test, ThePortMapperMayKnowNoInstrument) {
  instrument.port = 0;
  const Failure found = failure_of([&] { open(); });
  EXPECT_EQ(found.kind, DeviceErrorKind::not_found);
  EXPECT_EQ(found.text, "its port mapper knows no VXI-11 instrument");
}

TEST_F(Vxi11Test, IsLostWithItsConnectionAndComesBack) {
  const auto link = open();
  faults.unplugged = true;
  EXPECT_EQ(failure_of([&] { link->read(9, 1s); }).kind, DeviceErrorKind::lost);
  EXPECT_EQ(failure_of([&] { link->reopen(); }).kind, DeviceErrorKind::lost);
  EXPECT_EQ(failure_of([&] { link->write(bytes("a"), 1s); }).text, "it is closed");
  faults.unplugged = false;
  link->reopen();
  link->write(bytes("a"), 1s);
  EXPECT_EQ(link->read(9, 1s), bytes("a"));
}

TEST_F(Vxi11Test, LetsTheDeviceGo) {
  open().reset();
  EXPECT_EQ(instrument.links, 0);
}

TEST_F(Vxi11Test, JunkIsToldAndEndsTheConnection) {
  struct Junk final : BytePeer {
    void receive(std::span<const std::uint8_t>, Time now) override { at = now; }
    std::vector<TimedBytes> say(Time now) override {
      if (at > now) return {};
      at = kForever;
      return {{now, bytes("HTTP/1.1 400 Bad Request\r\n\r\n")}};
    }
    Time next() const override { return at; }
    Time at = kForever;
  } junk;
  const Failure found = failure_of([&] {
    open_vxi11_on(
        "vxi11:10.0.0.7", {"10.0.0.7", "inst0", 80},
        [&](int) { return memory_byte_link(junk, *clock); }, *clock);
  });
  EXPECT_EQ(found.kind, DeviceErrorKind::protocol);
  EXPECT_NE(found.text.find("none of a remote procedure call"), std::string::npos) << found.text;
}

TEST(InstrumentPlaces, AreRead) {
  const auto place = [](const std::string& text) {
    const InstrumentPlace read = parse_instrument_place("vxi11", text, "inst0");
    return read.host + " " + read.device + " " + std::to_string(read.port);
  };
  EXPECT_EQ(place("10.0.0.7"), "10.0.0.7 inst0 0");
  EXPECT_EQ(place("scope.lab:gpib0,5"), "scope.lab gpib0,5 0");
  EXPECT_EQ(place("[::1]:inst1@1024"), "::1 inst1 1024");
  EXPECT_EQ(place("[::1]"), "::1 inst0 0");
  for (const char* bad :
       {":inst0", "host:", "host:inst0@", "host:inst0@x", "host:@80", "[::1", "[]"})
    EXPECT_THROW(place(bad), std::invalid_argument) << bad;
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
