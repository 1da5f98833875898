// SPDX-License-Identifier: Apache-2.0
#include "jade/core/folder_lock.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include "jade/core/error.h"

namespace jade {
namespace {

constexpr const char* kFile = ".lock";

}  // namespace

std::optional<FolderLock> FolderLock::take(const std::filesystem::path& folder) {
  FolderLock lock(open((folder / kFile).c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644));
  if (lock.handle_ < 0) throw DataError(concat(folder.string(), ": cannot be locked"));
  if (flock(lock.handle_, LOCK_EX | LOCK_NB) != 0) return std::nullopt;
  return lock;
}

bool FolderLock::is_held(const std::filesystem::path& folder) {
  const int handle = open((folder / kFile).c_str(), O_RDWR | O_CLOEXEC);
  if (handle < 0) return false;
  const bool held = flock(handle, LOCK_EX | LOCK_NB) != 0;
  close(handle);
  return held;
}

FolderLock::~FolderLock() {
  if (handle_ >= 0) close(handle_);
}

}  // namespace jade
