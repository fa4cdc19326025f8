// Answers that no manual knows, at each place of each driver's conversation: an error that names
// the device and shows the bytes, never a number taken for one, another exception, or a wait
// without end.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/foot_pedal/driver.h"
#include "devices/instruments/kepco_bop/driver.h"
#include "devices/instruments/kepco_bop/emulator.h"
#include "devices/instruments/scpi_logger/driver.h"
#include "devices/instruments/scpi_logger/emulator.h"
#include "devices/instruments/scpi_probe/driver.h"
#include "devices/instruments/scpi_probe/emulator.h"
#include "devices/instruments/sutter_mp285/driver.h"
#include "devices/instruments/sutter_mp285/emulator.h"
#include "devices/instruments/sutter_mpc200/driver.h"
#include "devices/instruments/sutter_mpc200/emulator.h"
#include "devices/instruments/zaber/driver.h"
#include "devices/instruments/zaber/emulator.h"
#include "devices/links/printable.h"
#include "tests/devices/instruments/pololu_tic_test_bench.h"
#include "tests/devices/instruments/serial_test_bench.h"
#include "tests/devices/instruments/usb3103_test_bench.h"

#include <algorithm>
#include <exception>
#include <functional>
#include <memory>
#include <set>
#include <string>
#include <utility>
#include <vector>

namespace vitreo {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

std::string text_of(std::span<const std::uint8_t> bytes) { return {bytes.begin(), bytes.end()}; }
ByteString bytes_of(const std::string& text) { return {text.begin(), text.end()}; }

/// One way to say what no manual knows, by the answer that would be right. `core`: what an error
/// has to show of it.
struct Nonsense {
  const char* name;
  std::function<ByteString(const ByteString& right)> of;
  std::string core;
};

/// The line's end of the right answer, as the instrument has it.
std::string end_of(const ByteString& right) {
  const std::string text = text_of(right);
  const std::size_t begin = text.find_last_not_of("\r\n\x11\x13");
  return begin == std::string::npos ? text : text.substr(begin + 1);
}

const std::vector<Nonsense>& nonsense() {
  static const std::vector<Nonsense> all{
      {"a word", [](const ByteString& right) { return bytes_of("QUUX!" + end_of(right)); },
       "QUUX!"},
      {"no number", [](const ByteString& right) { return bytes_of("nan" + end_of(right)); }, "nan"},
      {"two words", [](const ByteString& right) { return bytes_of("0,QUUX!,7" + end_of(right)); },
       "QUUX!"},
      {"high bytes",
       [](const ByteString& right) {
         ByteString bytes{0xFE, 0x80, 0xFF, 0xFE};
         for (const char c : end_of(right)) bytes.push_back(static_cast<std::uint8_t>(c));
         return bytes;
       },
       "\\xFE"},
      {"a great deal",
       [](const ByteString& right) { return bytes_of(std::string(600, 'Q') + end_of(right)); },
       "QQQQ"},
  };
  return all;
}

/// The emulator, but for its answers from the `first` on.
struct Impostor final : BytePeer {
  Impostor(BytePeer& its_peer, const Nonsense& its_words, int its_first)
      : peer(its_peer), words(its_words), first(its_first) {}
  void receive(std::span<const std::uint8_t> bytes, Time now) override { peer.receive(bytes, now); }
  std::vector<TimedBytes> say(Time now) override {
    std::vector<TimedBytes> said = peer.say(now);
    for (TimedBytes& one : said) {
      if (one.bytes.empty() || answers++ < first) continue;
      one.bytes = words.of(one.bytes);
    }
    return said;
  }
  Time next() const override { return peer.next(); }
  void power_cycle(Time now) override { peer.power_cycle(now); }

  BytePeer& peer;
  const Nonsense& words;
  const int first;
  int answers = 0;
};

/// A driver, opened and used as in a run, and the far end that it has a manual for. `used` is
/// called when it has done its work: what comes of a destructor's zero has nobody to be reported
/// to.
struct Subject {
  const char* name;
  const char* role;
  std::function<std::unique_ptr<BytePeer>()> peer;
  std::function<void(std::unique_ptr<ByteLink>, Clock&, const std::function<void()>& used)> use;
};

void use_stage(Stage& stage, Clock& clock) {
  stage.position();
  std::vector<double> target;
  for (const StageAxis& axis : stage.info().axes)
    target.push_back(std::clamp(1e-3, axis.travel_min, axis.travel_max));
  move_to(stage, target, stage.info().axes.front().speed, 20s, clock);
  stage.position();
}

const std::vector<Subject>& subjects() {
  static const std::vector<Subject> all{
      {"kepco_bop", "coils", [] { return kepco_bop::make_emulator({}, nullptr); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         std::vector<std::unique_ptr<ByteLink>> links;
         links.push_back(std::move(link));
         const auto coils = kepco_bop::open(std::move(links), {}, clock);
         coils->set_currents(std::vector<double>{1});
         clock.sleep_for(500ms);
         coils->measured_currents();
         coils->make_safe();
         used();
       }},
      {"scpi_logger", "current_sensor",
       [] { return scpi_logger::make_emulator({}, [](int, Time) { return 0.5; }); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         scpi_logger::Settings settings;
         settings.coils = {{0, 101, 1}, {1, 102, 1}};
         scpi_logger::open(std::move(link), settings, clock)->measure(2s);
         used();
       }},
      {"scpi_probe", "field_probe",
       [] { return scpi_probe::make_emulator({}, [](Time) { return std::vector{0.01}; }); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         scpi_probe::open(std::move(link), {}, clock)->measure(2s);
         used();
       }},
      {"sutter_mp285", "stage", [] { return sutter_mp285::make_emulator(); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         const auto stage = sutter_mp285::open(std::move(link), {}, clock);
         use_stage(*stage, clock);
         used();
       }},
      {"sutter_mpc200", "stage", [] { return sutter_mpc200::make_emulator(); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         const auto stage = sutter_mpc200::open(std::move(link), {}, clock);
         use_stage(*stage, clock);
         used();
       }},
      {"zaber", "stage", [] { return zaber::make_emulator(); },
       [](std::unique_ptr<ByteLink> link, Clock& clock, const std::function<void()>& used) {
         const auto stage = zaber::open(std::move(link), {}, clock);
         use_stage(*stage, clock);
         used();
       }},
  };
  return all;
}

/// What came of one conversation.
struct Outcome {
  int answers = 0;
  std::string error;     // empty: none
  bool foreign = false;  // no DeviceError
  std::string device;
};

Outcome converse(const Subject& subject, const Nonsense& words, int first) {
  const auto clock = virtual_clock();
  const auto peer = subject.peer();
  Impostor impostor(*peer, words, first);
  Outcome outcome;
  try {
    subject.use(memory_byte_link(impostor, *clock, {200us, 1042us}), *clock,
                [&] { outcome.answers = impostor.answers; });
  } catch (const DeviceError& error) {
    outcome.error = error.what();
    outcome.device = error.device;
  } catch (const std::exception& error) {
    outcome.error = error.what();
    outcome.foreign = true;
  }
  EXPECT_LT(clock->now(), std::chrono::minutes(5)) << "it waited without end";
  return outcome;
}

/// The word itself; where a driver of single bytes does not wait for all of it, the bytes that have
/// come, behind the error's last colon or in its last quotes.
bool shows(const std::string& error, const Nonsense& words) {
  if (error.find(words.core) != std::string::npos) return true;
  const std::string text = error.substr(0, error.rfind(" ("));
  const std::size_t colon = text.rfind(": ") + 2, quote = text.rfind('"', text.size() - 2) + 1;
  const std::string shown =
      text.ends_with('"') ? text.substr(quote, text.size() - 1 - quote) : text.substr(colon);
  const std::string all = printable(words.of(bytes_of("7\r")), 1000);
  return !shown.empty() && all.find(shown) != std::string::npos;
}

constexpr int kNever = 1 << 30;

TEST(UnknownAnswers, OfAByteLinkAreNamedAndShownAtEachPlaceOfEachConversation) {
  for (const Subject& subject : subjects()) {
    const Outcome right = converse(subject, nonsense().front(), kNever);
    ASSERT_EQ(right.error, "") << subject.name;
    ASSERT_GT(right.answers, 2) << subject.name;
    for (const Nonsense& words : nonsense())
      for (int first = 0; first < right.answers; ++first) {
        const Outcome seen = converse(subject, words, first);
        const std::string where = std::string(subject.name) + ", " + words.name + " from answer " +
                                  std::to_string(first + 1) + " of " +
                                  std::to_string(right.answers) + ": " + seen.error;
        if (seen.error.empty()) {
          ADD_FAILURE() << where << "taken for an answer";
          continue;
        }
        EXPECT_FALSE(seen.foreign) << where;
        EXPECT_EQ(seen.device, subject.role) << where;
        EXPECT_TRUE(shows(seen.error, words)) << where;
      }
  }
}

/// Reports that no manual knows, by the right one.
const std::vector<std::pair<const char*, std::function<ByteString(const ByteString&)>>>&
report_nonsense() {
  static const std::vector<std::pair<const char*, std::function<ByteString(const ByteString&)>>>
      all{{"of another number",
           [](ByteString right) {
             right[0] = 0xEE;
             return right;
           }},
          {"of its number alone", [](const ByteString& right) { return ByteString{right[0]}; }},
          {"of high bytes",
           [](const ByteString& right) { return ByteString(right.size(), 0xEE); }}};
  return all;
}

TEST(UnknownAnswers, OfAUsb3103AreNamedAndShown) {
  int all = 0;
  for (const auto& [name, nonsense_of] : report_nonsense())
    for (int first = 0; first == 0 || first < all; ++first) {
      const auto clock = virtual_clock();
      usb3103::Bench bench;
      int answers = 0;
      int used = 0;
      const int from = all == 0 ? kNever : first;
      bench.answer = [&, &of = nonsense_of](
                         usb3103::Bytes report) -> std::optional<std::vector<usb3103::Report>> {
        std::vector<usb3103::Report> replies = bench.emulator->receive(report);
        for (usb3103::Report& reply : replies)
          if (answers++ >= from) reply = of(reply);
        return replies;
      };
      std::string said;
      try {
        const auto coils =
            usb3103::open(memory_hid_link(bench, *clock, usb3103::kLatency), {}, *clock);
        coils->set_currents(usb3103::kSomeCurrents);
        coils->measured_currents();
        used = answers;  // a destructor has nobody to report to
      } catch (const DeviceError& error) {
        said = error.what();
        EXPECT_EQ(error.device, "coils");
      }
      if (all == 0) {
        all = used;
        ASSERT_GT(all, 10);
        ASSERT_EQ(said, "");
        first = -1;
        continue;
      }
      const std::string where =
          std::string("a report ") + name + " from " + std::to_string(first + 1) + ": " + said;
      EXPECT_NE(said, "") << where;
      EXPECT_TRUE(said.find(": \"") != std::string::npos) << where;
    }
}

TEST(UnknownAnswers, OfATicAreNamedAndShown) {
  using pololu_tic::Code;
  for (const auto& [name, length] : {std::pair{"cut short", 3}, std::pair{"of none", 0}}) {
    const auto clock = virtual_clock();
    pololu_tic::Bench bench(*clock, {});
    bench.answer = [n = length](const UsbSetup& setup,
                                std::optional<ByteString> right) -> std::optional<ByteString> {
      if (right && (setup.type & 0x80) != 0)
        right->resize(std::min<std::size_t>(right->size(), static_cast<std::size_t>(n)), 0xEE);
      return right;
    };
    try {
      pololu_tic::open(memory_usb_link(bench, *clock, 300us), {}, *clock);
      ADD_FAILURE() << name << ": taken";
    } catch (const DeviceError& error) {
      EXPECT_EQ(error.device, "lens_mover");
      EXPECT_NE(std::string(error.what()).find("cut short"), std::string::npos) << error.what();
      EXPECT_NE(std::string(error.what()).find('"'), std::string::npos) << error.what();
    }
  }
}

/// A pedal whose reports the layout does not know is no pedal that is held.
TEST(UnknownAnswers, OfAPedalAreNamedAndShownAndCountAsReleased) {
  struct Foot final : HidPeer {
    std::vector<std::vector<std::uint8_t>> receive(std::span<const std::uint8_t>) override {
      return {};
    }
    void connect(const Send& its) override { send = its; }
    Send send;
  } foot;
  const auto clock = virtual_clock();
  foot_pedal::Settings settings;
  settings.name = "pedal";
  const auto pedal = foot_pedal::open(memory_hid_link(foot, *clock, 1ms), settings);
  const auto report = [&](std::vector<std::uint8_t> bytes) {
    foot.send(std::move(bytes));
    clock->sleep_for(5ms);
  };
  report(foot_pedal::encode(2, settings.layout));
  EXPECT_TRUE(is_held(pedal.get(), 2));
  report({0xAB, 0xCD});
  EXPECT_FALSE(is_held(pedal.get(), 2));
  try {
    pedal->state();
    ADD_FAILURE() << "no error";
  } catch (const DeviceError& error) {
    EXPECT_EQ(error.kind, DeviceErrorKind::protocol);
    EXPECT_EQ(error.device, "pedal");
    EXPECT_NE(std::string(error.what()).find("\\xAB\\xCD"), std::string::npos) << error.what();
  }
  report(foot_pedal::encode(2, settings.layout));
  EXPECT_TRUE(is_held(pedal.get(), 2)) << "the next one is known again";
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
