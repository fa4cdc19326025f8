// The testbed by umockdev. The only file that implements the kernel's side of usbfs and hidraw.
// SPDX-License-Identifier: Apache-2.0
#include "devices/testbed/usb_testbed.h"

#include "devices/time/error.h"

#ifndef VITREO_HAVE_UMOCKDEV

namespace vitreo {

std::string why_no_usb_testbed() { return "this program was built without umockdev"; }
std::unique_ptr<UsbTestbed> make_usb_testbed() {
  throw DeviceError(DeviceErrorKind::not_found, "testbed", why_no_usb_testbed());
}

}  // namespace vitreo

#else

#include "devices/testbed/fair_mutex.h"
#include "devices/testbed/pty_node.h"
#include "devices/testbed/timetable.h"
#include "devices/testbed/usb_descriptors.h"

#include <algorithm>
#include <cstring>
#include <deque>
#include <errno.h>
#include <filesystem>
#include <linux/hidraw.h>
#include <linux/input.h>
#include <linux/usbdevice_fs.h>
#include <map>
#include <mutex>
#include <sys/ioctl.h>
#include <time.h>
#include <umockdev.h>
#include <utility>
#include <vector>

namespace vitreo {
namespace {

namespace fs = std::filesystem;
using Bytes = std::vector<std::uint8_t>;
using Data = std::unique_ptr<UMockdevIoctlData, decltype(&g_object_unref)>;

/// The memory that a pointer in the client's structure refers to, copied from the client and, when
/// the request is completed, back to it.
Data resolve(UMockdevIoctlData* from, std::size_t offset, std::size_t size) {
  return {umockdev_ioctl_data_resolve(from, offset, size, nullptr), g_object_unref};
}

/// Completes a request with the result of the system call; true means handled.
/// Negative results come with an errno, as from the kernel.
gboolean done(UMockdevIoctlClient* client, long result, int error = 0) {
  umockdev_ioctl_client_complete(client, result, error);
  return TRUE;
}

/// One device that is plugged in. Its handlers run on the testbed's thread, what waited for a frame
/// on the timetable's, both under the testbed's lock, which is not held while a frame is awaited.
class Plugged {
 public:
  Plugged(Timetable& timetable, std::string node, std::string sysfs)
      : timetable_(timetable),
        mutex_(timetable.mutex()),
        node_(std::move(node)),
        sysfs_(std::move(sysfs)),
        handler_(umockdev_ioctl_base_new()) {
    g_signal_connect(handler_, "handle-ioctl", G_CALLBACK(on_ioctl), this);
    g_signal_connect(handler_, "handle-read", G_CALLBACK(on_read), this);
    g_signal_connect(handler_, "handle-write", G_CALLBACK(on_write), this);
  }
  Plugged(const Plugged&) = delete;
  Plugged& operator=(const Plugged&) = delete;
  virtual ~Plugged() {
    g_signal_handlers_disconnect_by_data(handler_, this);
    g_object_unref(handler_);
  }
  /// Announces it: the handler before the device, or a fast client would find a node without an
  /// answer.
  void add(UMockdevTestbed* testbed, const std::string& description) {
    umockdev_testbed_attach_ioctl(testbed, node_.c_str(), handler_, nullptr);
    GError* error = nullptr;
    if (umockdev_testbed_add_from_string(testbed, description.c_str(), &error) == FALSE) {
      const std::string why = error->message;
      g_error_free(error);
      throw DeviceError(DeviceErrorKind::refused, "testbed", why);
    }
  }
  /// As an unplugged cable: a hang-up for clients that poll, then the uevent, then the files.
  virtual void remove(UMockdevTestbed* testbed) {
    {
      const std::lock_guard lock(mutex_);
      gone_ = true;
      timetable_.forget(this);
      hang_up();
      pty_.close_far_end();
    }
    umockdev_testbed_uevent(testbed, sysfs_.c_str(), "remove");
    umockdev_testbed_remove_device(testbed, sysfs_.c_str());
    umockdev_testbed_detach_ioctl(testbed, node_.c_str(), nullptr);
  }
  virtual void set_fault(UsbFault fault) { fault_ = fault; }
  void set_latency(Time latency) { latency_ = latency; }
  // The node's link leads to it, for clients that poll; no data of the device goes through it.
  const PtyNode& pty() const { return pty_; }

 protected:
  virtual gboolean ioctl(UMockdevIoctlClient* client, unsigned long request,
                         UMockdevIoctlData* arg) = 0;
  virtual gboolean read(UMockdevIoctlClient*, UMockdevIoctlData*) { return FALSE; }
  /// Ends the calls of those who wait: the device has gone.
  virtual void hang_up() {}
  virtual gboolean write(UMockdevIoctlClient*, UMockdevIoctlData*) { return FALSE; }

  /// `work` with the next frame of an endpoint, at once where its transfers take no time.
  void with_frame(UsbFrames& endpoint, const std::function<void()>& work) {
    const Time now = timetable_.now();
    const Time due = later(endpoint.next(now), latency_);
    if (due <= now)
      work();
    else
      timetable_.add(due, this, work);
  }

  Timetable& timetable_;
  FairMutex& mutex_;
  Time latency_{};  // beyond the frame
  const std::string node_;
  const std::string sysfs_;
  PtyNode pty_;  // for poll()
  bool gone_ = false;
  UsbFault fault_ = UsbFault::none;

 private:
  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Plugged*>(self)->serve(client, [&](Plugged& me) {
      return me.ioctl(client, umockdev_ioctl_client_get_request(client),
                      umockdev_ioctl_client_get_arg(client));
    });
  }
  static gboolean on_read(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Plugged*>(self)->serve(client, [&](Plugged& me) {
      return me.read(client, umockdev_ioctl_client_get_arg(client));
    });
  }
  static gboolean on_write(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer self) {
    return static_cast<Plugged*>(self)->serve(client, [&](Plugged& me) {
      return me.write(client, umockdev_ioctl_client_get_arg(client));
    });
  }
  /// Every request under the testbed's lock. ENODEV once it is unplugged.
  template <class Work>
  gboolean serve(UMockdevIoctlClient* client, Work work) {
    const std::lock_guard lock(mutex_);
    if (gone_) return done(client, -1, ENODEV);
    return work(*this);
  }

  UMockdevIoctlBase* const handler_;
};

/// usbfs: control and bulk transfers come as URBs (USB request blocks) that are submitted and later
/// reaped (linux/usbdevice_fs.h).
class PluggedUsb final : public Plugged {
 public:
  PluggedUsb(Timetable& timetable, const std::string& node, const std::string& sysfs, UsbPeer& peer,
             Time interval)
      : Plugged(timetable, node, sysfs), peer_(peer), frames_(interval) {
    pty_.block_output();  // libusb takes a writable node for a URB that can be reaped
  }

 private:
  gboolean ioctl(UMockdevIoctlClient* client, unsigned long request,
                 UMockdevIoctlData* arg) override {
    switch (request) {
      case USBDEVFS_GET_CAPABILITIES: {
        const Data capabilities = resolve(arg, 0, sizeof(std::uint32_t));
        const std::uint32_t none = 0;
        std::memcpy(capabilities->data, &none, sizeof none);
        return done(client, 0);
      }
      case USBDEVFS_GETDRIVER:
      case USBDEVFS_IOCTL:
      case USBDEVFS_DISCONNECT:
        return done(client, -1, ENODATA);  // no kernel driver holds it
      case USBDEVFS_SUBMITURB:
        return submit(client, arg);
      case USBDEVFS_REAPURB:
      case USBDEVFS_REAPURBNDELAY:
        return collect(client, arg);
      case USBDEVFS_DISCARDURB:
        return discard(client, arg);
      case USBDEVFS_CLEAR_HALT: {
        // The kernel sends CLEAR_FEATURE(ENDPOINT_HALT): USB 2.0, 9.4.1.
        std::uint32_t endpoint = 0;
        std::memcpy(&endpoint, resolve(arg, 0, sizeof endpoint)->data, sizeof endpoint);
        peer_.control({0x02, 1, 0, static_cast<std::uint16_t>(endpoint)}, {}, 0);
        return done(client, 0);
      }
      default:  // claims, releases, resets
        return done(client, 0);
    }
  }

  /// Done with its frame, but for a silent device. The buffer begins with the eight bytes of the
  /// setup; it is copied from the client while that waits for this request.
  gboolean submit(UMockdevIoctlClient* client, UMockdevIoctlData* arg) {
    Data urb_data = resolve(arg, 0, sizeof(usbdevfs_urb));
    auto* urb = reinterpret_cast<usbdevfs_urb*>(urb_data->data);
    const int length = urb->buffer_length;
    Data buffer =
        resolve(urb_data.get(), offsetof(usbdevfs_urb, buffer), static_cast<std::size_t>(length));
    const bool control = urb->type == USBDEVFS_URB_TYPE_CONTROL && length >= 8;
    const bool bulk = urb->type == USBDEVFS_URB_TYPE_BULK && peer_.bulk() != nullptr;
    if (!control && !bulk) return done(client, -1, EINVAL);
    const unsigned long address = urb_data->client_addr;
    pending_.push_back({std::move(urb_data), std::move(buffer)});
    if (fault_ != UsbFault::silent) with_frame(frames_, [this, address] { complete(address); });
    return done(client, 0);
  }

  /// The transfer of a URB that was not taken back meanwhile.
  void complete(unsigned long address) {
    const auto one = find_pending(address);
    if (one == pending_.end() || fault_ == UsbFault::silent) return;
    auto& urb = *reinterpret_cast<usbdevfs_urb*>(one->urb->data);
    if (urb.type == USBDEVFS_URB_TYPE_CONTROL)
      transfer(urb, one->buffer->data);
    else if (!move_bulk(urb, one->buffer->data))
      return;  // it stays pending, until the device has something
    finish(std::move(one->urb));
    pending_.erase(one);
    give_to_pending();
  }

  /// Whether the URB is over: on the way in that wants something that the device has to give.
  bool move_bulk(usbdevfs_urb& urb, std::uint8_t* bytes) {
    const auto size = static_cast<std::size_t>(urb.buffer_length);
    urb.status = 0;
    urb.actual_length = 0;
    if ((urb.endpoint & 0x80) == 0) {
      if (!peer_.bulk()->take({bytes, size})) urb.status = -EPIPE;
      urb.actual_length = urb.status == 0 ? urb.buffer_length : 0;
      return true;
    }
    const auto given = peer_.bulk()->give();
    if (!given) return false;
    urb.status = given->size() > size ? -EOVERFLOW : 0;
    urb.actual_length = static_cast<int>(std::min(given->size(), size));
    std::copy_n(given->begin(), urb.actual_length, bytes);
    return true;
  }
  /// What came before may have given the device something to say.
  void give_to_pending() {
    for (const Pending& one : pending_) {
      const auto& urb = *reinterpret_cast<const usbdevfs_urb*>(one.urb->data);
      if (urb.type == USBDEVFS_URB_TYPE_BULK && (urb.endpoint & 0x80) != 0)
        return with_frame(frames_, [this, address = one.urb->client_addr] { complete(address); });
    }
  }

  /// USB 2.0, table 9-2: type, request, value, index, length. A stall is the status -EPIPE.
  /// The request's own length bounds the answer, and the client's buffer bounds both.
  void transfer(usbdevfs_urb& urb, std::uint8_t* bytes) {
    const auto word = [bytes](int at) {
      return static_cast<std::uint16_t>(bytes[at] | bytes[at + 1] << 8);
    };
    const UsbSetup setup{bytes[0], bytes[1], word(2), word(4)};
    const auto length = static_cast<std::uint16_t>(std::min<int>(word(6), urb.buffer_length - 8));
    const bool in = (setup.type & 0x80) != 0;
    const auto standard = standard_answer(peer_.identity(), setup, peer_.bulk() != nullptr);
    auto answer =
        standard ? standard
                 : peer_.control(setup, {bytes + 8, in ? std::size_t{0} : length}, in ? length : 0);
    urb.status = answer ? 0 : -EPIPE;
    urb.actual_length = 0;
    if (!answer) return;
    if (!in) {
      urb.actual_length = length;
      return;
    }
    urb.actual_length = static_cast<int>(std::min<std::size_t>(answer->size(), length));
    std::copy_n(answer->begin(), urb.actual_length, bytes + 8);
  }

  // Output that is allowed makes the node writable, which is how libusb learns of a URB to be
  // reaped.
  void finish(Data urb) {
    finished_.push_back(std::move(urb));
    pty_.allow_output();
  }

  /// The oldest finished URB; none blocks the node's output again.
  gboolean collect(UMockdevIoctlClient* client, UMockdevIoctlData* arg) {
    if (finished_.empty()) {
      pty_.block_output();
      return done(client, -1, EAGAIN);
    }
    const Data pointer = resolve(arg, 0, sizeof(void*));
    const Data urb = std::move(finished_.front());
    finished_.pop_front();
    umockdev_ioctl_data_set_ptr(pointer.get(), 0, urb.get());
    return done(client, 0);
  }

  /// A transfer at its deadline: libusb takes it back, and then reaps it with -ENOENT.
  gboolean discard(UMockdevIoctlClient* client, UMockdevIoctlData* arg) {
    unsigned long address = 0;
    std::memcpy(&address, arg->data, sizeof address);
    const auto one = find_pending(address);
    if (one == pending_.end()) return done(client, -1, EINVAL);
    reinterpret_cast<usbdevfs_urb*>(one->urb->data)->status = -ENOENT;
    finish(std::move(one->urb));
    pending_.erase(one);
    return done(client, 0);
  }

  struct Pending {
    Data urb;
    Data buffer;
  };
  std::deque<Pending>::iterator find_pending(unsigned long address) {
    return std::find_if(pending_.begin(), pending_.end(),
                        [address](const Pending& one) { return one.urb->client_addr == address; });
  }

  UsbPeer& peer_;
  UsbFrames frames_;
  std::deque<Pending> pending_;
  std::deque<Data> finished_;
};

/// hidraw: reports are written and read whole; one byte waits in the pty for each report that can
/// be read.
class PluggedHid final : public Plugged {
 public:
  PluggedHid(Timetable& timetable, const std::string& node, const std::string& sysfs, HidPeer& peer,
             Bytes descriptor, Time interval)
      : Plugged(timetable, node, sysfs),
        peer_(peer),
        descriptor_(std::move(descriptor)),
        out_(interval),
        in_(interval) {
    peer_.connect([this](Bytes report) { put(std::move(report)); });
  }
  ~PluggedHid() override {
    peer_.connect(nullptr);
    hang_up();
  }
  // Writers that were stuck get EIO: the kernel's own end of such a write.
  void set_fault(UsbFault fault) override {
    const bool ends = fault_ == UsbFault::stuck && fault != UsbFault::stuck;
    Plugged::set_fault(fault);
    if (ends) release_all(EIO);
  }

 private:
  gboolean ioctl(UMockdevIoctlClient* client, unsigned long request,
                 UMockdevIoctlData* arg) override {
    if (request == HIDIOCGRDESCSIZE) {
      const Data size = resolve(arg, 0, sizeof(int));
      const int bytes = static_cast<int>(descriptor_.size());
      std::memcpy(size->data, &bytes, sizeof bytes);
      return done(client, 0);
    }
    if (request == HIDIOCGRDESC) {
      const Data all = resolve(arg, 0, sizeof(hidraw_report_descriptor));
      std::memcpy(all->data + offsetof(hidraw_report_descriptor, value), descriptor_.data(),
                  descriptor_.size());
      return done(client, 0);
    }
    return done(client, -1, ENOTTY);
  }

  /// Not completed here: the writer waits for its frame. One whose report does not get through
  /// waits for release_all().
  gboolean write(UMockdevIoctlClient* client, UMockdevIoctlData* arg) override {
    writers_.push_back(
        {UMOCKDEV_IOCTL_CLIENT(g_object_ref(client)), Bytes(arg->data, arg->data + arg->data_len)});
    if (fault_ != UsbFault::stuck) with_frame(out_, [this, client] { take(client); });
    return TRUE;
  }

  /// The report of a writer whose frame has come. A client has one system call at a time.
  void take(UMockdevIoctlClient* client) {
    const auto writer = std::find_if(writers_.begin(), writers_.end(),
                                     [client](const Writer& one) { return one.client == client; });
    if (writer == writers_.end() || fault_ == UsbFault::stuck) return;
    const Writer own = std::move(*writer);
    writers_.erase(writer);
    if (fault_ == UsbFault::none)
      for (Bytes& reply : peer_.receive(own.report)) put(std::move(reply));
    release(own, static_cast<long>(own.report.size()));
  }

  /// One report a read, cut to the reader's buffer, and its byte out of the pty.
  gboolean read(UMockdevIoctlClient* client, UMockdevIoctlData* arg) override {
    if (reports_.empty()) return done(client, -1, EAGAIN);
    const Bytes report = std::move(reports_.front());
    reports_.pop_front();
    pty_.take_byte();
    const auto size = std::min<std::size_t>(report.size(), static_cast<std::size_t>(arg->data_len));
    Bytes all(arg->data, arg->data + arg->data_len);
    std::copy_n(report.begin(), size, all.begin());
    umockdev_ioctl_data_update(arg, 0, all.data(), static_cast<int>(size));
    return done(client, static_cast<long>(size));
  }

  // Called under the testbed's lock: by a request's handler, by the timetable, or in
  // with_emulators().
  void put(Bytes report) {
    with_frame(in_, [this, report = std::move(report)] {
      if (fault_ == UsbFault::silent || gone_) return;
      reports_.push_back(report);
      pty_.put_byte();
    });
  }

  /// Someone in a write() that has not returned.
  struct Writer {
    UMockdevIoctlClient* client;
    Bytes report;
  };
  static void release(const Writer& writer, long result, int error = 0) {
    umockdev_ioctl_client_complete(writer.client, result, error);
    g_object_unref(writer.client);
  }
  void release_all(int error) {
    for (const Writer& writer : std::exchange(writers_, {})) release(writer, -1, error);
  }
  void hang_up() override { release_all(ENODEV); }

  HidPeer& peer_;
  const Bytes descriptor_;
  UsbFrames out_;
  UsbFrames in_;
  std::vector<Writer> writers_;
  std::deque<Bytes> reports_;
};

/// evdev: what a program asks of the device (linux/input.h), and its events; one byte waits in the
/// pty for each piece of events that can be read.
class PluggedInput final : public Plugged {
 public:
  PluggedInput(Timetable& timetable, const std::string& node, const std::string& sysfs,
               InputNode input)
      : Plugged(timetable, node, sysfs), input_(std::move(input)) {}
  void change(InputNode input, const std::vector<InputEvent>& events) {
    input_ = std::move(input);
    timespec now{};
    ::clock_gettime(CLOCK_MONOTONIC, &now);
    Bytes piece;
    for (const InputEvent& one : events) {
      input_event event{};
      event.input_event_sec = now.tv_sec;
      event.input_event_usec = now.tv_nsec / 1000;
      event.type = static_cast<std::uint16_t>(one.type);
      event.code = static_cast<std::uint16_t>(one.code);
      event.value = one.value;
      const auto* const bytes = reinterpret_cast<const std::uint8_t*>(&event);
      piece.insert(piece.end(), bytes, bytes + sizeof event);
    }
    pieces_.push_back(std::move(piece));
    pty_.put_byte();
  }

 private:
  gboolean ioctl(UMockdevIoctlClient* client, unsigned long request,
                 UMockdevIoctlData* arg) override {
    constexpr unsigned kBits = 0x20, kAbs = 0x40, kGrab = 0x90;
    const unsigned number = _IOC_NR(request);
    if (_IOC_TYPE(request) != 'E') return done(client, -1, ENOTTY);
    if (number == kGrab) {
      if (grabbed_ && arg != nullptr && arg->client_addr != 0) return done(client, -1, EBUSY);
      grabbed_ = true;  // released by the closing of the node, which is not told here
      return done(client, 0);
    }
    if ((_IOC_DIR(request) & _IOC_READ) == 0) return done(client, 0);  // the clock of the stamps
    Bytes answer(_IOC_SIZE(request));
    const auto put = [&answer](const auto& value) {
      std::memcpy(answer.data(), &value, std::min(answer.size(), sizeof value));
    };
    if (request == EVIOCGVERSION) put(EV_VERSION);
    if (request == EVIOCGID) put(input_id{BUS_USB, input_.vendor, input_.product, 1});
    if (number == _IOC_NR(EVIOCGNAME(0))) put_text(answer, input_.name);
    if (number == _IOC_NR(EVIOCGUNIQ(0))) put_text(answer, input_.serial);
    if (number == _IOC_NR(EVIOCGKEY(0))) put_bits(answer, input_.held);
    if (number == kBits) put_bits(answer, {EV_SYN, EV_KEY, EV_ABS});
    if (number == kBits + EV_KEY) put_bits(answer, input_.keys);
    for (const InputNode::Axis& axis : input_.axes) {
      if (number == kBits + EV_ABS) put_bits(answer, {axis.code});
      if (number == kAbs + static_cast<unsigned>(axis.code))
        put(input_absinfo{axis.value, axis.minimum, axis.maximum, 0, axis.flat, 0});
    }
    const Data all = resolve(arg, 0, answer.size());
    std::copy(answer.begin(), answer.end(), all->data);
    return done(client, static_cast<long>(answer.size()));
  }
  static void put_text(Bytes& answer, const std::string& text) {
    std::copy_n(text.begin(), std::min(text.size(), answer.size()), answer.begin());
  }
  static void put_bits(Bytes& answer, const std::vector<int>& bits) {
    for (const int bit : bits)
      if (const auto at = static_cast<std::size_t>(bit / 8); at < answer.size())
        answer[at] = static_cast<std::uint8_t>(answer[at] | 1 << bit % 8);
  }

  gboolean read(UMockdevIoctlClient* client, UMockdevIoctlData* arg) override {
    if (pieces_.empty()) return done(client, -1, EAGAIN);
    Bytes all(arg->data, arg->data + arg->data_len);
    const Bytes piece = std::move(pieces_.front());
    pieces_.pop_front();
    pty_.take_byte();
    const std::size_t size = std::min(piece.size(), all.size());
    std::copy_n(piece.begin(), size, all.begin());
    umockdev_ioctl_data_update(arg, 0, all.data(), static_cast<int>(size));
    return done(client, static_cast<long>(size));
  }

  InputNode input_;
  bool grabbed_ = false;
  std::deque<Bytes> pieces_;
};

/// A node that is a link to a real terminal: the client itself executes its ioctls on it. (Without
/// a handler umockdev answers ioctls on a node of the testbed itself, and wrongly.)
class TerminalNode {
 public:
  TerminalNode(UMockdevTestbed* testbed, std::string node)
      : testbed_(testbed), node_(std::move(node)), handler_(umockdev_ioctl_base_new()) {
    g_signal_connect(handler_, "handle-ioctl", G_CALLBACK(on_ioctl), nullptr);
    umockdev_testbed_attach_ioctl(testbed_, node_.c_str(), handler_, nullptr);
  }
  ~TerminalNode() {
    umockdev_testbed_detach_ioctl(testbed_, node_.c_str(), nullptr);
    g_object_unref(handler_);
  }
  TerminalNode(const TerminalNode&) = delete;
  TerminalNode& operator=(const TerminalNode&) = delete;

 private:
  static gboolean on_ioctl(UMockdevIoctlBase*, UMockdevIoctlClient* client, gpointer) {
    int error = 0;
    const long result = umockdev_ioctl_client_execute(client, &error, nullptr);
    return done(client, result, error);
  }

  UMockdevTestbed* const testbed_;
  const std::string node_;
  UMockdevIoctlBase* const handler_;
};

// Peers are borrowed. Handlers call them on a thread of umockdev's, and the timetable on its own,
// under mutex_, which with_emulators() takes as well.
class Umockdev final : public UsbTestbed {
 public:
  Umockdev() : testbed_(umockdev_testbed_new()) {}
  Umockdev(const Umockdev&) = delete;
  Umockdev& operator=(const Umockdev&) = delete;
  // Handlers go before the testbed that calls them.
  ~Umockdev() override {
    while (!plugged_.empty()) unplug(plugged_.begin()->first);
    nodes_.clear();
    g_object_unref(testbed_);
  }

  int plug(UsbPeer& peer, Time interval) override {
    const int number = next_++;
    const UsbPaths paths(number);
    add(number, paths.node,
        std::make_unique<PluggedUsb>(timetable_, paths.node, paths.sysfs(), peer, interval),
        describe_usb(paths, peer.identity(), 0xFF, peer.bulk() != nullptr));
    return number;
  }
  int plug(HidPeer& peer, const UsbIdentity& identity, int usage_page, int usage,
           Time interval) override {
    const int number = next_++;
    const UsbPaths paths(number);
    const Bytes descriptor = report_descriptor(usage_page, usage);
    const HidPaths hid(paths, identity);
    add(number, hid.node,
        std::make_unique<PluggedHid>(timetable_, hid.node, paths.sysfs(), peer, descriptor,
                                     interval),
        describe_usb(paths, identity, 0x03) + describe_hid(paths, hid, identity, descriptor));
    return number;
  }
  int plug(const InputNode& node) override {
    const int number = next_++;
    const InputPaths paths(number);
    add(number, paths.node,
        std::make_unique<PluggedInput>(timetable_, paths.node, paths.sysfs(), node),
        describe_input(paths, node));
    return number;
  }
  void change(int plug, const InputNode& node, const std::vector<InputEvent>& events) override {
    const std::lock_guard lock(mutex_);
    dynamic_cast<PluggedInput&>(*plugged_.at(plug)).change(node, events);
  }
  void unplug(int plug) override {
    const auto found = plugged_.find(plug);
    if (found == plugged_.end()) return;
    found->second->remove(testbed_);
    plugged_.erase(found);
  }
  void add_node(const std::string& node, const std::string& target) override {
    remove_node(node);
    nodes_.emplace(node, std::make_unique<TerminalNode>(testbed_, node));
    link(node, target);
  }
  void remove_node(const std::string& node) override {
    const auto found = nodes_.find(node);
    if (found == nodes_.end()) return;
    fs::remove(file_of(node));
    nodes_.erase(found);
  }
  void set_latency(int plug, Time latency) override {
    const std::lock_guard lock(mutex_);
    plugged_.at(plug)->set_latency(latency);
  }
  void set_fault(int plug, UsbFault fault) override {
    const std::lock_guard lock(mutex_);
    plugged_.at(plug)->set_fault(fault);
  }
  void with_emulators(const std::function<void()>& work) override {
    const std::lock_guard lock(mutex_);
    work();
  }

 private:
  // The link is made after umockdev has made its own file of that name, and replaces it.
  void add(int number, const std::string& node, std::unique_ptr<Plugged> device,
           const std::string& description) {
    device->add(testbed_, description);
    link(node, device->pty().path());
    plugged_.emplace(number, std::move(device));
  }
  fs::path file_of(const std::string& node) const {
    gchar* const root = umockdev_testbed_get_root_dir(testbed_);
    fs::path path = std::string(root) + node;
    g_free(root);
    return path;
  }
  /// In place of the regular file that umockdev makes of a node.
  void link(const std::string& node, const std::string& target) {
    const fs::path path = file_of(node);
    fs::create_directories(path.parent_path());
    fs::remove(path);
    fs::create_symlink(target, path);
  }

  UMockdevTestbed* const testbed_;
  FairMutex mutex_;
  Timetable timetable_{mutex_};
  std::map<int, std::unique_ptr<Plugged> > plugged_;
  std::map<std::string, std::unique_ptr<TerminalNode> > nodes_;
  int next_ = 1;
};

}  // namespace

/// umockdev-wrapper is known by the library that it preloads.
std::string why_no_usb_testbed() {
  const char* const preloaded = std::getenv("LD_PRELOAD");
  if (preloaded != nullptr &&
      std::string(preloaded).find("libumockdev-preload") != std::string::npos)
    return "";
  return "this process was not started by umockdev-wrapper";
}

std::unique_ptr<UsbTestbed> make_usb_testbed() {
  if (const std::string why = why_no_usb_testbed(); !why.empty())
    throw DeviceError(DeviceErrorKind::not_found, "testbed", why);
  return std::make_unique<Umockdev>();
}

}  // namespace vitreo

#endif
