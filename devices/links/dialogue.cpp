// SPDX-License-Identifier: Apache-2.0
#include "devices/links/dialogue.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo {
namespace {

/// A command of 80 bytes takes 83 ms at 9600 baud; only a far end that takes nothing is later.
constexpr Time kWriteTimeout = std::chrono::seconds(1);
constexpr std::size_t kChunk = 256;
/// To discard at once: a broken instrument may send without end.
constexpr int kMostChunks = 256;
/// For how long an opening that found silence listens on, to tell a slow instrument from a dead
/// one.
constexpr Time kLastListening = std::chrono::seconds(2);

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace

Dialogue::Dialogue(std::unique_ptr<ByteLink> link, std::string device, Clock& clock,
                   const std::string& part)
    : link_(std::move(link)),
      device_(std::move(device)),
      part_(part.empty() ? "" : part + ": "),
      clock_(clock) {
  if (!link_) throw std::invalid_argument("link: must not be null");
}

/// The shield is made first: a stop that comes while this task waits for its turn is deferred too,
/// so a task that is stopped can still stop its instrument.
Dialogue::Turn::Turn(Dialogue& dialogue) : dialogue_(dialogue), shield_(dialogue.clock_) {
  dialogue.clock_.wait(
      dialogue.free_, [&dialogue] { return !dialogue.taken_; }, kForever);
  dialogue.taken_ = true;
}
Dialogue::Turn::~Turn() {
  dialogue_.taken_ = false;
  dialogue_.clock_.notify(dialogue_.free_);
}

void Dialogue::fail(DeviceErrorKind kind, const std::string& what) const {
  std::string text = part_ + what;
  const bool strange = kind == DeviceErrorKind::protocol || kind == DeviceErrorKind::not_found;
  const std::string heard = strange ? history_.last_heard() : "";
  if (!heard.empty() && text.find(heard) == std::string::npos) text += "; it says \"" + heard + '"';
  throw DeviceError(kind, device_, text);
}

/// A late answer may explain this silence too: the instrument is slow.
void Dialogue::fail_silent() {
  history_.gave_up(clock_.now());
  // Within an opening explain() says it.
  const std::string late = opening_ ? "" : history_.lateness();
  fail(DeviceErrorKind::timeout, silence() + (late.empty() ? "" : "; " + late));
}

/// Errors of the link are thrown again under the device's name; a lost link is noted.
template <class Work>
auto Dialogue::guarded(const Work& work) {
  if (lost_) fail(DeviceErrorKind::lost, link_->address() + " was lost");
  try {
    return work();
  } catch (const DeviceError& error) {
    lost_ = lost_ || error.kind == DeviceErrorKind::lost;
    fail(error.kind, renamed(error, device_).text);
  }
}

// The bytes are with the kernel when it returns; whether the instrument took them only an answer
// shows.
// An answer that is owed may have come meanwhile: it is looked for before the next question, or it
// would pass for the answer to that.
void Dialogue::send(std::span<const std::uint8_t> bytes, std::string_view called) {
  if (history_.owed()) fill(clock_.now());
  guarded([&] { link_->write(bytes, kWriteTimeout); });
  history_.sent(bytes, called, clock_.now());
}
void Dialogue::send(std::string_view text, std::string_view called) {
  send(bytes_of(text), called);
}

/// Whether a byte is there by `deadline`; what has arrived is kept for next().
bool Dialogue::fill(Time deadline) {
  if (!arrived_.empty()) return true;
  const Time left = std::max(deadline - clock_.now(), Time::zero());
  const ByteString bytes = guarded([&] { return link_->read(kChunk, left); });
  history_.heard(bytes, clock_.now());
  arrived_.insert(arrived_.end(), bytes.begin(), bytes.end());
  return !arrived_.empty();
}

std::optional<std::uint8_t> Dialogue::next(Time deadline) {
  if (!fill(deadline)) return std::nullopt;
  const std::uint8_t byte = arrived_.front();
  arrived_.pop_front();
  return byte;
}

/// Bytes of a reply that is cut short are gone: the next exchange begins anew.
ByteString Dialogue::take(std::size_t count, Time deadline) {
  ByteString bytes;
  while (bytes.size() < count) {
    const auto byte = next(deadline);
    if (!byte && bytes.empty()) fail_silent();
    if (!byte)
      fail(DeviceErrorKind::timeout, description() + ": only " + std::to_string(bytes.size()) +
                                         " of " + std::to_string(count) +
                                         " bytes came in time: " + history_.last_heard());
    bytes.push_back(*byte);
  }
  return bytes;
}

std::string Dialogue::line(char terminator, std::size_t most, Time deadline) {
  std::string text;
  while (const auto byte = next(deadline)) {
    if (static_cast<char>(*byte) == terminator) return text;
    text.push_back(static_cast<char>(*byte));
    if (text.size() > most)
      fail(DeviceErrorKind::protocol,
           description() + ": a reply without an end: " + printable(text));
  }
  if (text.empty()) fail_silent();
  fail(DeviceErrorKind::timeout,
       description() + ": only the beginning of an answer came in time: " + printable(text));
}

// A deadline of now reads only what has arrived already.
void Dialogue::discard() {
  for (int i = 0; i < kMostChunks && fill(clock_.now()); ++i) arrived_.clear();
}

void Dialogue::settle(Time silence) {
  const Time end = later(clock_.now(), 50 * silence);
  // Each byte begins the silence anew; the end bounds an instrument that never falls silent.
  while (clock_.now() < end && fill(later(clock_.now(), silence))) arrived_.clear();
}

/// What the bytes since the opening began say about an error of it; to be put behind its text.
/// Empty where they say nothing.
std::string Dialogue::cause() const {
  if (!history_.asked()) return "";  // the link itself failed
  const std::string looks = identified_ ? "" : history_.appearance();
  if (!looks.empty()) return "; " + looks;
  if (!history_.lateness().empty()) return "; " + history_.lateness() + ": is it slow?";
  if (identified_) return "";
  const bool serial = link_->address().starts_with("serial:");
  if (!history_.silent_from_the_beginning())
    return serial ? "; is this its cable, is the rate right?" : "";
  if (serial) return ": is it on, is this its cable, is the rate right?";
  return link_->address().starts_with("tcp:")
             ? ": the connection stands, so is this its address and port?"
             : "";
}

// Nothing is sent for it: a byte that one instrument ignores makes another one move or stop.
void Dialogue::explain(const DeviceError& error) {
  if (error.kind == DeviceErrorKind::lost || error.kind == DeviceErrorKind::out_of_range) throw;
  if (error.kind == DeviceErrorKind::timeout && history_.asked() && history_.silent()) {
    try {
      history_.gave_up(clock_.now());
      fill(later(clock_.now(), kLastListening));
    } catch (const DeviceError&) {  // the link went meanwhile: the silence is what is reported
    }
  }
  std::string text = error.text;
  const std::string& address = link_->address();
  if (address != "emulated" && text.find(address) == std::string::npos)
    text += "; its line is " + description();
  throw DeviceError(error.kind, device_, text + cause());
}

// Only the link is opened: the driver configures the instrument anew, for it may have lost its
// power.
void Dialogue::reopen() {
  lost_ = false;  // or guarded() would refuse the attempt
  arrived_.clear();
  try {
    guarded([&] { link_->reopen(); });
  } catch (const DeviceError&) {
    lost_ = true;
    throw;
  }
}

}  // namespace vitreo
