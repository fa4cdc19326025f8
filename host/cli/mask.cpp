// Command `vitreo mask`: its words; the work is mask_command.h's.
// SPDX-License-Identifier: Apache-2.0
#include "host/cli/command_line.h"
#include "host/cli/mask_command.h"
#include "host/cli/program.h"

#include <iostream>
#include <stdexcept>

namespace vitreo::cli {
namespace {

int mask(const MaskRequest& request) {
  try {
    return make_masks(request, std::cout) == 0 ? 0 : 1;
  } catch (const std::invalid_argument& error) {
    // All of them name an option or a file of the user's.
    throw ConfigError(std::string("mask: ") + error.what());
  }
}

}  // namespace

void add_mask(CommandLine& line, Program&) {
  const auto request = std::make_shared<MaskRequest>();
  Command command = line.command("mask",
                                 "masks of an object, to train a tracker with: NAME_mask.png, and "
                                 "overlays/NAME.png to look at. The outline is\n"
                                 "the object's in the first image; it is looked for in the others.",
                                 [request] { return mask(*request); });
  command.option("images", request->images, "of one size").required();
  command
      .option("--ellipse", request->ellipses,
              "cx,cy,A,B,phi: full axes in px, degrees from right to down")
      .one_word_each();
  command.option("--polygon", request->polygons, "x,y,x,y,x,y...: its corners").one_word_each();
  command.flag("--grab", request->grab, "the outline is rough: cut by color around it");
  command.option("--on", request->on, "x,y: surely on the object (with --grab)").one_word_each();
  command.option("--off", request->off, "x,y: surely not on it (with --grab)").one_word_each();
  command.option("--tip", request->tip,
                 "x,y: where its head ends in the first image; tips.csv gets those of the others");
  command.option("--margin", request->margin_px, "px by which a rough outline may be wrong (6)");
  command.option("--out", request->out,
                 "folder; the images are copied there too, as a training folder");
  command.flag("--force", request->force, "write over masks that are there");
  command.examples({"vitreo mask frames/*.png --ellipse 320,240,60,30,15 --grab --out training"});
}

}  // namespace vitreo::cli
