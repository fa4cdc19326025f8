// Aravis and GLib with ownership. Only devices/instruments/genicam/ includes it.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <arv.h>
#include <memory>
#include <string>

namespace vitreo::genicam {

struct Unref {
  void operator()(void* object) const { g_object_unref(object); }
};
/// Owns one reference.
template <class T>
using Object = std::unique_ptr<T, Unref>;

inline std::string text_and_free(GError* error) {
  std::string text = error->message;
  g_error_free(error);
  return text;
}

}  // namespace vitreo::genicam
