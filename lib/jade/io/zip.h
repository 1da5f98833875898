// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <utility>
#include <vector>

namespace jade::io {

/// Continuation of the message about a file that is not an archive.
struct ZipWords {
  std::string expected = "a zip archive";
  std::string remedy = "copy it again";
};

/// Whether a file begins like a zip archive. False for one that cannot be read.
bool is_zip(const std::filesystem::path& path);

/// A zip archive open for reading. Entries are decompressed on request, in steps, so that memory
/// grows with the actual content rather than the size that the archive claims.
class Zip {
 public:
  /// @throws DataError if the file is missing or not a zip archive.
  explicit Zip(const std::filesystem::path& path, const ZipWords& words = {});

  /// Names of all entries in archive order; those of folders end in '/'.
  const std::vector<std::string>& names() const { return names_; }
  bool has(const std::string& name) const;
  /// @throws DataError for an entry that is missing or damaged.
  std::string read(const std::string& name) const;
  /// Writes an entry to a file, a megabyte at a time. @throws DataError as read, or if `target`
  /// cannot be written.
  void extract(const std::string& name, const std::filesystem::path& target) const;

 private:
  std::filesystem::path path_;
  ZipWords words_;
  std::vector<std::string> names_;
};

/// Name and content of an entry.
using ZipEntries = std::vector<std::pair<std::string, std::string>>;

enum class ZipPacking { kDeflate, kStore };

/// Writes an archive through an AtomicFile, in the given order.
/// @param packing  kStore for content that is already compressed
/// @throws DataError naming the path.
void write_zip(const std::filesystem::path& path, const ZipEntries& entries,
               ZipPacking packing = ZipPacking::kDeflate);

}  // namespace jade::io
