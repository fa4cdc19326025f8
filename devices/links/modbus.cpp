// SPDX-License-Identifier: Apache-2.0
#include "devices/links/modbus.h"

#include "devices/links/dialogue.h"
#include "devices/links/printable.h"
#include "devices/time/error.h"

#include <algorithm>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::modbus {
namespace {

/// Adapters hand bytes over in blocks (FTDI's latency timer: 16 ms), so a shorter pause of theirs
/// is no end of a frame.
constexpr Time kBlock = std::chrono::milliseconds(20);
/// Above 19200 baud the silence is 1.75 ms at any rate (MSL 2.5.1.1).
constexpr Time kLeastSilence = std::chrono::microseconds(1750);

struct Question {
  std::uint8_t unit = 0;
  std::uint8_t function = 0;
  std::string words;  ///< "read holding registers 0 to 3 of unit 1"
  bool answered_by(std::span<const std::uint8_t> frame) const {
    return frame.size() >= 2 && frame[0] == unit && (frame[1] & ~kException) == function;
  }
};

std::string in_words(std::uint8_t unit, std::span<const std::uint8_t> pdu) {
  const auto function = static_cast<Function>(pdu[0]);
  std::string words = to_string(function);
  if (pdu.size() >= 5 && words.find("function") == std::string::npos) {
    const int first = word_at(pdu, 1);
    const bool one = function == Function::write_coil || function == Function::write_register;
    const int count = one ? 1 : word_at(pdu, 3);
    words += " " + std::to_string(first);
    if (count > 1) words += " to " + std::to_string(first + count - 1);
  }
  return words + " of unit " + std::to_string(unit);
}

/// What both framings have in common: the turn, the bytes that have come, and what an answer says.
class AnyClient : public Client {
 public:
  AnyClient(std::unique_ptr<ByteLink> link, const Settings& settings, Clock& clock)
      : settings_(settings), dialogue_(std::move(link), settings.name, clock) {
    if (settings.reply_timeout <= Time::zero())
      throw std::invalid_argument("reply_timeout: must be above 0");
    for (const Time time : {settings.late, settings.character, settings.turnaround})
      if (time < Time::zero()) throw std::invalid_argument("settings: no time may be negative");
  }

  std::vector<bool> read_coils(std::uint8_t unit, int first, int count) override {
    return read_bits(unit, Function::read_coils, first, count);
  }
  std::vector<bool> read_discrete_inputs(std::uint8_t unit, int first, int count) override {
    return read_bits(unit, Function::read_discrete_inputs, first, count);
  }
  std::vector<std::uint16_t> read_holding_registers(std::uint8_t unit, int first,
                                                    int count) override {
    return read_words(unit, Function::read_holding_registers, first, count);
  }
  std::vector<std::uint16_t> read_input_registers(std::uint8_t unit, int first,
                                                  int count) override {
    return read_words(unit, Function::read_input_registers, first, count);
  }
  void write_coil(std::uint8_t unit, int address, bool on) override {
    write(unit, checked([&] { return write_coil_request(address, on); }));
  }
  void write_register(std::uint8_t unit, int address, std::uint16_t value) override {
    write(unit, checked([&] { return write_register_request(address, value); }));
  }
  void write_coils(std::uint8_t unit, int first, const std::vector<bool>& values) override {
    write(unit, checked([&] { return write_coils_request(first, values); }));
  }
  void write_registers(std::uint8_t unit, int first,
                       std::span<const std::uint16_t> values) override {
    write(unit, checked([&] { return write_registers_request(first, values); }));
  }

  ByteString ask(std::uint8_t unit, std::span<const std::uint8_t> pdu) override {
    if (pdu.empty()) throw std::invalid_argument("pdu: must not be empty");
    const Dialogue::Turn turn(dialogue_);
    const Question question{unit, pdu[0], in_words(unit, pdu)};
    ByteString answer = exchange(question, pdu);
    if (answer.size() >= 2 && (answer[0] & kException) != 0) refuse(question, answer[1]);
    return answer;
  }

  bool lost() const override { return dialogue_.lost(); }
  void reopen() override {
    come_.clear();
    dialogue_.reopen();
    forget();
  }

 protected:
  /// The answer's PDU, of the right unit and function; empty of a broadcast.
  virtual ByteString exchange(const Question& question, std::span<const std::uint8_t> pdu) = 0;
  virtual void forget() {}

  /// Waits until so many bytes have come; they stay in come_.
  void need(std::size_t count, Time deadline) {
    while (come_.size() < count) {
      if (come_.empty()) {
        come_ = dialogue_.take(1, deadline);
      } else if (const auto byte = dialogue_.next(deadline)) {
        come_.push_back(*byte);
      } else {
        dialogue_.fail(DeviceErrorKind::timeout,
                       dialogue_.description() + ": only " + std::to_string(come_.size()) + " of " +
                           std::to_string(count) +
                           " bytes of an answer came in time: " + printable(come_));
      }
    }
  }
  /// The first bytes of come_, which are in it no more.
  ByteString taken(std::size_t count) {
    ByteString bytes(come_.begin(), come_.begin() + static_cast<std::ptrdiff_t>(count));
    come_.erase(come_.begin(), come_.begin() + static_cast<std::ptrdiff_t>(count));
    return bytes;
  }
  [[noreturn]] void confused(const Question& question, const std::string& what) {
    dialogue_.fail(DeviceErrorKind::protocol,
                   dialogue_.description() + ": to \"" + question.words + "\" " + what);
  }

  const Settings settings_;
  Dialogue dialogue_;
  ByteString come_;  // of a frame that is not whole yet

 private:
  /// On TCP unit 0 is the instrument itself, and answers (Messaging on TCP/IP, 4.4.2.3).
  bool broadcast(std::uint8_t unit) const { return unit == 0 && settings_.framing == Framing::rtu; }
  template <class Build>
  ByteString checked(const Build& build) {
    try {
      return build();
    } catch (const std::invalid_argument& problem) {
      throw DeviceError(DeviceErrorKind::out_of_range, settings_.name, problem.what());
    }
  }
  [[noreturn]] void refuse(const Question& question, std::uint8_t code) {
    constexpr std::uint8_t kTargetSilent = 11;
    dialogue_.fail(code == kTargetSilent ? DeviceErrorKind::timeout : DeviceErrorKind::refused,
                   "to \"" + question.words + "\" it says: " + exception_name(code) +
                       " (exception " + std::to_string(code) + ")");
  }
  /// MAP 6.1 to 6.4: function, count of bytes, bytes.
  ByteString read(std::uint8_t unit, Function function, int first, int count,
                  std::size_t (*size)(int count)) {
    const ByteString pdu = checked([&] {
      if (broadcast(unit)) throw std::invalid_argument("unit: a broadcast is not answered");
      return read_request(function, first, count);
    });
    const ByteString answer = ask(unit, pdu);
    const std::size_t wanted = size(count);
    if (answer.size() != 2 + wanted || answer[1] != wanted)
      confused({unit, pdu[0], in_words(unit, pdu)},
               "it answers " + std::to_string(answer.size() - 1) + " bytes in place of " +
                   std::to_string(1 + wanted) + ": " + printable(answer));
    return {answer.begin() + 2, answer.end()};
  }
  std::vector<bool> read_bits(std::uint8_t unit, Function function, int first, int count) {
    const auto size = [](int bits) { return (static_cast<std::size_t>(bits) + 7) / 8; };
    return unpack_bits(read(unit, function, first, count, size), count);
  }
  std::vector<std::uint16_t> read_words(std::uint8_t unit, Function function, int first,
                                        int count) {
    const auto size = [](int words) { return 2 * static_cast<std::size_t>(words); };
    const ByteString bytes = read(unit, function, first, count, size);
    std::vector<std::uint16_t> words;
    for (std::size_t at = 0; at < bytes.size(); at += 2) words.push_back(word_at(bytes, at));
    return words;
  }
  /// MAP 6.5, 6.6, 6.11, 6.12: the answer repeats the first five bytes of the question.
  void write(std::uint8_t unit, const ByteString& pdu) {
    const ByteString answer = ask(unit, pdu);
    if (broadcast(unit)) return;
    if (answer.size() != 5 || !std::equal(answer.begin(), answer.end(), pdu.begin()))
      confused({unit, pdu[0], in_words(unit, pdu)},
               "it answers of something else: " + printable(answer));
  }
};

/// An answer carries no mark of its question: after a time-out nothing is sent until the late
/// answer has come, or cannot come any more. It is known by unit, function, length and CRC,
/// wherever it begins: drivers of RS-485 put a byte of noise before it.
class RtuClient final : public AnyClient {
 public:
  using AnyClient::AnyClient;

 private:
  /// MSL 2.5.1.1.
  Time silence() const {
    const Time by_rate = settings_.character * 7 / 2;
    return settings_.character > Time::zero() ? std::max(by_rate, kLeastSilence) : by_rate;
  }
  Time pause_within() const { return std::max(silence(), kBlock); }
  Clock& clock() const { return dialogue_.clock(); }

  ByteString exchange(const Question& question, std::span<const std::uint8_t> pdu) override {
    wait_for_late_answer();
    come_.clear();
    dialogue_.discard();
    clock().sleep_until(later(last_, silence()));
    const ByteString frame = rtu_frame(question.unit, pdu);
    const Time on_the_line = static_cast<std::int64_t>(frame.size()) * settings_.character;
    dialogue_.send(frame, question.words);
    last_ = later(clock().now(), on_the_line);
    if (settings_.echo) take_echo(question, frame);
    if (question.unit == 0) {
      clock().sleep_until(later(last_, settings_.turnaround));
      return {};
    }
    owed_ = question;
    const Time deadline = later(last_, settings_.reply_timeout);
    owed_until_ = later(deadline, settings_.late);
    return answer(question, frame, deadline);
  }

  void take_echo(const Question& question, const ByteString& frame) {
    const ByteString back = dialogue_.take(frame.size(), later(last_, 10 * kBlock));
    if (back != frame)
      confused(question,
               "the line gives back something else than what is sent: " + printable(back));
  }

  /// What is in come_ of an answer.
  struct Found {
    std::optional<ByteString> pdu;  // of a whole one
    std::size_t wanted = 0;         // of one that has begun: its bytes in all; 0: none has
    std::size_t come = 0;           // and those that are there
    bool wrong_crc = false;         // of one that is whole
  };
  /// `over`: nothing has come for a while, which ends an answer whose length is not known.
  Found look(const Question& question, bool over) const {
    Found found;
    for (std::span<const std::uint8_t> rest(come_); rest.size() >= 2; rest = rest.subspan(1)) {
      if (!question.answered_by(rest)) continue;
      auto size = rtu_answer_size(rest);
      if (!size && rest[1] > 4 && over) size = rest.size();
      if (size && rest.size() >= *size) {
        if (has_right_crc(rest.first(*size))) {
          found.pdu =
              ByteString(rest.begin() + 1, rest.begin() + static_cast<std::ptrdiff_t>(*size) - 2);
          return found;
        }
        found.wrong_crc = true;
      } else if (found.wanted == 0 && (size || rest[1] <= 4)) {
        found.wanted = size.value_or(5);
        found.come = rest.size();
      }
    }
    return found;
  }

  ByteString answer(const Question& question, const ByteString& asked, Time deadline) {
    std::string stranger;
    const Time end = later(deadline, 260 * settings_.character + kBlock);
    for (;;) {
      if (come_.empty() && stranger.empty()) come_ = dialogue_.take(1, deadline);
      const Found begun = look(question, false);
      if (begun.pdu) return settled(*begun.pdu);
      const Time pause = later(clock().now(), pause_within());
      if (const auto byte = dialogue_.next(come_.empty()      ? deadline
                                           : begun.wanted > 0 ? end
                                                              : std::min(pause, end))) {
        come_.push_back(*byte);
        continue;
      }
      last_ = clock().now();
      const Found found = look(question, true);
      if (found.pdu) return settled(*found.pdu);
      if (come_ == asked)
        confused(question, "the line gives back what is sent: is `echo` to be set?");
      if (found.wrong_crc) {
        owed_.reset();
        confused(question, "it answers with a wrong CRC: " + printable(come_));
      }
      if (found.wanted > 0)
        dialogue_.fail(DeviceErrorKind::timeout,
                       dialogue_.description() + ": only " + std::to_string(found.come) + " of " +
                           std::to_string(found.wanted) +
                           " bytes of an answer came in time: " + printable(come_));
      if (!come_.empty()) stranger = printable(std::exchange(come_, {}));
      if (clock().now() >= deadline)
        dialogue_.fail(DeviceErrorKind::timeout, dialogue_.description() + ": to \"" +
                                                     question.words +
                                                     "\" came only what is no answer: " + stranger);
    }
  }
  ByteString settled(const ByteString& pdu) {
    last_ = clock().now();
    owed_.reset();
    come_.clear();
    return pdu;
  }

  void wait_for_late_answer() {
    if (!owed_) return;
    while (clock().now() < owed_until_ && !look(*owed_, true).pdu) {
      const auto byte = dialogue_.next(owed_until_);
      if (!byte) break;
      come_.push_back(*byte);
      last_ = clock().now();
    }
    owed_.reset();
  }
  void forget() override { owed_.reset(); }

  Time last_{};                   // when the line was last busy
  std::optional<Question> owed_;  // its answer has not come
  Time owed_until_{};
};

/// Each answer carries the number of its question: a late one is dropped.
class TcpClient final : public AnyClient {
 public:
  using AnyClient::AnyClient;

 private:
  ByteString exchange(const Question& question, std::span<const std::uint8_t> pdu) override {
    ++transaction_;
    dialogue_.send(tcp_frame(transaction_, question.unit, pdu), question.words);
    const Time deadline = later(dialogue_.clock().now(), settings_.reply_timeout);
    for (;;) {
      need(kMbap, deadline);
      const auto header = parse_mbap(come_);
      if (!header) {
        const ByteString junk = std::exchange(come_, {});
        dialogue_.abandon();  // where the next frame begins is not known
        confused(question,
                 "came what is no Modbus: " + printable(junk) + "; the connection is given up");
      }
      need(kMbap + header->pdu_size, deadline);
      const ByteString frame = taken(kMbap + header->pdu_size);
      if (header->transaction != transaction_) continue;
      if (!question.answered_by({frame.begin() + kMbap - 1, frame.end()}))
        confused(question, "it answers of something else: " + printable(frame));
      return {frame.begin() + kMbap, frame.end()};
    }
  }

  std::uint16_t transaction_ = 0;
};

}  // namespace

std::unique_ptr<Client> make_client(std::unique_ptr<ByteLink> link, const Settings& settings,
                                    Clock& clock) {
  if (settings.framing == Framing::tcp)
    return std::make_unique<TcpClient>(std::move(link), settings, clock);
  return std::make_unique<RtuClient>(std::move(link), settings, clock);
}

}  // namespace vitreo::modbus
