// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sstream>
#include <stdexcept>
#include <string>

namespace jade {

/// Exit codes of the programs. Documented in docs/troubleshooting.md; scripts rely on the numbers.
enum class ExitCode : int {
  kOk = 0,
  kBug = 1,           ///< A contract inside the program was broken.
  kUsage = 2,         ///< Command line or configuration.
  kData = 3,          ///< Missing, damaged or inconsistent input or output files.
  kDevice = 4,        ///< No such device, no driver, out of memory.
  kNumeric = 5,       ///< NaN or Inf.
  kCheckpoint = 6,    ///< A checkpoint that cannot be read or does not fit.
  kInterrupted = 130  ///< Ctrl-C or SIGTERM, after saving.
};

/// Joins its arguments into one string, as operator<< prints them.
template <class... Args>
std::string concat(const Args&... args) {
  std::ostringstream out;
  (out << ... << args);
  return out.str();
}

/// Base of all errors that the library throws. Messages are one line: what was expected, what was
/// found, what to do.
class Error : public std::runtime_error {
 public:
  Error(ExitCode exit_code, const std::string& message)
      : std::runtime_error(message), exit_code_(exit_code) {}
  ExitCode exit_code() const { return exit_code_; }

 private:
  ExitCode exit_code_;
};

/// Command line or configuration; messages name file:line:column and the key.
struct ConfigError : Error {
  explicit ConfigError(const std::string& message) : Error(ExitCode::kUsage, message) {}
};
/// Files; messages name the path.
struct DataError : Error {
  explicit DataError(const std::string& message) : Error(ExitCode::kData, message) {}
};
/// Devices and memory.
struct DeviceError : Error {
  explicit DeviceError(const std::string& message) : Error(ExitCode::kDevice, message) {}
};
/// NaN or Inf; messages name the step, the term and the first bad index.
struct NumericError : Error {
  explicit NumericError(const std::string& message) : Error(ExitCode::kNumeric, message) {}
};
/// Checkpoints; messages name the path.
struct CheckpointError : Error {
  explicit CheckpointError(const std::string& message) : Error(ExitCode::kCheckpoint, message) {}
};
/// Thrown by long work that was interrupted; see interrupt.h.
struct Interrupted : Error {
  Interrupted() : Error(ExitCode::kInterrupted, "interrupted") {}
};
/// A caller broke a function's contract: a bug in this program, not a user's mistake.
struct ContractError : Error {
  explicit ContractError(const std::string& message) : Error(ExitCode::kBug, message) {}
};

}  // namespace jade
