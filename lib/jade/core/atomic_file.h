// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade {

/// A file that appears whole or not at all: write to temporary_path(), then commit(), which syncs
/// it and renames it over the target. Without commit() the destructor removes it, and the old file
/// stays.
class AtomicFile {
 public:
  /// @throws DataError if the folder of `path` does not exist or is not writable.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_; }

  /// @throws DataError if the data cannot be brought to disk (full disk, for one).
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  bool committed_ = false;
};

/// A folder whose content appears once all of it is written: write into temporary_path(), which
/// lies in it, then commit(). Without commit() the destructor removes what was written, and the
/// folder too if it was not there before. Works where the folder is a link or a place where a disk
/// is mounted.
class AtomicFolder {
 public:
  /// @param path  holds nothing that is also written; made with its parents.
  /// @throws DataError if it cannot be made or is not writable.
  explicit AtomicFolder(std::filesystem::path path);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_; }

  /// @throws DataError if a name is taken in the folder.
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  bool made_ = false;
};

/// Writes `content` through an AtomicFile.
void write_file(const std::filesystem::path& path, const std::string& content);

/// The whole file. @throws DataError if it cannot be read.
std::string read_file(const std::filesystem::path& path);

/// Makes a folder with its parents and checks that files can be made in it.
/// @throws DataError naming the path and the reason.
void make_writable_folder(const std::filesystem::path& path);

}  // namespace jade
