// SPDX-License-Identifier: Apache-2.0
#include "devices/instruments/genicam/driver.h"

#include "devices/instruments/genicam/aravis.h"
#include "devices/instruments/genicam/chunks.h"
#include "devices/instruments/genicam/configuration.h"
#include "devices/instruments/genicam/features.h"
#include "devices/instruments/genicam/latch.h"
#include "devices/instruments/genicam/pixels.h"
#include "devices/time/device_clock.h"
#include "devices/time/error.h"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <utility>

namespace vitreo::genicam {
namespace {

using namespace std::chrono_literals;
/// Frames that wait between two grabs; when all are full, what waits is old.
constexpr int kBuffers = 16;
/// How long a stop may have to wait for a frame.
constexpr Time kSlice = 20ms;
/// After which a camera is lost: Aravis' own signal, control-lost, comes 5 s after a camera's
/// death.
constexpr Time kSilence = 450ms;
/// GigE Vision counts frames from 1 to this, and then from 1 again: 0 is for what has no number.
constexpr int kWrap = 65535;

/// Aravis receives on threads of its own, which know nothing of the clock's baton: they only push
/// full buffers, and the flag of a lost control.
class GenicamCamera final : public Camera {
 public:
  // Opening counts as hearing from it: the silence begins with the first frame that does not come.
  GenicamCamera(const Settings& settings, Clock& clock) : settings_(settings), clock_(clock) {
    clock_.outside([this] { start(); });
    heard_ = clock_.now();
  }
  GenicamCamera(const GenicamCamera&) = delete;
  GenicamCamera& operator=(const GenicamCamera&) = delete;
  ~GenicamCamera() override {
    clock_.outside([this] { stop(); });
  }

  const CameraInfo& info() const override { return info_; }
  CameraStatistics statistics() const override { return statistics_; }
  Frame grab(Time timeout) override;
  std::string feature(const std::string& name) override;
  std::string set_feature(const std::string& name, const std::string& value) override;

 private:
  void start();
  void open_stream();
  void stop();
  template <class Call>
  auto ask(const std::string& what, Call call);
  std::optional<Frame> newest(ArvBuffer* first);
  std::optional<Frame> take(ArvBuffer* buffer);
  Frame picture_of(ArvBuffer* buffer) const;
  void date(Frame& frame, ArvBuffer* buffer);
  void compare_clocks();
  void forget_foreign_clock(Time device, Time exposed);
  void count(std::uint64_t id);
  [[noreturn]] void fail(DeviceErrorKind kind, const std::string& what) const {
    throw DeviceError(kind, settings_.name, what);
  }
  static void on_control_lost(ArvDevice*, gpointer self) {
    static_cast<GenicamCamera*>(self)->control_lost_ = true;
  }

  const Settings settings_;
  Clock& clock_;
  CameraInfo info_;
  Object<ArvCamera> camera_;
  Object<ArvStream> stream_;
  std::optional<Features> features_;
  std::optional<Latch> latch_;
  std::optional<Chunks> chunks_;
  DeviceClock device_clock_;
  Time exposure_{};     // as the camera read it back last
  Time compared_at_{};  // when the clocks were compared last
  Time exposed_{};      // of the last frame
  std::atomic<bool> control_lost_{false};
  Time heard_{};               // when a buffer came last, whole or torn
  std::uint64_t last_id_ = 0;  // of the camera's
  std::uint64_t number_ = 0;
  CameraStatistics statistics_;
};

/// Calls Aravis; its error is thrown under the name of what was asked.
/// Aravis reports by a GError that the caller owns; with one the returned value means nothing.
template <class Call>
auto GenicamCamera::ask(const std::string& what, Call call) {
  GError* error = nullptr;
  if constexpr (std::is_void_v<decltype(call(&error))>) {
    call(&error);
    if (error != nullptr) fail(DeviceErrorKind::refused, what + ": " + text_and_free(error));
  } else {
    auto result = call(&error);
    if (error != nullptr) fail(DeviceErrorKind::refused, what + ": " + text_and_free(error));
    return result;
  }
}

/// Outside the baton: to find a camera by name asks all interfaces, which takes a second.
void GenicamCamera::start() {
  GError* error = nullptr;
  camera_.reset(
      arv_camera_new(settings_.camera.empty() ? nullptr : settings_.camera.c_str(), &error));
  if (!camera_)
    fail(DeviceErrorKind::not_found, "no camera '" + settings_.camera + "'" +
                                         (error != nullptr ? ": " + text_and_free(error) : ""));
  g_signal_connect(arv_camera_get_device(camera_.get()), "control-lost",
                   G_CALLBACK(on_control_lost), this);
  features_.emplace(camera_.get(), settings_.name);
  const Configuration configuration(camera_.get(), settings_, *features_);
  configuration.apply();
  chunks_.emplace(camera_.get(), *features_, settings_.chunks);
  info_ = configuration.read_back();
  exposure_ = from_seconds(configuration.exposure());
  latch_.emplace(camera_.get(), *features_);
  if (settings_.device_clock != "latch") latch_->give_up();
  open_stream();
}

// Buffers belong to the stream from here on and come back by popping; each holds one image of the
// payload that the camera states.
void GenicamCamera::open_stream() {
  ArvCamera* const c = camera_.get();
  // The packet socket, which Aravis takes where the process may (root, CAP_NET_RAW), is handed over
  // by the kernel in blocks, every 5 ms (tp_retire_blk_tov): each frame came late by up to that,
  // and dates by arrival with it. A datagram socket wakes its reader by each packet.
  if (arv_camera_is_gv_device(c) != FALSE)
    arv_camera_gv_set_stream_options(c, ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
  stream_.reset(
      ask("stream", [c](GError** e) { return arv_camera_create_stream(c, nullptr, nullptr, e); }));
  // "Controller privilege required": a second client may read registers, but gets no stream.
  if (!stream_) fail(DeviceErrorKind::refused, "no stream; does another program control it?");
  // With the buffer that the kernel chooses, a loaded machine lost nearly all frames (2.5 of 30 a
  // second); with a fixed one of 4 MiB none.
  if (ARV_IS_GV_STREAM(stream_.get()))
    g_object_set(stream_.get(), "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                 "socket-buffer-size", settings_.socket_buffer, nullptr);
  const unsigned payload = ask("payload", [c](GError** e) { return arv_camera_get_payload(c, e); });
  for (int i = 0; i < kBuffers; ++i)
    arv_stream_push_buffer(stream_.get(), arv_buffer_new(payload, nullptr));
  ask("start", [c](GError** e) { arv_camera_start_acquisition(c, e); });
}

/// Blocks for about 5 s when the camera answers no more; the error that follows is of no use.
void GenicamCamera::stop() {
  if (camera_) g_signal_handlers_disconnect_by_data(arv_camera_get_device(camera_.get()), this);
  if (camera_ && stream_ && !control_lost_) {
    GError* error = nullptr;
    arv_camera_stop_acquisition(camera_.get(), &error);
    if (error != nullptr) g_error_free(error);
  }
  stream_.reset();
  camera_.reset();
}

/// Frames are numbered by the exposure: the gap to the one before is what was lost. Ids of 16 bits
/// wrap from 65535 to 1; an id beyond that is of the extended mode of 64 bits, which does not.
void GenicamCamera::count(std::uint64_t id) {
  std::uint64_t step = 1;
  if (last_id_ != 0) {
    if (id > last_id_)
      step = id - last_id_;
    else if (last_id_ <= kWrap)
      step = id + kWrap - last_id_;  // wrapped round
    if (step == 0) step = 1;
  }
  last_id_ = id;
  number_ += step;
  statistics_.lost += step - 1;
}

/// The leader, the first packet of an image, bears its size: without it Aravis may call an image
/// whole that has none, and complains when it is asked for its size.
bool has_image(ArvBuffer* buffer) {
  if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS) return false;
  const ArvBufferPayloadType payload = arv_buffer_get_payload_type(buffer);
  const bool of_images = payload == ARV_BUFFER_PAYLOAD_TYPE_IMAGE ||
                         payload == ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA ||
                         payload == ARV_BUFFER_PAYLOAD_TYPE_MULTIPART;
  return of_images && arv_buffer_get_n_parts(buffer) > 0 &&
         arv_buffer_get_part_data_type(buffer, 0) == ARV_BUFFER_PART_DATA_TYPE_2D_IMAGE;
}

/// The frame in a buffer; nothing when packets of it are missing. The image is copied, for the
/// buffer goes back to the stream.
/// Torn frames are counted and heard as well: a network that loses packets is not a camera that is
/// gone.
std::optional<Frame> GenicamCamera::take(ArvBuffer* buffer) {
  heard_ = clock_.now();
  if (chunks_->on() && arv_buffer_get_payload_type(buffer) == ARV_BUFFER_PAYLOAD_TYPE_CHUNK_DATA)
    fail(DeviceErrorKind::refused,
         "its images come as chunk data, which do not tell their size: set chunks = \"off\"");
  count(arv_buffer_get_frame_id(buffer));
  if (!has_image(buffer)) {
    ++statistics_.torn;
    return std::nullopt;
  }
  Frame frame = picture_of(buffer);
  ++statistics_.delivered;
  frame.number = number_;
  frame.received = clock_.now();
  date(frame, buffer);
  return frame;
}

/// Its format is taken from the buffer: a camera may send another than it says.
Frame GenicamCamera::picture_of(ArvBuffer* buffer) const {
  const int width = arv_buffer_get_image_width(buffer);
  const int height = arv_buffer_get_image_height(buffer);
  const PixelFormat* const format = format_of(arv_buffer_get_image_pixel_format(buffer));
  std::size_t size = 0;
  const auto* const pixels = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &size));
  if (format == nullptr || format->name != settings_.pixel_format)
    fail(DeviceErrorKind::protocol, "an image of " +
                                        (format == nullptr ? "an unknown format" : format->name) +
                                        " came instead of " + settings_.pixel_format);
  if (width != info_.width_px || height != info_.height_px ||
      size < bytes_of(*format, width, height))
    fail(DeviceErrorKind::protocol, "an image of " + size_text(width, height) + " and " +
                                        std::to_string(size) + " bytes came");
  Frame frame;
  Pixels decoded = decode(*format, {pixels, size}, width, height);
  frame.image = std::move(decoded.image);
  frame.deep = std::move(decoded.deep);
  frame.bits = frame.deep.empty() ? 8 : format->bits;
  return frame;
}

/// When it was exposed. The buffer's system time stamp is the wall clock's at the arrival of the
/// first packet (ns); a wall clock that was set meanwhile cannot shift a frame by more than a
/// second.
void GenicamCamera::date(Frame& frame, ArvBuffer* buffer) {
  const std::uint64_t system = arv_buffer_get_system_timestamp(buffer);
  const std::uint64_t stamp = arv_buffer_get_timestamp(buffer);
  const std::int64_t age = g_get_real_time() * 1000 - static_cast<std::int64_t>(system);
  const Time arrived = frame.received - Time(std::clamp<std::int64_t>(age, 0, 1'000'000'000));
  const Time ended = arrived - from_seconds(settings_.readout);
  const Chunks::Said said = chunks_->read(buffer, stamp);
  const Time exposure = said.exposure.value_or(exposure_);
  frame.exposed = ended - exposure / 2;
  // Where Aravis does not know the clock's frequency it copies the host's stamp: no clock.
  if (stamp != 0 && stamp != system && settings_.device_clock != "none") {
    const Time stamped(static_cast<std::int64_t>(stamp));
    const Time begin = said.begin.value_or(settings_.stamps_the_end ? stamped - exposure : stamped);
    const Time end = begin + exposure;
    frame.device = begin + exposure / 2;
    forget_foreign_clock(*frame.device, frame.exposed);
    device_clock_.arrived(end, ended);
    frame.exposed = device_clock_.host_of(*frame.device).value_or(frame.exposed);
  }
  // While the first arrivals are learnt from, the map moves by as much as they jitter: times grow
  // all the same.
  constexpr Time kLeast = 1us;
  frame.exposed = std::min(std::max(frame.exposed, exposed_ + kLeast), frame.received);
  exposed_ = frame.exposed;
}

/// A latch that counts in another unit than its name says, or of another clock, would put the
/// frames seconds away from their arrival.
void GenicamCamera::forget_foreign_clock(Time device, Time exposed) {
  if (!device_clock_.is_compared()) return;
  if (std::chrono::abs(*device_clock_.host_of(device) - exposed) < 1s) return;
  latch_->give_up();
  device_clock_ = {};
}

/// Once a second, more often at first: by then a crystal has gone astray by a tenth of a
/// millisecond at worst.
void GenicamCamera::compare_clocks() {
  const Time now = clock_.now();
  const Time pause = device_clock_.is_compared() ? 1s : 0s;
  if (!latch_->usable() || now - compared_at_ < pause) return;
  compared_at_ = now;
  clock_.outside([this] { latch_->compare(clock_, device_clock_); });
}

std::string GenicamCamera::feature(const std::string& name) {
  std::string value;
  clock_.outside([&] { value = features_->value(name); });
  return value;
}

// A feature may change the exposure, which the times are made of.
std::string GenicamCamera::set_feature(const std::string& name, const std::string& value) {
  if (belongs_to_the_rig_file(name))
    fail(DeviceErrorKind::refused,
         "feature " + name + ": decides what an image is; set it in the rig file");
  std::string read;
  double exposed = 0;
  clock_.outside([&] {
    read = features_->set(name, value);
    exposed = Configuration(camera_.get(), settings_, *features_).exposure();
  });
  exposure_ = from_seconds(exposed);
  return read;
}

/// The newest whole frame of those that wait. When all buffers are full, the stream had none for
/// newer frames, and what waits is old: then nothing.
std::optional<Frame> GenicamCamera::newest(ArvBuffer* first) {
  std::optional<Frame> frame;
  int count = 0;
  for (ArvBuffer* buffer = first; buffer != nullptr;
       buffer = arv_stream_try_pop_buffer(stream_.get()), ++count) {
    std::optional<Frame> one;
    try {
      one = take(buffer);
    } catch (...) {
      arv_stream_push_buffer(stream_.get(), buffer);
      throw;
    }
    arv_stream_push_buffer(stream_.get(), buffer);
    if (one) frame = std::move(one);
  }
  return count >= kBuffers ? std::nullopt : frame;
}

// The wait is cut into slices of kSlice outside the baton, after each of which a stop can come
// through. Silence is measured on the clock, from the last buffer or from the call, whichever was
// later.
Frame GenicamCamera::grab(Time timeout) {
  const Time deadline = later(clock_.now(), timeout);
  const Time silence = std::max(kSilence, from_seconds(5 * info_.frame_period));
  // The time between two grabs is no silence of the camera's.
  Time listening = clock_.now();
  for (;;) {
    if (control_lost_) fail(DeviceErrorKind::lost, "the camera no longer answers");
    compare_clocks();
    ArvBuffer* buffer = nullptr;
    const Time slice = std::min(kSlice, deadline - clock_.now());
    clock_.outside([&] {
      buffer = arv_stream_timeout_pop_buffer(
          stream_.get(),
          static_cast<std::uint64_t>(std::max<std::int64_t>(0, slice.count() / 1000)));
    });
    if (auto frame = newest(buffer)) return *std::move(frame);
    listening = std::max(listening, heard_);
    if (settings_.trigger.empty() && clock_.now() - listening >= silence)
      fail(DeviceErrorKind::lost, "the camera has fallen silent");
    if (clock_.now() >= deadline) fail(DeviceErrorKind::timeout, "no frame in time");
    clock_.sleep_until(clock_.now());  // a stop comes through here
  }
}

}  // namespace

void Settings::check() const {
  const auto in = [](double value, double min, double max, const char* setting) {
    if (!(value >= min && value <= max))
      throw std::invalid_argument(std::string(setting) + ": must be in [" + std::to_string(min) +
                                  ", " + std::to_string(max) + "]");
  };
  if (name.empty()) throw std::invalid_argument("name: must not be empty");
  in(width_px, 1, 1 << 16, "width_px");
  in(height_px, 1, 1 << 16, "height_px");
  in(frame_rate, 0.01, 1e5, "frame_rate");
  in(exposure, 1e-6, 100, "exposure");
  in(gain, 0, 1e6, "gain");
  in(effective_pixel, 1e-9, 1, "effective_pixel");
  // From the datagram that every IPv4 host takes (RFC 791) to the usual jumbo frame.
  in(packet_size, 576, 9000, "packet_size");
  in(socket_buffer, 1 << 12, 1 << 28, "socket_buffer");
  in(offset_x_px, 0, 1 << 16, "offset_x_px");
  in(offset_y_px, 0, 1 << 16, "offset_y_px");
  in(trigger_delay, 0, 100, "trigger_delay");
  in(readout, 0, 10, "readout");
  if (format_of(pixel_format) == nullptr)
    throw std::invalid_argument("pixel_format: " + pixel_format + " is not known here");
  const bool odd = offset_x_px % 2 != 0 || offset_y_px % 2 != 0;
  if (odd && !format_of(pixel_format)->pattern.empty())
    throw std::invalid_argument("offset_x_px, offset_y_px: must be even, or the mosaic of " +
                                pixel_format + " is another");
  if (device_clock != "latch" && device_clock != "arrivals" && device_clock != "none")
    throw std::invalid_argument("device_clock: must be latch, arrivals or none");
  if (chunks != "auto" && chunks != "on" && chunks != "off")
    throw std::invalid_argument("chunks: must be auto, on or off");
  in(ptp_timeout, 0.1, 600, "ptp_timeout");
  if (trigger_edge != "rising" && trigger_edge != "falling")
    throw std::invalid_argument("trigger_edge: must be rising or falling");
}

std::unique_ptr<Camera> open(const Settings& settings, Clock& clock) {
  settings.check();
  return std::make_unique<GenicamCamera>(settings, clock);
}

// Asks every interface and waits for answers, which takes about a second.
std::vector<Found> list_cameras() {
  arv_update_device_list();
  std::vector<Found> found;
  const auto text = [](const char* said) { return std::string(said == nullptr ? "" : said); };
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    found.push_back({text(arv_get_device_id(i)), text(arv_get_device_vendor(i)),
                     text(arv_get_device_model(i)), text(arv_get_device_serial_nbr(i)),
                     text(arv_get_device_address(i)), text(arv_get_device_protocol(i))});
  return found;
}

}  // namespace vitreo::genicam
