// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/exchange.h"

#include "devices/links/printable.h"
#include "devices/links/scpi.h"
#include "devices/scripted/checksum.h"
#include "devices/scripted/conversion.h"
#include "devices/scripted/lua_values.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace vitreo::scripted {
namespace {

constexpr int kMostUnasked = 1000;    // messages before an answer
constexpr double kLongestSleep = 60;  // s, of one io:sleep
/// After which nothing more of an older answer comes, where the declared timeout is longer.
constexpr Time kSilence = std::chrono::milliseconds(50);
/// What a function of the file has beyond two answers that are late.
constexpr Time kLongestCall = std::chrono::seconds(10);
constexpr Time kLongestOpening = std::chrono::seconds(120);
constexpr std::size_t kLongestText = 65536;  // bytes, that a function sends or returns

/// Sets a flag for as long as it lives.
struct Scope {
  explicit Scope(bool& of) : flag(of), before(std::exchange(of, true)) {}
  ~Scope() { flag = before; }
  Scope(const Scope&) = delete;
  Scope& operator=(const Scope&) = delete;
  bool& flag;
  bool before;
};

std::string_view text_at(lua_State* L, int index, const char* what) {
  if (lua_type(L, index) != LUA_TSTRING)
    throw std::invalid_argument(std::string(what) + ": must be a text");
  std::size_t size = 0;
  const char* const text = lua_tolstring(L, index, &size);
  if (size > kLongestText)
    throw std::invalid_argument(std::string(what) + ": must be at most 65536 bytes long");
  return {text, size};
}

/// A field of the options at `index`, as a number of s; `fallback` where it is not there.
Time time_option(lua_State* L, int index, const char* name, Time fallback) {
  if (lua_type(L, index) != LUA_TTABLE) return fallback;
  lua_pushstring(L, name);
  const int type = lua_rawget(L, index);
  const double value = lua_tonumber(L, -1);
  lua_pop(L, 1);
  if (type == LUA_TNIL) return fallback;
  if (type != LUA_TNUMBER || !(value >= 0 && value <= 600))
    throw std::invalid_argument(std::string(name) + ": must be 0 to 600 s");
  return from_seconds(value);
}

std::span<const std::uint8_t> bytes(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

}  // namespace

Exchange::Exchange(Loaded& loaded, Dialogue& dialogue) : loaded_(loaded), dialogue_(dialogue) {
  sandbox().push_operations({"ask", "send", "read", "sleep", "now", "fail"});
  io_ = Reference(sandbox().stack());
}

Time Exchange::reply_deadline() const {
  return std::min(later(dialogue_.clock().now(), loaded_.declaration.link.timeout), until_);
}

// Functions within an operation of another (match, rest, unasked) are part of its time.
void Exchange::invoke(int arguments, int results, Operations* operations) {
  struct Restore {
    Time& until;
    Time before;
    ~Restore() { until = before; }
  } const restore{until_, until_};
  if (until_ == kForever) until_ = later(dialogue_.clock().now(), longest_call());
  sandbox().call(arguments, results, operations, &dialogue_.clock());
}

Time Exchange::longest_call() const {
  return opening_ ? kLongestOpening : later(kLongestCall, 2 * declaration().link.timeout);
}

void Exchange::send(std::string_view message) {
  const LinkDeclaration& link = declaration().link;
  Clock& clock = dialogue_.clock();
  if (link.pause > Time::zero() && sent_before_)
    // Slow instruments lose what comes before they have settled: counted from whichever was later.
    clock.sleep_until(later(std::max(sent_, answered_), link.pause));
  const std::string whole = framed(link.framing, std::string(message), ++transaction_);
  // Of a Modbus PDU the first byte is its function, which the answer has to repeat.
  function_ = message.empty() ? '\0' : message.front();
  dialogue_.send(whole);
  sent_ = clock.now();
  sent_before_ = true;
  if (link.echo) drop_echo(whole, reply_deadline());
}

/// A half-duplex line, or an instrument that repeats what it hears.
void Exchange::drop_echo(std::string_view sent, Time deadline) {
  const ByteString heard = dialogue_.take(sent.size(), deadline);
  if (!std::equal(heard.begin(), heard.end(), bytes(sent).begin(), bytes(sent).end()))
    dialogue_.fail(DeviceErrorKind::protocol, "its echo is not what was sent: " + printable(heard));
}

std::string Exchange::take(std::size_t count, Time deadline) {
  const ByteString taken = dialogue_.take(count, deadline);
  return {taken.begin(), taken.end()};
}

std::string Exchange::until(const std::string& end, Time deadline) {
  std::string message;
  while (!message.ends_with(end)) {
    // A line ends at the last byte of the end; where that is a part of the message it goes on.
    message += dialogue_.line(end.back(), declaration().link.framing.most, deadline) + end.back();
    if (message.size() > declaration().link.framing.most)
      dialogue_.fail(DeviceErrorKind::protocol, "its message does not end: " + printable(message));
  }
  message.resize(message.size() - end.size());
  return message;
}

/// Its first bytes say how many follow; a function of which they do not ends with a silence.
std::string Exchange::rtu_answer(Time deadline) {
  constexpr Time kEnd = std::chrono::milliseconds(20);
  // Unit, function and one byte more, which in the answer to a reading counts those that follow.
  std::string frame = take(3, deadline);
  const auto size = modbus::rtu_answer_size(bytes(frame));
  if (size && *size > frame.size()) frame += take(*size - frame.size(), deadline);
  if (!size)
    while (const auto byte = dialogue_.next(later(dialogue_.clock().now(), kEnd)))
      frame.push_back(static_cast<char>(*byte));
  // Less than unit, function and a CRC of two bytes is no frame.
  if (frame.size() < 4 || !modbus::has_right_crc(bytes(frame)))
    dialogue_.fail(DeviceErrorKind::protocol,
                   "the checksum of its message is wrong: " + printable(frame));
  if (static_cast<std::uint8_t>(frame[0]) != declaration().link.framing.unit)
    dialogue_.fail(DeviceErrorKind::protocol, "another unit answers: " + printable(frame));
  // Without the unit in front and the CRC behind: the PDU.
  return frame.substr(1, frame.size() - 3);
}

/// Answers to older questions have another transaction, and are passed over.
std::string Exchange::tcp_answer(Time deadline) {
  for (;;) {
    const std::string header = take(modbus::kMbap, deadline);
    const auto mbap = modbus::parse_mbap(bytes(header));
    if (!mbap) dialogue_.fail(DeviceErrorKind::protocol, "not Modbus: " + printable(header));
    std::string pdu = take(mbap->pdu_size, deadline);
    if (mbap->transaction == transaction_) return pdu;
  }
}

/// The PDU of the answer to the last question; an exception is a refusal.
std::string Exchange::modbus_answer(Time deadline) {
  const bool tcp = declaration().link.framing.modbus == modbus::Framing::tcp;
  unsure_ = true;
  std::string pdu = tcp ? tcp_answer(deadline) : rtu_answer(deadline);
  const auto function = static_cast<std::uint8_t>(pdu.empty() ? '\0' : pdu.front());
  // An exception repeats the function with its highest bit set, and says why in one byte (MODBUS
  // Application Protocol V1.1b3, section 7).
  if (pdu.size() == 2 && function == (static_cast<std::uint8_t>(function_) | modbus::kException)) {
    // The answer has come, though it is a no: there is none that could still come late.
    unsure_ = false;
    dialogue_.fail(DeviceErrorKind::refused,
                   "it answers: " + modbus::exception_name(static_cast<std::uint8_t>(pdu[1])));
  }
  if (function != static_cast<std::uint8_t>(function_))
    dialogue_.fail(DeviceErrorKind::protocol, "it answers another question: " + printable(pdu));
  return pdu;
}

/// Between brackets, by the length that it says of itself.
std::string Exchange::counted(Time deadline) {
  const Framing& framing = declaration().link.framing;
  const int count = static_cast<unsigned char>(take(1, deadline).front()) - framing.counted;
  if (count < 0)
    dialogue_.fail(DeviceErrorKind::protocol, "its message says that it is shorter than its frame");
  std::string message =
      take(static_cast<std::size_t>(count) + checksum_size(framing.checksum) + framing.stop.size(),
           deadline);
  if (!message.ends_with(framing.stop))
    dialogue_.fail(DeviceErrorKind::protocol,
                   "its message does not end where it says: " + printable(message));
  message.resize(message.size() - framing.stop.size());
  return message;
}

/// One message as it is on the wire, without its frame but with its checksum.
std::string Exchange::unframed(Time deadline) {
  const Framing& framing = declaration().link.framing;
  switch (framing.kind) {
    case Framing::Kind::line:
      return until(framing.receive_end, deadline);
    case Framing::Kind::fixed:
      return take(framing.length, deadline);
    case Framing::Kind::header: {
      std::string message = take(framing.length, deadline);
      lua_State* const L = sandbox().stack();
      framing.rest.push();
      lua_pushlstring(L, message.data(), message.size());
      invoke(1, 1);
      const auto rest = quantity_at(L, -1);
      lua_pop(L, 1);
      const double* const count = rest ? std::get_if<double>(&*rest) : nullptr;
      if (count == nullptr || *count < 0 || *count > static_cast<double>(framing.most))
        throw ScriptFault(sandbox().file() +
                          ": link.message.rest: does not give how many bytes follow");
      if (*count > 0) message += take(static_cast<std::size_t>(*count), deadline);
      return message;
    }
    case Framing::Kind::brackets: {
      until(framing.start, deadline);  // what is in front of it belongs to no message
      return framing.counted < 0 ? until(framing.stop, deadline) : counted(deadline);
    }
    case Framing::Kind::modbus:
      return modbus_answer(deadline);
    case Framing::Kind::quiet:
      break;
  }
  // A message without a length and an end is over when the line has been silent for `quiet`.
  std::string message = take(1, deadline);
  Clock& clock = dialogue_.clock();
  while (const auto byte = dialogue_.next(later(clock.now(), framing.quiet))) {
    message.push_back(static_cast<char>(*byte));
    if (message.size() > framing.most)
      dialogue_.fail(DeviceErrorKind::protocol, "its message does not end");
  }
  return message;
}

/// What is wrong with the file makes the instrument safe, once, and is told by file and line.
template <class Work>
auto Exchange::judged(const Work& work) {
  if (!fault_.empty())
    dialogue_.fail(DeviceErrorKind::protocol, "its driver failed before: " + fault_);
  try {
    return work();
  } catch (const ScriptFault& fault) {
    break_down(fault);
  }
}

std::string Exchange::receive(Time deadline) {
  return judged([&] { return next_message(deadline); });
}

// What does not come in time may come later.
std::string Exchange::next_message(Time deadline) {
  // Both stay set where the message throws: the next question then waits for what may still come.
  const bool before = std::exchange(unsure_, true);
  const bool owed = std::exchange(owed_, true);
  std::string message = without_checksum(unframed(deadline));
  unsure_ = before;
  owed_ = owed;
  return message;
}

std::string Exchange::without_checksum(std::string message) {
  const Checksum kind = declaration().link.framing.checksum;
  const std::size_t size = checksum_size(kind);
  if (size == 0) return message;
  if (message.size() < size ||
      checksum_of(kind, std::string_view(message).substr(0, message.size() - size)) !=
          message.substr(message.size() - size))
    dialogue_.fail(DeviceErrorKind::protocol,
                   "the checksum of its message is wrong: " + printable(message));
  message.resize(message.size() - size);
  return message;
}

/// For what the instrument says by itself.
void Exchange::hand_over(const std::string& message) {
  if (!declaration().unasked) return;
  lua_State* const L = sandbox().stack();
  declaration().unasked.push();
  lua_pushlstring(L, message.data(), message.size());
  invoke(1, 0);
}

/// Waits for the answer that is owed, as long as for any answer, then for silence.
void Exchange::settle() {
  const Time until = std::min(reply_deadline(), deadline_);
  if (std::exchange(owed_, false)) dialogue_.await(until);
  dialogue_.settle(kSilence);
}

// While it is waited for, and after it was given up: it may come yet.
Time Exchange::owed() const { return owed_ ? dialogue_.clock().now() - asked_ : Time::zero(); }

// Where the last answer did not come in time it may come now, and would be taken for that of this
// question, and each answer for that of the next question from then on: so it is waited for once
// more, and the line must be silent.
std::string Exchange::ask(std::string_view message, Time timeout,
                          const std::function<bool(const std::string&)>& wanted) {
  Clock& clock = dialogue_.clock();
  if (unsure_) settle();
  // Where answers are told by a match, what has come already is no rubbish: it goes to `unasked`.
  if (!wanted) dialogue_.discard();
  unsure_ = true;
  send(message);
  asked_ = clock.now();
  const Time deadline = std::min({later(asked_, timeout), deadline_, until_});
  // An instrument that reports without a pause would keep the question waiting for ever.
  for (int i = 0; i < kMostUnasked; ++i) {
    // The time of the first byte is that of the answer; how long the rest takes is the line's.
    owed_ = true;  // for who looks meanwhile
    owed_ = !dialogue_.await(deadline);
    answered_ = clock.now();
    std::string answer = next_message(deadline);
    const bool empty = answer.empty() && declaration().link.framing.kind == Framing::Kind::line;
    if (empty) continue;
    if (!wanted || wanted(answer)) {
      unsure_ = owed_ = false;
      return answer;
    }
    hand_over(answer);
  }
  dialogue_.fail(DeviceErrorKind::protocol, "it goes on talking, and does not answer");
}

// The order of the questions is that of their wiring: nothing is set before it is known what it is.
Identity Exchange::identify() {
  const Declaration& all = declaration();
  Identity identity;
  if (const auto* function = std::get_if<Reference>(&all.identity)) {
    lua_State* const L = sandbox().stack();
    function->push();
    io_.push();
    invoke(1, 3, this);
    const auto text = [&](int index) {
      return lua_type(L, index) == LUA_TSTRING ? std::string(lua_tostring(L, index)) : "";
    };
    identity = {text(-3), text(-2), text(-1)};
    lua_pop(L, 3);
    if (identity.name.empty())
      dialogue_.fail(DeviceErrorKind::not_found, "this is no " + all.title);
    return identity;
  }
  std::string said = ask(std::get<std::string>(all.identity), all.link.timeout);
  // Without a pattern the answer has to be that of *IDN? (IEEE 488.2).
  if (all.identity_match.empty()) {
    const auto who = scpi::identity(said);
    if (!who)
      dialogue_.fail(DeviceErrorKind::not_found,
                     "this is no " + all.title + ": " + printable(said));
    return *who;
  }
  auto found = captures(sandbox(), said, all.identity_match);
  for (int i = 1; !found && i < all.identity_tries; ++i) {
    said = ask(std::get<std::string>(all.identity), all.link.timeout);
    found = captures(sandbox(), said, all.identity_match);
  }
  if (!found)
    dialogue_.fail(DeviceErrorKind::not_found, "this is no " + all.title + ": " + printable(said));
  identity.name = all.title;
  for (std::size_t i = 0; i < std::min(found->size(), all.identity_fields.size()); ++i) {
    const std::string shown = printable((*found)[i], 80);
    if (all.identity_fields[i] == "name") identity.name = shown;
    if (all.identity_fields[i] == "serial") identity.serial = shown;
    if (all.identity_fields[i] == "firmware") identity.firmware = shown;
  }
  return identity;
}

Identity Exchange::begin() {
  // A new opening forgives the file's fault. What an earlier program asked may still be answered:
  // hence unsure_.
  fault_.clear();
  unsure_ = true;
  owed_ = false;
  const Scope opening(opening_);
  return judged([&] {
    const Declaration& all = declaration();
    if (all.link.opening_pause > Time::zero()) dialogue_.clock().sleep_for(all.link.opening_pause);
    Identity identity = identify();
    // From here on an error is no longer explained by another instrument on the line.
    dialogue_.identified();
    for (const std::string& message : all.setup) {
      send(message);
      check_errors();
    }
    if (all.start_up) call(all.start_up, {});
    return identity;
  });
}

void Exchange::break_down(const ScriptFault& fault) {
  fault_ = printable(fault.what(), 400);
  // Told beside the fault: that the instrument may still be energized must not be hidden by it.
  std::string unsafe;
  try {
    make_safe();
  } catch (const std::exception& error) {
    unsafe = std::string("; it could not be made safe either: ") + error.what();
  }
  dialogue_.fail(DeviceErrorKind::protocol, "its driver failed: " + fault_ + unsafe);
}

std::optional<QuantityValue> Exchange::call(const Reference& function,
                                            const std::vector<QuantityValue>& arguments) {
  return judged([&] {
    lua_State* const L = sandbox().stack();
    if (lua_checkstack(L, static_cast<int>(arguments.size()) + LUA_MINSTACK) == 0)
      throw ScriptFault(sandbox().file() + ": a function would have too many arguments");
    function.push();
    io_.push();
    for (const QuantityValue& argument : arguments) push_quantity(L, argument);
    invoke(1 + static_cast<int>(arguments.size()), 1, this);
    const bool none = lua_isnil(L, -1);
    auto value = none ? std::nullopt : quantity_at(L, -1);
    const std::string kind = luaL_typename(L, -1);
    lua_pop(L, 1);
    if (!none && !value)
      throw ScriptFault(sandbox().file() + ": a function returned a " + kind +
                        " that is no finite number, text, flag or list of numbers");
    if (const auto* text = value ? std::get_if<std::string>(&*value) : nullptr;
        text != nullptr && text->size() > kLongestText)
      throw ScriptFault(sandbox().file() + ": a function returned a text of " +
                        std::to_string(text->size()) + " bytes, which is too long");
    return value;
  });
}

std::optional<QuantityValue> Exchange::perform(const Action& action,
                                               const std::vector<QuantityValue>& arguments,
                                               bool answer, std::optional<Time> timeout) {
  if (const auto* function = std::get_if<Reference>(&action)) return call(*function, arguments);
  return judged([&]() -> std::optional<QuantityValue> {
    const auto& format = std::get<std::string>(action);
    const std::string message = arguments.empty() ? format : message_of(format, arguments);
    if (answer) return ask(message, timeout.value_or(declaration().link.timeout));
    send(message);
    return std::nullopt;
  });
}

void Exchange::set(const PropertyDeclaration& property, const QuantityValue& value) {
  if (!property.held || !std::holds_alternative<std::string>(property.set)) {
    perform(property.set, {value}, false);
    return;
  }
  std::string request;
  try {
    request = write_request(*property.held, value);
  } catch (const std::out_of_range& problem) {
    dialogue_.fail(DeviceErrorKind::out_of_range, property.info.name + ": " + problem.what());
  }
  if (!confirms(request, ask(request, declaration().link.timeout)))
    dialogue_.fail(DeviceErrorKind::protocol,
                   property.info.name + ": its answer is not that it was set");
}

/// A value that the format cannot say (2.5 for "%d") is the caller's fault, not the file's.
std::string Exchange::message_of(const std::string& format,
                                 const std::vector<QuantityValue>& arguments) {
  try {
    return message_for(sandbox(), format, arguments);
  } catch (const ScriptFault& fault) {
    if (std::string_view(fault.what()).find("no integer representation") == std::string_view::npos)
      throw;
    dialogue_.fail(DeviceErrorKind::out_of_range,
                   "must be a whole number for \"" + printable(format) + "\"");
  }
}

std::optional<std::vector<std::string>> Exchange::found(const std::string& text,
                                                        const std::string& pattern) {
  return judged([&] { return captures(sandbox(), text, pattern); });
}

void Exchange::check_errors() {
  const Declaration& all = declaration();
  if (!is_there(all.errors)) return;
  const auto said = perform(all.errors, {}, true);
  const std::string* const text = said ? std::get_if<std::string>(&*said) : nullptr;
  if (text == nullptr) return;  // a function fails by itself
  if (!found(*text, all.no_error))
    dialogue_.fail(DeviceErrorKind::refused, "it reports an error: " + printable(*text));
}

// A stop waits until it is over. Where the file's function fails there are still the bytes that the
// guardian would send.
void Exchange::make_safe() {
  const Declaration& all = declaration();
  const Scope safe(making_safe_);
  const StopShield shield(dialogue_.clock());
  // The time of a call that failed is over; this has its own.
  const Deadline fresh(*this, kForever);
  const Time until = std::exchange(until_, kForever);
  try {
    carry_out_safe();
    until_ = until;
  } catch (const ScriptFault& fault) {
    until_ = until;
    if (fault_.empty()) fault_ = printable(fault.what(), 400);
    for (const std::string& message : all.rescue.send) send(message);
    dialogue_.fail(DeviceErrorKind::protocol,
                   "its make_safe failed: " + printable(fault.what(), 400) +
                       (all.rescue.send.empty() ? "" : "; its rescue was sent instead"));
  } catch (...) {
    until_ = until;
    throw;
  }
}

void Exchange::carry_out_safe() {
  const Declaration& all = declaration();
  for (const std::string& message : all.safe) send(message);
  for (const auto& [index, value] : all.safe_values) {
    const PropertyDeclaration& property = all.properties[index];
    if (property.held && std::holds_alternative<std::string>(property.set)) {
      set(property, value);
    } else if (const auto* format = std::get_if<std::string>(&property.set)) {
      send(message_for(sandbox(), *format, {value}));
      if (!property.expects.empty()) next_message(reply_deadline());
    } else {
      // Not by call(), which would judge a fault and come here again.
      std::get<Reference>(property.set).push();
      io_.push();
      push_quantity(sandbox().stack(), value);
      invoke(2, 0, this);
    }
  }
  if (const Reference* const function = safe_function()) {
    function->push();
    io_.push();
    invoke(1, 0, this);
  }
}

/// What stops a stage is its safe state, where none is declared.
const Reference* Exchange::safe_function() const {
  const Declaration& all = declaration();
  if (const auto* declared = std::get_if<Reference>(&all.make_safe)) return declared;
  const auto halt = all.functions.find("halt");
  return all.safe.empty() && all.safe_values.empty() && halt != all.functions.end() ? &halt->second
                                                                                    : nullptr;
}

// io:ask(message, { timeout = 0.5, match = "^A" }): match may be a function(message).
int Exchange::op_ask(lua_State* L) {
  const std::string message(text_at(L, 1, "message"));
  const Time timeout = time_option(L, 2, "timeout", declaration().link.timeout);
  std::function<bool(const std::string&)> wanted;
  if (lua_type(L, 2) == LUA_TTABLE) {
    lua_pushstring(L, "match");
    lua_rawget(L, 2);
    if (lua_type(L, -1) == LUA_TSTRING) {
      wanted = [this, pattern = std::string(lua_tostring(L, -1))](const std::string& answer) {
        return captures(sandbox(), answer, pattern).has_value();
      };
    } else if (lua_type(L, -1) == LUA_TFUNCTION) {
      lua_pushvalue(L, -1);
      wanted = [this, function = Reference(L)](const std::string& answer) {
        lua_State* const stack = sandbox().stack();
        function.push();
        lua_pushlstring(stack, answer.data(), answer.size());
        invoke(1, 1);
        const bool good = lua_toboolean(stack, -1) != 0;
        lua_pop(stack, 1);
        return good;
      };
    } else if (lua_type(L, -1) != LUA_TNIL) {
      throw std::invalid_argument("match: must be a pattern or a function");
    }
    lua_pop(L, 1);
  }
  const std::string answer = ask(message, timeout, wanted);
  lua_pushlstring(L, answer.data(), answer.size());
  return 1;
}

// io:read { timeout = 1 }: the next message, asked for or not.
int Exchange::op_read(lua_State* L) {
  const Time timeout = time_option(L, 1, "timeout", declaration().link.timeout);
  const std::string message =
      next_message(std::min({later(dialogue_.clock().now(), timeout), deadline_, until_}));
  lua_pushlstring(L, message.data(), message.size());
  return 1;
}

/// While it lives a stop is felt, where the caller allows it.
struct Exchange::Hearing {
  explicit Hearing(Exchange& exchange) : clock(exchange.dialogue_.clock()) {
    if (exchange.breakable_ && !exchange.making_safe_) before = clock.set_deaf(false);
  }
  ~Hearing() {
    if (before) clock.set_deaf(*before);
  }
  Hearing(const Hearing&) = delete;
  Hearing& operator=(const Hearing&) = delete;
  Clock& clock;
  std::optional<bool> before{};
};

bool Exchange::hears(Clock& clock) {
  // The clock says what it was only when it is set: it is set, and set back.
  const bool deaf = clock.set_deaf(true);
  clock.set_deaf(deaf);
  return !deaf;
}

int Exchange::perform(std::string_view operation, lua_State* L) {
  Clock& clock = dialogue_.clock();
  if (clock.now() >= until_)
    throw Endless("after " + std::to_string(longest_call() / std::chrono::seconds(1)) + " s");
  if (operation == "ask") return op_ask(L);
  if (operation == "read") return op_read(L);
  if (operation == "now") return lua_pushnumber(L, to_seconds(clock.now())), 1;
  if (operation == "send") {
    send(text_at(L, 1, "message"));
    return 0;
  }
  if (operation == "sleep") {
    const double duration = lua_type(L, 1) == LUA_TNUMBER ? lua_tonumber(L, 1) : -1;
    if (!(duration >= 0 && duration <= kLongestSleep))
      throw std::invalid_argument("duration: must be 0 to 60 s");
    // A sleep ends with the time of its call, which is then refused as one without an end.
    const Time end = std::min(later(clock.now(), from_seconds(duration)), until_);
    const Hearing hearing(*this);
    clock.sleep_until(end);
    return 0;
  }
  // io:fail("refused", "the probe is not plugged in")
  const std::string kind(text_at(L, 1, "kind"));
  const std::string what(text_at(L, 2, "what"));
  for (const DeviceErrorKind one :
       {DeviceErrorKind::not_found, DeviceErrorKind::timeout, DeviceErrorKind::lost,
        DeviceErrorKind::protocol, DeviceErrorKind::refused, DeviceErrorKind::out_of_range})
    if (kind == to_string(one)) dialogue_.fail(one, printable(what, 200));
  throw std::invalid_argument("kind: must be refused, protocol, timeout, ...");
}

}  // namespace vitreo::scripted
