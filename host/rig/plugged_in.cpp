// SPDX-License-Identifier: Apache-2.0
#include "host/rig/plugged_in.h"

#include "devices/instruments/genicam/driver.h"
#include "devices/links/hid_link.h"
#include "devices/links/usb_link.h"
#include "host/rig/registry.h"

#include <algorithm>
#include <functional>

namespace vitreo {
namespace {

using Json = nlohmann::json;

/// Adds what `find` finds, or why the bus cannot be searched: one bus does not hide the others.
void look(Json& rows, const std::string& bus, const std::function<void()>& find) {
  try {
    find();
  } catch (const std::exception& problem) {
    rows.push_back({{"bus", bus}, {"problem", problem.what()}});
  }
}

// Either may be missing in a descriptor.
std::string name_of(const UsbIdentity& usb) {
  return usb.manufacturer + (usb.manufacturer.empty() || usb.name.empty() ? "" : " ") + usb.name;
}

Json row_of(const std::string& bus, const UsbIdentity& found) {
  return {{"bus", bus},
          {"address", to_string(bus, {found.vendor, found.product, found.serial})},
          {"name", name_of(found)},
          {"place", found.place},
          {"driver", driver_for(found.vendor, found.product)}};
}

// "usb" beside the node: the node's number may change with the next plugging, the adapter's serial
// number does not.
Json row_of(const SerialPort& port) {
  const std::vector<std::string> drivers = drivers_for(port);
  Json row = {{"bus", "serial"},
              {"address", "serial:" + port.node},
              {"name", port.usb ? name_of(*port.usb) : ""},
              {"place", port.usb ? "usb " + port.usb->place : port.node},
              {"driver", drivers.size() == 1 ? drivers.front() : ""}};
  if (drivers.size() > 1) row["candidates"] = drivers;
  if (port.usb)
    row["usb"] = to_string("usb", {port.usb->vendor, port.usb->product, port.usb->serial});
  return row;
}

}  // namespace

// Nothing is opened for it: vendor and product numbers are in the descriptors that the system has
// read already. Of several drivers the registry's first.
std::string driver_for(int vendor, int product) {
  for (const IdentifiedDriver& driver : identified_drivers())
    if (usb_kind(driver.identification, vendor, product) != nullptr) return driver.name;
  return "";
}

const UsbKind* usb_kind(const Identification& identification, int vendor, int product) {
  for (const UsbKind& kind : identification.usb)
    if (kind.vendor == vendor &&
        std::find(kind.products.begin(), kind.products.end(), product) != kind.products.end())
      return &kind;
  return nullptr;
}

// Its own numbers decide first, then a name in the adapter's descriptor; a plain adapter (FTDI,
// CP210x, PL2303, CH340, a port of the machine) leaves every driver possible whose instruments have
// no numbers of their own.
std::vector<std::string> drivers_for(const SerialPort& port) {
  std::vector<std::string> own, named, plain;
  for (const auto& [name, identification] : identified_drivers()) {
    if (!identification.question) continue;
    if (identification.usb.empty()) plain.push_back(name);
    if (!port.usb) continue;
    if (usb_kind(identification, port.usb->vendor, port.usb->product) != nullptr)
      own.push_back(name);
    const std::vector<std::string>& words = identification.words;
    if (std::any_of(words.begin(), words.end(), [&port](const std::string& word) {
          return name_of(*port.usb).find(word) != std::string::npos;
        }))
      named.push_back(name);
  }
  std::vector<std::string> drivers = !own.empty() ? own : !named.empty() ? named : plain;
  std::sort(drivers.begin(), drivers.end());
  return drivers;
}

Json find_instruments() {
  Json rows = Json::array();
  look(rows, "serial", [&] {
    for (const SerialPort& port : list_serial_ports()) rows.push_back(row_of(port));
  });
  look(rows, "usb", [&] {
    for (const UsbIdentity& found : list_usb_devices()) rows.push_back(row_of("usb", found));
  });
  look(rows, "hid", [&] {
    for (const UsbIdentity& found : list_hid_devices()) rows.push_back(row_of("hid", found));
  });
  look(rows, "genicam", [&] {
    for (const genicam::Found& found : genicam::list_cameras())
      rows.push_back({{"bus", "genicam"},
                      {"address", "genicam:" + found.identity},
                      {"name", found.vendor + " " + found.model},
                      {"place", found.protocol + " " + found.address},
                      {"driver", "genicam"}});
  });
  // The same device as a USB and as a HID one: the driver takes it by one of them.
  // One row keeps the driver, the HID one, as the drivers open these by "hid:". The Tic alone is
  // driven by USB transfers.
  for (Json& row : rows) {
    const std::string driver = row.value("driver", "");
    if (row.value("bus", "") != "usb" || driver.empty() || driver == "pololu_tic") continue;
    row["driver"] = "";
    row["taken_as"] = "hid";
  }
  return rows;
}

}  // namespace vitreo
