// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/emulator.h"

#include "devices/links/modbus_emulator.h"
#include "devices/links/printable.h"
#include "devices/scripted/checksum.h"
#include "devices/scripted/conversion.h"
#include "devices/scripted/lua_values.h"
#include "devices/scripted/table_reader.h"
#include "devices/time/error.h"

#include <algorithm>
#include <deque>
#include <utility>

namespace vitreo::scripted {
namespace {

/// What each emulator can do: things that move at a constant speed, and messages of its own accord.
/// e:glide("x", 5, 2.4), e:at("x"), e:gliding("x"), e:later(0.5, "done").
constexpr const char* kPrelude = R"(
local methods = {}
function methods:at(name)
  local one = self.glides[name]
  if not one then return 0 end
  local part = one.speed * (self.now - one.began)
  local way = one.to - one.from
  if part >= math.abs(way) then return one.to end
  return one.from + (way < 0 and -part or part)
end
function methods:glide(name, to, speed)
  self.glides[name] = { from = self:at(name), to = to, speed = speed, began = self.now }
end
function methods:gliding(name)
  local one = self.glides[name]
  return one ~= nil and self:at(name) ~= one.to
end
function methods:later(delay, message)
  self.planned[#self.planned + 1] = { self.now + delay, message }
end
local kind = { __index = methods }
return function() return setmetatable({ now = 0, glides = {}, planned = {} }, kind) end
)";

/// What it may say at once, and hear without an end.
constexpr std::size_t kMostWaiting = 4u << 20;  // bytes
constexpr std::size_t kMostPlanned = 20'000;    // messages
constexpr std::size_t kOverhead = 1024;         // bytes

class ScriptedEmulator final : public Emulator, private modbus::Store {
 public:
  ScriptedEmulator(Loaded loaded, Surroundings surroundings)
      : loaded_(std::move(loaded)), surroundings_(std::move(surroundings)) {
    read();
    power_up(Time::zero());
    if (!fault_.empty()) throw ScriptFault(fault_);
  }
  const std::string& fault() const override { return fault_; }

  void receive(std::span<const std::uint8_t> bytes, Time now) override {
    if (modbus_) return modbus_->receive(bytes, now);
    for (const std::uint8_t byte : bytes) {
      // Byte by byte: a message ends where its end is, whatever the link's portions are.
      if (heard_.size() > framing().most + kOverhead) heard_.clear();  // it has no end
      heard_.push_back(static_cast<char>(byte));
      heard_at_ = now;
      if (const auto message = complete(now)) answer(*message, now);
    }
  }
  std::vector<TimedBytes> say(Time now) override {
    if (modbus_) return modbus_->say(now);
    end_of_silence(now);
    std::vector<TimedBytes> said;
    while (!planned_.empty() && planned_.front().at <= now) {
      said.push_back(std::move(planned_.front()));
      planned_.pop_front();
      waiting_ -= said.back().bytes.size();
    }
    return said;
  }
  Time next() const override {
    if (modbus_) return modbus_->next();
    Time first = planned_.empty() ? kForever : planned_.front().at;
    if (framing().kind == Framing::Kind::quiet && !heard_.empty())
      first = std::min(first, later(heard_at_, framing().quiet));
    return first;
  }
  void power_cycle(Time now) override {
    heard_.clear();
    planned_.clear();
    if (modbus_) modbus_->power_cycle(now);
    waiting_ = 0;
    power_up(now);
  }

  std::optional<std::vector<double>> position(Time now) override {
    if (!position_ || !fault_.empty()) return std::nullopt;
    std::optional<std::vector<double>> list;
    attempt(now, [&] {
      position_.push();
      state_.push();
      sandbox().call(1, 1);
      if (lua_type(stack(), -1) == LUA_TNUMBER)
        list = {{lua_tonumber(stack(), -1)}};
      else
        list = numbers_at(stack(), -1);
      lua_pop(stack(), 1);
    });
    const auto& axes = loaded_.declaration.axes;
    if (!list || list->size() != axes.size()) return std::nullopt;
    // The simulated world is in SI, the file in the axis' unit.
    for (std::size_t i = 0; i < axes.size(); ++i) (*list)[i] = axes[i].unit.to_si((*list)[i]);
    return list;
  }

 private:
  Sandbox& sandbox() const { return *loaded_.sandbox; }
  lua_State* stack() const { return sandbox().stack(); }
  const Framing& framing() const { return loaded_.declaration.link.framing; }

  /// answers = { ["*IDN?"] = "...", { "^SETP (.+)$", function(e, value) ... end } }
  void read() {
    if (!loaded_.declaration.emulator) throw ScriptFault(sandbox().file() + ": it has no emulator");
    loaded_.declaration.emulator.push();
    TableReader reader(sandbox(), "emulator");
    power_up_ = reader.function("start");
    message_ = reader.function("message");
    position_ = reader.function("position");
    delay_ = reader.seconds("delay", 0.001, 60);
    if (auto answers = reader.table("answers")) {
      for (const std::string& message : answers->keys()) exact_[message] = answers->action(message);
      for (TableReader& one : reader.list("answers")) {
        one.reference().push();
        lua_rawgeti(stack(), -1, 1);
        const std::string pattern =
            lua_type(stack(), -1) == LUA_TSTRING ? lua_tostring(stack(), -1) : "";
        lua_pop(stack(), 1);
        const int type = lua_rawgeti(stack(), -1, 2);
        if (pattern.empty() || (type != LUA_TFUNCTION && type != LUA_TSTRING)) {
          lua_pop(stack(), 2);
          one.fail("", "must be { pattern, answer or function(e, captures) }");
        }
        patterns_.emplace_back(pattern, Reference(stack()));
        lua_pop(stack(), 1);
      }
    }
    read_registers(reader);
    if (exact_.empty() && patterns_.empty() && !message_ && !modbus_)
      reader.fail("answers", "neither answers nor message is there");
    reader.finish();
    sandbox().run_own(kPrelude);
    make_state_ = Reference(stack());
  }

  /// registers = { temperature = function(e) return 20 end, set_point = 25 }: by the names of
  /// properties, in their units. What is written stands in the state, e.set_point.
  void read_registers(TableReader& reader) {
    if (framing().kind != Framing::Kind::modbus) return;
    auto registers = reader.table("registers");
    if (!registers) reader.fail("registers", "is missing: { set_point = 25, ... }");
    for (const PropertyDeclaration& one : loaded_.declaration.properties) {
      if (!one.held || !registers->has(one.info.name)) continue;
      try {
        held_[one.info.name] = *registers->value(one.info.name);
      } catch (const ScriptFault&) {
        held_[one.info.name] = registers->function(one.info.name);
      }
    }
    registers->finish();
    // Frames, silence and exceptions of Modbus are the link's emulator; this one is its store.
    modbus_ = modbus::make_emulator(*this,
                                    {.framing = framing().modbus,
                                     .unit = framing().unit,
                                     .delay = delay_,
                                     .character = character_time(loaded_.declaration.link.serial)});
  }

  static modbus::Table table_of(RegisterTable table) {
    return table == RegisterTable::coil             ? modbus::Table::coils
           : table == RegisterTable::discrete_input ? modbus::Table::discrete_inputs
           : table == RegisterTable::input          ? modbus::Table::input_registers
                                                    : modbus::Table::holding_registers;
  }
  const PropertyDeclaration* property_at(modbus::Table table, std::uint16_t address) const {
    for (const PropertyDeclaration& one : loaded_.declaration.properties)
      if (one.held && held_.contains(one.info.name) && table_of(one.held->table) == table &&
          address >= one.held->address && address < one.held->address + width_of(*one.held))
        return &one;
    return nullptr;
  }
  std::optional<std::vector<std::uint16_t>> words(const PropertyDeclaration& property, Time now) {
    std::optional<QuantityValue> value;
    attempt(now, [&] {
      const auto& entry = held_.at(property.info.name);
      if (const auto* function = std::get_if<Reference>(&entry)) {
        function->push();
        state_.push();
        sandbox().call(1, 1);
        value = quantity_at(stack(), -1);
        lua_pop(stack(), 1);
      } else {
        state_.push();
        lua_pushstring(stack(), property.info.name.c_str());
        lua_rawget(stack(), -2);
        value = quantity_at(stack(), -1);
        lua_pop(stack(), 2);
      }
      if (!value)
        throw ScriptFault(sandbox().file() + ": emulator.registers." + property.info.name +
                          ": gives no value");
    });
    try {
      return value ? std::optional(words_of(*property.held, *value)) : std::nullopt;
    } catch (const std::out_of_range&) {
      return std::nullopt;
    }
  }
  std::optional<std::uint16_t> read(modbus::Table table, std::uint16_t address, Time now) override {
    const PropertyDeclaration* const property = property_at(table, address);
    const auto all = property == nullptr ? std::nullopt : words(*property, now);
    if (!all) return std::nullopt;
    return (*all)[static_cast<std::size_t>(address - property->held->address)];
  }
  std::uint8_t write(modbus::Table table, std::uint16_t address, std::uint16_t value,
                     Time now) override {
    constexpr std::uint8_t kNoAddress = 2, kNoValue = 3;
    const PropertyDeclaration* const property = property_at(table, address);
    auto all = property == nullptr ? std::nullopt : words(*property, now);
    if (!all || !is_there(property->set)) return kNoAddress;
    // A value of two words is written word by word: the other one keeps what it had.
    (*all)[static_cast<std::size_t>(address - property->held->address)] = value;
    const auto held = value_of_words(*property->held, *all);
    if (!held) return kNoValue;
    put(property->info.name, *held);
    return 0;
  }
  void put(const std::string& name, const QuantityValue& value) {
    state_.push();
    push_quantity(stack(), value);
    set(name.c_str());
    lua_pop(stack(), 1);
  }

  void power_up(Time now) {
    fault_.clear();
    full_ = false;
    make_state_.push();
    sandbox().call(0, 1);
    state_ = Reference(stack());
    for (const auto& [name, entry] : held_)
      if (const auto* value = std::get_if<QuantityValue>(&entry)) put(name, *value);
    attempt(now, [&] {
      if (!power_up_) return;
      power_up_.push();
      state_.push();
      sandbox().call(1, 0);
    });
  }

  /// The state with the time and what it feels; then `work`, then what it planned.
  template <class Work>
  void attempt(Time now, const Work& work) {
    if (!fault_.empty()) return;
    try {
      state_.push();
      lua_pushnumber(stack(), to_seconds(now));
      set("now");
      if (surroundings_.field) {
        std::vector<double> field = surroundings_.field(now);
        for (double& one : field) one = loaded_.declaration.unit.from_si(one);
        push_quantity(stack(), field);
        set("field");
      }
      lua_pop(stack(), 1);
      work();
      take_planned();
      drive(now);
      if (full_) throw ScriptFault(sandbox().file() + ": emulator: it says more than is heard");
    } catch (const ScriptFault& fault) {
      // Whatever the failed work left on the stack. Behind these last words the emulator is silent.
      lua_settop(stack(), 0);
      fault_ = fault.what();
      planned_.clear();
      waiting_ = 0;
      plan(now, "its emulator failed: " + printable(fault_, 300));
    }
  }
  /// [state, value] -> [state]
  void set(const char* field) {
    lua_pushstring(stack(), field);
    lua_insert(stack(), -2);
    lua_rawset(stack(), -3);
  }

  /// e.currents, in the declared unit, flow in the simulated coils.
  void drive(Time now) {
    if (!surroundings_.drive) return;
    state_.push();
    lua_pushstring(stack(), "currents");
    lua_rawget(stack(), -2);
    auto list = numbers_at(stack(), -1);
    lua_pop(stack(), 2);
    if (!list ||
        list->size() != static_cast<std::size_t>(loaded_.declaration.numbers.at("channels")))
      return;
    for (double& one : *list) one = loaded_.declaration.unit.to_si(one);
    // Currents that did not change are no event of the plant.
    if (*list == driven_) return;
    driven_ = *list;
    surroundings_.drive(now, driven_);
  }

  void take_planned() {
    state_.push();
    lua_pushstring(stack(), "planned");
    const int type = lua_rawget(stack(), -2);
    const auto count = type == LUA_TTABLE ? static_cast<lua_Integer>(lua_rawlen(stack(), -1)) : 0;
    for (lua_Integer i = 1; i <= count && !full_; ++i) {
      if (lua_rawgeti(stack(), -1, i) == LUA_TTABLE) {
        lua_rawgeti(stack(), -1, 1);
        lua_rawgeti(stack(), -2, 2);
        const double at = lua_tonumber(stack(), -2);
        if (lua_type(stack(), -1) == LUA_TSTRING && at >= 0 && at < 1e9)
          plan(from_seconds(at), {lua_tostring(stack(), -1), lua_rawlen(stack(), -1)});
        lua_pop(stack(), 2);
      }
      lua_pop(stack(), 1);
    }
    lua_pop(stack(), 1);
    lua_newtable(stack());
    set("planned");
    lua_pop(stack(), 1);
  }

  /// Framed, in the order of time.
  void plan(Time at, const std::string& message) {
    if (waiting_ + message.size() > kMostWaiting || planned_.size() > kMostPlanned) {
      full_ = true;
      return;
    }
    const std::string whole = framed_answer(framing(), message);
    waiting_ += whole.size();
    TimedBytes timed{at, {whole.begin(), whole.end()}};
    // Behind those of the same time: what was said first comes first.
    const auto behind = std::upper_bound(planned_.begin(), planned_.end(), at,
                                         [](Time t, const TimedBytes& one) { return t < one.at; });
    planned_.insert(behind, std::move(timed));
  }

  /// The message that has come whole, without frame and checksum.
  std::optional<std::string> complete(Time now) {
    const Framing& frame = framing();
    std::string message;
    switch (frame.plain_send ? Framing::Kind::line : frame.kind) {
      case Framing::Kind::line: {
        const std::string& end = frame.send_end;
        if (end.empty() || !heard_.ends_with(end)) return std::nullopt;
        message = heard_.substr(0, heard_.size() - end.size());
        break;
      }
      case Framing::Kind::fixed:
        if (heard_.size() < frame.length) return std::nullopt;
        message = heard_;
        break;
      case Framing::Kind::header:
        if (heard_.size() == frame.length) attempt(now, [this] { rest_ = rest(); });
        if (heard_.size() < frame.length || heard_.size() < frame.length + rest_)
          return std::nullopt;
        message = heard_;
        break;
      case Framing::Kind::brackets:
        if (frame.counted >= 0) {
          heard_.erase(0, std::min(heard_.find(frame.start), heard_.size()));
          if (heard_.size() < 2) return std::nullopt;
          const int size = static_cast<unsigned char>(heard_[1]) - frame.counted;
          const std::size_t whole =
              static_cast<std::size_t>(std::max(size, 0)) + checksum_size(frame.checksum) + 3;
          if (heard_.size() < whole) return std::nullopt;
          message = heard_.substr(2, whole - 3);
          break;
        }
        if (!heard_.ends_with(frame.stop)) return std::nullopt;
        message = heard_.substr(0, heard_.size() - 1);
        // From the last start on: one that was broken off before it is dropped. Without any (npos +
        // 1 is 0) the whole text is taken.
        message = message.substr(std::min(message.size(), message.rfind(frame.start) + 1));
        break;
      case Framing::Kind::quiet:   // end_of_silence()
      case Framing::Kind::modbus:  // modbus_
        return std::nullopt;
    }
    heard_.clear();
    return checked(std::move(message));
  }
  std::optional<std::string> checked(std::string message) const {
    const std::size_t size = checksum_size(framing().checksum);
    if (message.size() < size) return std::nullopt;
    const std::string sum = message.substr(message.size() - size);
    message.resize(message.size() - size);
    // Silence, as an instrument answers to a message that it cannot trust.
    if (checksum_of(framing().checksum, message) != sum) return std::nullopt;
    return message;
  }
  std::size_t rest() {
    framing().rest.push();
    lua_pushlstring(stack(), heard_.data(), framing().length);
    sandbox().call(1, 1);
    const double count = lua_tonumber(stack(), -1);
    lua_pop(stack(), 1);
    if (!(count >= 0 && count <= static_cast<double>(framing().most)))
      throw ScriptFault(sandbox().file() +
                        ": link.message.rest: does not give how many bytes follow");
    return static_cast<std::size_t>(count);
  }
  void end_of_silence(Time now) {
    if (framing().kind != Framing::Kind::quiet || heard_.empty()) return;
    const Time end = later(heard_at_, framing().quiet);
    if (now < end) return;
    if (const auto message = checked(std::exchange(heard_, {}))) answer(*message, end);
  }

  void answer(const std::string& message, Time now) {
    attempt(now, [&] {
      const auto found = exact_.find(message);
      if (found != exact_.end()) {
        if (const auto* text = std::get_if<std::string>(&found->second))
          return plan(later(now, delay_), *text);
        return reply(std::get<Reference>(found->second), {}, now);
      }
      for (const auto& [pattern, answered] : patterns_)
        if (const auto parts = captures(sandbox(), message, pattern))
          return reply(answered, *parts, now);
      if (message_) reply(message_, {message}, now);
    });
  }

  /// A text, a function(e, ...) that gives a text, a list of texts or nothing.
  void reply(const Reference& answered, const std::vector<std::string>& parts, Time now) {
    answered.push();
    if (lua_type(stack(), -1) == LUA_TFUNCTION) {
      state_.push();
      for (const std::string& part : parts) lua_pushlstring(stack(), part.data(), part.size());
      sandbox().call(1 + static_cast<int>(parts.size()), 1);
    }
    if (lua_type(stack(), -1) == LUA_TSTRING)
      plan(later(now, delay_), {lua_tostring(stack(), -1), lua_rawlen(stack(), -1)});
    if (lua_type(stack(), -1) == LUA_TTABLE)
      for (lua_Integer i = 1; !full_ && lua_rawgeti(stack(), -1, i) == LUA_TSTRING; ++i) {
        plan(later(now, delay_), {lua_tostring(stack(), -1), lua_rawlen(stack(), -1)});
        lua_pop(stack(), 1);
      }
    lua_settop(stack(), 0);
  }

  Loaded loaded_;
  const Surroundings surroundings_;
  Reference power_up_, message_, position_, make_state_, state_;
  std::map<std::string, Action> exact_;
  std::vector<std::pair<std::string, Reference>> patterns_;
  std::map<std::string, std::variant<QuantityValue, Reference>> held_;
  std::unique_ptr<BytePeer> modbus_;  // null: another wire
  Time delay_{};
  std::string heard_;
  Time heard_at_{};
  std::size_t rest_ = 0;  // bytes that follow the header that was heard
  std::deque<TimedBytes> planned_;
  std::size_t waiting_ = 0;  // bytes of planned_
  bool full_ = false;        // more than that is not planned
  std::vector<double> driven_;
  std::string fault_;  // what went wrong in it; then it says nothing any more
};

class EmulatedLink final : public ByteLink {
 public:
  EmulatedLink(std::shared_ptr<Emulator> emulator, std::unique_ptr<ByteLink> link)
      : emulator_(std::move(emulator)), link_(std::move(link)) {}
  const std::string& address() const override { return link_->address(); }
  std::string description() const override { return link_->description(); }
  void write(std::span<const std::uint8_t> bytes, Time timeout) override {
    link_->write(bytes, timeout);
  }
  ByteString read(std::size_t most, Time timeout) override {
    ByteString bytes = link_->read(most, timeout);
    if (!emulator_->fault().empty())
      throw DeviceError(DeviceErrorKind::protocol, link_->address(),
                        "its emulator failed: " + printable(emulator_->fault(), 400));
    return bytes;
  }
  bool hung_up() const override { return link_->hung_up(); }
  void reopen() override { link_->reopen(); }

 private:
  std::shared_ptr<Emulator> emulator_;
  std::unique_ptr<ByteLink> link_;
};

}  // namespace

std::unique_ptr<ByteLink> link_to(std::shared_ptr<Emulator> emulator,
                                  std::unique_ptr<ByteLink> link) {
  if (!emulator) return link;
  return std::make_unique<EmulatedLink>(std::move(emulator), std::move(link));
}

std::unique_ptr<Emulator> make_emulator(Loaded loaded, Surroundings surroundings) {
  return std::make_unique<ScriptedEmulator>(std::move(loaded), std::move(surroundings));
}

}  // namespace vitreo::scripted
