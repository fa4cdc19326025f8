// Real cameras, videos and image sequences as a rig file describes them.
// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/driver.h"
#include "devices/instruments/genicam/pixels.h"
#include "devices/instruments/genicam/timing.h"
#include "devices/instruments/iidc/driver.h"
#include "devices/instruments/iidc/timing.h"
#include "devices/instruments/image_sequence/driver.h"
#include "devices/instruments/opencv_camera/driver.h"
#include "host/rig/drivers/drivers.h"
#include "host/rig/drivers/reopened.h"
#include "host/rig/drivers/serial.h"

namespace vitreo {
namespace {

/// The address without its scheme and colon.
std::string address_of(const InstrumentReader& instrument, const std::string& scheme) {
  const std::string head = scheme + ":";
  if (instrument.address.rfind(head, 0) != 0)
    instrument.reader.fail("address", "must begin with " + head);
  return instrument.address.substr(head.size());
}

// The same key and bounds as the model's pixel in rig_settings.cpp, which reads it first: camera
// and model agree on the scale.
double read_pixel(ConfigReader& reader, double fallback) {
  return reader.number("effective_pixel", fallback, {0.5e-6, 200e-6, "m"});
}

/// "Name = value": what stands before the first '=' is the feature's name; a command has no '='.
std::pair<std::string, std::string> feature_of(ConfigReader& reader, const std::string& text) {
  const auto trimmed = [](const std::string& part) {
    const auto first = part.find_first_not_of(' ');
    const auto last = part.find_last_not_of(' ');
    return first == std::string::npos ? "" : part.substr(first, last - first + 1);
  };
  const std::size_t at = text.find('=');
  const std::string name = trimmed(text.substr(0, at));
  if (name.empty()) reader.fail("features", "\"" + text + "\" does not begin with a name");
  return {name, at == std::string::npos ? "" : trimmed(text.substr(at + 1))};
}

/// Where on the sensor, in which format, when, and what else the camera can.
void read_genicam_extras(ConfigReader& reader, genicam::Settings& settings) {
  settings.offset_x_px = reader.integer("offset_x_px", settings.offset_x_px, 0, 1 << 16);
  settings.offset_y_px = reader.integer("offset_y_px", settings.offset_y_px, 0, 1 << 16);
  std::vector<std::string> formats;
  for (const genicam::PixelFormat& format : genicam::pixel_formats())
    formats.push_back(format.name);
  settings.pixel_format = reader.choice("pixel_format", settings.pixel_format, formats);
  settings.user_set = reader.text("user_set", settings.user_set);
  settings.trigger = reader.text("trigger", settings.trigger);
  settings.trigger_edge =
      reader.choice("trigger_edge", settings.trigger_edge, {"rising", "falling"});
  settings.trigger_delay = reader.number("trigger_delay", settings.trigger_delay, {0, 100, "s"});
  settings.exposure_output = reader.text("exposure_output", settings.exposure_output);
  for (const std::string& feature : reader.texts("features"))
    settings.features.push_back(feature_of(reader, feature));
  settings.device_clock =
      reader.choice("device_clock", settings.device_clock, {"latch", "arrivals", "none"});
  settings.stamps_the_end = reader.choice("stamps", "exposure_start",
                                          {"exposure_start", "exposure_end"}) == "exposure_end";
  settings.readout = reader.number("readout", settings.readout, {0, 10, "s"});
  settings.chunks = reader.choice("chunks", settings.chunks, {"auto", "on", "off"});
  settings.ptp = reader.flag("ptp", settings.ptp);
  settings.ptp_timeout = reader.number("ptp_timeout", settings.ptp_timeout, {0.1, 600, "s"});
}

}  // namespace

// A packet is a UDP datagram: 576 bytes pass everywhere, 9000 are a jumbo frame. A socket's buffer
// must hold what arrives while the thread is not running.
Opener<Camera> read_genicam(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  genicam::Settings settings;
  settings.name = instrument.role;
  settings.camera = address_of(instrument, "genicam");
  settings.width_px = reader.integer("width_px", settings.width_px, 1, 1 << 16);
  settings.height_px = reader.integer("height_px", settings.height_px, 1, 1 << 16);
  settings.frame_rate = reader.number("frame_rate", settings.frame_rate, {0.01, 1e4, "Hz"});
  settings.exposure = reader.number("exposure", settings.exposure, {1e-6, 100, "s"});
  settings.gain = reader.number("gain", settings.gain, {0, 1000, ""});
  settings.packet_size = reader.integer("packet_size", settings.packet_size, 576, 9000);
  settings.socket_buffer =
      reader.integer("socket_buffer", settings.socket_buffer, 1 << 12, 1 << 28);
  settings.effective_pixel = read_pixel(reader, settings.effective_pixel);
  read_genicam_extras(reader, settings);
  check_settings(instrument, settings);
  const double link_rate = reader.number("link_rate", 1e9, {1e6, 1e12, ""});  // bit/s
  instrument.links.loads.push_back({instrument.role, "an image",
                                    genicam::image_time(settings, link_rate), true,
                                    settings.frame_rate});
  return reopened<Camera>(instrument.role, [settings](const RigContext& where) {
    return genicam::open(settings, where.clock);
  });
}

/// "iidc:GUID", or "iidc:any" where there is only one camera.
Opener<Camera> read_iidc(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  iidc::Settings settings;
  settings.name = instrument.role;
  settings.guid = address_of(instrument, "iidc");
  if (settings.guid == "any") settings.guid.clear();
  settings.width_px = reader.integer("width_px", settings.width_px, 1, 1 << 14);
  settings.height_px = reader.integer("height_px", settings.height_px, 1, 1 << 14);
  settings.frame_rate = reader.number("frame_rate", settings.frame_rate, {0.01, 1e4, "Hz"});
  settings.exposure = reader.number("exposure", settings.exposure, {1e-6, 100, "s"});
  settings.shutter_unit = reader.number("shutter_unit", settings.shutter_unit, {0, 1, "s"});
  settings.gain = reader.number("gain", settings.gain, {0, 4095, ""});  // dB or counts
  settings.fast_bus = reader.flag("fast_bus", settings.fast_bus);
  settings.effective_pixel = read_pixel(reader, settings.effective_pixel);
  check_settings(instrument, settings);
  instrument.links.loads.push_back(
      {instrument.role, "an image", iidc::image_time(settings), true, settings.frame_rate});
  return reopened<Camera>(instrument.role, [settings](const RigContext& where) {
    return iidc::open(settings, where.clock);
  });
}

// `timing`: "camera" drops what is not grabbed in time, as a real camera does; "every_frame" waits
// for the program, for evaluations that must see each image. Not reopened: a folder that ends has
// ended.
Opener<Camera> read_image_sequence(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  image_sequence::Settings settings;
  settings.name = instrument.role;
  settings.folder = address_of(instrument, "images");
  settings.frame_rate = reader.number("frame_rate", settings.frame_rate, {0.01, 1e4, "Hz"});
  const std::string timing = reader.choice("timing", "camera", {"camera", "every_frame"});
  settings.every_frame = timing == "every_frame";
  instrument.links.loads.push_back({instrument.role, "an image", {}, true, settings.frame_rate});
  settings.repeat = reader.choice("at_the_end", "stop", {"stop", "repeat"}) == "repeat";
  settings.effective_pixel = read_pixel(reader, settings.effective_pixel);
  check_settings(instrument, settings);
  return [settings](const RigContext& where) {
    return Opened<Camera>{nullptr, image_sequence::open(settings, where.clock)};
  };
}

Opener<Camera> read_opencv_camera(const InstrumentReader& instrument) {
  ConfigReader& reader = instrument.reader;
  opencv_camera::Settings settings;
  settings.name = instrument.role;
  settings.source = address_of(instrument, "video");
  settings.width_px = reader.integer("width_px", 0, 0, 1 << 16);
  settings.height_px = reader.integer("height_px", 0, 0, 1 << 16);
  settings.frame_rate = reader.number("frame_rate", 0, {0, 1e4, "Hz"});
  settings.exposure = reader.number("exposure", 0, {0, 100, "s"});
  if (reader.has("gain")) settings.gain = reader.integer("gain", 0, 0, 1 << 16);
  settings.effective_pixel = read_pixel(reader, settings.effective_pixel);
  check_settings(instrument, settings);
  // Which format and bus the system's camera sends its images by is not known here.
  instrument.links.loads.push_back({instrument.role, "an image", {}, true, settings.frame_rate});
  const auto open = [settings](const RigContext& where) {
    return opencv_camera::open(settings, where.clock);
  };
  if (opencv_camera::is_node(settings.source)) return reopened<Camera>(instrument.role, open);
  return [open](const RigContext& where) {  // a video that is over does not begin again
    return Opened<Camera>{nullptr, open(where)};
  };
}

}  // namespace vitreo
