// Binding of vision.mosaic: one picture from many views of a retina (thesis appendix A).
// SPDX-License-Identifier: Apache-2.0
#include "host/lua/interpreter/scheduler.h"
#include "host/lua/interpreter/tables.h"
#include "host/lua/interpreter/work.h"
#include "host/lua/vision/bind_vision.h"
#include "vision/mosaic.h"

namespace vitreo::lua {
namespace {

/// A registration of many large views takes minutes; one that takes more is taken for hung.
constexpr double kMaxTime = 600;  // s

/// What the task works on and fills: it lives until both it and the call are done.
struct Made {
  std::vector<cv::Mat> views;
  vision::MosaicSettings settings;
  vision::MosaicPlan plan;
  vision::Mosaic mosaic;
};

/// {a, b, u, c, d, v}: x' = a x + b y + u, y' = c x + d y + v.
void push_place(lua_State* L, const Eigen::Affine2d& place) {
  std::vector<double> numbers;
  for (int i = 0; i < 2; ++i)
    for (int j = 0; j < 3; ++j) numbers.push_back(place.matrix()(i, j));
  push_numbers(L, numbers);
}

/// A view that could not be joined keeps its entry, false: places are parallel to the views.
int push_made(const Call& call, const Made& made) {
  lua_State* const L = call.L;
  ResultTable table(call);
  table.number("rms_px", made.plan.rms_px)
      .number("worst_px", made.plan.worst_px)
      .number("sigma_px", made.plan.sigma_px)
      .number("joined", static_cast<double>(made.plan.joined()))
      .number("spare_links", static_cast<double>(made.plan.spare_links));
  push_image(L, made.mosaic.image);
  table.top("image");
  push_image(L, made.mosaic.cover);
  table.top("cover");
  lua_newtable(L);
  for (std::size_t i = 0; i < made.plan.mosaic_from_view.size(); ++i) {
    const auto& place = made.plan.mosaic_from_view[i];
    if (place)
      push_place(L, made.mosaic.image_from_mosaic * *place);
    else
      lua_pushboolean(L, 0);
    lua_rawseti(L, -2, static_cast<lua_Integer>(i + 1));
  }
  table.top("places");
  return 1;
}

/// Registration, then blending, on one task: the script waits, others go on.
int mosaic(Call& call) {
  auto made = std::make_shared<Made>();
  made->views = images_option(call);
  if (call.flag_option("affine")) made->settings.registration.model = vision::ViewModel::affine;
  if (const auto turn = call.number_option("max_rotation"))
    made->settings.registration.max_rotation = *turn;
  made->settings.check();
  return call.wait(work(
      call, "mosaic",
      [made] {
        made->plan = vision::plan_mosaic(made->views, made->settings);
        made->mosaic = vision::blend_mosaic(made->views, made->plan, made->settings);
      },
      from_seconds(kMaxTime), [made](Call& done) { return push_made(done, *made); }));
}

}  // namespace

std::vector<Binding> vision_mosaic_rows() {
  Argument turn = number_option_row("max_rotation", 0, 3.15, "between two views (30 deg)");
  turn.unit = "rad";
  return {
      {"vision.mosaic",
       {options_of(
           {{.name = "images", .type = Type::list, .help = "views, neighbors beside each other"},
            flag_option_row("affine", "scale and shear too: a tilted sensor"),
            turn})},
       {"table",
        {{"image", "", "the mosaic"},
         {"cover", "", "image: 255 where any view covers it, else 0"},
         {"rms_px", "", "of the registration"},
         {"worst_px", "", ""},
         {"sigma_px", "", ""},
         {"joined", "", "how many views"},
         {"spare_links", "", "more than the fewest that join them"},
         {"places", "", "{a, b, u, c, d, v} of each view into the image, or false"}}},
       "joins views to one picture",
       mosaic,
       "vision.mosaic { images = views }"}};
}

}  // namespace vitreo::lua
