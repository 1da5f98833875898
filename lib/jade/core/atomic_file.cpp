// SPDX-License-Identifier: Apache-2.0
#include "jade/core/atomic_file.h"

#include <cerrno>
#include <cstring>
#include <fcntl.h>
#include <fstream>
#include <sstream>
#include <unistd.h>

#include "jade/core/error.h"

namespace jade {
namespace {

namespace fs = std::filesystem;

/// Syncs a file, or the entries of a folder, to disk.
void sync_path(const fs::path& path) {
  const int handle = open(path.c_str(), O_RDONLY | O_CLOEXEC);
  const bool synced = handle >= 0 && fsync(handle) == 0;
  const int reason = errno;
  if (handle >= 0) close(handle);
  if (!synced)
    throw DataError(concat(path.string(), ": cannot be brought to disk: ", std::strerror(reason)));
}

fs::path folder_of(const fs::path& path) {
  return path.has_parent_path() ? path.parent_path() : fs::path(".");
}

/// The file that links lead to, existing or not.
fs::path target_of(fs::path path) {
  constexpr int kMostLinks = 40;  // as in Linux; links may form a circle
  std::error_code ignored;
  for (int i = 0; i < kMostLinks && fs::is_symlink(path, ignored); ++i) {
    path = path.parent_path() / fs::read_symlink(path, ignored);
  }
  return path;
}

}  // namespace

AtomicFile::AtomicFile(fs::path path) : path_(target_of(std::move(path))) {
  temporary_ = path_;
  temporary_ += concat(".", getpid(), ".part");
  if (access(folder_of(path_).c_str(), W_OK) != 0) {
    throw DataError(concat(path_.string(), ": cannot be written: ", std::strerror(errno),
                           "; choose a folder that exists and is writable"));
  }
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;
  if (!committed_) fs::remove(temporary_, ignored);
}

void AtomicFile::commit() {
  sync_path(temporary_);
  std::error_code failure;
  fs::rename(temporary_, path_, failure);
  if (failure) throw DataError(concat(path_.string(), ": cannot be replaced: ", failure.message()));
  committed_ = true;
  sync_path(folder_of(path_));
}

AtomicFolder::AtomicFolder(fs::path path)
    : path_(std::move(path)),
      temporary_(path_ / concat(".", getpid(), ".part")),
      made_(!fs::exists(path_)) {
  make_writable_folder(path_);
  make_writable_folder(temporary_);
}

AtomicFolder::~AtomicFolder() {
  std::error_code ignored;
  fs::remove_all(temporary_, ignored);
  if (made_) fs::remove(path_, ignored);  // does not remove a folder with content
}

void AtomicFolder::commit() {
  std::error_code failure;
  for (const fs::directory_entry& entry : fs::directory_iterator(temporary_)) {
    const fs::path target = path_ / entry.path().filename();
    fs::rename(entry.path(), target, failure);
    if (failure) {
      throw DataError(concat(target.string(), ": cannot be put there: ", failure.message()));
    }
  }
}

void write_file(const fs::path& path, const std::string& content) {
  AtomicFile file(path);
  std::ofstream out(file.temporary_path(), std::ios::binary);
  out.write(content.data(), static_cast<std::streamsize>(content.size()));
  out.close();
  if (!out) throw DataError(concat(path.string(), ": cannot be written; is the disk full?"));
  file.commit();
}

std::string without_mark(const std::string& text) {
  return text.rfind("\xEF\xBB\xBF", 0) == 0 ? text.substr(3) : text;
}

std::string read_file(const fs::path& path) {
  errno = 0;
  std::ifstream in(path, std::ios::binary);
  std::ostringstream content;
  if (in && !fs::is_directory(path)) content << in.rdbuf();
  const int error = errno;
  if (!in || fs::is_directory(path)) {
    const char* const why = error == EACCES   ? ": permission denied"
                            : error == ENOENT ? ": no such file"
                                              : "";
    throw DataError(concat(path.string(), ": cannot be read", why));
  }
  return content.str();
}

void make_writable_folder(const fs::path& path) {
  std::error_code failure;
  fs::create_directories(path, failure);
  if (failure || !fs::is_directory(path)) {
    throw DataError(concat(path.string(), ": cannot make this folder: ",
                           failure ? failure.message() : "a file of that name is in the way"));
  }
  if (access(path.c_str(), W_OK | X_OK) != 0) {
    throw DataError(
        concat(path.string(), ": this folder is not writable; choose another with --output"));
  }
}

void check_link(const fs::path& path) {
  std::error_code ignored;
  if (!fs::is_symlink(path, ignored) || fs::exists(path, ignored)) return;
  throw DataError(concat(path.string(), ": expected a file, found a link to ",
                         fs::read_symlink(path, ignored).string(),
                         ", which does not exist; copy that file, or remove the link"));
}

}  // namespace jade
