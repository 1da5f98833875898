// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>

namespace jade {

/// Writes a file completely or not at all: write to temporary_path(), then call commit(), which
/// syncs the file and renames it over the destination, or over the file that the destination links
/// to. Without commit() the destructor removes the temporary file, and the old file stays.
class AtomicFile {
 public:
  /// @throws DataError if the folder of `path` does not exist or is not writable.
  explicit AtomicFile(std::filesystem::path path);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_; }

  /// @throws DataError if the data cannot be written to disk (for example, the disk is full).
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  bool committed_ = false;
};

/// Publishes the content of a folder only when all of it is written: write into temporary_path(), a
/// folder inside it, then call commit(). Without commit() the destructor removes what was written,
/// and the folder too if this object created it. Also works for links and mount points.
class AtomicFolder {
 public:
  /// @param path  must contain none of the files to be written; created with its parents.
  /// @throws DataError if it cannot be created or is not writable.
  explicit AtomicFolder(std::filesystem::path path);
  ~AtomicFolder();
  AtomicFolder(const AtomicFolder&) = delete;
  AtomicFolder& operator=(const AtomicFolder&) = delete;

  const std::filesystem::path& temporary_path() const { return temporary_; }

  /// @throws DataError if the folder already contains a file of the same name.
  void commit();

 private:
  std::filesystem::path path_;
  std::filesystem::path temporary_;
  bool made_ = false;
};

/// Writes `content` through an AtomicFile.
void write_file(const std::filesystem::path& path, const std::string& content);

/// Returns the content of a file. @throws DataError if it cannot be read.
std::string read_file(const std::filesystem::path& path);

/// @throws DataError if the path is a link whose target is missing, as of data that were not
/// copied.
void check_link(const std::filesystem::path& path);

/// Removes the UTF-8 byte order mark that spreadsheets and Windows editors put before a text.
std::string without_mark(const std::string& text);

/// Creates a folder with its parents and checks that files can be created in it.
/// @throws DataError naming the path and the reason.
void make_writable_folder(const std::filesystem::path& path);

}  // namespace jade
