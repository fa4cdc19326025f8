// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/kepco_bop/driver.h"

#include "devices/instruments/kepco_bop/wire.h"
#include "devices/links/dialogue.h"
#include "devices/time/error.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <deque>
#include <exception>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::kepco_bop {
namespace {

/// After which nothing more of an older answer comes: 29 bytes' time at 9600 baud.
constexpr Time kSilence = std::chrono::milliseconds(30);
/// Its error queue holds 15.
constexpr int kMostErrors = 16;
/// Relative, of limits that are read back: they come back in few digits.
constexpr double kReadBack = 1e-3;

std::string in_short(double number) {
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%g", number);
  return text.data();
}

/// One supply: one channel. Each line that is sent has one answer, so a late one is found by the
/// line being unsure: then the input is cleared by ESC, and what still comes is discarded.
/// lately_ always holds the set-point in force at the beginning of the settling time, so that the
/// range of currents that may flow is known.
class Supply {
 public:
  /// `channel` counts from 1, as the rig file's addresses do.
  Supply(std::unique_ptr<ByteLink> link, int channel, const Settings& settings, Clock& clock)
      : settings_(settings),
        channel_(channel),
        dialogue_(std::move(link), settings.name, clock, "channel " + std::to_string(channel)) {}

  /// For the first time; `explain`: an error of it is looked into, which may take 2 s more.
  void open(bool explain) {
    if (!explain) return configure();
    dialogue_.opening([this] { configure(); });
  }
  void configure();
  void be_open();
  void send_current(double current);
  double take_measured();
  void ask_measured() { send("MEAS:CURR?"); }
  double take_asked();
  // The set-point is asked back: what counts is that the supply has taken the zero.
  void zero() {
    expect_number("CURR 0;:CURR?", 0);
    lately_.push_back({clock().now(), 0});
    zero_ = Zero::confirmed;
  }
  void switch_off() { ask("OUTP OFF;:OUTP?"); }
  const Identity& identity() const { return identity_; }
  bool lost() const { return dialogue_.lost(); }
  LinkState link_state() const {
    return {dialogue_.hung_up()
                ? "channel " + std::to_string(channel_) + ", " + dialogue_.description()
                : "",
            asked_ ? clock().now() - *asked_ : Time::zero()};
  }
  Dialogue& dialogue() { return dialogue_; }
  int channel() const { return channel_; }
  /// Whether it is known to be a BOP: nothing but *IDN? is sent to anything else.
  bool known() const { return zero_ != Zero::none; }
  bool has_confirmed_zero() const { return zero_ == Zero::confirmed; }
  std::string zero_text() const;

 private:
  void send(const std::string& line);
  std::string answer();
  std::string ask(const std::string& line) {
    send(line);
    return answer();
  }
  void expect(const std::string& line, const std::string& wanted);
  void expect_number(const std::string& line, double wanted);
  void limit(const std::string& name, double magnitude);
  void check_read_back(double measured);
  void fail_for(const scpi::Error& error);
  Clock& clock() const { return dialogue_.clock(); }
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    dialogue_.fail(kind, what);
  }

  /// Since it was opened first: no zero was sent, one was tried, one was read back.
  enum class Zero { none, tried, confirmed };

  struct Set {
    Time at;
    double current;
  };
  const Settings& settings_;
  const int channel_;
  Dialogue dialogue_;
  Identity identity_;
  Zero zero_ = Zero::none;
  // An answer to an older question may still come.
  bool unsure_ = true;
  std::optional<Time> asked_;  // the question whose answer is owed
  // What was set within the settling time, and the last before.
  std::deque<Set> lately_;
};

// The line is unsure from before the command until its answer was read, so an exception in between
// leaves it so, and the next command clears it.
void Supply::send(const std::string& line) {
  if (unsure_) {
    const char clear = kClearInput;
    dialogue_.send(std::string_view(&clear, 1));
    dialogue_.settle(kSilence);
  }
  dialogue_.discard();
  unsure_ = true;
  dialogue_.send(line + "\n");
  asked_ = clock().now();
}

/// The next line that is not empty: on a serial port set commands are answered by an empty one
/// (manual of the 1 kW BOP: the line terminator is returned when a line was parsed), on the network
/// by none. XON and XOFF, which may wrap an answer, are removed by trimmed().
std::string Supply::answer() {
  const Time deadline = later(clock().now(), from_seconds(settings_.reply_timeout));
  for (;;) {
    std::string line = answer_in(dialogue_.line('\n', kMaxAnswer, deadline));
    if (line.empty()) continue;
    unsure_ = false;
    asked_.reset();
    return line;
  }
}

/// Sends a line that ends in a question, and compares its answer.
void Supply::expect(const std::string& line, const std::string& wanted) {
  const std::string said = ask(line);
  if (said != wanted)
    fail(DeviceErrorKind::refused,
         "after \"" + line + "\" it says " + printable(said) + ", not " + wanted);
}

// The tolerance is relative, but never finer than that of 1 A or 1 V, so that zeros can be
// compared.
void Supply::expect_number(const std::string& line, double wanted) {
  const std::string said = ask(line);
  const auto number = scpi::number(said);
  if (!number)
    fail(DeviceErrorKind::protocol, "\"" + line + "\" is answered by " + printable(said));
  if (std::abs(*number - wanted) > kReadBack * std::max(1., std::abs(wanted)))
    fail(DeviceErrorKind::refused, "after \"" + line + "\" it keeps " + in_short(*number));
}

/// A limit of both signs, read back one by one: asked without a sign it answers two numbers (manual
/// B.22, B.94). Whether the negative one is told with its sign the manual does not say.
void Supply::limit(const std::string& name, double magnitude) {
  expect_number(with_number(name, magnitude) + ";:" + name + ":POS?", magnitude);
  const std::string question = name + ":NEG?";
  const std::string said = ask(question);
  const auto number = scpi::number(said);
  if (!number || std::abs(std::abs(*number) - magnitude) > kReadBack * std::max(1., magnitude))
    fail(DeviceErrorKind::refused, "\"" + question + "\" is answered by " + printable(said) +
                                       ", not by " + in_short(magnitude));
}

/// -222 is "data out of range"; the device's own errors (temperature, overcurrent) are positive,
/// the other negative ones are of syntax.
void Supply::fail_for(const scpi::Error& error) {
  if (error.code == 0) return;
  const std::string what = "error " + std::to_string(error.code) + ", " + printable(error.text);
  fail(error.code == -222 || error.code > 0 ? DeviceErrorKind::refused : DeviceErrorKind::protocol,
       what);
}

/// Everything that a fresh link needs, at zero current: first of all the zero, for the supply may
/// still hold what a host that died has asked for.
/// The identity is kept from the first opening: after a lost link another supply at the same
/// address is refused, with whatever it holds.
void Supply::configure() {
  unsure_ = true;
  lately_.clear();
  const std::string said = ask("*IDN?");
  const auto who = decode_identity(said);
  if (!who) fail(DeviceErrorKind::not_found, "this is no Kepco BOP: " + printable(said));
  if (!identity_.name.empty() && (who->name != identity_.name || who->serial != identity_.serial))
    fail(DeviceErrorKind::not_found,
         "it was a " + to_string(identity_) + ", and now there is a " + to_string(*who));
  dialogue_.identified();
  zero_ = Zero::tried;
  expect("*CLS;:SYST:REM 1;:SYST:REM?", "1");
  expect_number("CURR 0;:CURR?", 0);
  // The zero once more: in voltage mode the one above was not the set point.
  const std::string mode = ask("FUNC:MODE CURR;:FUNC:MODE?");
  if (mode == "0" || mode == "VOLT") fail(DeviceErrorKind::refused, "it stays in voltage mode");
  if (mode != "1" && mode != "CURR")
    fail(DeviceErrorKind::protocol, "its mode is none that is known: " + printable(mode));
  expect_number("CURR 0;:CURR?", 0);
  zero_ = Zero::confirmed;
  if (is_bit_card(*who)) {
    expect_number(with_number("VOLT", settings_.voltage_limit) + ";:VOLT?",
                  settings_.voltage_limit);
  } else {
    limit("CURR:LIM", settings_.current_limit);
    limit("VOLT:PROT", settings_.voltage_limit);
  }
  // Off must not open the circuit of an inductive load: ACTIVE holds 0 A and 0 V instead.
  expect("OUTP:MODE ACTIVE;:OUTP:MODE?", "ACTIVE");
  expect("OUTP ON;:OUTP?", "1");
  for (int i = 0; i < kMostErrors; ++i) {
    const auto error = scpi::error(ask("SYST:ERR?"));
    if (!error) fail(DeviceErrorKind::protocol, "its error queue cannot be read");
    if (error->code == 0) break;
    fail_for(*error);
  }
  identity_ = *who;
  lately_.push_back({clock().now(), 0});
}

/// What is known of its current after an opening that failed, and no more.
std::string Supply::zero_text() const {
  switch (zero_) {
    case Zero::none:
      return "no zero was sent to it, so a current that was set before may still flow";
    case Zero::tried:
      return "its zero was tried and is not confirmed, so a current may still flow";
    case Zero::confirmed:
      return "it has confirmed its zero";
  }
  return "";
}

/// After a lost link.
/// Half configured counts as lost, so that the next call begins anew.
void Supply::be_open() {
  if (!dialogue_.lost()) return;
  dialogue_.reopen();
  try {
    configure();
  } catch (const DeviceError&) {
    dialogue_.abandon();
    throw;
  }
}

// Apart from take_measured(), so that all supplies have their set-point before any is asked.
void Supply::send_current(double current) {
  send(set_and_measure(current));
  lately_.push_back({clock().now(), current});
}

double Supply::take_measured() {
  const std::string said = answer();
  const auto measured = decode_measured(said);
  if (!measured)
    fail(DeviceErrorKind::protocol, "no current and no error can be read in " + printable(said));
  fail_for(measured->error);
  check_read_back(measured->current);
  return measured->current;
}

double Supply::take_asked() {
  const std::string said = answer();
  const auto current = scpi::number(said);
  if (!current) fail(DeviceErrorKind::protocol, "its current is no number: " + printable(said));
  return *current;
}

/// The current that flows lies between the least and the largest set-point of the settling time,
/// but for the tolerance, or something is broken: a fuse, a coil, a supply.
void Supply::check_read_back(double measured) {
  // From the last set-point, not from now: it was measured with that.
  const Time begin = lately_.back().at - from_seconds(settings_.settling_time);
  while (lately_.size() > 1 && lately_[1].at <= begin) lately_.pop_front();
  const auto [low, high] =
      std::minmax_element(lately_.begin(), lately_.end(),
                          [](const Set& a, const Set& b) { return a.current < b.current; });
  if (measured < low->current - settings_.read_back_tolerance ||
      measured > high->current + settings_.read_back_tolerance)
    fail(DeviceErrorKind::refused,
         in_short(measured) + " A flow where " + in_short(lately_.back().current) + " A were set");
}

/// The dialogue of the first supply lends its Turn to all: an exchange with all supplies is one.
/// The links are as many as the channels; each supply has an answer of its own to wait for.
class Bops final : public CoilAmplifier {
 public:
  Bops(std::vector<std::unique_ptr<ByteLink>> links, const Settings& settings, Clock& clock)
      : settings_(settings), clock_(clock), currents_(links.size()) {
    for (auto& link : links)
      supplies_.push_back(std::make_unique<Supply>(
          std::move(link), static_cast<int>(supplies_.size()) + 1, settings_, clock));
    const Dialogue::Turn turn(supplies_.front()->dialogue());
    open_all();
  }
  Bops(const Bops&) = delete;
  Bops& operator=(const Bops&) = delete;
  ~Bops() override {
    const StopShield shield(clock_);
    // Lost supplies are not opened again here: what they still hold is the guardian's.
    quietly([this] { zero_all(false); });
    for (const auto& supply : supplies_) quietly([&] { supply->switch_off(); });
  }

  std::string identity() const override {
    return std::to_string(supplies_.size()) + " x " + to_string(supplies_.front()->identity());
  }
  int channels() const override { return static_cast<int>(supplies_.size()); }
  double current_limit() const override { return settings_.current_limit; }
  std::vector<double> currents() const override { return currents_; }
  void set_currents(std::span<const double> currents) override;
  std::optional<std::vector<double>> measured_currents() override {
    const Dialogue::Turn turn(supplies_.front()->dialogue());
    std::vector<double> measured(supplies_.size());
    side_by_side([](Supply& supply, std::size_t) { supply.ask_measured(); },
                 [&](Supply& supply, std::size_t i) { measured[i] = supply.take_asked(); });
    return measured;
  }
  LinkState link_state() const override {
    LinkState all;
    for (const auto& supply : supplies_) {
      const LinkState one = supply->link_state();
      if (all.hung_up.empty()) all.hung_up = one.hung_up;
      all.owed = std::max(all.owed, one.owed);
    }
    return all;
  }
  void make_safe() override {
    ++orders_;
    const Dialogue::Turn turn(supplies_.front()->dialogue());
    zero_all(true);
  }

 private:
  /// For what has no caller to report to: the other supplies still get their zero.
  template <class Work>
  static void quietly(const Work& work) {
    try {
      work();
    } catch (...) {
    }
  }
  void open_all();
  [[noreturn]] void give_up(const Supply& first, const DeviceError& failure);
  void check(std::span<const double> currents) const;
  template <class Ask, class Take>
  void side_by_side(const Ask& ask, const Take& take);
  void step(const std::vector<double>& currents);
  void zero_all(bool open_lost);

  const Settings settings_;
  Clock& clock_;
  std::vector<std::unique_ptr<Supply>> supplies_;
  std::vector<double> currents_;  // A, as last set
  std::uint64_t orders_ = 0;      // calls of make_safe(), which break off a ramp
};

/// Each supply is opened whatever became of the others: its zero comes first, and must not depend
/// on another one. The first error counts.
void Bops::open_all() {
  const Supply* first = nullptr;
  std::optional<DeviceError> failure;
  for (const auto& supply : supplies_) {
    try {
      supply->open(!failure);
    } catch (const DeviceError& error) {
      if (failure) continue;
      first = supply.get();
      failure.emplace(error);
    }
  }
  if (failure) give_up(*first, *failure);
}

/// No supply stays energized; the error says which ones have confirmed that no current is set.
void Bops::give_up(const Supply& first, const DeviceError& failure) {
  for (const auto& supply : supplies_) {
    if (!supply->known()) continue;
    quietly([&] { supply->zero(); });
    quietly([&] { supply->switch_off(); });
  }
  const char* const between = failure.text.ends_with('?') ? " " : "; ";
  std::string text = failure.text + between + first.zero_text(), unconfirmed;
  std::size_t others = 0;
  for (const auto& supply : supplies_) {
    if (supply.get() == &first || supply->has_confirmed_zero()) continue;
    unconfirmed += (others++ == 0 ? "" : ", ") + std::to_string(supply->channel());
  }
  if (others > 0) text += "; nor is the zero of channel " + unconfirmed + " confirmed";
  if (supplies_.size() > others + 1)
    text += others > 0 ? "; every other one is" : "; every other channel has confirmed its zero";
  throw DeviceError(failure.kind, failure.device, text);
}

/// Before anything is sent: a refused set-point changes no channel.
/// Mistakes of the caller first, then the limit, each over all channels.
void Bops::check(std::span<const double> currents) const {
  if (currents.size() != supplies_.size())
    throw std::invalid_argument("currents: " + settings_.name + " has " +
                                std::to_string(supplies_.size()) + " channels, not " +
                                std::to_string(currents.size()));
  for (std::size_t i = 0; i < currents.size(); ++i)
    if (!std::isfinite(currents[i]))
      throw std::invalid_argument("currents: channel " + std::to_string(i + 1) +
                                  " is not a finite number");
  for (std::size_t i = 0; i < currents.size(); ++i)
    if (std::abs(currents[i]) > settings_.current_limit)
      throw DeviceError(DeviceErrorKind::refused, settings_.name,
                        in_short(currents[i]) + " A on channel " + std::to_string(i + 1) +
                            " is beyond the limit of " + in_short(settings_.current_limit) + " A");
}

/// All questions are sent before any answer is read: eight take as long as one. A supply that fails
/// keeps the others neither from their question nor from their answer; the first error counts.
template <class Ask, class Take>
void Bops::side_by_side(const Ask& ask, const Take& take) {
  std::exception_ptr failure;
  std::vector<bool> asked(supplies_.size());
  for (std::size_t i = 0; i < supplies_.size(); ++i) {
    try {
      ask(*supplies_[i], i);
      asked[i] = true;
    } catch (const DeviceError&) {
      if (!failure) failure = std::current_exception();
    }
  }
  for (std::size_t i = 0; i < supplies_.size(); ++i) {
    try {
      if (asked[i]) take(*supplies_[i], i);
    } catch (const DeviceError&) {
      if (!failure) failure = std::current_exception();
    }
  }
  if (failure) std::rethrow_exception(failure);
}

/// The channels step together but for the time of a line.
void Bops::step(const std::vector<double>& currents) {
  side_by_side(
      [&](Supply& supply, std::size_t i) {
        currents_[i] = currents[i];  // from here on it may flow
        supply.send_current(currents[i]);
      },
      [](Supply& supply, std::size_t) { supply.take_measured(); });
}

/// A ramp of n = ceil(max |dI| / (max_slope step_time)) set-points, linear in each channel, which
/// bounds the voltage L dI/dt of the coils.
void Bops::set_currents(std::span<const double> currents) {
  check(currents);
  const std::uint64_t order = orders_;
  const Dialogue::Turn turn(supplies_.front()->dialogue());
  const std::vector<double> from = currents_;
  double largest = 0;
  for (std::size_t i = 0; i < from.size(); ++i)
    largest = std::max(largest, std::abs(currents[i] - from[i]));
  const int steps = std::max(
      1, static_cast<int>(std::ceil(largest / (settings_.max_slope * settings_.step_time))));
  for (int k = 1; k <= steps; ++k) {
    // Another task wants zero: it waits for no more than the set point that is on its way.
    if (order != orders_)
      throw DeviceError(DeviceErrorKind::refused, settings_.name,
                        "were made safe while a set point was on its way");
    const Time begun = clock_.now();
    std::vector<double> wanted(currents.begin(), currents.end());
    // The last step takes the wanted currents themselves, without the rounding of an interpolation.
    for (std::size_t i = 0; k < steps && i < wanted.size(); ++i)
      wanted[i] = from[i] + (currents[i] - from[i]) * k / steps;
    step(wanted);
    // The dialogue stays taken for the whole ramp: nothing may come between its set-points.
    if (k < steps) clock_.sleep_until(later(begun, from_seconds(settings_.step_time)));
  }
}

/// Without a ramp, for the supplies' own voltage limits protect the coils. Each zero that gets
/// through counts, so each supply has two attempts, and none waits for another's success.
void Bops::zero_all(bool open_lost) {
  std::exception_ptr failure;
  for (std::size_t i = 0; i < supplies_.size(); ++i) {
    for (int round = 0; round < 2; ++round) {
      try {
        if (open_lost) supplies_[i]->be_open();
        supplies_[i]->zero();
        currents_[i] = 0;
        break;
      } catch (const DeviceError&) {
        if (round == 1) failure = std::current_exception();
      }
    }
  }
  if (failure) std::rethrow_exception(failure);
}

}  // namespace

// Every number is a divisor, a limit or a time: zero has no meaning for any.
void Settings::check() const {
  const auto positive = [](double value) { return std::isfinite(value) && value > 0; };
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  if (!positive(current_limit)) throw std::invalid_argument("current_limit: must be positive");
  if (!positive(voltage_limit)) throw std::invalid_argument("voltage_limit: must be positive");
  if (!positive(max_slope)) throw std::invalid_argument("max_slope: must be positive");
  if (!positive(step_time)) throw std::invalid_argument("step_time: must be positive");
  if (!positive(reply_timeout)) throw std::invalid_argument("reply_timeout: must be positive");
  if (!positive(settling_time)) throw std::invalid_argument("settling_time: must be positive");
  if (!positive(read_back_tolerance))
    throw std::invalid_argument("read_back_tolerance: must be positive");
}

std::unique_ptr<CoilAmplifier> open(std::vector<std::unique_ptr<ByteLink>> links,
                                    const Settings& settings, Clock& clock) {
  settings.check();
  if (links.empty()) throw std::invalid_argument("links: there must be one at least");
  return std::make_unique<Bops>(std::move(links), settings, clock);
}

}  // namespace vitreo::kepco_bop
