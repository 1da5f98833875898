// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <cstddef>
#include <optional>
#include <sys/types.h>

namespace jade::serve {

/// One request's socket: so many bytes may come, and so long may the request take, and an answer
/// that nobody takes, or that is taken bit by bit, whatever library reads and writes. A request
/// that never ends, or comes a byte per second, holds a thread no longer, and no more memory, than
/// any other.
class Connection {
 public:
  struct Limits {
    size_t request_bytes = size_t{16} << 10;  ///< of request line, headers and body together
    std::chrono::milliseconds reading{2000};  ///< the whole request
    std::chrono::milliseconds writing{2000};  ///< until the reader takes more of the answer
    size_t unread_bytes = size_t{1} << 20;  ///< passed over at the end, so that the answer arrives
    std::chrono::milliseconds answer{60000};  ///< all of it, for a reader that takes it bit by bit
  };

  /// Takes the socket, which need not block, and closes it at the end.
  /// @param stopping  once true, a reader gets no more time by taking something; may be null
  Connection(int socket, const Limits& limits, const std::atomic<bool>* stopping = nullptr);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  /// Returns as recv() does: bytes read, 0 at the end, -1 beyond a limit.
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
  void renew_writing();
  int queued() const;  ///< bytes that the reader's machine has not taken yet

  int socket_;
  Limits limits_;
  const std::atomic<bool>* stopping_;
  size_t taken_ = 0;
  Clock::time_point read_until_;
  std::optional<Clock::time_point> write_until_;  ///< from the first byte on
  Clock::time_point answer_until_;                ///< with write_until_
  int queued_ = 0;                                ///< when last asked
  std::array<char, 4096> buffer_{};               // libraries read byte by byte
  size_t begin_ = 0, end_ = 0;
};

}  // namespace jade::serve
