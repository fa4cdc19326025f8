// SPDX-License-Identifier: Apache-2.0
#include "devices/links/message_bytes.h"

#include <algorithm>
#include <deque>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

constexpr std::size_t kMost = 1 << 20;  // bytes of a message
constexpr Time kClear = std::chrono::seconds(1);

class MessageBytes final : public ByteLink {
 public:
  MessageBytes(std::unique_ptr<MessageLink> link, std::string end, Clock& clock)
      : link_(std::move(link)), end_(std::move(end)), clock_(clock) {
    if (!link_) throw std::invalid_argument("link: must not be null");
  }

  const std::string& address() const override { return link_->address(); }
  std::string description() const override { return link_->description(); }

  // An answer that was asked for and has not come would be taken for that of this message: on these
  // buses it can be called back.
  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    if (std::exchange(missed_, false)) link_->clear(kClear);
    link_->write(bytes, timeout);
    due_ = true;
  }

  ByteString read(std::size_t most, Time timeout) override {
    if (arrived_.empty() && due_ && timeout > Time::zero()) {
      const auto message = link_->read(kMost, timeout);
      missed_ = !message;
      due_ = !message;
      if (message) {
        arrived_.insert(arrived_.end(), message->begin(), message->end());
        if (!ends_right(*message)) arrived_.insert(arrived_.end(), end_.begin(), end_.end());
      }
    } else if (arrived_.empty() && timeout > Time::zero()) {
      clock_.sleep_for(timeout);
    }
    const auto count = static_cast<std::ptrdiff_t>(std::min(most, arrived_.size()));
    ByteString taken(arrived_.begin(), arrived_.begin() + count);
    arrived_.erase(arrived_.begin(), arrived_.begin() + count);
    return taken;
  }

  void reopen() override {
    link_->reopen();
    arrived_.clear();
    due_ = missed_ = false;
  }

 private:
  bool ends_right(const ByteString& message) const {
    return message.size() >= end_.size() &&
           std::equal(end_.rbegin(), end_.rend(), message.rbegin(),
                      [](char a, std::uint8_t b) { return static_cast<std::uint8_t>(a) == b; });
  }

  std::unique_ptr<MessageLink> link_;
  const std::string end_;
  Clock& clock_;
  std::deque<std::uint8_t> arrived_;
  bool due_ = false;     // a message was sent, and nothing has come since
  bool missed_ = false;  // it was read for, in vain
};

}  // namespace

std::unique_ptr<ByteLink> message_bytes(std::unique_ptr<MessageLink> link, const std::string& end,
                                        Clock& clock) {
  return std::make_unique<MessageBytes>(std::move(link), end, clock);
}

}  // namespace vitreo
