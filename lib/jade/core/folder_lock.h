// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <utility>

namespace jade {

/// Locks a folder against other processes through FOLDER/.lock. The kernel releases the lock when
/// the process ends, even if it crashes.
class FolderLock {
 public:
  /// Returns no value if another process holds the lock.
  /// @throws DataError if the lock file cannot be created.
  static std::optional<FolderLock> take(const std::filesystem::path& folder);
  /// Whether a process holds the lock; false if the folder has no lock file.
  static bool is_held(const std::filesystem::path& folder);

  ~FolderLock();
  FolderLock(FolderLock&& other) noexcept : handle_(std::exchange(other.handle_, -1)) {}
  FolderLock& operator=(FolderLock&& other) noexcept {
    std::swap(handle_, other.handle_);
    return *this;
  }

 private:
  explicit FolderLock(int handle) : handle_(handle) {}
  int handle_;
};

}  // namespace jade
