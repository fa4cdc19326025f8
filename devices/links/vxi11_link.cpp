// SPDX-License-Identifier: Apache-2.0
#include "devices/links/vxi11_link.h"

#include "devices/links/node_lock.h"
#include "devices/links/onc_rpc.h"
#include "devices/links/tcp_link.h"
#include "devices/time/error.h"

#include <algorithm>
#include <limits>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// An instrument answers a call a little after the time-out that the call gave it.
constexpr Time kCallGrace = std::chrono::milliseconds(500);
constexpr Time kOpeningTimeout = std::chrono::seconds(2);
/// What one call asks for at most.
constexpr std::uint32_t kReadSize = 65536;
/// An instrument must take 1024 bytes a call (VXI-11, rule B.6.3); one that says less is mistaken.
constexpr std::uint32_t kLeastWriteSize = 1024;

std::string error_name(std::uint32_t code) {
  switch (code) {
    case 1:
      return "syntax error";
    case 3:
      return "device not accessible";
    case 4:
      return "invalid link identifier";
    case 5:
      return "parameter error";
    case 6:
      return "channel not established";
    case 8:
      return "operation not supported";
    case 9:
      return "out of resources";
    case 11:
      return "device locked by another link";
    case 12:
      return "no lock held by this link";
    case 15:
      return "I/O timeout";
    case 17:
      return "I/O error";
    case 21:
      return "invalid address";
    case 23:
      return "abort";
    default:
      return "error " + std::to_string(code);
  }
}

DeviceErrorKind kind_of_vxi11(std::uint32_t code) {
  switch (code) {
    case vxi11::not_accessible:
    case 21:
      return DeviceErrorKind::not_found;
    case vxi11::invalid_link:
    case vxi11::no_channel:
      return DeviceErrorKind::lost;
    case vxi11::io_timeout:
      return DeviceErrorKind::timeout;
    case vxi11::io_error:
      return DeviceErrorKind::protocol;
    default:
      return DeviceErrorKind::refused;
  }
}

/// ms, rounded up: a deadline that is a fraction of one away has not passed.
std::uint32_t in_milliseconds(Time time) {
  const auto count = std::chrono::ceil<std::chrono::milliseconds>(time).count();
  return static_cast<std::uint32_t>(
      std::clamp<std::int64_t>(count, 0, std::numeric_limits<std::int32_t>::max()));
}

// A call is one question and its answer on the core channel, in order. A device_read that was not
// answered in time, or whose task was stopped, stays on its way: its answer belongs to the message
// that the next read continues.
class Vxi11Link final : public MessageLink {
 public:
  Vxi11Link(std::string address, InstrumentPlace place, ConnectTo connect, Clock& clock)
      : address_(std::move(address)),
        place_(std::move(place)),
        connect_(std::move(connect)),
        clock_(clock) {
    open();
  }
  Vxi11Link(const Vxi11Link&) = delete;
  Vxi11Link& operator=(const Vxi11Link&) = delete;
  // Lets the device go, which an instrument may not notice of a closed connection at once.
  ~Vxi11Link() override {
    if (!core_) return;
    const StopShield shield(clock_);
    try {
      if (!reading_) call(vxi11::destroy_link, XdrWriter().word(link_), kCallGrace);
    } catch (const DeviceError&) {  // it is gone already
    }
  }

  const std::string& address() const override { return address_; }
  std::string description() const override {
    return address_ + (locked_ ? "" : " (which knows no locks)");
  }

  void write(std::span<const std::uint8_t> message, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    drop_read(deadline);
    do {
      const auto part = message.first(std::min<std::size_t>(message.size(), write_size_));
      const bool last = part.size() == message.size();
      const std::size_t took = write_part(part, last, deadline);
      if (took > part.size() || (took == 0 && !part.empty()))
        fail(DeviceErrorKind::protocol, "it says that it took " + std::to_string(took) + " of " +
                                            std::to_string(part.size()) + " bytes");
      message = message.subspan(took);
    } while (!message.empty());
  }

  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    for (;;) {
      const auto part = read_part(deadline);
      if (!part) return std::nullopt;
      size_ += part->data.size();
      if (size_ <= most) come_.insert(come_.end(), part->data.begin(), part->data.end());
      if (part->last) return whole(most);
      if (part->timed_out) return std::nullopt;
    }
  }

  void clear(Time timeout) override {
    const Time deadline = later(clock_.now(), timeout);
    const StopShield shield(clock_);
    if (reading_) abort_read(timeout);
    drop_read(deadline);
    const std::uint32_t left = in_milliseconds(std::max(deadline - clock_.now(), Time::zero()));
    // Flags, lock timeout, I/O timeout.
    ByteString results =
        call(vxi11::device_clear, XdrWriter().word(link_).word(0).word(0).word(left),
             later(timeout, kCallGrace));
    parsed(results, [&](XdrReader& reader) { check(reader.word(), "a device clear"); });
  }

  void reopen() override {
    core_.reset();
    open();
  }

 private:
  struct Part {
    ByteString data;
    bool last = false;
    bool timed_out = false;
  };

  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, address_, what);
  }

  /// Calls the connections; a loss of theirs is the link's.
  template <class Work>
  auto guarded(const Work& work) -> decltype(work()) {
    if (!core_) fail(DeviceErrorKind::lost, "it is closed");
    try {
      return work();
    } catch (const DeviceError& error) {
      // Lost, or out of step after half a record; a refusal is an answer.
      if (error.device != address_ && error.kind != DeviceErrorKind::refused) core_.reset();
      throw renamed(error, address_);
    }
  }
  template <class Parse>
  auto parsed(std::span<const std::uint8_t> results, const Parse& parse)
      -> decltype(parse(std::declval<XdrReader&>())) {
    XdrReader reader(results);
    try {
      return parse(reader);
    } catch (const std::out_of_range&) {
      core_.reset();
      fail(DeviceErrorKind::protocol, "a reply that is too short");
    }
  }
  void check(std::uint32_t error, const std::string& what) {
    if (error == vxi11::no_error) return;
    if (error == vxi11::locked) throw OwnedError(address_);
    const DeviceErrorKind kind = kind_of_vxi11(error);
    if (kind == DeviceErrorKind::lost) core_.reset();
    fail(kind, "it answers " + what + " with \"" + error_name(error) + "\" (" +
                   std::to_string(error) + ")");
  }

  /// Throws DeviceError{timeout} where the other side does not answer at all.
  ByteString call(std::uint32_t procedure, const XdrWriter& arguments, Time timeout) {
    return guarded([&] {
      const std::uint32_t id = rpc_->send(procedure, arguments, timeout);
      auto results = rpc_->results(id, later(clock_.now(), timeout));
      if (!results)
        throw DeviceError(DeviceErrorKind::timeout, address_, "it does not answer in time");
      return *std::move(results);
    });
  }

  void open() {
    come_.clear();
    size_ = 0;
    reading_.reset();
    try {
      const int port = place_.port != 0 ? place_.port : mapped_port();
      core_ = connect_(port);
    } catch (const DeviceError& error) {
      throw renamed(error, address_);
    }
    rpc_.emplace(*core_, clock_, vxi11::kCore, vxi11::kVersion);
    try {
      locked_ = create(true);
      if (!locked_) create(false);
    } catch (...) {
      core_.reset();
      throw;
    }
  }

  int mapped_port() {
    const auto mapper = connect_(vxi11::kMapperPort);
    OncRpc rpc(*mapper, clock_, vxi11::kMapper, vxi11::kMapperVersion);
    constexpr std::uint32_t kTcp = 6;
    const std::uint32_t id = rpc.send(
        vxi11::kGetPort, XdrWriter().word(vxi11::kCore).word(vxi11::kVersion).word(kTcp).word(0),
        kOpeningTimeout);
    const auto results = rpc.results(id, later(clock_.now(), kOpeningTimeout));
    if (!results) fail(DeviceErrorKind::timeout, "its port mapper does not answer");
    const std::uint32_t port = parsed(*results, [](XdrReader& reader) { return reader.word(); });
    if (port == 0 || port > 65535)
      fail(DeviceErrorKind::not_found, "its port mapper knows no VXI-11 instrument");
    return static_cast<int>(port);
  }

  /// False where the device knows no locks.
  bool create(bool lock) {
    constexpr std::uint32_t kClient =
        1;  // a number of ours, which has no meaning for the other side
    const ByteString results = call(
        vxi11::create_link,
        XdrWriter().word(kClient).word(lock ? 1 : 0).word(0).text(place_.device), kOpeningTimeout);
    return parsed(results, [&](XdrReader& reader) {
      const std::uint32_t error = reader.word();
      if (lock && error == vxi11::not_supported) return false;
      check(error, "the opening of \"" + place_.device + "\"");
      link_ = reader.word();
      abort_port_ = static_cast<int>(reader.word() & 0xFFFF);
      write_size_ = std::max(reader.word(), kLeastWriteSize);
      return true;
    });
  }

  std::size_t write_part(std::span<const std::uint8_t> part, bool last, Time deadline) {
    const Time left = std::max(deadline - clock_.now(), Time::zero());
    // I/O timeout, lock timeout, flags.
    const ByteString results = call(vxi11::device_write,
                                    XdrWriter()
                                        .word(link_)
                                        .word(in_milliseconds(left))
                                        .word(0)
                                        .word(last ? vxi11::kEndFlag : 0)
                                        .opaque(part),
                                    later(left, kCallGrace));
    return parsed(results, [&](XdrReader& reader) {
      check(reader.word(), "a write");
      return reader.word();
    });
  }

  /// What the answer to one device_read brings; nothing where none came in time.
  std::optional<Part> read_part(Time deadline) {
    const auto results = guarded([&] {
      if (!reading_) {
        const Time left = std::max(deadline - clock_.now(), Time::zero());
        // Size, I/O timeout, lock timeout, flags, terminating character.
        reading_ = rpc_->send(vxi11::device_read,
                              XdrWriter()
                                  .word(link_)
                                  .word(kReadSize)
                                  .word(in_milliseconds(left))
                                  .word(0)
                                  .word(0)
                                  .word(0),
                              kOpeningTimeout);
      }
      return rpc_->results(*reading_, later(deadline, kCallGrace));
    });
    if (!results) return std::nullopt;
    reading_.reset();
    return parsed(*results, [&](XdrReader& reader) {
      const std::uint32_t error = reader.word();
      const std::uint32_t reason = reader.word();
      Part part{reader.opaque(), (reason & vxi11::kEndReason) != 0, error == vxi11::io_timeout};
      if (!part.timed_out) check(error, "a read");
      if (part.data.empty() && reason == 0 && !part.timed_out)
        fail(DeviceErrorKind::protocol, "it answers a read with no bytes and no reason");
      return part;
    });
  }

  ByteString whole(std::size_t most) {
    const std::size_t size = std::exchange(size_, 0);
    ByteString message = std::exchange(come_, {});
    if (size > most)
      fail(DeviceErrorKind::protocol,
           "a message of " + std::to_string(size) + " bytes, more than " + std::to_string(most));
    return message;
  }

  /// Forgets the message that is under way. The answer to a read of before must have come, for the
  /// instrument does one call after another.
  void drop_read(Time deadline) {
    come_.clear();
    size_ = 0;
    if (!reading_) return;
    const auto results =
        guarded([&] { return rpc_->results(*reading_, later(deadline, kCallGrace)); });
    if (!results) fail(DeviceErrorKind::timeout, "it does not answer a read of before");
    reading_.reset();
  }

  /// By the channel that is there for it. Where that fails, the read ends at its own time-out.
  void abort_read(Time timeout) {
    try {
      const auto channel = connect_(abort_port_);
      OncRpc rpc(*channel, clock_, vxi11::kAbort, vxi11::kVersion);
      const std::uint32_t id = rpc.send(vxi11::kDeviceAbort, XdrWriter().word(link_), timeout);
      rpc.results(id, later(clock_.now(), timeout));
    } catch (const DeviceError&) {
    }
  }

  const std::string address_;
  const InstrumentPlace place_;
  const ConnectTo connect_;
  Clock& clock_;
  std::unique_ptr<ByteLink> core_;  // null once it was lost
  std::optional<OncRpc> rpc_;
  std::uint32_t link_ = 0;  // the instrument's number of it
  int abort_port_ = 0;
  std::size_t write_size_ = kLeastWriteSize;
  bool locked_ = false;
  std::optional<std::uint32_t> reading_;  // the call that is not answered yet
  ByteString come_;                       // of a message that is not whole yet
  std::size_t size_ = 0;                  // its bytes so far, with those beyond what is wanted
};

}  // namespace

std::unique_ptr<MessageLink> open_vxi11_on(const std::string& address, const InstrumentPlace& place,
                                           ConnectTo connect, Clock& clock) {
  return std::make_unique<Vxi11Link>(address, place, std::move(connect), clock);
}

std::unique_ptr<MessageLink> open_vxi11(const std::string& place, Clock& clock) {
  const InstrumentPlace parsed = parse_instrument_place("vxi11", place, "inst0");
  return open_vxi11_on(
      "vxi11:" + place, parsed,
      [host = parsed.host, &clock](int port) {
        return open_tcp(join_host_and_port(host, port), kOpeningTimeout, clock);
      },
      clock);
}

}  // namespace vitreo
