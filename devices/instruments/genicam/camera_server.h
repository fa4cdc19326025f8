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
  double age = 0;            ///< s: how long ago it was; 0 but for ServerFaults::late
};
using Draw = std::function<void(const Exposure&, cv::Mat& image)>;

/// Faults of the camera and of its line.
struct ServerFaults {
  bool silent = false;      ///< it hangs: no image, no answer
  bool frozen = false;      ///< the last image again and again, under new numbers
  double late = 0;          ///< s: how old an image is when it is sent, at most 0.9
  int drops = 0;            ///< each n-th image is never sent; 0: all are
  int torn = 0;             ///< of each n-th a fifth of the packets is never sent
  double lost_packets = 0;  ///< of the packets of all images, in [0, 1]: never sent
  void check() const;       ///< throws std::invalid_argument naming the fault
};

/// Serves as long as the object exists; its destruction is that of an unplugged camera. `draw` is
/// called from a thread of its own. Throws DeviceError{refused} when the interface or its port 3956
/// is not to be had.
class CameraServer {
 public:
  virtual ~CameraServer() = default;
  /// How many images it has drawn.
  virtual std::uint64_t exposures() const = 0;
  /// From the next image on. Any thread. Throws as ServerFaults::check().
  virtual void set_faults(const ServerFaults& faults) = 0;
};
std::unique_ptr<CameraServer> serve_camera(const ServerSettings& settings, Draw draw);

}  // namespace vitreo::genicam
