// SPDX-License-Identifier: Apache-2.0
// Files that this process may not read, also in tests that run as root.
#pragma once

#include <filesystem>
#include <unistd.h>

namespace jade::test {

/// Removes all permissions of a file, and root's right to ignore them, for its lifetime.
class WithoutRights {
 public:
  explicit WithoutRights(const std::filesystem::path& path) : path_(path), user_(geteuid()) {
    std::filesystem::permissions(path.parent_path(), std::filesystem::perms::all);
    std::filesystem::permissions(path, std::filesystem::perms::none);
    constexpr uid_t kOther = 65534;
    if (user_ == 0) static_cast<void>(seteuid(kOther));
  }
  ~WithoutRights() {
    if (user_ == 0) static_cast<void>(seteuid(user_));
    std::filesystem::permissions(path_, std::filesystem::perms::owner_all);
  }
  WithoutRights(const WithoutRights&) = delete;
  WithoutRights& operator=(const WithoutRights&) = delete;

 private:
  std::filesystem::path path_;
  uid_t user_;
};

}  // namespace jade::test
