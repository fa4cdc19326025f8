// Chunk data of a GenICam camera: what it says of each frame beside the image.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "devices/instruments/genicam/aravis.h"
#include "devices/instruments/genicam/features.h"
#include "devices/time/clock.h"

#include <optional>
#include <string>
#include <vector>

namespace vitreo::genicam {

class Chunks {
 public:
  /// Before the stream's buffers are made, for the payload grows. `wanted`: "on" (a camera that has
  /// none is refused), "off", or "auto": of USB3 Vision, and of GigE Vision from version 2 on,
  /// where an image keeps its size in the leader. Outside the baton.
  Chunks(ArvCamera* camera, const Features& features, const std::string& wanted);
  bool on() const { return parser_ != nullptr; }

  /// Nothing of what the camera does not say, or says in no unit that is known here.
  struct Said {
    std::optional<Time> begin;     ///< of the exposure, by the camera's clock (SFNC ChunkTimestamp)
    std::optional<Time> exposure;  ///< of this frame
  };
  /// `leader`: the frame's stamp in its leader, ns.
  Said read(ArvBuffer* buffer, std::uint64_t leader);

 private:
  std::optional<Time> begin(ArvBuffer* buffer, std::uint64_t leader);
  std::optional<Time> exposure(ArvBuffer* buffer);

  Object<ArvChunkParser> parser_;
  bool says_begin_ = false;
  bool says_exposure_ = false;
  std::vector<double> units_;  // ns, that its stamps may have
};

}  // namespace vitreo::genicam
