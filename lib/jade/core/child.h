// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <sys/types.h>
#include <utility>
#include <vector>

namespace jade {

/// How a program ended.
struct ChildExit {
  int code = -1;           ///< -1 when a signal ended it
  int signal = 0;          ///< that ended it
  int64_t peak_bytes = 0;  ///< resident size at its highest
};

/// A child process, found on PATH if its name has no slash. Its output is appended to a file. It
/// receives SIGTERM when this process dies.
class Child {
 public:
  /// @param environment  variables set in addition to those of this process
  /// @throws DataError if `log` cannot be written or the program cannot be started.
  Child(const std::vector<std::string>& command,
        const std::vector<std::pair<std::string, std::string>>& environment,
        const std::filesystem::path& log);
  /// Sends SIGTERM and waits for the process to end.
  ~Child();
  Child(Child&& other) noexcept : pid_(other.pid_) { other.pid_ = 0; }
  Child& operator=(Child&&) = delete;

  /// Returns how the process ended, or no value while it runs. Never waits.
  std::optional<ChildExit> poll();
  /// Sends SIGINT, on which jade programs save and stop.
  void interrupt();
  pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = 0;
};

/// Runs a program to its end and calls `meanwhile` several times per second.
/// @return its exit code: 127 if there is no such program, -1 if a signal ended it
/// @throws Interrupted after stopping it; the errors of Child and of `meanwhile`.
int run_to_end(const std::vector<std::string>& command,
               const std::vector<std::pair<std::string, std::string>>& environment,
               const std::filesystem::path& log, const std::function<void()>& meanwhile = {});

}  // namespace jade
