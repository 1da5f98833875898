// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace jade::restore {

/// The name of the metadata inside a restorer's TorchScript file.
inline constexpr const char* kRestorerMetadataFile = "jade_efnet.json";

/// Contents of jade_efnet.json in the file; the keys of docs/engineering/restorer.md §1.1.
struct RestorerMetadata {
  int64_t version = 1;  ///< of the format
  std::string kind;     ///< "efnet" or "image"
  std::string name;
  int64_t width = 0;
  int64_t parameters = 0;
  std::string input;  ///< "scer" or "bins", "counts" of version 2, "none" of kind image
  /// Equal half-open windows of the exposure that it takes the signed event sums of; 0: none.
  int64_t windows = 0;
  bool any_time = false;        ///< restores any moment, else the middle of the exposure only
  bool stored_as_half = false;  ///< the weights lie in the file as float16
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

/// The metadata of a restorer's file, without loading its network.
/// @throws DataError as parse_restorer_metadata, and for what is no TorchScript file.
RestorerMetadata read_restorer_metadata(const std::filesystem::path& path);

/// @param times  moments that a restoration is wanted of, 0 the start and 1 the end of an exposure
/// @throws DataError naming the path where the restorer can do the middle only and another one is
///   asked for; ContractError for moments outside [0,1] and none at all.
void check_times(const std::filesystem::path& path, const RestorerMetadata& metadata,
                 const std::vector<double>& times);

}  // namespace jade::restore
