// Face of a run: what shows it and steers it from outside, such as a page or a control socket.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace vitreo {

class Session;

/// Made before the run and outliving it. The engine uses a face by this interface alone.
class Face {
 public:
  virtual ~Face() = default;
  /// The session may be shown and steered (Session::desk) from now on. What cannot be offered is an
  /// event of the record, not an exception.
  virtual void begin(Session& session) = 0;
  /// The session is not touched after this. `outcome`: "stopped: by the operator".
  virtual void end(const std::string& outcome) = 0;
};

}  // namespace vitreo
