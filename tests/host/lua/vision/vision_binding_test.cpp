// Vision from Lua: from files to tracks, and the errors of wrong calls.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"
#include "tests/vision/sequence_files.h"

#include <fstream>

namespace vitreo {
namespace {

/// Ten frames and four masks, made once for all tests.
const TemporaryFolder& recorded() {
  static const TemporaryFolder folder;
  static const bool made = [] {
    vision::generated::write_sequence({.seed = 5, .size = {320, 240}}, 10, 4, folder.path());
    std::ofstream(folder.path() / "frames" / "broken.png") << "\x89PNG\r\n\x1a\nno more";
    return true;
  }();
  EXPECT_TRUE(made);
  return folder;
}

class VisionBinding : public LuaBench {
 protected:
  VisionBinding() {  // what a script may read lies beside its modules
    std::filesystem::create_directory_symlink(recorded().path(), folder.path() / "lib" / "out");
    std::filesystem::copy(recorded().path(), folder.path() / "lib" / "seq",
                          std::filesystem::copy_options::recursive);
  }
  Ended with_vision(const std::string& body) {
    return run("local vision, files = require 'vision', require 'files'\n" + body);
  }
  void expect_fine(const std::string& body) { EXPECT_EQ(with_vision(body).error, "") << body; }
  void expect_refused(const std::string& body, const std::vector<std::string>& parts) {
    expect_all(with_vision(body).error, parts);
  }
  const std::string model_ =
      "local model = vision.color_model.train { images = vision.training 'seq/training' } ";
};

TEST_F(VisionBinding, ImagesAreReadListedAndMeasured) {
  expect_fine(
      "local list = vision.images 'seq/frames' assert(#list == 11 and list[1].name == "
      "'broken.png')\n"
      "assert(list[2].number == 0 and list[11].number == 9)\n"
      "local image = vision.load_image(list[2].path) local w, h = image:size()\n"
      "assert(w == 320 and h == 240 and image:channels() == 3 and #{image:pixel(319, 239)} == 3)\n"
      "local gray = image:gray() assert(gray:channels() == 1 and gray:pixel(0, 0) <= 255)\n"
      "local w2, h2 = image:crop { x = 300, y = 0, width = 20, height = 240 }:size() assert(w2 == "
      "20 and h2 == 240)");
  expect_fine(
      "local t = vision.training 'seq/training' assert(#t == 4 and t[1].name == 'robot_0')\n"
      "assert(t[1].mask:channels() == 1 and t[1].mask:mean() > 0)");
  expect_refused("vision.load_image 'seq/frames/broken.png'", {"p.lua:3", "broken.png", "damaged"});
  expect_refused("vision.load_image('seq/truth.csv')", {"truth.csv: is not an image"});
  expect_refused("local i = vision.load_image 'seq/frames/frame_0000.png' i:pixel(320, 0)",
                 {"image:pixel: ", "320 x 240"});
  expect_refused(
      "local i = vision.load_image 'seq/frames/frame_0000.png' i:crop { x = 310, y = 0, width = "
      "20, height = 9 }",
      {"image:crop: sticks out"});
  expect_refused("vision.training 'seq/frames'", {"vision.training: ", "has no training pair"});
  expect_refused("vision.lod_image 'x.png'",
                 {"vision: there is no lod_image; did you mean load_image?"});
  expect_refused("vision.color_model.trian {}",
                 {"vision.color_model: there is no trian; did you mean train?"});
}

TEST_F(VisionBinding, AScriptReadsNothingThatNobodyGaveIt) {
  expect_refused("vision.load_image '/etc/passwd'", {"path: /etc/passwd lies outside of"});
  expect_refused("vision.load_image 'out/frames/frame_0000.png'",
                 {"lies outside of"});  // a link that leads away
  expect_refused("vision.load_image 'lib/../../../etc/passwd'", {"vision.load_image: path: "});
  expect_refused("vision.images 'nowhere'", {"nowhere: there is no such file or folder"});
  expect_refused("files.read_csv '/etc/passwd'", {"lies outside of"});
}

TEST_F(VisionBinding, WhatAScriptWritesStaysInTheRunsFolder) {
  expect_fine(
      "local image = vision.load_image 'seq/frames/frame_0000.png'\n"
      "assert(vision.load_image(image:save 'first.png'):pixel(3, 4) == image:pixel(3, 4))\n"
      "run:picture('first', image, 'as it is') files.write('a.csv', 'x,y\\n1,\\n2,b\\n')\n"
      "local rows, names = files.read_csv(files.write('b.csv', 'x;y\\n1;\\n2.5;b\\n'))\n"
      "assert(#rows == 2 and rows[1].x == 1 and rows[1].y == nil and rows[2].y == 'b' and names[2] "
      "== 'y')");
  EXPECT_TRUE(std::filesystem::exists(recorder.folder() / "first.png"));
  ASSERT_EQ(recorder.pictures().size(), 1u);
  EXPECT_EQ(recorder.pictures()[0].caption, "as it is");
  expect_refused("files.write('../x.csv', '')",
                 {"files.write: name: '../x.csv' is not a plain file name"});
  expect_refused("files.write('run.sqlite-wal', '')", {"belongs to the run's record"});
  expect_refused("files.write('a.csv', '')", {"a.csv is in the run's folder already"});
  expect_refused("vision.load_image('seq/frames/frame_0000.png'):save 'first.jpg'",
                 {"wants to end in .png"});
  expect_refused("files.read_csv(files.write('c.csv', 'x\\n1,2\\n'))", {"c.csv:2: has 2 cells"});
}

TEST_F(VisionBinding, AModelIsTrainedRankedSavedAndLoaded) {
  expect_fine(
      model_ +
      "local r, deviation, each = model:quality() assert(r > 1 and r < 2 and deviation >= 0 and "
      "#each == 4)\n"
      "local t = model:thresholds() assert(t.low < t.high)\n"
      "assert(model:likelihood(75, 77, 80) > 1 and model:likelihood(168, 92, 52) < -1, 'metal, "
      "fundus')\n"
      "local s = model:shape() assert(math.abs(s.major_px - 60) < 5 and math.abs(s.minor_px - 30) "
      "< 3)\n"
      "local again = vision.color_model.load(model:save 'robot.model') local r2 = again:quality()\n"
      "assert(r2 == r and again:channels() == 'RGB' and again:image_size() == 320)");
  expect_fine(
      "local ranks = vision.color_model.rank { images = vision.training 'seq/training' }\n"
      "assert(#ranks == 18 and ranks[1].channels == 'RG' and ranks[1].mean > 1 and "
      "ranks[1].deviation < 1)");
  expect_refused("vision.color_model.train { images = {} }",
                 {"vision.color_model.train: images: is empty"});
  expect_refused("vision.color_model.train { images = { 5 } }",
                 {"images: entry 1: wants {image = , mask = }"});
  expect_refused(
      "vision.color_model.train { images = vision.training 'seq/training', channels = 'RQ' }",
      {"RQ"});
  expect_refused(
      "local t = vision.training 'seq/training' t[2].mask = t[2].image vision.color_model.train { "
      "images = t }",
      {"image 2"});
  expect_refused("vision.color_model.load 'seq/truth.csv'", {"seq/truth.csv: ", "object model"});
}

TEST_F(VisionBinding, ATrackerFollowsAndSaysHowWell) {
  expect_fine(
      model_ +
      "local truth = files.read_csv 'seq/truth.csv' local tracker = vision.tracker { model = model "
      "}\n"
      "for i = 0, 9 do\n"
      "  local t = tracker:update(vision.load_image(('seq/frames/frame_%04d.png'):format(i)))\n"
      "  assert(t.state == 'tracking' and #t.covariance == 25 and t.covariance[1] > 0 and "
      "t.cpu_time > 0)\n"
      "  local off = math.sqrt((t.x_px - truth[i+1].cx)^2 + (t.y_px - truth[i+1].cy)^2) assert(off "
      "< 1, off)\n"
      "  assert(math.abs(t.major_px - truth[i+1].A) < 4 and t.inliers > 0.5)\n"
      "end\n"
      "local image = vision.load_image 'seq/frames/frame_0009.png'\n"
      "local blank = image:crop { x = 0, y = 0, width = 320, height = 240 }\n"
      "local drawn = image:overlay { track = tracker:update(blank), trail = { { 0, 0 }, { 9, 9 } "
      "}, caption = 'x' }\n"
      "assert(drawn:channels() == 3) tracker:reset()\n"
      "tracker:place { x_px = truth[1].cx, y_px = truth[1].cy, major_px = 60, minor_px = 30, angle "
      "= 0 }");
  expect_refused(
      model_ + "vision.tracker { model = model }:update(vision.training('seq/training')[1].mask)",
      {"tracker:update: image: must be 8-bit color"});
  expect_refused(model_ + "vision.tracker { model = model, threshold_low = 0 }",
                 {"threshold_high"});
  expect_refused("vision.tracker {}", {"vision.tracker: model: is missing; wants a color_model"});
  expect_refused(model_ + "vision.tracker { model = model }:place { x_px = 3 }",
                 {"tracker:place: at: y_px: wants"});
}

TEST_F(VisionBinding, SeveralObjectsOwnTheirPixels) {
  expect_fine(
      model_ +
      "local truth = files.read_csv 'seq/truth.csv' local all = vision.multi_tracker { models = { "
      "model } }\n"
      "local tracks, cpu = all:update(vision.load_image 'seq/frames/frame_0000.png') assert(cpu > "
      "0 and #tracks == 1)\n"
      "assert(tracks[1].state == 'tracking' and math.abs(tracks[1].x_px - truth[1].cx) < 1)\n"
      "assert(all:owners():pixel(math.floor(truth[1].cx), math.floor(truth[1].cy)) == 1)\n"
      "assert(all:owners():pixel(0, 0) == 0) all:reset()");
  expect_refused("vision.multi_tracker { models = { 3 } }",
                 {"models: entry 1: wants a color_model, got a number"});
  expect_refused(model_ +
                     "vision.multi_tracker { models = { model } }:place(2, { x_px = 9, y_px = 9, "
                     "major_px = 60, "
                     "minor_px = 30, angle = 0 })",
                 {"multi_tracker:place: object"});
}

TEST_F(VisionBinding, BackgroundSubtractionOfEveryKindFindsWhatIsNew) {
  expect_fine(
      "for _, kind in ipairs { 'fixed', 'running', 'mog2', 'knn' } do\n"
      "  local tracker = vision.background_tracker { kind = kind, max_area_px = 30000 }\n"
      "  local image = vision.load_image 'seq/frames/frame_0003.png'\n"
      "  for i = 1, 20 do tracker:learn(image) end\n"
      "  assert(tracker:update(image) == nil, kind)\n"
      "end");
  expect_refused("vision.background_tracker { kind = 'gmg' }",
                 {"kind: wants fixed, running, mog2 or knn, got 'gmg'"});
}

TEST_F(VisionBinding, FocusIsMeasuredAndItsPeakSearched) {
  expect_fine(
      "local image = vision.load_image 'seq/frames/frame_0000.png'\n"
      "for _, name in ipairs(vision.focus.measures()) do\n"
      "  local value, more = vision.focus.measure(image, { measure = name, x = 10, y = 10, width = "
      "99, height = 80 })\n"
      "  assert(value ~= 0 and more.pixels > 7000, name)\n"
      "end\n"
      "local search = vision.autofocus { low = 0, high = 1, step = 0.01 } local at, done = "
      "search:start(), nil\n"
      "repeat local next_at, ended = search:next(at, 1 + 50 * math.exp(-(at - 0.371)^2 / 0.01)) "
      "done = ended\n"
      "  at = next_at or at until ended\n"
      "assert(done.answer == 'found' and math.abs(done.position - 0.371) < 0.005 and done.readings "
      "< 60)\n"
      "assert(vision.focus.peak({ 1, 2, 3 }, { 1, 1, 1 }).answer == 'no peak')");
  expect_refused("vision.focus.peak({ 1, 2 }, { 1 })",
                 {"vision.focus.peak: values: has 1 numbers, positions has 2"});
  expect_refused("vision.autofocus { low = 1, high = 0, step = 0.1 }", {"vision.autofocus: "});
  expect_refused("vision.focus.measure(vision.load_image 'seq/frames/frame_0000.png', { x = 1 })",
                 {"all four"});
}

TEST_F(VisionBinding, ViewsAreJoinedIntoOnePicture) {
  expect_fine(
      "local image = vision.load_image 'seq/frames/frame_0000.png' local views = {}\n"
      "for i = 1, 3 do views[i] = image:crop { x = 30 * i, y = 10 * i, width = 200, height = 180 } "
      "end\n"
      "local made = vision.mosaic { images = views } assert(made.joined == 3 and made.rms_px < "
      "0.3)\n"
      "local w, h = made.image:size() assert(math.abs(w - 260) <= 3 and math.abs(h - 200) <= 3, "
      "w)\n"
      "assert(math.abs(made.places[3][3] - made.places[1][3] - 60) < 0.5)");
  expect_refused("vision.mosaic { images = { vision.load_image 'seq/frames/frame_0000.png' } }",
                 {"vision.mosaic: "});
}

TEST_F(VisionBinding, ManyImagesDoNotFillTheMemory) {
  // 2000 images of 0.2 MB each, none of them kept: Lua sees only handles, the count of bytes
  // collects them.
  expect_fine(
      "local image = vision.load_image 'seq/frames/frame_0000.png' local w, h = image:size()\n"
      "for i = 1, 2000 do image:crop { x = 0, y = 0, width = w, height = h } end");
  expect_refused(
      "local all, image = {}, vision.load_image 'seq/frames/frame_0000.png'\n"
      "while true do all[#all + 1] = image:overlay {} end",
      {"the script holds more than 512 MB of images"});
}

TEST_F(VisionBinding, ACameraGivesItsImages) {
  expect_fine(
      "local frame = rig.top_camera:grab() local w, h = frame.image:size()\n"
      "assert(w == frame.width_px and h == frame.height_px and frame.image:pixel(0, 0) == 7)");
}

}  // namespace
}  // namespace vitreo
