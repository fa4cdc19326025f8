// Preloaded library of the testbed: processes find the interface 127.0.0.2 beside 127.0.0.1, so
// that a second GigE Vision camera can be offered there; the port of its protocol is fixed, and
// Aravis offers one camera an interface. Linux routes all of 127.0.0.0/8 without any alias.
// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <dlfcn.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <netinet/in.h>

namespace {

sockaddr_in address_of(const char* text) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  inet_pton(AF_INET, text, &address.sin_addr);
  return address;
}

/// The entry stays for ever: freeifaddrs() of glibc frees the head of the list, which is one block.
ifaddrs* second_loopback() {
  static char name[] = "lo:vitreo";
  static sockaddr_in address = address_of("127.0.0.2");
  static sockaddr_in mask = address_of("255.0.0.0");
  static sockaddr_in broadcast = address_of("127.255.255.255");
  static ifaddrs entry{};
  entry.ifa_name = name;
  entry.ifa_flags = IFF_UP | IFF_RUNNING | IFF_LOOPBACK;
  entry.ifa_addr = reinterpret_cast<sockaddr*>(&address);
  entry.ifa_netmask = reinterpret_cast<sockaddr*>(&mask);
  entry.ifa_broadaddr = reinterpret_cast<sockaddr*>(&broadcast);
  return &entry;
}

}  // namespace

/// As the one of libc, with one entry more at the end of the list.
extern "C" __attribute__((visibility("default"))) int getifaddrs(ifaddrs** list) noexcept {
  using Function = int (*)(ifaddrs**);
  static const auto next = reinterpret_cast<Function>(dlsym(RTLD_NEXT, "getifaddrs"));
  if (next == nullptr || next(list) != 0) return -1;
  ifaddrs** end = list;
  while (*end != nullptr) end = &(*end)->ifa_next;
  // Nothing before it: then freeifaddrs() would be given what is not to be freed.
  if (end != list) *end = second_loopback();
  return 0;
}
