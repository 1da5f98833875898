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

/// A program that runs beside us, found on PATH where its name has no slash, with its output at the
/// end of a file. It is asked to stop when we die.
class Child {
 public:
  /// @param environment  set on top of ours
  /// @throws DataError if `log` cannot be written or the program not started.
  Child(const std::vector<std::string>& command,
        const std::vector<std::pair<std::string, std::string>>& environment,
        const std::filesystem::path& log);
  /// Asks it to stop and waits for it.
  ~Child();
  Child(Child&& other) noexcept : pid_(other.pid_) { other.pid_ = 0; }
  Child& operator=(Child&&) = delete;

  /// How it ended, or nothing while it runs. Never waits.
  std::optional<ChildExit> poll();
  /// Asks it to save and stop.
  void interrupt();
  pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = 0;
};

/// Runs a program to its end and calls `meanwhile` some times a second.
/// @return its exit code: 127 where there is no such program, -1 when a signal ended it
/// @throws Interrupted after stopping it; what Child and `meanwhile` throw.
int run_to_end(const std::vector<std::string>& command,
               const std::vector<std::pair<std::string, std::string>>& environment,
               const std::filesystem::path& log, const std::function<void()>& meanwhile = {});

}  // namespace jade
