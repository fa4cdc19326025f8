// SPDX-License-Identifier: Apache-2.0
#include "host/lua/script/protocol_files.h"

#include <filesystem>

namespace vitreo::lua {

std::string find_protocol(const Context& context, const std::string& name) {
  namespace fs = std::filesystem;
  std::error_code error;
  if (name.find('\0') != std::string::npos) return "";
  if (name.ends_with(".lua") && fs::is_regular_file(name, error)) return name;
  for (const std::string& folder : context.protocol_folders)
    if (const fs::path file = fs::path(folder) / (name + ".lua");
        name.find('/') == std::string::npos && fs::is_regular_file(file, error))
      return file.lexically_normal().string();
  return "";
}

std::vector<std::string> protocol_names(const Context& context) {
  std::vector<std::string> names;
  std::error_code error;
  for (const std::string& folder : context.protocol_folders)
    for (const auto& entry : std::filesystem::directory_iterator(folder, error))
      if (entry.path().extension() == ".lua") names.push_back(entry.path().stem().string());
  return names;
}

}  // namespace vitreo::lua
