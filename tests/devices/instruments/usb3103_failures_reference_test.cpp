// The USB-3103's driver on a wire that refuses, is silent, late, foreign or gone, against the words
// of its header, of its role's and of docs/instruments.md.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/usb3103/driver.h"
#include "tests/devices/instruments/usb3103_reference.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <string>
#include <vector>

namespace vitreo::usb3103 {
namespace VITREO_TEST_FILE {

using reference::Bytes;
using reference::error_of;
using reference::Terminals;
using Reports = std::vector<Bytes>;
using namespace std::chrono_literals;

const std::vector<double> kCurrents{1, -2, 3, -4, 5, -6, 7, -8};
const std::string kNoZero =
    "; no zero was sent to its outputs, so a current that was set before may still flow";
const std::string kZeros =
    "; zeros were sent to its outputs, and it has no read-back to confirm them";

class Usb3103Failures : public testing::Test {
 protected:
  Usb3103Failures() {
    settings_.name = "left";
    settings_.enable_line = 5;
    settings_.reply_timeout = 0.05;
  }
  std::unique_ptr<CoilAmplifier> opened() { return open(far_.link(), settings_, *clock_); }
  std::string opening_error() {
    return error_of([this] { opened(); });
  }

  std::unique_ptr<Clock> clock_ = virtual_clock();
  Terminals far_{*clock_};
  Settings settings_;
};

TEST_F(Usb3103Failures, an_opening_that_fails_says_how_many_outputs_were_sent_a_zero) {
  // status, eight ranges, which are at 0 V when they are set, and what follows
  for (int report = 0; report <= 30; ++report) {
    Terminals far(*clock_);
    const auto refuse = [&far, report, count = 0](const Bytes&) mutable {
      if (count++ == report) far.gone = true;
      if (far.gone) throw DeviceError(DeviceErrorKind::lost, "the cable", "it is out");
      return false;
    };
    far.refuses = refuse;
    const int zeros = std::clamp(report - 1, 0, 8);
    const std::string known = zeros == 0   ? kNoZero
                              : zeros == 8 ? kZeros
                                           : "; a zero was sent to " + std::to_string(zeros) +
                                                 " of its 8 outputs, so a current may still flow";
    EXPECT_EQ(error_of([&] { open(far.link(), settings_, *clock_); }),
              "lost: left: the cable: it is out" + known)
        << report;
    EXPECT_EQ(far.taken.size(), report) << report;
  }
}

TEST_F(Usb3103Failures, an_opening_ends_where_a_question_finds_no_answer) {
  // The status twice, the calibration of eight channels, and the status again.
  for (int question = 0; question < 11; ++question) {
    Terminals far(*clock_);
    far.refuses = [&far, question, count = 0](const Bytes& report) mutable {
      const bool asks = report[0] == 0x44 || report[0] == 0x30;
      if (asks && count++ == question) far.silent = true;
      return false;
    };
    const Time begun = clock_->now();
    EXPECT_EQ(error_of([&] { open(far.link(), settings_, *clock_); }),
              "timeout: left: no answer within 0.05 s" + (question == 0 ? kNoZero : kZeros));
    EXPECT_EQ(clock_->now() - begun, 50ms);
    EXPECT_FALSE(far.line_is_high(5));
  }
}

TEST_F(Usb3103Failures, an_opening_refuses_a_slave_and_what_is_no_usb3103) {
  far_.slave = true;
  EXPECT_EQ(opening_error(),
            "refused: left: stays a slave of its sync pin, so coils cannot step "
            "together" +
                kZeros);
  far_.slave = false;
  far_.foreign = [] { return Bytes{0x31, 0x07, 0x80}; };
  far_.news();
  const std::string error = opening_error();
  EXPECT_EQ(error,
            "not found: left: this is no USB-3103: only answers to something else within "
            "0.05 s: \"1\\x07\\x80\"" +
                kNoZero);
  EXPECT_EQ(far_.news(), (Reports{{0x44, 0}}));  // a stranger is set nothing
}

TEST_F(Usb3103Failures, a_set_point_ends_at_the_report_that_fails_and_is_made_safe_after) {
  for (int report = 0; report <= 10; ++report) {
    Terminals far(*clock_);
    auto amplifier = open(far.link(), settings_, *clock_);
    far.news();
    far.refuses = [report, count = 0](const Bytes&) mutable { return count++ == report; };
    EXPECT_EQ(error_of([&] { amplifier->set_currents(kCurrents); }),
              "timeout: left: the bus: not taken");
    EXPECT_EQ(far.news().size(), report + 1);
    far.refuses = nullptr;
    amplifier->make_safe();
    for (const double volt : far.volts) EXPECT_NEAR(volt, 0, 1e-9);
    EXPECT_FALSE(far.line_is_high(5)) << report;
    EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 0.0));
  }
}

TEST_F(Usb3103Failures, making_safe_tries_every_output_and_the_line_whatever_fails) {
  for (std::uint8_t bad = 0; bad < 8; ++bad) {
    Terminals far(*clock_);
    const auto amplifier = open(far.link(), settings_, *clock_);
    amplifier->set_currents(kCurrents);
    far.refuses = [bad](const Bytes& b) { return b[0] == 0x14 && b[1] == bad; };
    EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), "timeout: left: the bus: not taken");
    for (std::size_t i = 0; i < 8; ++i)
      EXPECT_NEAR(far.volts[i], i == bad ? kCurrents[i] / 2 : 0, 2e-4) << int{bad} << " " << i;
    EXPECT_FALSE(far.line_is_high(5));
    EXPECT_NE(amplifier->currents(), std::vector<double>(8, 0.0));  // not all are
    // One that is refused once is tried again after the others.
    far.news();
    far.refuses = [bad, count = 0](const Bytes& b) mutable {
      return b[0] == 0x14 && b[1] == bad && count++ == 0;
    };
    EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), "");
    EXPECT_EQ(far.news().size(), 8 + 1 + 2);
    for (const double volt : far.volts) EXPECT_NEAR(volt, 0, 1e-9);
    EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 0.0));
  }
}

TEST_F(Usb3103Failures, zeros_go_out_though_the_line_is_refused_or_nothing_answers) {
  const auto amplifier = opened();
  amplifier->set_currents(kCurrents);
  far_.refuses = [](const Bytes& b) { return b[0] == 0x06; };
  EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), "timeout: left: the bus: not taken");
  for (const double volt : far_.volts) EXPECT_NEAR(volt, 0, 1e-9);
  far_.refuses = nullptr;
  amplifier->set_currents(kCurrents);
  far_.silent = true;
  const Time begun = clock_->now();
  EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), "timeout: left: no answer within 0.05 s");
  EXPECT_EQ(clock_->now() - begun, 50ms);
  for (const double volt : far_.volts) EXPECT_NEAR(volt, 0, 1e-9);
  EXPECT_FALSE(far_.line_is_high(5));
}

TEST_F(Usb3103Failures, a_wire_that_is_gone_is_tried_to_the_end_and_destruction_throws_nothing) {
  auto amplifier = opened();
  amplifier->set_currents(kCurrents);
  far_.gone = true;
  const std::string lost = "lost: left: the cable: it is out";
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }), lost);
  EXPECT_EQ(error_of([&] { amplifier->set_currents(kCurrents); }), lost);
  for (const bool destroyed : {false, true}) {
    far_.news();
    if (destroyed) {
      amplifier.reset();
    } else {
      EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), lost);
      EXPECT_EQ(amplifier->currents(), kCurrents);  // what flows, as far as is known
    }
    const Reports tried = far_.news();
    for (std::uint8_t i = 0; i < 8; ++i)
      EXPECT_NE(std::find(tried.begin(), tried.end(), Bytes({0x14, i, 0x00, 0x80, 0})),
                tried.end());
    EXPECT_NE(std::find(tried.begin(), tried.end(), Bytes({0x06, 5, 0})), tried.end());
  }
}

TEST_F(Usb3103Failures, foreign_reports_without_end_are_an_error_with_their_bytes) {
  const auto amplifier = opened();
  for (const bool slow : {false, true}) {
    far_.foreign = [&] {
      if (slow) clock_->sleep_for(4ms);
      return Bytes{0x30, 0x41, 0xFF};
    };
    far_.reads = 0;
    const Time begun = clock_->now();
    EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }),
              "protocol: left: only answers to something else within 0.05 s: \"0A\\xFF\"");
    EXPECT_LT(far_.reads, 1000);
    EXPECT_EQ(error_of([&] { amplifier->make_safe(); }).substr(0, 9), "protocol:");
    for (const double volt : far_.volts) EXPECT_NEAR(volt, 0, 1e-9);
    EXPECT_LE(clock_->now() - begun, 1s);
  }
  far_.foreign = nullptr;
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }), "");  // and then goes on
}

TEST_F(Usb3103Failures, some_foreign_reports_before_the_answer_are_passed_over) {
  const auto amplifier = opened();
  far_.refuses = [this](const Bytes& b) {
    if (b[0] == 0x44)
      for (const Bytes& other : Reports{{0x03, 0xFF}, {0x30, 1, 2, 3}, {0x21, 0, 0, 0, 0}, {}})
        far_.answer(other);
    return false;
  };
  for (int turn = 0; turn < 3; ++turn) amplifier->set_currents(kCurrents);
  far_.refuses = [this](const Bytes& b) {
    if (b[0] == 0x44) far_.answer({0x44});
    return false;
  };
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }),
            "protocol: left: its status is cut short: \"D\"");
}

TEST_F(Usb3103Failures, an_answer_is_waited_for_until_the_deadline_and_none_is_taken_after) {
  const auto amplifier = opened();
  far_.answer_after = 50ms;
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }), "");
  far_.answer_after = 51ms;
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }),
            "timeout: left: no answer within 0.05 s");
  clock_->sleep_for(10ms);  // it is there by now
  far_.silent = true;
  EXPECT_EQ(error_of([&] { amplifier->measured_currents(); }),
            "timeout: left: no answer within 0.05 s");
}

TEST_F(Usb3103Failures, making_safe_overtakes_a_set_point_that_is_on_its_way) {
  const auto amplifier = opened();
  far_.write_takes = 1ms;
  std::string error;
  const auto task = clock_->spawn(
      "setter", [&] { error = error_of([&] { amplifier->set_currents(kCurrents); }); });
  clock_->sleep_for(4500us);
  amplifier->make_safe();
  clock_->sleep_for(100ms);
  task->join();
  EXPECT_EQ(error, "refused: left: was made safe while a set point was on its way");
  for (const double volt : far_.volts) EXPECT_NEAR(volt, 0, 1e-9);
  EXPECT_FALSE(far_.line_is_high(5));
  EXPECT_EQ(amplifier->currents(), std::vector<double>(8, 0.0));
  EXPECT_EQ(std::count(far_.taken.begin(), far_.taken.end(), Bytes({0x15, 0})), 0);
}

TEST_F(Usb3103Failures, a_task_that_is_stopped_can_still_zero_its_outputs) {
  const auto amplifier = opened();
  amplifier->set_currents(kCurrents);
  far_.write_takes = 1ms;
  std::string set, safe;
  const auto task = clock_->spawn("setter", [&] {
    set = error_of([&] { amplifier->set_currents(std::vector<double>(8, 9.0)); });
    safe = error_of([&] { amplifier->make_safe(); });
  });
  clock_->sleep_for(3500us);
  task->request_stop();
  clock_->sleep_for(100ms);
  EXPECT_EQ(set, "stopped");
  for (const double volt : far_.volts) EXPECT_NEAR(volt, 0, 1e-9);
  EXPECT_FALSE(far_.line_is_high(5));
  EXPECT_EQ(safe, "stopped");  // once all was on its way
}

TEST_F(Usb3103Failures, what_the_link_shows_without_a_question_is_told) {
  const auto amplifier = opened();
  EXPECT_EQ(gone_text(amplifier->link_state()), "");
  EXPECT_EQ(amplifier->link_state().owed, Time::zero());
  far_.news();
  far_.answer_after = 30ms;
  const auto task = clock_->spawn("asker", [&] { amplifier->measured_currents(); });
  clock_->sleep_for(21ms);
  EXPECT_EQ(amplifier->link_state().owed, 21ms);
  clock_->sleep_for(30ms);
  task->join();
  EXPECT_EQ(amplifier->link_state().owed, Time::zero());
  far_.hung_up = true;
  EXPECT_EQ(gone_text(amplifier->link_state()),
            "the USB-3103 has hung up: its cable is out, or it has lost its power");
  EXPECT_EQ(far_.news(), (Reports{{0x44, 0}}));  // no report was sent for it
}

TEST_F(Usb3103Failures, a_heartbeats_line_that_is_refused_is_an_error) {
  settings_.heartbeat = true;
  const auto amplifier = opened();
  EnableLine& line = *amplifier->enable_line();
  line.set(true);
  far_.refuses = [](const Bytes& b) { return b[0] == 0x06; };
  EXPECT_EQ(error_of([&] { line.set(false); }), "timeout: left: the bus: not taken");
  EXPECT_EQ(error_of([&] { line.make_safe(); }), "timeout: left: the bus: not taken");
  EXPECT_TRUE(line.high());
  EXPECT_EQ(error_of([&] { amplifier->make_safe(); }), "timeout: left: the bus: not taken");
  EXPECT_TRUE(far_.line_is_high(5));
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::usb3103
