// Mask command: masks of an object for training, without a painting program.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <iosfwd>
#include <string>
#include <vector>

namespace vitreo {

struct MaskRequest {
  std::vector<std::string> images;
  std::vector<std::string> ellipses;  ///< "cx,cy,A,B,phi": full axes in px, degrees from +u to +v
  std::vector<std::string> polygons;  ///< "x,y,x,y,x,y..."
  std::vector<std::string> on;        ///< "x,y", surely on the object
  std::vector<std::string> off;       ///< "x,y", surely not
  std::string tip;       ///< "x,y": where its head ends in the first image; "": nowhere
  bool grab = false;     ///< the outline is rough: cut by color around it
  double margin_px = 6;  ///< how rough
  std::string out;  ///< folder for NAME.png, NAME_mask.png, overlays/NAME.png; "": beside the image
  bool force = false;  ///< write over masks that are there
};

/// The first image gets the outline; the object is learnt from it, found in the other images, and
/// cut there; with a tip, tips.csv (name, x_px, y_px) beside the masks has the tips of the images
/// in which it was recognized. Says a line an image. The number of images in which it was not
/// found. Throws std::invalid_argument naming the option or the file.
int make_masks(const MaskRequest& request, std::ostream& out);

}  // namespace vitreo
