// Vision from Lua: from files to tracks, and the errors of wrong calls.
// SPDX-License-Identifier: Apache-2.0
#include "tests/host/lua/interpreter/lua_bench.h"
#include "tests/vision/sequence_files.h"

#include <opencv2/videoio.hpp>

#include <fstream>

namespace vitreo {
namespace VITREO_TEST_FILE {

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
      "local model = vision.color_model { images = vision.training { folder = 'seq/training' } } ";
};

TEST_F(VisionBinding, ImagesAreReadListedAndMeasured) {
  expect_fine(
      "local list = vision.images { folder = 'seq/frames' } assert(#list == 11 and list[1].name == "
      "'broken.png')\n"
      "assert(list[2].number == 0 and list[11].number == 9)\n"
      "local image = vision.image { file = list[2].file } local i = image:info()\n"
      "assert(i.width_px == 320 and i.height_px == 240 and i.channels == 3)\n"
      "local corner = { x = 300, y = 200, width = 20, height = 40 }\n"
      "local all, part, cut = image:mean(), image:mean(corner), image:crop(corner):mean()\n"
      "assert(part.blue == cut.blue and part.red ~= all.red and all.gray == nil)\n"
      "i = image:crop({ x = 300, y = 0, width = 20, height = 240 }):info() assert(i.width_px == 20 "
      "and i.height_px == 240)");
  expect_fine(
      "local t = vision.training { folder = 'seq/training' } assert(#t == 4 and t[1].name == "
      "'robot_0')\n"
      "assert(t[1].mask:info().channels == 1 and t[1].mask:mean().gray > 0 and not "
      "t[1].mask:mean().red)");
  expect_refused("vision.image { file = 'seq/frames/broken.png' }",
                 {"p.lua:3", "broken.png", "damaged"});
  expect_refused("vision.image { file = 'seq/truth.csv' }", {"truth.csv: is not an image"});
  expect_refused(
      "vision.image({ file = 'seq/frames/frame_0000.png' }):mean { x = 320, y = 0, width = 1, "
      "height = 1 }",
      {"image:mean: sticks out", "320 x 240"});
  expect_refused(
      "local i = vision.image { file = 'seq/frames/frame_0000.png' } i:crop { x = 310, y = 0, "
      "width = 20, height = 9 }",
      {"image:crop: sticks out"});
  expect_refused("vision.training { folder = 'seq/frames' }",
                 {"vision.training: ", "has no training pair"});
  expect_refused("vision.imge { file = 'x.png' }",
                 {"vision: there is no imge; did you mean image?"});
  expect_refused("vision.color_model {}", {"vision.color_model: images: is missing"});
  const std::string training = "local t = vision.training { folder = 'seq/training' } ";
  expect_refused(training + "t[2].tip = 5 vision.color_model { images = t }",
                 {"images: entry 2: tip: wants {x_px = , y_px = }, got a number"});
  expect_refused(training + "t[2].tip = { x_px = 5 } vision.color_model { images = t }",
                 {"images: entry 2: tip: y_px: wants a number"});
  expect_refused(training + "t[2].tip = { x_px = 5, y_px = 5 } vision.color_model { images = t }",
                 {"tips: wants at least four images in which it is known"});
}

TEST_F(VisionBinding, AScriptReadsNothingThatNobodyGaveIt) {
  expect_refused("vision.image { file = '/etc/passwd' }", {"path: /etc/passwd lies outside of"});
  expect_refused("vision.image { file = 'out/frames/frame_0000.png' }",
                 {"lies outside of"});  // a link that leads away
  expect_refused("vision.image { file = 'lib/../../../etc/passwd' }", {"vision.image: path: "});
  expect_refused("vision.images { folder = 'nowhere' }",
                 {"nowhere: there is no such file or folder"});
  expect_refused("files.read_csv '/etc/passwd'", {"lies outside of"});
}

TEST_F(VisionBinding, WhatAScriptWritesStaysInTheRunsFolder) {
  expect_fine(
      "local image = vision.image { file = 'seq/frames/frame_0000.png' }\n"
      "local kept = vision.image { file = image:save 'first.png' } local at = { x = 3, y = 4, "
      "width = 1, "
      "height = 1 } assert(kept:mean(at).red == image:mean(at).red)\n"
      "run:picture { title = 'first', image = image, note = 'as it is' } files.write('a.csv', "
      "'x,y\\n1,\\n2,b\\n')\n"
      "local read = files.read_csv(files.write('b.csv', 'x;y\\n1;\\n2.5;b\\n')) local rows, names "
      "= read.rows, read.columns\n"
      "assert(#rows == 2 and rows[1].x == 1 and rows[1].y == nil and rows[2].y == 'b' and names[2] "
      "== 'y')");
  EXPECT_TRUE(std::filesystem::exists(recorder.folder() / "first.png"));
  ASSERT_EQ(recorder.pictures().size(), 1u);
  EXPECT_EQ(recorder.pictures()[0].caption, "as it is");
  expect_refused("files.write('../x.csv', '')",
                 {"files.write: name: '../x.csv' is not a plain file name"});
  expect_refused("files.write('run.sqlite-wal', '')", {"belongs to the run's record"});
  expect_refused("files.write('a.csv', '')", {"a.csv is in the run's folder already"});
  expect_refused("vision.image({ file = 'seq/frames/frame_0000.png' }):save 'first.jpg'",
                 {"wants to end in .png"});
  expect_refused("files.read_csv(files.write('c.csv', 'x\\n1,2\\n'))", {"c.csv:2: has 2 cells"});
}

TEST_F(VisionBinding, AModelIsTrainedRankedSavedAndLoaded) {
  expect_fine(
      model_ +
      "local info = model:info() local q = info.quality assert(q.mean > 1 and q.mean < 2 and "
      "q.deviation >= 0 and #q.of_images == 4)\n"
      "local t = info.thresholds assert(t.low < t.high)\n"
      "local s = info.shape assert(math.abs(s.major_px - 60) < 5 and math.abs(s.minor_px - 30) < "
      "3)\n"
      "local again = vision.color_model({ file = model:save 'robot.model' }):info()\n"
      "assert(again.quality.mean == q.mean and again.channels == 'RGB' and again.width_px == 320)");
  expect_fine(
      "local ranks = vision.rank_channels { images = vision.training { folder = 'seq/training' } "
      "}\n"
      "assert(#ranks == 18 and ranks[1].channels == 'RG' and ranks[1].mean > 1 and "
      "ranks[1].deviation < 1)");
  expect_refused("vision.color_model { images = {} }", {"vision.color_model: images: is empty"});
  expect_refused("vision.color_model { images = { 5 } }",
                 {"images: entry 1: wants {image = , mask = }"});
  expect_refused(
      "vision.color_model { images = vision.training { folder = 'seq/training' }, channels = 'RQ' "
      "}",
      {"RQ"});
  expect_refused(
      "local t = vision.training { folder = 'seq/training' } t[2].mask = t[2].image "
      "vision.color_model { images = t }",
      {"image 2"});
  expect_refused("vision.color_model { file = 'seq/truth.csv' }",
                 {"seq/truth.csv: ", "object model"});
}

TEST_F(VisionBinding, ATrackerFollowsAndSaysHowWell) {
  expect_fine(model_ +
              "local truth = files.read_csv('seq/truth.csv').rows local tracker = vision.tracker { "
              "model = model }\n"
              "for i = 0, 9 do\n"
              "  local seen = tracker:update(vision.image { file = "
              "('seq/frames/frame_%04d.png'):format(i) })\n"
              "  local t = seen.tracks[1] assert(#seen.tracks == 1 and seen.cpu_time > 0 and "
              "seen.owners == nil)\n"
              "  assert((t.state == 'tracking') == (i >= 2), 'three frames must agree')\n"
              "  if i >= 2 then\n"
              "  assert(#t.covariance == 25 and t.covariance[1] > 0)\n"
              "  local off = math.sqrt((t.x_px - truth[i+1].cx)^2 + (t.y_px - truth[i+1].cy)^2) "
              "assert(off < 1, off)\n"
              "  assert(math.abs(t.major_px - truth[i+1].A) < 4 and t.inliers > 0.5)\n"
              "  end\n"
              "end\n"
              "local image = vision.image { file = 'seq/frames/frame_0009.png' }\n"
              "local blank = image:crop { x = 0, y = 0, width = 320, height = 240 }\n"
              "local drawn = image:overlay { track = tracker:update(blank).tracks[1], trail = { { "
              "0, 0 }, { "
              "9, 9 } }, caption = 'x' }\n"
              "assert(drawn:info().channels == 3) tracker:reset()\n"
              "assert(tracker:update(blank).tracks[1].expected == nil, 'searching again')\n"
              "tracker:set_ellipse { x_px = truth[1].cx, y_px = truth[1].cy, major_px = 60, "
              "minor_px = 30, angle = math.rad(truth[1].phi_deg) }\n"
              "local first = vision.image { file = 'seq/frames/frame_0000.png' }\n"
              "local t = tracker:update(first).tracks[1]\n"
              "assert(t.state == 'tracking' and math.abs(t.expected.x_px - truth[1].cx) < 1e-9)");
  expect_fine(model_ +
              "local gray = vision.training({ folder = 'seq/training' })[1].mask\n"
              "assert(vision.tracker { model = model }:update(gray).tracks[1].state ~= 'tracking', "
              "'a gray image has no colors of the robot')");
  expect_refused(model_ + "vision.tracker { model = model, threshold_low = 0 }",
                 {"threshold_high"});
  expect_refused("vision.tracker {}", {"vision.tracker: options: wants either model or models"});
  expect_refused(model_ + "vision.tracker { model = model, models = { model } }",
                 {"wants either model or models"});
  expect_refused(model_ + "vision.tracker { model = model }:set_ellipse { x_px = 3 }",
                 {"tracker:set_ellipse: ellipse: y_px: wants"});
}

TEST_F(VisionBinding, SeveralObjectsOwnTheirPixels) {
  expect_fine(
      model_ +
      "local truth = files.read_csv('seq/truth.csv').rows\n"
      "local all = vision.tracker { models = { model, model } }\n"
      "local image = vision.image { file = 'seq/frames/frame_0000.png' }\n"
      "all:set_ellipse({ x_px = truth[1].cx, y_px = truth[1].cy, major_px = 60, minor_px = 30, "
      "angle = math.rad(truth[1].phi_deg) }, { object = 2 })\n"
      "local made = all:update(image, { owners = true }) local tracks = made.tracks\n"
      "assert(made.cpu_time > 0 and #tracks == 2 and tracks[1].state == 'searching')\n"
      "assert(tracks[2].state == 'tracking' and math.abs(tracks[2].x_px - truth[1].cx) < 1)\n"
      "local function owner(x, y) return made.owners:mean({ x = math.floor(x), y = math.floor(y), "
      "width = 1, height = 1 }).gray end\n"
      "assert(owner(truth[1].cx, truth[1].cy) == 2 and owner(0, 0) == 0)\n"
      "local before = made.owners:mean().gray all:reset() all:update(image)\n"
      "assert(made.owners:mean().gray == before, 'the map is its frame\\'s')");
  expect_refused("vision.tracker { models = { 3 } }",
                 {"models: entry 1: wants a color_model, got a number"});
  const std::string place =
      ":set_ellipse({ x_px = 9, y_px = 9, major_px = 60, minor_px = 30, angle = 0 }";
  expect_refused(model_ + "vision.tracker { model = model }" + place + ", { object = 2 })",
                 {"tracker:set_ellipse: object: wants 1 to 1, got 2"});
  expect_refused(model_ + "vision.tracker { models = { model, model } }" + place + ")",
                 {"tracker:set_ellipse: object: is missing; the tracker follows 2"});
}

TEST_F(VisionBinding, BackgroundSubtractionOfEveryKindFindsWhatIsNew) {
  expect_fine(
      "for _, kind in ipairs { 'fixed', 'running', 'mog2', 'knn' } do\n"
      "  local tracker = vision.background_tracker { kind = kind, max_area_px = 30000 }\n"
      "  local image = vision.image { file = 'seq/frames/frame_0003.png' }\n"
      "  for i = 1, 20 do tracker:learn(image) end\n"
      "  assert(tracker:update(image) == nil, kind)\n"
      "end");
  expect_refused("vision.background_tracker { kind = 'gmg' }",
                 {"kind: wants fixed, running, mog2 or knn, got 'gmg'"});
}

TEST_F(VisionBinding, FocusIsMeasuredAndItsPeakSearched) {
  expect_fine(
      "local image = vision.image { file = 'seq/frames/frame_0000.png' }\n"
      "for _, name in ipairs(vision.focus_measures()) do\n"
      "  local made = image:focus { measure = name, x = 10, y = 10, width = 99, height = 80 }\n"
      "  assert(made.value ~= 0 and made.pixels > 7000, name)\n"
      "end\n"
      "local search = vision.autofocus { low = 0, high = 1, step = 0.01 } local done = "
      "search:next()\n"
      "while done.move_to do local at = done.move_to\n"
      "  done = search:next { position = at, value = 1 + 50 * math.exp(-(at - 0.371)^2 / 0.01) } "
      "end\n"
      "assert(done.answer == 'found' and math.abs(done.position - 0.371) < 0.005 and done.readings "
      "< 60)\n"
      "assert(vision.focus_peak({ positions = { 1, 2, 3 }, values = { 1, 1, 1 } }).answer == 'no "
      "peak')");
  expect_refused("vision.focus_peak { positions = { 1, 2 }, values = { 1 } }",
                 {"vision.focus_peak: values: has 1 numbers, positions has 2"});
  expect_refused("vision.autofocus { low = 1, high = 0, step = 0.1 }", {"vision.autofocus: "});
  expect_refused("vision.autofocus({ low = 0, high = 1, step = 0.1 }):next { position = 0 }",
                 {"autofocus:next: position, value: one is missing"});
  expect_refused("vision.image({ file = 'seq/frames/frame_0000.png' }):focus { x = 1 }",
                 {"all four"});
}

TEST_F(VisionBinding, ViewsAreJoinedIntoOnePicture) {
  expect_fine(
      "local image = vision.image { file = 'seq/frames/frame_0000.png' } local views = {}\n"
      "for i = 1, 3 do views[i] = image:crop { x = 30 * i, y = 10 * i, width = 200, height = 180 } "
      "end\n"
      "local made = vision.mosaic { images = views } assert(made.joined == 3 and made.rms_px < "
      "0.3)\n"
      "local size = made.image:info() assert(math.abs(size.width_px - 260) <= 3 and "
      "math.abs(size.height_px - 200) <= 3, size.width_px)\n"
      "assert(math.abs(made.places[3][3] - made.places[1][3] - 60) < 0.5)");
  expect_refused(
      "vision.mosaic { images = { vision.image { file = 'seq/frames/frame_0000.png' } } }",
      {"vision.mosaic: "});
}

TEST_F(VisionBinding, AVideoIsReadToItsEndAndSaysHowManyFramesItHas) {
  cv::VideoWriter writer((folder.path() / "lib" / "recorded.avi").string(),
                         cv::VideoWriter::fourcc('M', 'J', 'P', 'G'), 20, {64, 48}, false);
  for (int i = 0; i < 3; ++i) writer.write(cv::Mat(48, 64, CV_8UC1, cv::Scalar(50 * i)));
  writer.release();
  expect_fine(
      "local video, read = vision.video { file = 'recorded.avi' }, 0\n"
      "while video:read() do read = read + 1 end\n"
      "assert(read == 3 and video:info().frames == 3 and video:read() == nil)");
}

TEST_F(VisionBinding, ManyImagesDoNotFillTheMemory) {
  // 2000 images of 0.2 MB each, none of them kept: Lua sees only handles, the count of bytes
  // collects them.
  expect_fine(
      "local image = vision.image { file = 'seq/frames/frame_0000.png' } local size = "
      "image:info()\n"
      "for i = 1, 2000 do image:crop { x = 0, y = 0, width = size.width_px, height = "
      "size.height_px } end");
  expect_refused(
      "local all, image = {}, vision.image { file = 'seq/frames/frame_0000.png' }\n"
      "while true do all[#all + 1] = image:overlay {} end",
      {"the script holds more than 512 MB of images"});
}

TEST_F(VisionBinding, ACameraGivesItsImages) {
  expect_fine(
      "local frame = rig.top_camera:grab() local size = frame.image:info()\n"
      "assert(size.width_px == frame.width_px and size.height_px == frame.height_px and "
      "frame.image:mean({ x = 0, y = 0, width = 1, height = 1 }).gray == 7)");
}

}  // namespace VITREO_TEST_FILE
}  // namespace vitreo
