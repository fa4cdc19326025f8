// MCAP file: schemas, channels, messages, metadata and attachments by the published specification
// (mcap.dev/spec, version 0), in chunks without compression, each with its index.
// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <string>
#include <string_view>

namespace vitreo {

/// Written front to back; only finish() makes it a whole file. Throws std::runtime_error naming the
/// file.
class McapFile {
 public:
  /// A new file; one that is there already is an error.
  explicit McapFile(const std::filesystem::path& file);
  ~McapFile();
  McapFile(const McapFile&) = delete;
  McapFile& operator=(const McapFile&) = delete;

  /// A channel of JSON messages; `schema` is a JSON Schema. Channels with the same name and text of
  /// the schema share one.
  std::uint16_t add_channel(const std::string& topic, const std::string& schema_name,
                            const std::string& schema);
  /// `time`: ns since 1970, UTC, as log time and as publish time.
  void message(std::uint16_t channel, std::uint64_t time, std::string_view data);
  void metadata(const std::string& name, const std::map<std::string, std::string>& values);
  void attachment(const std::string& name, const std::string& media_type, std::uint64_t time,
                  std::string_view bytes);
  /// The rest of the data, the summary with all indexes and statistics, the footer.
  void finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace vitreo
