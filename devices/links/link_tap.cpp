// SPDX-License-Identifier: Apache-2.0
#include "devices/links/link_tap.h"

#include "devices/time/error.h"

#include <utility>

namespace vitreo {
namespace {

using Bytes = std::span<const std::uint8_t>;

/// What the decorators have in common: the link, and its reports to the tap.
template <class Link>
class Watched {
 public:
  Watched(std::unique_ptr<Link> link, LinkName name, LinkTap& tap, const Clock& clock)
      : link_(std::move(link)), name_(std::move(name)), tap_(tap), clock_(clock) {
    note(LinkEvent::opened);
  }
  Link& operator*() const { return *link_; }
  Link* operator->() const { return link_.get(); }
  void note(LinkEvent event, Bytes bytes = {}) const {
    tap_.passed(name_, clock_.now(), event, bytes);
  }
  /// Calls the link; a DeviceError of it is noted and goes on. A stop is none of the link's.
  template <class Call>
  auto guarded(const Call& call) const {
    try {
      return call();
    } catch (const DeviceError& error) {
      const std::string text = error.what();
      note(LinkEvent::failed,
           Bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
      throw;
    }
  }

 private:
  std::unique_ptr<Link> link_;
  LinkName name_;
  LinkTap& tap_;
  const Clock& clock_;
};

/// Writes are noted before they are made: what a broken write has sent is not known, and must not
/// be missing.
class TappedByteLink final : public ByteLink {
 public:
  explicit TappedByteLink(Watched<ByteLink> link) : link_(std::move(link)) {}
  const std::string& address() const override { return link_->address(); }
  std::string description() const override { return link_->description(); }
  void write(Bytes bytes, Time timeout) override {
    link_.note(LinkEvent::to_instrument, bytes);
    link_.guarded([&] { link_->write(bytes, timeout); });
  }
  ByteString read(std::size_t most, Time timeout) override {
    ByteString bytes = link_.guarded([&] { return link_->read(most, timeout); });
    if (!bytes.empty()) link_.note(LinkEvent::from_instrument, bytes);
    return bytes;
  }
  bool hung_up() const override { return link_->hung_up(); }
  void reopen() override {
    link_.guarded([&] { link_->reopen(); });
    link_.note(LinkEvent::opened);
  }

 private:
  const Watched<ByteLink> link_;
};

class TappedMessageLink final : public MessageLink {
 public:
  explicit TappedMessageLink(Watched<MessageLink> link) : link_(std::move(link)) {}
  const std::string& address() const override { return link_->address(); }
  std::string description() const override { return link_->description(); }
  void write(Bytes message, Time timeout) override {
    link_.note(LinkEvent::to_instrument, message);
    link_.guarded([&] { link_->write(message, timeout); });
  }
  std::optional<ByteString> read(std::size_t most, Time timeout) override {
    auto message = link_.guarded([&] { return link_->read(most, timeout); });
    if (message) link_.note(LinkEvent::from_instrument, *message);
    return message;
  }
  void clear(Time timeout) override {
    link_.note(LinkEvent::cleared);
    link_.guarded([&] { link_->clear(timeout); });
  }
  void reopen() override {
    link_.guarded([&] { link_->reopen(); });
    link_.note(LinkEvent::opened);
  }

 private:
  const Watched<MessageLink> link_;
};

class TappedHidLink final : public HidLink {
 public:
  explicit TappedHidLink(Watched<HidLink> link) : link_(std::move(link)) {}
  void write(Bytes report) override {
    link_.note(LinkEvent::to_instrument, report);
    link_.guarded([&] { link_->write(report); });
  }
  std::optional<std::vector<std::uint8_t>> read(Time timeout) override {
    auto report = link_.guarded([&] { return link_->read(timeout); });
    if (report) link_.note(LinkEvent::from_instrument, *report);
    return report;
  }
  bool hung_up() const override { return link_->hung_up(); }

 private:
  const Watched<HidLink> link_;
};

class TappedEventLink final : public EventLink {
 public:
  explicit TappedEventLink(Watched<EventLink> link) : link_(std::move(link)) {
    last_ = link_->state();
  }
  const std::string& address() const override { return link_->address(); }
  const EventDevice& device() const override { return link_->device(); }
  const EventState& state() override {
    const EventState& now = *link_.guarded([&] { return &link_->state(); });
    for (std::size_t i = 0; i < now.axes.size(); ++i)
      if (now.axes[i] != last_.axes[i]) note(device().axes[i].name, now.axes[i]);
    for (std::size_t i = 0; i < now.pressed.size(); ++i)
      if (now.pressed[i] != last_.pressed[i]) note(device().buttons[i], now.pressed[i] ? 1 : 0);
    last_ = now;
    return now;
  }
  bool wait(Time timeout) override {
    return link_.guarded([&] { return link_->wait(timeout); });
  }
  void reopen() override {
    link_.guarded([&] { link_->reopen(); });
    link_.note(LinkEvent::opened);
    last_ = link_->state();
  }

 private:
  void note(const std::string& name, int value) const {
    const std::string text = name + " " + std::to_string(value);
    link_.note(LinkEvent::from_instrument,
               Bytes(reinterpret_cast<const std::uint8_t*>(text.data()), text.size()));
  }

  const Watched<EventLink> link_;
  EventState last_;
};

class TappedUsbLink final : public UsbLink {
 public:
  explicit TappedUsbLink(Watched<UsbLink> link) : link_(std::move(link)) {}
  const UsbIdentity& identity() const override { return link_->identity(); }
  void write(const UsbSetup& setup, Bytes data, Time timeout) override {
    link_.note(LinkEvent::to_instrument, packet(setup, data.size(), data));
    link_.guarded([&] { link_->write(setup, data, timeout); });
  }
  std::vector<std::uint8_t> read(const UsbSetup& setup, std::uint16_t length,
                                 Time timeout) override {
    link_.note(LinkEvent::to_instrument, packet(setup, length, {}));
    auto answer = link_.guarded([&] { return link_->read(setup, length, timeout); });
    link_.note(LinkEvent::from_instrument, answer);
    return answer;
  }

 private:
  /// As on the bus: type, request, then value, index and length, little-endian; the data behind.
  static std::vector<std::uint8_t> packet(const UsbSetup& setup, std::size_t length, Bytes data) {
    std::vector<std::uint8_t> bytes{setup.type, setup.request};
    for (const std::size_t word : {std::size_t{setup.value}, std::size_t{setup.index}, length}) {
      bytes.push_back(static_cast<std::uint8_t>(word & 0xFF));
      bytes.push_back(static_cast<std::uint8_t>(word >> 8 & 0xFF));
    }
    bytes.insert(bytes.end(), data.begin(), data.end());
    return bytes;
  }

  const Watched<UsbLink> link_;
};

}  // namespace

const char* to_string(LinkEvent event) {
  switch (event) {
    case LinkEvent::to_instrument:
      return "to";
    case LinkEvent::from_instrument:
      return "from";
    case LinkEvent::opened:
      return "opened";
    case LinkEvent::cleared:
      return "cleared";
    case LinkEvent::failed:
      return "failed";
  }
  return "unknown";
}

std::unique_ptr<ByteLink> tapped(std::unique_ptr<ByteLink> link, LinkName name, LinkTap& tap,
                                 const Clock& clock) {
  return std::make_unique<TappedByteLink>(
      Watched<ByteLink>(std::move(link), std::move(name), tap, clock));
}
std::unique_ptr<MessageLink> tapped(std::unique_ptr<MessageLink> link, LinkName name, LinkTap& tap,
                                    const Clock& clock) {
  return std::make_unique<TappedMessageLink>(
      Watched<MessageLink>(std::move(link), std::move(name), tap, clock));
}
std::unique_ptr<HidLink> tapped(std::unique_ptr<HidLink> link, LinkName name, LinkTap& tap,
                                const Clock& clock) {
  return std::make_unique<TappedHidLink>(
      Watched<HidLink>(std::move(link), std::move(name), tap, clock));
}
std::unique_ptr<UsbLink> tapped(std::unique_ptr<UsbLink> link, LinkName name, LinkTap& tap,
                                const Clock& clock) {
  return std::make_unique<TappedUsbLink>(
      Watched<UsbLink>(std::move(link), std::move(name), tap, clock));
}

std::unique_ptr<EventLink> tapped(std::unique_ptr<EventLink> link, LinkName name, LinkTap& tap,
                                  const Clock& clock) {
  return std::make_unique<TappedEventLink>(
      Watched<EventLink>(std::move(link), std::move(name), tap, clock));
}

}  // namespace vitreo
