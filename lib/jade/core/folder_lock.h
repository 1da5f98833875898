// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <utility>

namespace jade {

/// Holds a folder against other processes by FOLDER/.lock. The kernel drops it with the process,
/// however that ends.
class FolderLock {
 public:
  /// Returns no value if another process holds the lock. @throws DataError if the file cannot be
  /// made.
  static std::optional<FolderLock> take(const std::filesystem::path& folder);
  /// Whether somebody holds the folder now; false where there is none.
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
