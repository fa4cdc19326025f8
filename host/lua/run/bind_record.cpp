// Bindings of run: samples and frames into the record, and samples out of it again.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/binding.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/run/classes.h"
#include "host/record/meaning.h"
#include "host/record/run_labels.h"
#include "host/session/error_statistics.h"
#include "host/text/units.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

constexpr double kEnd = 1e9;            // s: after the end of every run
constexpr const char* kTimes = "time";  // of the lists that run:samples gives: no channel's name

/// {speed = 1, place = {x, y, z}} as channels place_x, place_y, place_z, speed.
struct Sample {
  std::vector<std::string> names;
  std::vector<std::string> keys;  // the key of each channel
  std::vector<double> values;
};

Sample sample_of(const Call& call, int index) {
  lua_State* const L = call.L;
  Sample sample;
  const auto add = [&sample](const std::string& name, const std::string& key, double value) {
    sample.names.push_back(name);
    sample.keys.push_back(key);
    sample.values.push_back(value);
  };
  // The keys come sorted: the order of a Lua table changes from run to run, and that of the
  // channels must not.
  for (const std::string& key : text_keys(L, index)) {
    if (key == kTimes)
      throw std::invalid_argument("values: time: is kept for every sample; give this another name");
    lua_getfield(L, index, key.c_str());
    const auto vector = to_vector(L, -1);
    if (vector) {
      for (int i = 0; i < 3; ++i) add(key + "_" + "xyz"[i], key, (*vector)[i]);
    } else if (lua_type(L, -1) == LUA_TNUMBER) {
      add(key, key, lua_tonumber(L, -1));
    } else {
      throw std::invalid_argument(
          "values: " + key + ": wants a number or a position {x, y, z}, got " + kind_of(L, -1));
    }
    lua_pop(L, 1);
  }
  if (sample.names.empty())
    throw std::invalid_argument("values: wants names and numbers, such as {speed = 1*mm_per_s}");
  return sample;
}

/// The SI unit of a channel: values are SI, so `units` says what they measure, and "mm" is m.
std::string unit_of(const Call& call, const std::string& key) {
  if (!call.has(2)) return "";
  lua_getfield(call.L, call.index(2), key.c_str());
  const std::string symbol = lua_isnil(call.L, -1) ? "" : plain_text(call.L, -1);
  lua_pop(call.L, 1);
  const auto unit = find_unit(symbol);
  if (!unit) throw std::invalid_argument("units: " + key + ": " + symbol + " is not a unit");
  return std::string(unit->dimension);
}

/// What a channel is, as the script says it.
std::string help_of(const Call& call, const std::string& key) {
  std::string text;
  if (call.has(3)) {
    lua_getfield(call.L, call.index(3), key.c_str());
    if (!lua_isnil(call.L, -1)) text = plain_text(call.L, -1);
    lua_pop(call.L, 1);
  }
  return text.empty() ? key + ", as the script records it" : text;
}

/// The stream of that name, made by its first sample. A stream of the host is refused: a script
/// could forge what the loop has measured.
Context::Script& script_stream(const Call& call, const std::string& name, const Sample& sample) {
  Context& context = call.context();
  const auto found = context.script_streams.find(name);
  if (found != context.script_streams.end()) return found->second;
  Recorder& recorder = session_of(call.L).recorder;
  if (recorder.stream(name))
    throw std::invalid_argument("stream: " + name + " is recorded by the host");
  StreamInfo info{name, "script", {}, kScriptClock};
  for (std::size_t i = 0; i < sample.names.size(); ++i)
    info.channels.push_back(
        {sample.names[i], unit_of(call, sample.keys[i]), help_of(call, sample.keys[i])});
  return context.script_streams[name] = {recorder.add_stream(info), sample.names};
}

/// A row has a value for every channel, since the table of the record has fixed columns. What is
/// not known is told before what is missing: of a misspelt name both are true.
void check_channels(const std::string& stream, const std::vector<std::string>& known,
                    const std::vector<std::string>& given) {
  for (const std::string& name : given)
    if (std::find(known.begin(), known.end(), name) == known.end())
      throw std::invalid_argument("values: " + name + " was not in the first sample of " + stream);
  for (const std::string& name : known)
    if (std::find(given.begin(), given.end(), name) == given.end())
      throw std::invalid_argument("values: " + name +
                                  " is missing; it was in the first sample of " + stream);
}

// The row's time is that of the call, on the run's clock: a script cannot date a sample back.
int record(Call& call) {
  Session& session = session_of(call.L);
  const std::string name = call.text(0);
  const Sample sample = sample_of(call, call.index(1));
  const Context::Script& stream = script_stream(call, name, sample);
  check_channels(name, stream.channels, sample.names);
  session.recorder.sample(stream.stream, session.clock.now(), sample.values);
  return 0;
}

int tag(Call& call) {
  session_of(call.L).recorder.tag(call.text(0), call.text(1));
  return 0;
}

int describe_sample(Call& call) {
  for (const std::string& field : sample_fields())
    if (const auto value = call.text_option(field.c_str()))
      session_of(call.L).recorder.describe_sample(field, *value);
  return 0;
}

/// Checked in a dry run, too; there the policy is only noted, for the space that it would need.
int record_frames(Call& call) {
  const int every = static_cast<int>(call.number_option("every").value_or(1));
  Session& session = session_of(call.L);
  const FramePolicy policy{call.text(0), every,
                           static_cast<int>(call.number_option("window").value_or(0)),
                           call.number_option("around").value_or(0)};
  // A window of 0 px means whole frames, and 0 s around events means all the time.
  session.frames.check(policy);
  if (session.rehearsal != nullptr)
    session.rehearsal->frames.push_back(policy);
  else
    session.frames.start(policy);
  return 0;
}

/// The recording of frames looks at the kinds of events, and "keep" is one that it keeps frames
/// for.
int keep_frames(Call& call) {
  Session& session = session_of(call.L);
  session.recorder.event(session.clock.now(), "keep", call.text(0));
  return 0;
}

std::string joined(const std::vector<std::string>& names) {
  std::string text;
  for (const std::string& name : names) text += (text.empty() ? "" : ", ") + name;
  return text;
}

/// Throws std::invalid_argument with the channels that there are: a misspelt one would be nil, as
/// the stream itself is where the record has none of that name.
std::size_t channel_named(const Stream& stream, const std::string& name) {
  std::vector<std::string> known;
  for (std::size_t i = 0; i < stream.info.channels.size(); ++i) {
    if (stream.info.channels[i].name == name) return i;
    known.push_back(stream.info.channels[i].name);
  }
  throw std::invalid_argument("channels: the stream " + stream.info.name + " has no " + name +
                              "; it has " + joined(known));
}

/// The names at `channels`; without them all of the stream's.
std::vector<std::string> wanted_channels(const Call& call, const Stream& stream) {
  std::vector<std::string> names;
  if (!call.has(1)) {
    for (const Channel& channel : stream.info.channels) names.push_back(channel.name);
    return names;
  }
  const auto count = static_cast<lua_Integer>(lua_rawlen(call.L, call.index(1)));
  for (lua_Integer i = 1; i <= count; ++i) {
    if (lua_rawgeti(call.L, call.index(1), i) != LUA_TSTRING)
      throw std::invalid_argument("channels: entry " + std::to_string(i) + ": wants a name, got " +
                                  kind_of(call.L, -1));
    names.emplace_back(lua_tostring(call.L, -1));
    lua_pop(call.L, 1);
  }
  return names;
}

/// The rows of a stream whose times, in s, lie from `from` to `to`, both among them.
std::vector<std::size_t> rows_within(const Stream& stream, double from, double to) {
  std::vector<std::size_t> rows;
  for (std::size_t row = 0; row < stream.times.size(); ++row) {
    const double time = to_seconds(stream.times[row]);
    if (time >= from && time <= to) rows.push_back(row);
  }
  return rows;
}

/// One table of lists that are equally long. Every list has a value for every time: a NaN of the
/// record (an unseen robot) stays one, since a nil would shift what follows it.
int samples(Call& call) {
  const Stream* const stream = session_of(call.L).recorder.stream(call.text(0));
  if (stream == nullptr) return 0;
  const std::vector<std::string> names = wanted_channels(call, *stream);
  const std::vector<std::size_t> rows = rows_within(*stream, call.number_option("from").value_or(0),
                                                    call.number_option("to").value_or(kEnd));
  std::vector<double> values(rows.size());
  ResultTable table(call);
  const int at = lua_gettop(call.L);
  for (const std::string& name : names) {
    const std::size_t channel = channel_named(*stream, name);
    for (std::size_t i = 0; i < rows.size(); ++i) values[i] = stream->at(rows[i], channel);
    push_numbers(call.L, values);
    lua_setfield(call.L, at, name.c_str());
  }
  for (std::size_t i = 0; i < rows.size(); ++i) values[i] = to_seconds(stream->times[rows[i]]);
  table.numbers(kTimes, values, "s");
  return 1;
}

/// An error of nothing would be a perfect one. A dry run has other streams than the run, and
/// measures nothing.
void check_compared(const Call& call, std::size_t count, double from, double to) {
  if (count > 0 || session_of(call.L).rehearsal != nullptr) return;
  throw std::runtime_error("nothing to compare: '" + call.text_option("of").value_or("") +
                           "' and '" + call.text_option("against").value_or("") +
                           "' have no place at the same moment from " + format_quantity(from, "s") +
                           " to " + format_quantity(to, "s"));
}

int errors(Call& call) {
  const auto text = [&call](const char* name) { return call.text_option(name).value_or(""); };
  const Session& session = session_of(call.L);
  const double now = to_seconds(session.clock.now());
  // By default up to now and not to kEnd, as the error of an empty span tells both its ends.
  const double from = call.number_option("from").value_or(0),
               to = call.number_option("to").value_or(now);
  const ErrorStatistics s =
      error_statistics(session.recorder, text("of"), text("of_prefix"), text("against"),
                       text("against_prefix"), from_seconds(from), from_seconds(to));
  check_compared(call, s.count, from, to);
  ResultTable table(call);
  table.number("count", static_cast<double>(s.count));
  // The names are those of error_fields(), from which the reference is made; all are lengths in m.
  const std::pair<const char*, double> fields[] = {{"rms", s.rms},
                                                   {"mean", s.mean},
                                                   {"max", s.max},
                                                   {"lateral_rms", s.lateral_rms},
                                                   {"depth_rms", s.depth_rms},
                                                   {"lateral_mean", s.lateral_mean},
                                                   {"depth_mean", s.depth_mean},
                                                   {"lateral_max", s.lateral_max},
                                                   {"depth_max", s.depth_max},
                                                   {"lateral_std", s.lateral_std},
                                                   {"depth_std", s.depth_std}};
  for (const auto& [name, value] : fields) table.number(name, value, "m");
  return 1;
}

Returned error_fields() {
  std::vector<ResultField> fields{{"count", "", "of moments that are compared"}};
  for (const char* name : {"rms", "mean", "max"}) fields.push_back({name, "m", "of the distance"});
  for (const char* name : {"lateral_rms", "lateral_mean", "lateral_max", "lateral_std"})
    fields.push_back({name, "m", "of its part across the eye's axis"});
  for (const char* name : {"depth_rms", "depth_mean", "depth_max", "depth_std"})
    fields.push_back({name, "m", "of its part along it"});
  return {"table", std::move(fields)};
}

Argument time_option(const char* name, const char* help) {
  return {.name = name,
          .type = Type::number,
          .unit = "s",
          .optional = true,
          .min = 0,
          .max = kEnd,
          .help = help};
}

}  // namespace

std::vector<Binding> run_record_rows() {
  const auto text = [](const char* name, bool optional, const char* help) {
    return Argument{.name = name, .type = Type::text, .optional = optional, .help = help};
  };
  const Argument stream = text("stream", false, "its name");
  const Argument span{
      .name = "options",
      .type = Type::options,
      .options = {time_option("from", "first time"), time_option("to", "last time")}};
  return {
      {"record",
       {stream,
        {.name = "values", .type = Type::table, .help = "numbers and positions by name"},
        {.name = "units",
         .type = Type::table,
         .optional = true,
         .help = "unit by name, such as {speed = \"m/s\"}"},
        {.name = "help",
         .type = Type::table,
         .optional = true,
         .help = "what it is, by name, for those who read the record"}},
       "",
       "records one sample; the first decides the channels",
       record,
       "run:record(\"drift\", { speed = 20e-6 }, { speed = \"m/s\" }, { speed = \"of the drift\" "
       "})"},
      {"tag",
       {text("key", false, "a word"), text("value", false, "any text of one line")},
       "",
       "tags the run, as --tag KEY=VALUE does: vitreo runs finds it by that",
       tag,
       "run:tag(\"batch\", \"a 1\")"},
      {"describe_sample",
       {{.name = "sample",
         .type = Type::options,
         .options = {text("eye", true, "its id"), text("species", true, "of the animal"),
                     text("age", true, "of the animal or donor"),
                     text("died", true, "when the animal died: 2026-11-24T05:40"),
                     text("removed", true, "when the eye was removed: 2026-11-24T08:10"),
                     text("pipette", true, "with which the robot is inserted: 24 G"),
                     text("light", true, "lamp, level and way into the eye"),
                     text("robot", true, "its id")}}},
       "",
       "keeps in the record what is known of the sample, as --sample FIELD=VALUE does",
       describe_sample,
       "run:describe_sample { eye = \"pig 7 left\", removed = \"2026-11-24T08:10\" }"},
      {"record_frames",
       {text("camera", false, "its role: top_camera or side_camera"),
        {.name = "options",
         .type = Type::options,
         .options = {{.name = "every",
                      .type = Type::integer,
                      .optional = true,
                      .min = 1,
                      .max = 1000000,
                      .help = "keeps one frame of so many"},
                     {.name = "window",
                      .type = Type::integer,
                      .optional = true,
                      .min = 8,
                      .max = 8192,
                      .help = "px: only a window about the robot, and a whole frame each second"},
                     {.name = "around",
                      .type = Type::number,
                      .unit = "s",
                      .optional = true,
                      .min = 0.1,
                      .max = 600,
                      .help =
                          "only so long before and after alarms, errors and run:keep_frames"}}}},
       "",
       "records a camera's frames from now on",
       record_frames,
       "run:record_frames(\"top_camera\", { every = 15 })"},
      {"keep_frames",
       {text("why", false, "for the record")},
       "",
       "keeps the frames around this moment, where they are recorded around events only",
       keep_frames,
       "run:keep_frames(\"it jumped\")"},
      {"samples",
       {stream,
        {.name = "channels",
         .type = Type::list,
         .optional = true,
         .help = "their names; without them all"},
        span},
       Returned("table", {{kTimes, "s", "of each sample"},
                          {"...", "",
                           "under a channel's name the list of its values, in the channel's SI "
                           "unit; NaN where nothing was measured"}})
           .or_nil("where the record has no such stream"),
       "what was recorded, in lists that are equally long",
       samples,
       "run:samples(\"servo\", { \"x\", \"y\" }, { from = 1 * s })"},
      {"errors",
       {{.name = "options",
         .type = Type::options,
         .options = {text("of", false, "the stream that is judged"),
                     text("of_prefix", true, "of its x, y, z"),
                     text("against", false, "the stream that it is judged by"),
                     text("against_prefix", true, "of its x, y, z"),
                     time_option("from", "first time"), time_option("to", "last time")}}},
       error_fields(),
       "how far two streams of positions are from each other",
       errors,
       "run:errors { of = \"servo\", against = \"truth\" }"}};
}

}  // namespace vitreo::lua
