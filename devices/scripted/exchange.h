// Exchange of a scripted instrument with its link: messages as the file declares them, and the
// operations that its functions have.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/links/dialogue.h"
#include "devices/scripted/declaration.h"
#include "devices/scripted/sandbox.h"
#include "devices/time/identity.h"

#include <functional>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace vitreo::scripted {

/// All calls during a Turn of the dialogue. Errors of the file (ScriptFault) come out as
/// DeviceError{protocol} "its driver failed: pump.lua:12: ...", after the declared safe state was
/// sent; from then on every call says so, until begin() is called anew.
class Exchange : public Operations {
 public:
  /// `loaded` and `dialogue` outlive it.
  Exchange(Loaded& loaded, Dialogue& dialogue);

  /// After the link was opened: pause, identity, setup, the file's start_up. The dialogue's opening
  /// is the caller's.
  Identity begin();

  /// One message, with end and checksum.
  void send(std::string_view message);
  /// The next message, without them. Throws DeviceError{timeout}, {protocol}.
  std::string receive(Time deadline);
  /// A question and its answer. `wanted`: whether a message is the answer; others are what the
  /// instrument says by itself. Empty: the first one is.
  std::string ask(std::string_view message, Time timeout,
                  const std::function<bool(const std::string&)>& wanted = {});
  /// When the last question was sent, its answer there; for how long one is owed, zero: none is.
  Time asked() const { return asked_; }
  Time answered() const { return answered_; }
  Time owed() const;

  /// Carries out an action: a message is asked, or sent where `answer` is false; a function is
  /// called with io and `arguments`. What comes back: the answer's text, or the function's value.
  std::optional<QuantityValue> perform(const Action& action,
                                       const std::vector<QuantityValue>& arguments, bool answer,
                                       std::optional<Time> timeout = {});
  /// Sets a property; `value` as the file sees it. A register's answer is looked at.
  void set(const PropertyDeclaration& property, const QuantityValue& value);
  /// Calls a function of the file with io and arguments.
  std::optional<QuantityValue> call(const Reference& function,
                                    const std::vector<QuantityValue>& arguments);
  /// While it lives no answer is waited for beyond `deadline`, whatever the file says.
  class Deadline {
   public:
    Deadline(Exchange& exchange, Time deadline)
        : exchange_(exchange), before_(std::exchange(exchange.deadline_, deadline)) {}
    ~Deadline() { exchange_.deadline_ = before_; }
    Deadline(const Deadline&) = delete;
    Deadline& operator=(const Deadline&) = delete;

   private:
    Exchange& exchange_;
    Time before_;
  };

  /// While it lives, made during a Turn, a stop breaks the file's functions off while they sleep:
  /// of what is read, where nothing is left half done. `feels`: hears() before that Turn.
  class Breakable {
   public:
    Breakable(Exchange& exchange, bool feels)
        : exchange_(exchange), before_(std::exchange(exchange.breakable_, feels)) {}
    ~Breakable() { exchange_.breakable_ = before_; }
    Breakable(const Breakable&) = delete;
    Breakable& operator=(const Breakable&) = delete;

   private:
    Exchange& exchange_;
    bool before_;
  };
  /// Whether the calling task's waits feel a stop.
  static bool hears(Clock& clock);

  /// After a command: asks for the instrument's errors where the file declares how.
  void check_errors();
  /// What a pattern of the file finds in a text, as captures() does.
  std::optional<std::vector<std::string>> found(const std::string& text,
                                                const std::string& pattern);
  /// The declared safe state; a stage that declares none is halted. Where a function of the file
  /// fails in it the rescue is sent, and DeviceError{protocol} says so.
  void make_safe();
  /// Whether a function of the file failed since begin().
  const std::string& fault() const { return fault_; }
  void fail(DeviceErrorKind kind, const std::string& what) const { dialogue_.fail(kind, what); }

  Sandbox& sandbox() { return *loaded_.sandbox; }
  const Declaration& declaration() const { return loaded_.declaration; }
  Dialogue& dialogue() { return dialogue_; }

  int perform(std::string_view operation, lua_State* L) override;

 private:
  template <class Work>
  auto judged(const Work& work);
  [[noreturn]] void break_down(const ScriptFault& fault);
  struct Hearing;
  void invoke(int arguments, int results, Operations* operations = nullptr);
  Time longest_call() const;
  const Reference* safe_function() const;
  void carry_out_safe();
  std::string message_of(const std::string& format, const std::vector<QuantityValue>& arguments);
  void settle();
  std::string next_message(Time deadline);
  std::string without_checksum(std::string message);
  std::string unframed(Time deadline);
  std::string take(std::size_t count, Time deadline);
  std::string modbus_answer(Time deadline);
  std::string rtu_answer(Time deadline);
  std::string tcp_answer(Time deadline);
  std::string until(const std::string& end, Time deadline);
  std::string counted(Time deadline);
  void drop_echo(std::string_view sent, Time deadline);
  void hand_over(const std::string& message);
  Identity identify();
  int op_ask(lua_State* L);
  int op_read(lua_State* L);
  Time reply_deadline() const;

  Loaded& loaded_;
  Dialogue& dialogue_;
  Reference io_;
  Time deadline_ = kForever;
  Time until_ = kForever;  // of the function of the file that runs
  bool unsure_ = false;    // part of an older answer may still come
  bool owed_ = false;      // a whole one, to a question that was given up
  bool breakable_ = false;
  bool opening_ = false;
  bool making_safe_ = false;
  std::string fault_;
  Time sent_{};
  std::uint16_t transaction_ = 0;  // of Modbus on TCP, counted up
  char function_ = 0;              // of Modbus, what was asked last
  bool sent_before_ = false;
  Time asked_{};
  Time answered_{};
};

}  // namespace vitreo::scripted
