// The calls by which libdc1394 meets Linux' FireWire nodes, taken by the bus of this process: they
// are defined in the program, so the loader binds the library to these. Everything else passes.
// SPDX-License-Identifier: Apache-2.0
#include "tests/devices/firewire/state.h"

#include <cerrno>
#include <cstdarg>
#include <cstring>
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <sys/mman.h>
#include <unistd.h>

using vitreo::firewire_bus;

namespace {

/// The function of that name behind this program's own.
template <typename Function>
Function* next(const char* name) {
  return reinterpret_cast<Function*>(::dlsym(RTLD_NEXT, name));
}

/// The bus, if the descriptor is one of its nodes.
vitreo::FireWireBus::State* bus_of(int descriptor) {
  vitreo::FireWireBus::State* bus = firewire_bus;
  return bus != nullptr && bus->holds(descriptor) ? bus : nullptr;
}

int returned(int result) {
  if (result >= 0) return result;
  errno = -result;
  return -1;
}

}  // namespace

extern "C" {

DIR* opendir(const char* name) {
  static auto* const real = next<DIR*(const char*)>("opendir");
  vitreo::FireWireBus::State* bus = firewire_bus;
  if (bus != nullptr && std::strcmp(name, "/dev") == 0) return real(bus->folder.c_str());
  return real(name);
}

int open(const char* path, int flags, ...) {
  static auto* const real = next<int(const char*, int, ...)>("open");
  std::va_list rest;
  va_start(rest, flags);
  const mode_t mode = (flags & (O_CREAT | __O_TMPFILE)) != 0 ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  vitreo::FireWireBus::State* bus = firewire_bus;
  if (bus != nullptr && std::strncmp(path, "/dev/fw", 7) == 0) return returned(bus->open(path));
  return real(path, flags, mode);
}

int close(int descriptor) {
  static auto* const real = next<int(int)>("close");
  if (auto* bus = bus_of(descriptor)) bus->close(descriptor);
  return real(descriptor);
}

int ioctl(int descriptor, unsigned long request, ...) noexcept {
  static auto* const real = next<int(int, unsigned long, ...)>("ioctl");
  std::va_list rest;
  va_start(rest, request);
  void* argument = va_arg(rest, void*);
  va_end(rest);
  if (auto* bus = bus_of(descriptor)) return returned(bus->ioctl(descriptor, request, argument));
  return real(descriptor, request, argument);
}

// Of a node that is gone Linux says so.
ssize_t read(int descriptor, void* into, size_t size) {
  static auto* const real = next<ssize_t(int, void*, size_t)>("read");
  const ssize_t count = real(descriptor, into, size);
  if (count == 0 && bus_of(descriptor) != nullptr) return returned(-ENODEV);
  return count;
}

// The ring of a node is memory of this process.
void* mmap(void* at, size_t size, int protection, int flags, int descriptor,
           off_t offset) noexcept {
  static auto* const real = next<void*(void*, size_t, int, int, int, off_t)>("mmap");
  if (descriptor >= 0 && bus_of(descriptor) != nullptr)
    return real(nullptr, size, protection, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  return real(at, size, protection, flags, descriptor, offset);
}

// libdc1394 looks for the same cameras through libraw1394 too; that has none here.
void* raw1394_new_handle() {
  errno = ENODEV;
  return nullptr;
}

}  // extern "C"
