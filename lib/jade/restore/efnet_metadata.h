// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>

namespace jade::restore {

/// The name of the metadata inside a restorer's TorchScript file.
inline constexpr const char* kRestorerMetadataFile = "jade_efnet.json";

/// What jade_efnet.json in the file says; the keys of docs/efnet.md §1.1.
struct RestorerMetadata {
  std::string kind;  ///< "efnet" or "image"
  std::string name;
  int64_t width = 0;
  int64_t parameters = 0;
  std::string input;  ///< "scer", "bins" or "none"
  std::string channel_order;
  int64_t padding_multiple = 1;
  int64_t minimum_size = 1;
  bool uses_mask = false;
  std::string weights_sha256;
  std::string source;
};

/// How every problem with a restorer's file is told.
/// @throws DataError "path: what", always.
[[noreturn]] void fail_restorer(const std::filesystem::path& path, const std::string& what);

/// @param text  what jade_efnet.json holds; empty where the file has none.
/// @throws DataError naming the path: no metadata (with the command that exports a file with it),
///   another version, or values that make no sense.
RestorerMetadata parse_restorer_metadata(const std::filesystem::path& path,
                                         const std::string& text);

}  // namespace jade::restore
