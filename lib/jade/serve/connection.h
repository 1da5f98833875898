// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <optional>
#include <sys/types.h>

namespace jade::serve {

/// One request's socket: so many bytes may come, and so long may each way take, whatever library
/// reads and writes. A request that never ends, or comes a byte per second, holds a thread no
/// longer, and no more memory, than any other.
class Connection {
 public:
  struct Limits {
    size_t request_bytes = size_t{16} << 10;  ///< of request line, headers and body together
    std::chrono::milliseconds reading{2000}, writing{2000};
    size_t unread_bytes = size_t{1} << 20;  ///< passed over at the end, so that the answer arrives
  };

  /// Takes the socket, which need not block, and closes it at the end.
  Connection(int socket, const Limits& limits);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// As recv(): bytes, 0 at the end, -1 beyond a limit.
  ssize_t read(char* into, size_t size);
  /// All of it, or -1.
  ssize_t write(const char* from, size_t size);
  /// True once there is something to read, or room to write, in time.
  bool can_read();
  bool can_write();
  int socket() const { return socket_; }

 private:
  using Clock = std::chrono::steady_clock;
  bool wait(short event, Clock::time_point until) const;
  Clock::time_point write_until();

  int socket_;
  Limits limits_;
  size_t taken_ = 0;
  Clock::time_point read_until_;
  std::optional<Clock::time_point> write_until_;  ///< from the first byte on
  std::array<char, 4096> buffer_{};               // libraries read byte by byte
  size_t begin_ = 0, end_ = 0;
};

}  // namespace jade::serve
