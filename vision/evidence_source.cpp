// SPDX-License-Identifier: Apache-2.0
#include "vision/evidence_source.h"

namespace vitreo::vision {

void ColorEvidence::read(const cv::Mat& image, int v, int u, int step, int count,
                         std::int8_t* to) const {
  const std::int8_t* table = model_->table().data();
  const unsigned char* from = image.ptr<unsigned char>(v) + 3 * static_cast<std::ptrdiff_t>(u);
  for (int k = 0; k < count; ++k, from += 3 * static_cast<std::ptrdiff_t>(step))
    to[k] = table[light_.cell_of(from[0], from[1], from[2])];
}

}  // namespace vitreo::vision
