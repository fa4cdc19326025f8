// Instruments whose file is broken: each ends in an error that names file and line or key, within
// bounded time and memory, with the instrument made safe, and harms nothing else.
// SPDX-License-Identifier: Apache-2.0
#include "devices/scripted/emulator.h"
#include "tests/devices/scripted/bench.h"

#include <gtest/gtest.h>

#include <chrono>

namespace vitreo::scripted {
namespace VITREO_TEST_FILE {

using namespace std::chrono_literals;

constexpr const char* kPump = R"lua(@first@
return {
  title = "A pump", kind = "instrument", link = { timeout = 0.5@link@ },
  identity = { ask = "ID?", match = "^(PUMP)", fields = { "name" } },
  make_safe = @make_safe@, @more@
  properties = {
    rate = { ask = @ask@, set = @set@, min = 0, max = 10@rate@ },
    polled = { ask = @poll@, every = @every@ },
  },
  commands = { prime = { send = @command@, done = @done@ } },
}
)lua";

using Pieces = std::map<std::string, std::string>;

/// A pump of a file with these pieces, opened on a far end.
struct Pump {
  explicit Pump(Pieces pieces = {}, const LinkFaults* faults = nullptr) {
    for (const auto& [name, usual] : Pieces{{"ask", "'RATE?'"},
                                            {"set", "'RATE %g'"},
                                            {"make_safe", "'STOP'"},
                                            {"poll", "'P?'"},
                                            {"every", "0"},
                                            {"command", "'PRIME'"},
                                            {"done", "nil"}})
      pieces.emplace(name, usual);
    far.answers["ID?"] = {"PUMP\n"};
    far.answers["RATE?"] = {"5\n"};
    far.answers["P?"] = {"7\n"};
    file = filled(kPump, pieces);
    link = faults;
  }
  Instrument& opened() {
    if (!instrument)
      instrument =
          open_instrument({load("pump.lua", file, unit_of),
                           memory_byte_link(far, *clock, {.latency = 1ms}, link), "pump", *clock});
    return *instrument;
  }
  /// How often a message was heard, once what was sent has arrived.
  int heard(const std::string& message) {
    clock->sleep_for(20ms);
    return far.count(message);
  }
  double rate() { return std::get<double>(opened().read(1, 1s).value); }

  std::unique_ptr<Clock> clock = virtual_clock();
  FarEnd far;
  std::string file;
  const LinkFaults* link = nullptr;
  std::unique_ptr<Instrument> instrument;
};
constexpr std::size_t kPolled = 0, kRate = 1;  // sorted by name

/// What `work` throws says; and that it took little of the machine's time.
template <class Work>
std::string error_of(const Work& work) {
  const double began = wall_seconds();
  std::string said = "no error";
  try {
    work();
  } catch (const std::exception& error) {
    said = error.what();
  }
  EXPECT_LT(wall_seconds() - began, 10) << said;
  return said;
}

void expect_says(const std::string& text, const std::string& words) {
  EXPECT_NE(text.find(words), std::string::npos) << words << " is not in: " << text;
}

struct Row {
  const char* name;
  const char* body;   ///< of function(io)
  const char* words;  ///< of the error
};
void PrintTo(const Row& row, std::ostream* out) { *out << row.name; }

/// Bodies that fail wherever they stand, and each for a reason of its own.
const std::vector<Row> kBodies{
    {"EndlessLoop", "while true do end", "works for too long"},
    {"EndlessLoopThatCatches", "while true do pcall(function() while true do end end) end",
     "works for too long"},
    {"EndlessLoopOfOperations", "while true do io:now() end", "does not end: io:now"},
    {"EndlessLoopOfSleeps", "while true do io:sleep(1) end", "does not end: io:sleep after 11 s"},
    {"SleepsThatAreCaught", "while true do pcall(io.sleep, io, 1) end", "does not end"},
    {"WorkBetweenOperations", "while true do for i = 1, 300000 do end io:now() end",
     "more than 20000000 instructions in all"},
    {"Memory", "local t = {} for i = 1, 1e9 do t[i] = { i } end", "more memory"},
    {"MemoryThatIsCaught",
     "local t = {} for i = 1, 1e9 do pcall(function() t[i] = ('x'):rep(1000) .. i end) end", ""},
    {"OneGreatText", "return ('x'):rep(1e7)", ""},
    {"TextThatGrows", "local s = 'x' while true do s = s .. s end", "more memory"},
    {"RepOfNothing", "return ('').rep('', 1 << 62)", "string.rep"},
    {"RepOfNothingByMethod", "return (''):rep(1 << 62)", "string.rep"},
    {"Recursion", "local function f() return 1 + f() end return f()", "pump.lua:"},
    {"RecursionOfCalls", "local function f() return pcall(f) end while true do f() end",
     "pump.lua:"},
    {"RecursionOfMetatables",
     "local t = setmetatable({}, { __index = function(t, k) return t[k .. 'x'] end }) return t.x",
     "pump.lua:"},
    {"PatternsThatGoBackAndForth", "return (('a'):rep(20000)):match('(.-)(.-)(.-)(.-)x')",
     "pattern takes too many steps"},
    {"PatternsThatAreCaught", "while true do pcall(string.find, ('a'):rep(9999), '.-.-.-b') end",
     "works for too long"},
    {"GsubOfAPatternLikeIt", "return (('a'):rep(3000)):gsub('(.*)(.*)(.*)x', '')",
     "pattern takes too many steps"},
    {"GmatchOfAPatternLikeIt", "for a in (('a'):rep(3000)):gmatch('.-.-.-x') do end",
     "pattern takes too many steps"},
    {"BalancedPatterns", "local s = ('('):rep(1e6) for i = 1, 1e4 do s:find('%b()') end",
     "pattern takes too many steps"},
    {"PlainFind",
     "local s, p = ('a'):rep(1e6), ('a'):rep(5e5) .. 'b' for i = 1, 1e6 do s:find(p, 1, true) end",
     "works for too long"},
    {"MoveOfNothing", "table.move({}, 1, 1 << 61, 2)", "too long"},
    {"InsertByAFalseLength",
     "table.insert(setmetatable({}, { __len = function() return 1 << 61 end }), 1, 5)", "__len"},
    {"ConcatOfDefaults",
     "return table.concat(setmetatable({}, { __index = rawlen }), '', 1, 1 << 50)", "too long"},
    {"SortByAFalseOrder",
     "local t = {} for i = 1, 200 do t[i] = i % 7 end table.sort(t, function() return true end)",
     "pump.lua:"},
    {"SortOfMuch", "local t = {} for i = 1, 1e5 do t[i] = -i end while true do table.sort(t) end",
     "works for too long"},
    {"ComparisonsOfMegabytes",
     "local a, b = ('x'):rep(3e6) .. 'y', ('x'):rep(3e6) .. 'y' for i = 1, 1e9 do if a ~= b then "
     "end end",
     "works for too long"},
    {"UpperOfMegabytes", "local a = ('x'):rep(2e6) for i = 1, 1e5 do a:upper() end",
     "works for too long"},
    {"NextOverHoles",
     "local t = {} for i = 1, 1e5 do t['k' .. i] = i end for i = 1, 1e5 do t['k' .. i] = nil end "
     "for i = 1, 1e9 do next(t) end",
     "works for too long"},
    {"Nil", "local a return a.x", "attempt to index a nil value"},
    {"NaN", "return 0/0", "no finite number"},
    {"Infinity", "return math.huge", "no finite number"},
    {"AFunction", "return print_it", "print_it is not known"},
    {"AFunctionIsReturned", "return function() end", "returned a function"},
    {"ATableOfRubbish", "return { {}, 'x' }", "returned a table"},
    {"AnErrorThatIsATable", "error({ 1 })", "raised a table as an error"},
    {"AnErrorThatIsNil", "error(nil)", "raised a nil as an error"},
    {"AnErrorThatIsAFunction", "error(error)", "raised a function as an error"},
    {"AnErrorOfNoLine", "error('boiling', 0)", "boiling"},
    {"AnErrorWhoseTextRaises",
     "error(setmetatable({}, { __tostring = function() error('again') end }))", "raised a table"},
    {"AnErrorOfMegabytes", "error(('x'):rep(3e6))", "pump.lua:"},
    {"AFinalizer", "setmetatable({}, { __gc = function() while true do end end })",
     "__gc cannot be used"},
    {"AnEndlessClose",
     "local c <close> = setmetatable({}, { __close = function() while true do end end }) return 1",
     "works for too long"},
    {"ACloseThatRaises",
     "local c <close> = setmetatable({}, { __close = function() error('shut') end }) return 1",
     "shut"},
    {"YieldInASort", "table.sort({ 3, 1, 2 }, function() return io:now() > 0 end)",
     "cannot be called here"},
    {"YieldInAGsub", "return (('abc'):gsub('.', function() return io:ask('RATE?') end))",
     "cannot be called here"},
    {"YieldInATostring",
     "return tostring(setmetatable({}, { __tostring = function() return io:ask('RATE?') end }))",
     "cannot be called here"},
    {"WithoutAColon", "return io.ask('RATE?')", "with a colon"},
    {"WrongArguments", "return io:ask(5)", "io:ask: message: must be a text"},
    {"WrongTimeout", "return io:ask('RATE?', { timeout = -1 })", "timeout: must be 0 to 600"},
    {"TooManyArguments", "local t = {} for i = 1, 400 do t[i] = 'x' end io:send(table.unpack(t))",
     "too many arguments"},
    {"AMessageOfMegabytes", "io:send(('x'):rep(2e6))", "must be at most 65536 bytes"},
    {"MatchIsEndless", "return io:ask('RATE?', { match = function() while true do end end })",
     "works for too long"},
    {"MatchIsEndlessAndCaught",
     "while true do pcall(io.ask, io, 'RATE?', { match = function() while true do end end }) end",
     "works for too long"},
    {"MatchUsesIo", "return io:ask('RATE?', { match = function() return io:ask('RATE?') end })",
     "cannot be called here"},
    {"MatchIsNoPattern", "return io:ask('RATE?', { match = '(' })", "unfinished capture"},
    {"AnUnknownKindOfFailure", "io:fail('boredom', 'x')", "kind: must be"},
    {"SettingsLater", "settings { rate = 5 }", "settings"},
    {"ItsOperationsAreGone", "for k in pairs(io) do io[k] = nil end return io:ask('RATE?')",
     "nil value"},
};

class BrokenBody : public testing::TestWithParam<Row> {};

void expect_safe(Pump& pump, const std::string& said, const Row& row) {
  expect_says(said, "pump.lua");
  expect_says(said, row.words);
  EXPECT_EQ(pump.heard("STOP"), 1) << said;
  const std::string after = error_of([&] { pump.rate(); });
  expect_says(after, "its driver failed before: pump.lua");
}

TEST_P(BrokenBody, OfAQuestionIsToldAndMadeSafe) {
  Pump pump(Pieces{{"ask", std::string("function(io)\n") + GetParam().body + "\nend"}});
  pump.opened();
  expect_safe(pump, error_of([&] { pump.rate(); }), GetParam());
}

TEST_P(BrokenBody, OfASettingIsToldAndMadeSafe) {
  Pump pump(Pieces{{"set", std::string("function(io)\n") + GetParam().body + "\nend"}});
  pump.opened();
  expect_safe(pump, error_of([&] { pump.opened().set(kRate, 3.0); }), GetParam());
}

TEST_P(BrokenBody, OfTheStartIsTold) {
  Pump pump(
      Pieces{{"more", std::string("start_up = function(io)\n") + GetParam().body + "\nend,"}});
  const std::string said = error_of([&] { pump.opened(); });
  if (said == "no error") return;  // what it returns is nobody's
  expect_says(said, "pump.lua");
  EXPECT_EQ(pump.heard("STOP"), 1) << said;
}

TEST_P(BrokenBody, OfTheSafeStateIsToldAndTheRescueIsSent) {
  Pump pump(Pieces{{"make_safe", std::string("function(io)\n") + GetParam().body + "\nend"},
                   {"more", "rescue = { identify = { 'ID?', 'PUMP' }, send = { 'OFF' } },"}});
  pump.opened();
  const std::string said = error_of([&] { pump.opened().make_safe(); });
  if (said == "no error") return;
  expect_says(said, "pump.lua");
  EXPECT_EQ(pump.heard("OFF"), 1) << said;
}

TEST_P(BrokenBody, OfAPollIsToldAndTheOthersGoOn) {
  Pump pump(Pieces{{"poll", std::string("function(io)\n") + GetParam().body + "\nend"},
                   {"every", "0.5"}});
  Instrument& broken = pump.opened();
  FarEnd far;
  far.answers = pump.far.answers;
  Pump whole(Pieces{{"every", "0.5"}});
  const std::unique_ptr<Instrument> other =
      open_instrument({load("other.lua", whole.file, unit_of),
                       memory_byte_link(far, *pump.clock, {.latency = 1ms}), "other", *pump.clock});
  pump.clock->sleep_for(13s);
  expect_says(broken.latest(kPolled).fault, "pump.lua");
  EXPECT_EQ(pump.heard("STOP"), 1);
  EXPECT_EQ(other->latest(kPolled).fault, "");
  EXPECT_EQ(far.count("STOP"), 0);
  EXPECT_GT(far.count("P?"), 10);
}

INSTANTIATE_TEST_SUITE_P(All, BrokenBody, testing::ValuesIn(kBodies),
                         [](const auto& row) { return std::string(row.param.name); });

// ---------------------------------------------------------------- where no io is

struct Place {
  const char* name;
  Pieces pieces;
  const char* words;
};
void PrintTo(const Place& row, std::ostream* out) { *out << row.name; }

class BrokenPlace : public testing::TestWithParam<Place> {};

TEST_P(BrokenPlace, IsTold) {
  Pump pump(GetParam().pieces);
  const auto more = GetParam().pieces.find("more");
  if (more != GetParam().pieces.end() && more->second.starts_with("unasked"))
    pump.far.answers["RATE?"] = {"noise\nnoise\n5\n"};
  const std::string said = error_of([&] {
    pump.opened();
    pump.rate();
    pump.opened().set(kRate, 2.5);
  });
  expect_says(said, "pump.lua");
  expect_says(said, GetParam().words);
}

const std::string kForEver = "function() while true do end end";
const std::string kLongNumbers = "= ('a'):rep(4000)";
INSTANTIATE_TEST_SUITE_P(
    All, BrokenPlace,
    testing::ValuesIn(std::vector<Place>{
        {"TheFile", {{"first", "while true do end"}}, "works for too long"},
        {"TheFileOfMemory", {{"first", "local s = 'x' for i = 1, 99 do s = s .. s end"}}, "memory"},
        {"SettingsAreEndless",
         {{"first", "local s = settings { a = (function() while true do end end)() }"}},
         "works for too long"},
        {"SettingsOfNaN", {{"first", "local s = settings { a = 0/0 }"}}, "settings.a"},
        {"SettingsWithoutADefault",
         {{"first", "local s = settings { a = { unit = 'mm' } }"}},
         "settings.a.default"},
        {"SettingsTwice", {{"first", "settings { a = 1 } settings { a = 2 }"}}, "settings"},
        {"SettingsOfManyNames",
         {{"first", "local t = {} for i = 1, 5000 do t['a' .. i] = i end settings(t)"}},
         "too many entries"},
        {"SettingsOfNames", {{"first", "settings { ['a\\0b'] = 1 }"}}, "small letters"},
        {"StringIsGone",
         {{"first", "string = nil"}, {"answer", ""}, {"more", "setup = string.rep('x', 2),"}},
         "string is not known"},
        {"ItReturnsNothing", {{"first", "do return end"}}, "must return a table"},
        {"ItReturnsItself", {{"first", "local t = {} t.title = t do return t end"}}, "title"},
        {"ALinkOfNothing", {{"first", "do return { title = 'x' } end"}}, "link: is missing"},
        {"APropertyOfABadName",
         {{"more", "properties = { ['x\\0'] = { ask = 'A?' } }, p ="}},
         "pump.lua"},
        {"NamesWithANull",
         {{"first",
           "do return { title = 'x', link = {}, identity = '?', properties = { ['x\\0'] = "
           "{ ask = 'A?' } } } end"}},
         "small letters"},
        {"ChoicesOfHuge", {{"rate", ", type = 'text', choices = { a = 0/0 }"}}, "choices.a"},
        {"AnAnswerPatternThatIsNone", {{"rate", ", answer = '(%d'"}}, "unfinished capture"},
        {"AnAnswerPatternThatGoesOn",
         {{"rate", ", answer = '(.-)(.-)(.-)(.-)(.-)(.-)(.-)(.-)#'"},
          {"link", ", longest = 9999"},
          {"ask", "function() return ('a'):rep(4000) end"}},
         "too many steps"},
        {"AnErrorPatternThatIsNone",
         {{"more", "errors = { ask = 'RATE?', none = '[' },"}},
         "malformed pattern"},
        {"AFormatThatIsNone", {{"set", "'RATE %y'"}}, "invalid conversion"},
        {"AFormatOfMore", {{"set", "'RATE %g %g'"}}, "bad argument"},
        {"RestIsEndless",
         {{"link", ", send_terminator = '\\n', message = { header = 2, rest = " + kForEver + " }"}},
         "works for too long"},
        {"RestIsNil",
         {{"link", ", send_terminator = '\\n', message = { header = 2, rest = function() end }"}},
         "link.message.rest"},
        {"RestIsNegative",
         {{"link",
           ", send_terminator = '\\n', message = { header = 2, rest = function() return -1 end }"}},
         "link.message.rest"},
        {"RestIsHuge",
         {{"link",
           ", send_terminator = '\\n', message = { header = 2, rest = function() return 1e300 end "
           "}"}},
         "link.message.rest"},
        {"UnaskedIsEndless",
         {{"more", "unasked = " + kForEver + ","},
          {"ask", "function(io) return io:ask('RATE?', { match = '^%d' }) end"}},
         "works for too long"},
        {"UnaskedUsesIo",
         {{"first", "local kept"},
          {"more", "unasked = function() kept:send('X') end,"},
          {"ask", "function(io) kept = io return io:ask('RATE?', { match = '^%d' }) end"}},
         "cannot be called here"},
        {"TooManyArguments",
         {{"more",
           "commands = (function() local t = {} for i = 1, 300 do t[i] = { name = 'a' .. i, min = "
           "0, "
           "max = 1 } end return { go = { send = 'GO', arguments = t } } end)(), c ="}},
         "pump.lua"},
    }),
    [](const auto& row) { return std::string(row.param.name); });

// ---------------------------------------------------------------- bytes

TEST(BrokenFarEnd, AnAnswerOfMegabytesIsNotTaken) {
  Pump pump;
  pump.opened();
  pump.far.answers["RATE?"] = {std::string(4 << 20, '7') + "\n"};
  expect_says(error_of([&] { pump.rate(); }), "a reply without an end");
}

TEST(BrokenFarEnd, BytesWithoutAnEndAreToldAndTheNextAnswerIsItsOwn) {
  Pump pump;
  pump.opened();
  pump.far.answers["RATE?"] = {std::string(3000, '7')};
  expect_says(error_of([&] { pump.rate(); }), "pump");
  pump.far.answers["RATE?"] = {"4\n"};
  EXPECT_EQ(pump.rate(), 4);
}

TEST(BrokenFarEnd, TalkWithoutAnEndIsToldWhereAnAnswerIsWaitedFor) {
  Pump pump(Pieces{{"ask", "function(io) return io:ask('RATE?', { match = '^%d' }) end"}});
  pump.opened();
  std::string noise;
  for (int i = 0; i < 5000; ++i) noise += "noise\n";
  pump.far.answers["RATE?"] = {noise};
  expect_says(error_of([&] { pump.rate(); }), "it goes on talking");
}

TEST(BrokenFarEnd, AnAnswerThatIsLateIsNotThatOfTheNextQuestion) {
  for (const Time late : {600ms, 1500ms, 4000ms}) {
    Pump pump;
    pump.opened();
    pump.far.answers["RATE?"] = {"1\n", late};
    expect_says(error_of([&] { pump.rate(); }), "says nothing to");
    pump.clock->sleep_for(std::max(late - 700ms, Time::zero()));
    pump.far.answers["P?"] = {"7\n"};
    EXPECT_EQ(std::get<double>(pump.opened().read(kPolled, 1s).value), 7);
  }
}

TEST(BrokenFarEnd, AConfirmationThatIsLateIsNotTheAnswerOfTheNextQuestion) {
  Pump pump(Pieces{{"rate", ", expects = '^OK'"}});
  pump.far.other = [](const std::string& message) -> std::optional<FarEnd::Answer> {
    if (message.starts_with("RATE ")) return FarEnd::Answer{"OK\n", 503ms};
    return std::nullopt;
  };
  pump.opened();
  expect_says(error_of([&] { pump.opened().set(kRate, 3.0); }), "says nothing to");
  EXPECT_EQ(pump.rate(), 5);
}

TEST(BrokenFarEnd, ADriverThatNeverEndsIsEndedWhereTheFarEndIsSilent) {
  Pump pump(Pieces{{"ask", "function(io) while true do pcall(io.ask, io, 'NOTHING') end end"}});
  pump.opened();
  const Time began = pump.clock->now();
  expect_says(error_of([&] { pump.rate(); }), "does not end: io:ask after 11 s");
  EXPECT_LT(pump.clock->now() - began, 13s);
  EXPECT_EQ(pump.heard("STOP"), 1);
}

// ---------------------------------------------------------------- links that go

TEST(LostLink, InEachOperationIsToldAsLostAndTheInstrumentComesBack) {
  for (const char* operation :
       {"io:ask('RATE?')", "io:send('RATE?')", "io:read()", "io:read { timeout = 5 }"}) {
    LinkFaults faults;
    Pump pump(Pieces{{"ask", std::string("function(io) ") + operation + " return 5 end"}}, &faults);
    pump.opened();
    faults.unplugged = true;
    expect_says(error_of([&] { pump.rate(); }), "(lost)");
    faults.unplugged = false;
    pump.far.answers["RATE?"] = {"5\n5\n"};
    const std::string again = error_of([&] { pump.rate(); });
    EXPECT_EQ(again.find("lost"), std::string::npos) << operation << ": " << again;
  }
}

TEST(LostLink, DuringASleepIsFeltAfterIt) {
  LinkFaults faults;
  Pump pump(Pieces{{"ask", "function(io) io:sleep(2) return io:ask('RATE?') end"}}, &faults);
  pump.opened();
  const auto cutter = pump.clock->spawn("cutter", [&] {
    pump.clock->sleep_for(1s);
    faults.unplugged = true;
  });
  expect_says(error_of([&] { pump.opened().read(kRate, 5s); }), "(lost)");
}

TEST(LostLink, WhereTheDriverFailsBothAreTold) {
  LinkFaults faults;
  Pump pump(Pieces{{"ask", "function(io) pcall(io.ask, io, 'RATE?') return nothing.x end"}},
            &faults);
  pump.opened();
  faults.unplugged = true;
  const std::string said = error_of([&] { pump.rate(); });
  expect_says(said, "nothing is not known");
  expect_says(said, "could not be made safe either");
}

// ---------------------------------------------------------------- stops

TEST(AStop, IsFeltInASleepOfWhatIsRead) {
  Pump pump(Pieces{{"ask", "function(io) io:sleep(8) return 5 end"}});
  Instrument& instrument = pump.opened();
  Time ended = kForever;
  auto reader = pump.clock->spawn("reader", [&] {
    try {
      instrument.read(kRate, 20s);
    } catch (const Stopped&) {
      ended = pump.clock->now();
      throw;
    }
  });
  pump.clock->sleep_for(1s);
  reader->request_stop();
  reader->join();
  EXPECT_LE(ended, 1100ms);
  EXPECT_EQ(pump.heard("STOP"), 0);
  EXPECT_NE(error_of([&] {
              pump.far.answers["P?"] = {"7\n"};
              pump.opened().read(kPolled, 1s);
            }),
            "stopped");
}

TEST(AStop, EndsAReadInEachOperationWithinItsTime) {
  for (const char* body :
       {"while true do io:now() end", "while true do io:sleep(0.1) end",
        "while true do io:ask('RATE?') io:sleep(0.05) end", "while true do pcall(io.read, io) end",
        "while true do io:send('RATE?') io:sleep(0.05) end", "while true do end"}) {
    Pump pump(Pieces{{"ask", std::string("function(io) ") + body + " end"}});
    Instrument& instrument = pump.opened();
    std::string said;
    auto reader = pump.clock->spawn("reader", [&] {
      try {
        instrument.read(kRate, 20s);
      } catch (const DeviceError& error) {
        said = error.what();
      }
    });
    pump.clock->sleep_for(500ms);
    const Time asked = pump.clock->now();
    reader->request_stop();
    const double wall = wall_seconds();
    reader->join();
    EXPECT_LT(pump.clock->now() - asked, 12s) << body;
    EXPECT_LT(wall_seconds() - wall, 5) << body;
    if (!said.empty()) expect_says(said, "pump.lua:");
  }
}

TEST(AStop, DoesNotBreakTheSafeStateOff) {
  Pump pump(Pieces{{"make_safe", "function(io) io:sleep(1) io:send('STOP') end"}});
  Instrument& instrument = pump.opened();
  auto safe = pump.clock->spawn("safe", [&] { instrument.make_safe(); });
  pump.clock->sleep_for(500ms);
  safe->request_stop();
  safe->join();
  EXPECT_EQ(pump.heard("STOP"), 1);
}

// ---------------------------------------------------------------- what is kept and overwritten

TEST(KeptOperations, WorkInEveryFunctionOfTheFileThatRunsOnTheLink) {
  Pump pump(Pieces{{"first", "local kept"},
                   {"more", "start_up = function(io) kept = io end,"},
                   {"ask", "function() return kept:ask('RATE?') end"}});
  pump.opened();
  EXPECT_EQ(pump.rate(), 5);
}

TEST(OverwrittenGlobals, AreTheFilesOwnLoss) {
  Pump pump(Pieces{
      {"first", "string = nil table.unpack = nil setmetatable = nil pcall = nil tostring = nil"},
      {"rate", ", answer = '(%d+)'"}});
  pump.opened();
  EXPECT_EQ(pump.rate(), 5);
  pump.opened().set(kRate, 2.5);
  EXPECT_EQ(pump.heard("RATE 2.5"), 1);
}

TEST(SettingsThatAreWrittenLater, ChangeNothingOfTheDeclaration) {
  const std::string text =
      filled(kPump, {{"first", "local set = settings { limit = { default = 5, unit = 'mm' } }"},
                     {"ask", "function() set.limit = 99 set = nil return 1 end"},
                     {"set", "'R %g'"},
                     {"make_safe", "'STOP'"},
                     {"poll", "'P?'"},
                     {"every", "0"},
                     {"command", "'C'"},
                     {"done", "nil"}});
  const Loaded loaded = load("pump.lua", text, unit_of, {{"limit", 7.0}});
  EXPECT_EQ(std::get<double>(loaded.declaration.settings.at(0).fallback), 5);
}

TEST(AValueThatTheFormatCannotSay, IsRefusedAndTheDriverGoesOn) {
  Pump pump(Pieces{{"set", "'RATE %d'"}});
  pump.opened();
  expect_says(error_of([&] { pump.opened().set(kRate, 2.5); }), "must be a whole number");
  pump.opened().set(kRate, 2.0);
  EXPECT_EQ(pump.heard("RATE 2"), 1);
}

TEST(AFileOfALongName, IsNamedWhole) {
  const std::string name = "/a/folder/of/instruments/" + std::string(80, 'x') + "/pump.lua";
  const std::string said = error_of([&] { load(name, "local a\nreturn a.x", unit_of); });
  EXPECT_EQ(said, name + ":2: attempt to index a nil value (local 'a')");
}

// ---------------------------------------------------------------- two tasks

TEST(TwoTasks, HaveTheInstrumentOneAfterTheOther) {
  Pump pump(Pieces{{"first", "local inside = 0"}, {"ask", R"(function(io)
                inside = inside + 1
                local answer = io:ask('RATE?')
                if inside ~= 1 then error('two at once') end
                inside = inside - 1
                return answer
              end)"}});
  Instrument& instrument = pump.opened();
  int good = 0;
  const auto many = [&] {
    for (int i = 0; i < 20; ++i) good += std::get<double>(instrument.read(kRate, 2s).value) == 5;
  };
  const auto first = pump.clock->spawn("a", many), second = pump.clock->spawn("b", many);
  first->join();
  second->join();
  EXPECT_EQ(good, 40);
}

// ---------------------------------------------------------------- emulators

constexpr const char* kEmulated = R"(@first@
return {
  title = "A pump", link = { timeout = 0.5@link@ }, identity = { ask = "ID?", match = "PUMP" },
  make_safe = "STOP",
  properties = { rate = { ask = "RATE?" } },
  emulator = { @emulator@ },
}
)";

std::string emulated(const std::map<std::string, std::string>& pieces) {
  const std::string text = filled(kEmulated, pieces);
  const auto clock = virtual_clock();
  return error_of([&] {
    const std::shared_ptr<Emulator> peer = make_emulator(load("pump.lua", text, unit_of));
    const auto instrument =
        open_instrument({load("pump.lua", text, unit_of),
                         link_to(peer, memory_byte_link(*peer, *clock)), "pump", *clock});
    clock->sleep_for(1s);
    instrument->read(0, 1s);
    peer->power_cycle(clock->now());
    instrument->read(0, 1s);
  });
}

const std::string kIdentity = "answers = { ['ID?'] = 'PUMP', ['RATE?'] = ";

TEST(BrokenEmulator, IsToldOnTheLine) {
  for (const auto& [body, words] : std::vector<std::pair<std::string, std::string>>{
           {"function() while true do end end", "its emulator failed: pump.lua:"},
           {"function() local a return a.x end", "its emulator failed: pump.lua:"},
           {"function() return ('x'):rep(1e8) end", "its emulator failed: pump.lua:"},
           {"function() return (('a'):rep(9999)):match('.-.-.-x') end", "its emulator failed"},
           {"function(e) error(e) end", "its emulator failed: pump.lua:"},
           {"function(e) e.glides = nil e:glide('x', 1, 1) end", "its emulator failed: pump.lua"},
           {"function(e) setmetatable(e, nil) e:later(1, 'x') end",
            "its emulator failed: pump.lua"},
           {"function(e) io:ask('RATE?') end", "io is not known"}})
    expect_says(emulated({{"emulator", kIdentity + body + " }"}}), words);
}

TEST(BrokenEmulator, ThatSaysMoreThanThereIsRoomForIsTold) {
  for (const char* body :
       {"function() local s, t = ('x'):rep(1e6), {} for i = 1, 1e5 do t[i] = s end return t end",
        "function(e) local s = ('x'):rep(1e6) for i = 1, 1e4 do e:later(i, s) end end",
        "function(e) for i = 1, 3e4 do e:later(0, '') end return '5' end"})
    expect_says(emulated({{"emulator", kIdentity + body + " }"}}), "says more than is heard");
}

TEST(BrokenEmulator, OfOverwrittenGlobalsStillHasItsState) {
  EXPECT_EQ(emulated({{"first", "setmetatable = function() return 5 end math = nil"},
                      {"emulator",
                       kIdentity + "function(e) e:glide('x', 1, 1) return e:at('x') .. '' end }"}}),
            "no error");
}

TEST(BrokenEmulator, InItsStartIsTold) {
  expect_says(
      emulated({{"emulator", "start = function() error('dead') end, " + kIdentity + "'5' }"}}),
      "pump.lua:6: dead");
}

TEST(BrokenEmulator, InHowManyBytesFollowIsTold) {
  for (const char* rest : {"error('rest')", "while true do end", "return 'x'", "return 1e9"})
    expect_says(
        emulated(
            {{"link",
              std::string(", send_terminator = '\\n', message = { header = 2, rest = function() ") +
                  rest + " end }"},
             {"emulator", kIdentity + "'5' }"}}),
        "pump.lua");
}

TEST(BrokenEmulator, AMessageWithoutAnEndIsForgotten) {
  const auto peer = make_emulator(
      load("pump.lua", filled(kEmulated, {{"emulator", kIdentity + "'5' }"}}), unit_of));
  const std::vector<std::uint8_t> noise(1 << 20, 'x');
  for (int i = 0; i < 20; ++i) peer->receive(noise, Time::zero());
  const std::string question = "\nID?\n";
  peer->receive({reinterpret_cast<const std::uint8_t*>(question.data()), question.size()},
                Time::zero());
  EXPECT_EQ(peer->say(1s).size(), 1u);
}

TEST(BrokenEmulator, IsNoneWhereItsTablesAreWrong) {
  for (const auto& [emulator, words] : std::vector<std::pair<std::string, std::string>>{
           {"", "emulator.answers"},
           {"answers = { { 5, 'x' } }", "emulator.answers[1]"},
           {"answers = { {} }", "emulator.answers[1]"},
           {"answers = 5", "emulator.answers"},
           {"answers = { ['ID?'] = 5 }", "emulator.answers.ID?"},
           {"answers = { x = 'y' }, delay = 0/0", "emulator.delay"},
           {"answers = { x = 'y' }, other = 1", "emulator.other: is not known"}})
    expect_says(emulated({{"emulator", emulator}}), "pump.lua: " + words);
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::scripted
