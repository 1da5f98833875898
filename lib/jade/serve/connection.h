// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <optional>
#include <sys/types.h>

namespace jade::serve {

/// One request's socket with limits on its bytes, on the time to receive the request, and on the
/// time for the client to receive the answer, independent of the HTTP library. A request that never
/// ends, or arrives one byte per second, occupies a thread no longer, and no more memory, than any
/// other.
class Connection {
 public:
  struct Limits {
    size_t request_bytes = size_t{16} << 10;  ///< request line, headers and body together
    std::chrono::milliseconds reading{2000};  ///< for the whole request
    std::chrono::milliseconds writing{2000};  ///< until the client accepts more of the answer
    size_t unread_bytes = size_t{1} << 20;    ///< skipped at the end, so that the answer arrives
    std::chrono::milliseconds answer{60000};  ///< for the whole answer, if the client reads slowly
  };

  /// Takes ownership of the socket, which need not be blocking.
  /// @param stopping  once true, reading does not extend a client's time; may be null
  Connection(int socket, const Limits& limits, const std::atomic<bool>* stopping = nullptr);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// Returns like recv(): bytes read, 0 at the end, -1 beyond a limit.
  ssize_t read(char* into, size_t size);
  /// Writes all bytes, or returns -1.
  ssize_t write(const char* from, size_t size);
  /// True once there is data to read, or space to write, in time.
  bool can_read();
  bool can_write();
  int socket() const { return socket_; }

 private:
  using Clock = std::chrono::steady_clock;
  bool wait(short event, Clock::time_point until) const;
  Clock::time_point write_until();
  void renew_writing();
  int queued() const;  ///< bytes that the client's machine has not received yet

  int socket_;
  Limits limits_;
  const std::atomic<bool>* stopping_;
  size_t taken_ = 0;
  Clock::time_point read_until_;
  std::optional<Clock::time_point> write_until_;  ///< from the first byte on
  Clock::time_point answer_until_;                ///< with write_until_
  int queued_ = 0;                                ///< at the last query
  std::array<char, 4096> buffer_{};               // libraries read single bytes
  size_t begin_ = 0, end_ = 0;
};

}  // namespace jade::serve
