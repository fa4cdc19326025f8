// Bindings of images and videos: from files and cameras, into the run's folder and report.
// SPDX-License-Identifier: Apache-2.0
#include "host/files/image_files.h"
#include "host/files/video_file.h"
#include "host/lua/interpreter/context.h"
#include "host/lua/interpreter/readable.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/values.h"
#include "host/lua/vision/bind_vision.h"
#include "host/lua/vision/classes.h"
#include "vision/draw.h"

#include <opencv2/imgproc.hpp>

#include <cmath>
#include <stdexcept>

namespace vitreo::lua {
namespace {

const cv::Mat& pixels_of(const Call& call) { return call.self<Image>().pixels; }

/// A mask is binarized while it is read, so masks of 0 and 1 do as well as those of 0 and 255.
int read_image(Call& call) {
  const auto file = readable(call.context(), *call.text_option("file"));
  push_image(call.L, call.flag_option("mask") ? read_mask(file) : read_color_image(file));
  return 1;
}

/// Files only, not their pixels: a long sequence would not fit into memory.
int list_images(Call& call) {
  const auto files = image_files(readable(call.context(), *call.text_option("folder")));
  return push_result_list(call, files.size(), [&files](ResultTable& entry, std::size_t i) {
    entry.text("file", files[i].string()).text("name", files[i].filename().string());
    if (const auto number = number_in(files[i])) entry.integer("number", *number);
  });
}

/// Images with their masks, all at once: a model is trained from all of them.
int training(Call& call) {
  const auto files = labeled_files(readable(call.context(), *call.text_option("folder")));
  return push_result_list(call, files.size(), [&](ResultTable& entry, std::size_t i) {
    push_image(call.L, read_color_image(files[i].image));
    entry.top("image");
    push_image(call.L, read_mask(files[i].mask));
    entry.top("mask").text("name", files[i].name);
  });
}

/// The file stays open between frames: a handle, and not a list of images.
int open_video(Call& call) {
  push_handle(call.L, video_class(),
              std::make_shared<VideoFile>(readable(call.context(), *call.text_option("file"))));
  return 1;
}

/// Nothing at the end, so that `while` loops end there.
int video_read(Call& call) {
  const cv::Mat frame = call.self<VideoFile>().read();
  if (frame.empty()) return 0;
  push_image(call.L, frame);
  return 1;
}

int video_info(Call& call) {
  const int frames = call.self<VideoFile>().count();
  ResultTable table(call);
  if (frames > 0) table.integer("frames", frames);  // 0: the file does not say
  return 1;
}

/// The handle is empty from here on: its file is closed now and not when Lua collects it.
int video_close(Call& call) {
  close_handle(call);
  return 0;
}

int image_info(Call& call) {
  ResultTable(call)
      .integer("width_px", pixels_of(call).cols)
      .integer("height_px", pixels_of(call).rows)
      .integer("channels", pixels_of(call).channels());
  return 1;
}

/// A part of the image by the options x, y, width and height, all of them needed. Throws
/// std::invalid_argument when it sticks out: a part that is cut off would be another one than
/// asked.
cv::Mat part_of(const Call& call) {
  const auto whole = [&](const char* name) { return static_cast<int>(*call.number_option(name)); };
  const cv::Rect asked(whole("x"), whole("y"), whole("width"), whole("height"));
  const cv::Rect all(0, 0, pixels_of(call).cols, pixels_of(call).rows);
  if ((asked & all) != asked)
    throw std::invalid_argument("sticks out of the image, which is " + std::to_string(all.width) +
                                " x " + std::to_string(all.height));
  return pixels_of(call)(asked);
}

/// One value of a gray image, three of a color image, of which OpenCV keeps blue first.
int mean(Call& call) {
  const cv::Mat part = call.has(0) ? part_of(call) : pixels_of(call);
  const cv::Scalar bgr = cv::mean(part);
  ResultTable table(call);
  if (part.channels() == 1)
    table.number("gray", bgr[0]);
  else
    table.number("red", bgr[2]).number("green", bgr[1]).number("blue", bgr[0]);
  return 1;
}

/// A copy: a part that shared its pixels would keep the whole image alive.
int crop(Call& call) {
  push_image(call.L, part_of(call).clone());
  return 1;
}

/// PNG alone, which loses nothing: what was saved is what was measured.
int save(Call& call) {
  const std::string name = call.text(0);
  if (!name.ends_with(".png"))
    throw std::invalid_argument("name: wants to end in .png, got " + name);
  const auto file = writable(call.context(), name);
  write_png(file, pixels_of(call));
  return call.result(file.string());
}

/// An option that may be a track: the fields beside the ellipse are not looked at.
std::optional<vision::Ellipse> ellipse_option(const Call& call, const char* name) {
  std::optional<vision::Ellipse> ellipse;
  if (call.push_option(name)) {
    const int table = lua_gettop(call.L);
    lua_getfield(call.L, table, "x_px");  // a track that was not measured has no place
    if (!lua_isnil(call.L, -1)) ellipse = ellipse_at(call.L, table, name);
    lua_settop(call.L, table);
  }
  lua_pop(call.L, 1);
  return ellipse;
}

/// The center's 2 x 2 block of the track's 5 x 5 covariance, which stands there row by row.
std::optional<Eigen::Matrix2d> covariance_of_track(const Call& call) {
  std::optional<Eigen::Matrix2d> made;
  if (call.push_option("track")) {
    lua_getfield(call.L, -1, "covariance");
    if (const auto numbers = to_numbers(call.L, -1); numbers && numbers->size() == 25)
      made = (Eigen::Matrix2d() << (*numbers)[0], (*numbers)[1], (*numbers)[5], (*numbers)[6])
                 .finished();
    lua_pop(call.L, 1);
  }
  lua_pop(call.L, 1);
  return made;
}

/// Past centers, px.
std::vector<Eigen::Vector2d> trail_option(const Call& call) {
  std::vector<Eigen::Vector2d> trail;
  if (call.push_option("trail")) {
    const int list = lua_gettop(call.L);
    for (lua_Integer i = 1; i <= static_cast<lua_Integer>(lua_rawlen(call.L, list)); ++i) {
      lua_rawgeti(call.L, list, i);
      const auto point = to_numbers(call.L, -1);
      if (!point || point->size() != 2)
        throw std::invalid_argument("trail: entry " + std::to_string(i) + ": wants {x, y} in px");
      trail.emplace_back((*point)[0], (*point)[1]);
      lua_settop(call.L, list);
    }
  }
  lua_pop(call.L, 1);
  return trail;
}

/// A new image: the frame itself stays as it was measured.
int overlay(Call& call) {
  vision::Overlay what;
  what.tracked = ellipse_option(call, "track");
  what.covariance_px2 = covariance_of_track(call);
  what.expected = ellipse_option(call, "expected");
  what.trail_px = trail_option(call);
  what.caption = call.text_option("caption").value_or("");
  push_image(call.L, vision::draw_overlay(pixels_of(call), what));
  return 1;
}

/// White where an ellipse is: a mask as if outlined by hand.
int ellipse_mask(Call& call) {
  const vision::Ellipse e = ellipse_at(call.L, call.index(0), "ellipse");
  cv::Mat mask = cv::Mat::zeros(pixels_of(call).size(), CV_8U);
  // cv::ellipse takes fixed-point coordinates: 8 bits are 1/256 px.
  constexpr int kBits = 8;
  constexpr double kOne = 1 << kBits;
  const auto fixed = [](double px) { return static_cast<int>(std::lround(px * kOne)); };
  cv::ellipse(mask, cv::Point(fixed(e.center_px.x()), fixed(e.center_px.y())),
              cv::Size(fixed(e.semi_major_px), fixed(e.semi_minor_px)), e.angle * 180 / M_PI, 0,
              360, cv::Scalar(255), cv::FILLED, cv::LINE_8, kBits);
  push_image(call.L, mask);
  return 1;
}

}  // namespace

std::vector<Binding> vision_image_rows() {
  const auto text = [](const char* name, const char* help) {
    return Argument{.name = name, .type = Type::text, .help = help};
  };
  return {{"vision.image",
           {options_of({text("file", "PNG, JPEG, TIFF or BMP"),
                        flag_option_row("mask", "as gray, 0 off the object; else 8-bit color")})},
           "image",
           "reads an image or a mask",
           read_image,
           "vision.image { file = \"frame.png\" }"},
          {"vision.images",
           {options_of({text("folder", "with images")})},
           {"list of tables",
            {{"file", "", "for vision.image"},
             {"name", "", "of the file"},
             {.name = "number", .help = "the last in the name", .optional = true}}},
           "the images in a folder without the masks, frame_2 before frame_10",
           list_images,
           "vision.images { folder = \"training\" }"},
          {"vision.training",
           {options_of({text("folder", "with images NAME.png and masks NAME_mask.png")})},
           {"list of tables", {{"image", "", ""}, {"mask", "", "image"}, {"name", "", ""}}},
           "reads every image that has a mask",
           training,
           "vision.training { folder = \"training\" }"},
          {"vision.video",
           {options_of({text("file", "a video")})},
           "video",
           "opens a video to be read frame by frame",
           open_video,
           "vision.video { file = \"recorded.avi\" }"}};
}

const Class& image_class() {
  const auto whole = [](const char* name, double min) {
    return Argument{.name = name, .type = Type::integer, .min = min, .max = 1e6};
  };
  const auto level = [](const char* name) {
    return ResultField{.name = name, .help = "0 to 255", .optional = true};
  };
  const Argument corners =
      options_of({whole("x", 0), whole("y", 0), whole("width", 1), whole("height", 1)});
  Argument part = corners;
  part.optional = true;
  const Returned color{"table", {level("gray"), level("red"), level("green"), level("blue")}};
  static const Class kind{
      "image",
      "a picture, 8-bit gray or color; the first pixel's center is at (0, 0), u right, v down",
      {{"info",
        {},
        {"table",
         {{"width_px", "", ""}, {"height_px", "", ""}, {"channels", "", "1: gray, 3: color"}}},
        "size and channels",
        image_info,
        "image:info()"},
       {"mean",
        {part},
        color,
        "mean gray, or red, green and blue, of the image or of a part, such as a pixel",
        mean,
        "image:mean { x = 10, y = 20, width = 1, height = 1 }"},
       {"crop",
        {corners},
        "image",
        "a part of it",
        crop,
        "image:crop { x = 10, y = 20, width = 64, height = 48 }"},
       {"save",
        {{.name = "name",
          .type = Type::text,
          .help = "a new file of the run's folder, such as \"first.png\""}},
        "path",
        "keeps it in the run's folder",
        save,
        "image:save(\"first.png\")"},
       {"ellipse_mask",
        {{.name = "ellipse",
          .type = Type::table,
          .help = "x_px, y_px, full axes major_px, minor_px, angle"}},
        "image",
        "a mask of this image's size, to train with: 255 where the ellipse is, else 0",
        ellipse_mask,
        "image:ellipse_mask { x_px = 50, y_px = 40, major_px = 30, minor_px = 20, angle = 0 }"},
       focus_row(),
       {"overlay",
        {options_of(
            {{.name = "track",
              .type = Type::table,
              .optional = true,
              .help = "as tracker:update gives it"},
             {.name = "expected",
              .type = Type::table,
              .optional = true,
              .help = "an ellipse, drawn dashed"},
             {.name = "trail", .type = Type::list, .optional = true, .help = "{{x, y}, ...}, px"},
             {.name = "caption", .type = Type::text, .optional = true}})},
        "image",
        "in color, with ellipse, axis, covariance (its 95 % ellipse, ten times as large), trail "
        "and words drawn",
        overlay,
        "image:overlay { track = track, caption = \"seen\" }"}}};
  return kind;
}

const Class& video_class() {
  static const Class kind{"video",
                          "a recorded video; make one with vision.video",
                          {{"read",
                            {},
                            Returned("image").or_nil("at the end"),
                            "the next frame",
                            video_read,
                            "video:read()"},
                           {"info",
                            {},
                            {"table",
                             {{.name = "frames",
                               .help = "how many the file claims to have, when it says",
                               .optional = true}}},
                            "number of frames",
                            video_info,
                            "video:info()"},
                           {.name = "close",
                            .doc = "closes the file",
                            .function = video_close,
                            .example = "video:close()",
                            .when_closed = true}}};
  return kind;
}

}  // namespace vitreo::lua
