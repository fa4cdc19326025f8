// Camera server: a GigE Vision camera in software, with real GVCP and GVSP on a network interface,
// that streams the images it is given.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <opencv2/core/mat.hpp>

#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace vitreo::genicam {

struct ServerSettings {
  /// Its address or the interface's name; one camera an address, for the port 3956 is fixed.
  std::string interface = "127.0.0.1";
  std::string serial = "VITREO01";
  int width_px = 640;       ///< at first; a client may ask for another, up to 2048
  int height_px = 480;      ///< likewise
  double lost_packets = 0;  ///< of all image packets, in [0, 1]: never sent
  void check() const;       ///< throws std::invalid_argument naming the setting
};

/// One image to be drawn, into a CV_8U matrix of the size that the client asked for.
struct Exposure {
  std::uint64_t number = 0;  ///< counts the exposures since the server was made
  double time = 0;           ///< s
};
using Draw = std::function<void(const Exposure&, cv::Mat& image)>;

/// Serves as long as the object exists; its destruction is that of an unplugged camera. `draw` is
/// called from a thread of its own. Throws DeviceError{refused} when the interface or its port 3956
/// is not to be had.
class CameraServer {
 public:
  virtual ~CameraServer() = default;
  /// How many images it has drawn.
  virtual std::uint64_t exposures() const = 0;
};
std::unique_ptr<CameraServer> serve_camera(const ServerSettings& settings, Draw draw);

}  // namespace vitreo::genicam
