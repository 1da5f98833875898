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
  /// Number of equal half-open windows of the exposure whose signed event sums it takes; 0: none.
  int64_t windows = 0;
  bool any_time = false;        ///< restores any moment, else only the middle of the exposure
  bool stored_as_half = false;  ///< the file stores the weights as float16
  std::string channel_order;
  int64_t padding_multiple = 1;
  int64_t minimum_size = 1;
  bool uses_mask = false;
  std::string weights_sha256;
  std::string source;
};

/// Reports a problem with a restorer's file.
/// @throws DataError "path: what", always.
[[noreturn]] void fail_restorer(const std::filesystem::path& path, const std::string& what);

/// @param text  content of jade_efnet.json; empty if the file has none.
/// @throws DataError naming the path: no metadata (with the command that exports a file with it),
///   another version, or invalid values.
RestorerMetadata parse_restorer_metadata(const std::filesystem::path& path,
                                         const std::string& text);

/// The metadata of a restorer's file, without loading its network.
/// @throws DataError as parse_restorer_metadata, and for files that are not TorchScript.
RestorerMetadata read_restorer_metadata(const std::filesystem::path& path);

/// @param times  moments to restore, 0 the start and 1 the end of an exposure
/// @throws DataError naming the path if the restorer supports only the middle and another moment is
///   requested; ContractError for moments outside [0,1] or an empty list.
void check_times(const std::filesystem::path& path, const RestorerMetadata& metadata,
                 const std::vector<double>& times);

}  // namespace jade::restore
