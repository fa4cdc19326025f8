// The examples of the reference: each one runs in a simulated rig, and gives what its row says.
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/engine/library.h"
#include "host/lua/interpreter/state.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/reference/reference.h"
#include "tests/host/lua/interpreter/lua_bench.h"
#include "tests/vision/sequence_files.h"

#include <opencv2/videoio.hpp>

#include <set>

namespace vitreo::lua {
namespace VITREO_TEST_FILE {

/// Every role: the simulated laboratory, and instruments of its kind beside it.
constexpr const char* kRig = R"(
local units = require "units"
return {
  base = "simulated",
  title = "Every role",
  top_camera = { width_px = 692, height_px = 518, effective_pixel = 28.6 * units.um },
  rotation_stage = { driver = "zaber", address = "emulated", max_speed = 1 },
  field_probe = { driver = "scpi_probe", address = "emulated", question = "MEAS?", axes = 3 },
  lamp = { driver = "led", address = "emulated", output = 1, amperes_per_volt = 0.1, full_current = 0.3 },
  joystick = { driver = "spacemouse", address = "emulated" },
  pedal = { driver = "foot_pedal", address = "emulated" },
  truth = { bodies = { target = {
    shape = "spheroid", semi_axis = 0.4e-3, semi_radius = 0.4e-3, position = { 0, 0, 10e-3 }, fixed = true, axis = { 0, 0, 1 },
  } } },
}
)";

// What the examples of a group refer to.
constexpr const char* kOptics = R"(
local eye = optics.system { name = "navarro_condensing" }
local map, law = eye:wide_angle_map {}, eye:axis_law()
local view = optics.system({ name = "model_eye_5_3" }):localizer { center = { 691.5, 517.5 } }
local robot = { shape = "spheroid", half_length = 1 * mm, radius = 0.5 * mm }
local seen = view:ellipse { body = robot, position = { 0, 0, 2 * mm }, axis = { 1, 0, 0 } }
local points, pixels, on_retina, foci, target_points = {}, {}, {}, {}, {}
for i, b in ipairs { { mm, 0, 0 }, { -mm, 0.5 * mm, 0 }, { 0, -mm, 0.2 * mm }, { 0, 0.3 * mm, mm }, { -0.4 * mm, -0.6 * mm, -0.8 * mm } } do
  local at = view:pixel(vector(b) + vector(0, 0, 3 * mm))
  points[i] = { body = b, u = at.u, v = at.v }
  local x, y = (i % 3) * mm, (i // 3) * mm
  pixels[i] = { m = { x, y }, pixel = { 100 - x / (14 * um), 200 + y / (14 * um) } }
end
for i = 1, 20 do
  local r, a = i * 0.2 * mm, i * 2.4
  on_retina[i] = { r * math.cos(a), r * math.sin(a), r * r / (24 * mm) }
end
for i = 1, 8 do
  local x, y, z = (i % 3) * mm, (i % 2) * mm, (i // 3) * mm
  target_points[i] = { position = { x, y, z }, pixel = { 100 + x / (14 * um) * (1 + 2 * z), 200 - y / (14 * um) * (1 + 2 * z) } }
end
for i = 0, 4 do foci[i + 1] = { depth = i * mm, distance = eye:axial_image(i * mm).distance } end
)";

constexpr const char* kControl = R"(
local path = control.line { from = { 0, 0, 0 }, to = { mm, 0, 0 } }
local field_model, readings = control.field_model { name = "octomag" }, {}
for n = 1, 60 do
  local at, currents = vector(math.random() - 0.5, math.random() - 0.5, math.random() - 0.5) * 0.02, {}
  for k = 1, 8 do currents[k] = 8 * math.random() - 4 end
  readings[n] = { position = at, currents = currents, field = field_model:field({ position = at, currents = currents }).field }
end
local measured, commanded, falls, along = { time = {}, x = {}, y = {}, z = {} }, { time = {}, commanded_x = {}, commanded_y = {}, commanded_z = {} }, {}, 0
for i = 1, 150 do
  local u = (i // 15) % 2 == 0 and mm or -mm
  measured.time[i], measured.x[i], measured.y[i], measured.z[i] = i / 15, along + um * math.random(), 0, 0
  commanded.time[i], commanded.commanded_x[i], commanded.commanded_y[i], commanded.commanded_z[i] = i / 15, u, 0, 0
  along = along + u / 15
end
for k = 1, 2 do
  local fell = { time = {}, x = {}, y = {}, z = {} }
  for i = 1, 18 do
    fell.time[i], fell.x[i], fell.y[i], fell.z[i] = i / 15, 0, 0, um * math.random() - mm * math.max(0, i / 15 - 0.55)
  end
  falls[k] = { measured = fell, off = 0.5, on = 1.1 }
end
)";

constexpr const char* kVision = R"(
local image, training = vision.image { file = "frame.png" }, vision.training { folder = "training" }
local color_model = vision.color_model { images = training }
local tracker, background_tracker, search = vision.tracker { model = color_model }, vision.background_tracker {}, vision.autofocus { low = 0, high = mm, step = 50 * um }
local video, views = vision.video { file = "recorded.avi" }, {}
for i = 1, 3 do views[i] = image:crop { x = 30 * i, y = 10 * i, width = 200, height = 180 } end
search:next()
local track = tracker:update(image).tracks[1]
local retina_map = vision.retina_map {}
retina_map:update(image)
)";

constexpr const char* kServo = R"(
rig.sample:remove_robot()
local background = rig:learn_background { frames = 4 }
local servo <close> = rig:servo { feedback = "pose_sensor", law = "estimator" }
servo:hold({ 0, 0, 0 })
rig.sample:insert_robot({ 0, 0, 0 })
servo:wait_until_tracked()
)";

constexpr const char* kRun = R"(
local eye, image = rig:eye(), rig.top_camera:grab().image
local track, reminder = { x_px = 50, y_px = 40, major_px = 30, minor_px = 20, angle = 0 }, run:remind("wet the eye")
local alarm = run:alarm { name = "gel", priority = "low", text = "it is warm" }
)";

/// Runs one example, and compares what it returns with its row; what is wrong goes into `failures`.
constexpr const char* kCheck = R"(
local failures = {}
local function kind_is(value, kind)
  if kind == "number" or kind == "string" then return type(value) == kind end
  if kind == "path" then return type(value) == "string" end
  if kind == "true or false" then return type(value) == "boolean" end
  if kind == "vector" then return type(value) == "table" and #value == 3 and value.norm ~= nil end
  if kind == "numbers" or kind == "names" then
    if type(value) ~= "table" then return false end
    for _, one in ipairs(value) do
      if type(one) ~= (kind == "numbers" and "number" or "string") then return false end
    end
    return true
  end
  return tostring(value) == kind
end
local compare
local function compare_table(value, fields, where)
  if type(value) ~= "table" then return { where .. " is no table" } end
  local wrong = {}
  for name in pairs(value) do
    if not fields[name] and not fields["..."] then wrong[#wrong + 1] = where .. "." .. tostring(name) .. " is not in the row" end
  end
  for name, field in pairs(fields) do
    if value[name] == nil then
      if not field.optional and name ~= "..." then wrong[#wrong + 1] = where .. "." .. name .. " is nil" end
    elseif field.fields then
      for _, one in ipairs(compare(value[name], field.fields, where .. "." .. name)) do wrong[#wrong + 1] = one end
    end
  end
  return wrong
end
function compare(value, fields, where) -- a table, or a list of tables
  if type(value) ~= "table" or #value == 0 then return compare_table(value, fields, where) end
  local wrong = {}
  for i, entry in ipairs(value) do
    for _, one in ipairs(compare_table(entry, fields, ("%s[%d]"):format(where, i))) do wrong[#wrong + 1] = one end
  end
  return wrong
end
local function example(name, returns, call)
  local result = table.pack(pcall(call))
  local value = result[2]
  local function fail(what) failures[#failures + 1] = name .. ": " .. what end
  if not result[1] then return fail(tostring(value)) end
  if returns.kind == "any" then return end
  if returns.kind == "" then return result.n > 1 and fail("returns something") end
  if value == nil then return not returns.optional and fail("returns nil") end
  if result.n > 2 then fail(("returns %d values"):format(result.n - 1)) end
  if returns.kind == "list" and #value == 0 then return end
  if returns.fields then
    for _, one in ipairs(compare(value, returns.fields, "result")) do fail(one) end
  elseif not kind_is(value, returns.kind) then
    fail(("returns %s, not a %s"):format(tostring(value), returns.kind))
  end
end
)";

using Names = std::set<std::string>;
/// Classes and modules whose examples run in one script.
const Names kOfOptics{"optics", "optical_system", "wide_angle_map", "localizer", "axis_law"};
const Names kOfControl{"control", "trajectory", "field_model"};
const Names kOfVision{"vision",  "retina_map",         "image",    "video", "color_model",
                      "tracker", "background_tracker", "autofocus"};
const Names kOfServo{"servo", "background"};
const Names kOfRig{"rig",         "camera",         "coils",          "lens_mover",
                   "sample",      "stage",          "rotation_stage", "motion",
                   "field_probe", "operator_input", "lamp",           "simulation"};
const Names kOfRun{"run", "files", "reminder", "alarm", "format_quantity"};

/// "servo" of servo:go_to, "control" of control.line.
std::string group_of(const Entry& entry) {
  const std::string name = full_name(entry.owner, *entry.row);
  return name.substr(0, name.find_first_of(".:"));
}

std::string fields_text(const std::vector<ResultField>& fields) {
  std::string text = "{ ";
  for (const ResultField& field : fields)
    text += "['" + field.name + "'] = { optional = " + (field.optional ? "true" : "false") +
            (field.fields.empty() ? "" : ", fields = " + fields_text(field.fields)) + " }, ";
  return text + "}";
}

/// "vector", "numbers", "servo": what `example` compares with; "any" where the row says it in
/// words.
std::string kind_of_result(const Returned& returns) {
  const std::set<std::string> vectors{"position", "velocity",  "force",
                                      "field",    "direction", "vector"};
  const std::set<std::string> plain{"", "number", "string", "path", "true or false", "table"};
  if (vectors.contains(returns.type)) return "vector";
  if (returns.type == "list of numbers") return "numbers";
  if (returns.type == "list of names") return "names";
  if (returns.type == "list of tables") return "list";
  if (plain.contains(returns.type) || find_class(library(), returns.type)) return returns.type;
  return "any";
}

std::string example_line(const Entry& entry) {
  const Returned& returns = entry.row->returns;
  return "example(\"" + full_name(entry.owner, *entry.row) + "\", { kind = \"" +
         kind_of_result(returns) + "\", optional = " + (returns.optional ? "true" : "false") +
         (returns.fields.empty() ? "" : ", fields = " + fields_text(returns.fields)) +
         " }, function() return " + example(entry) + " end)\n";
}

class Examples : public LuaBench {
 protected:
  Examples() {
    const std::filesystem::path lib = folder.path() / "lib";
    std::ofstream(lib / "every_role.lua") << kRig;
    engine = make_lua_engine({std::string(VITREO_SOURCE_DIR) + "/scripts", lib.string()});
    bench = std::make_unique<TestBench>(1, SimulationShifts{},
                                        engine->load_rig((lib / "every_role.lua").string()));
  }

  /// Files that examples of the vision read.
  void write_images() {
    const std::filesystem::path lib = folder.path() / "lib";
    vision::generated::write_sequence({.seed = 5, .size = {320, 240}}, 2, 3, lib);
    std::filesystem::copy(lib / "frames" / "frame_0000.png", lib / "frame.png");
    cv::VideoWriter writer((lib / "recorded.avi").string(),
                           cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 20, {64, 48}, false);
    for (int i = 0; i < 3; ++i) writer.write(cv::Mat(48, 64, CV_8UC1, cv::Scalar(50 * i)));
  }

  /// Runs the examples of these classes and modules after `names`, in the order of the rows.
  void expect_run(const std::string& names, const Names& groups, const Names& without = {}) {
    std::string body = kExampleNames + names + kCheck;
    for (const Entry& entry : all_entries(library())) {
      const std::string name = full_name(entry.owner, *entry.row);
      if (groups.contains(group_of(entry)) && !without.contains(name)) body += example_line(entry);
    }
    body += "if #failures > 0 then error(table.concat(failures, '\\n'), 0) end";
    const std::string file =
        write("p.lua", "return { title = 't', run = function(rig, p, run)\n" + body + "\nend }");
    const Ended end = ended([&] { engine->run(engine->describe(file), {}, *bench->session); });
    EXPECT_EQ(end.error, "");
  }

  std::unique_ptr<TestBench> bench;
};

TEST(ExampleGroups, HaveEveryCallButThoseOfThePrompt) {
  // Those of a viewing chain want looks that are measured: protocols/calibrate_bench.lua has them.
  // The prompt's own, show and plot, and fits are tried in prompt_test.cpp.
  Names known{"help", "check", "show", "plot", "fit", "viewing_chain"};
  for (const Names& group : {kOfOptics, kOfControl, kOfVision, kOfServo, kOfRig, kOfRun})
    known.insert(group.begin(), group.end());
  for (const Entry& entry : all_entries(library()))
    EXPECT_TRUE(known.contains(group_of(entry))) << full_name(entry.owner, *entry.row);
}

TEST_F(Examples, OfTheOpticsRun) { expect_run(kOptics, kOfOptics); }

TEST_F(Examples, OfTheControlRun) { expect_run(kControl, kOfControl); }

TEST_F(Examples, OfTheVisionRun) {
  write_images();
  expect_run(kVision, kOfVision);
}

TEST_F(Examples, OfTheServoRun) { expect_run(kServo, kOfServo, {"servo:spin"}); }

TEST_F(Examples, OfTheRotatingServoRun) {
  const auto entry = find_entry(library(), "servo:spin");
  ASSERT_TRUE(entry);
  std::string servo = kServo;
  const std::string law = "law = \"estimator\"";
  servo.replace(servo.find(law), law.size(), "law = control.rotating { mode = \"tumbler\" }");
  const std::string file =
      write("p.lua", "return { title = 't', run = function(rig, p, run)\n" +
                         std::string(kExampleNames) + servo + example(*entry) +
                         "\nrun:wait(0.5 * s)\nlocal turns = servo:rotation()\n"
                         "assert(turns.frequency > 0 and turns.frequency <= turns.limit)"
                         "\nend }");
  const Ended end = ended([&] { engine->run(engine->describe(file), {}, *bench->session); });
  EXPECT_EQ(end.error, "");
}

TEST_F(Examples, OfTheRigsInstrumentsRun) {
  const std::string machine =
      "files.write('machine.yaml', control.field_model({ name = 'octomag' }):to_yaml { low = { "
      "-cm, "
      "-cm, -cm }, high = { cm, cm, cm } })\nlocal eye = rig:eye():sample { number = 1 }\n"
      "rig.sample:remove_robot() local background = rig:learn_background { frames = 4 }\n"
      "local motion = rig.stage:start { 0.05 * mm } motion:wait()\n";
  // A reload is for the prompt (tests/host/lua/prompt/reload_test.cpp); a field is identified by
  // minutes of motion (protocols/calibrate_field.lua).
  expect_run(machine, kOfRig, {"rig:reload", "rig:identify_field"});
}

TEST_F(Examples, OfTheRunAndItsFilesRun) {
  write_images();
  bench->session->questions.prepare({"lamp=yes", "depth=3 mm"});
  // A stop and an abort end the script; errors wants a servo's record, which the servo's has.
  expect_run(std::string(kServo) + kRun, kOfRun, {"run:stop", "run:abort"});
}

TEST_F(Examples, OfAStopAndAnAbortEndTheRun) {
  for (const char* name : {"run:stop", "run:abort"}) {
    const auto entry = find_entry(library(), name);
    ASSERT_TRUE(entry);
    const std::string file = write("p.lua", "return { title = 't', run = function(rig, p, run)\n" +
                                                example(*entry) + "\nend }");
    TestBench fresh;
    EXPECT_TRUE(ended([&] { engine->run(engine->describe(file), {}, *fresh.session); }).stopped);
  }
}

TEST(ResultTables, RefuseAFieldOrAUnitThatTheRowHasNot) {
  static int (*wrong)(Call&) = nullptr;
  static const std::vector<Binding> rows = {
      {"wrong", {}, {"table", {{"speed", "m/s", ""}}}, "", [](Call& call) { return wrong(call); }}};
  const auto refused = [](int (*function)(Call&)) {
    wrong = function;
    const State state(library(), nullptr, {});
    lua_State* const L = state.main();
    open_globals(L, rows);
    EXPECT_NE(luaL_dostring(L, "wrong()"), LUA_OK);
    return std::string(lua_tostring(L, -1));
  };
  expect_all(refused([](Call& call) {
               ResultTable(call).number("speed", 1, "N");
               return 1;
             }),
             {"wrong: ", "speed is pushed in 'N'", "'m/s'"});
  expect_all(refused([](Call& call) {
               ResultTable(call).number("sped", 1, "m/s");
               return 1;
             }),
             {"sped is not in the row"});
  expect_all(refused([](Call& call) { return call.result(1.0, "m"); }), {"pushed in 'm'"});
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo::lua
