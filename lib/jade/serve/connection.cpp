// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/connection.h"

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <linux/sockios.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <unistd.h>

namespace jade::serve {
namespace {

/// Polling interval of a full socket.
constexpr std::chrono::milliseconds kLook{100};

}  // namespace

Connection::Connection(int socket, const Limits& limits, const std::atomic<bool>* stopping)
    : socket_(socket),
      limits_(limits),
      stopping_(stopping),
      read_until_(Clock::now() + limits.reading) {}

Connection::~Connection() {
  // Unread input would turn the close into a reset, and the answer would be lost. A client that
  // keeps sending is reset anyway: a local flood sends 50 MB and more in 50 ms.
  shutdown(socket_, SHUT_WR);
  const auto until = Clock::now() + std::chrono::milliseconds(50);
  size_t left = limits_.unread_bytes;
  while (left > 0 && wait(POLLIN, until)) {
    const ssize_t got = recv(socket_, buffer_.data(), std::min(left, buffer_.size()), MSG_DONTWAIT);
    if (got <= 0) break;
    left -= static_cast<size_t>(got);
  }
  close(socket_);
}

bool Connection::wait(short event, Clock::time_point until) const {
  for (;;) {
    const auto left =
        std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    if (left < 0) return false;
    pollfd one{socket_, event, 0};
    const int ready = poll(&one, 1, static_cast<int>(left) + 1);
    if (ready > 0) return true;
    if (ready < 0 && errno != EINTR) return false;
  }
}

bool Connection::can_read() { return begin_ < end_ || wait(POLLIN, read_until_); }

ssize_t Connection::read(char* into, size_t size) {
  if (begin_ == end_) {
    const size_t room = std::min(buffer_.size(), limits_.request_bytes - taken_);
    if (room == 0 || !wait(POLLIN, read_until_)) return -1;
    const ssize_t got = recv(socket_, buffer_.data(), room, 0);
    if (got <= 0) return got;
    begin_ = 0;
    end_ = static_cast<size_t>(got);
    taken_ += end_;
  }
  const size_t given = std::min(size, end_ - begin_);
  std::memcpy(into, buffer_.data() + begin_, given);
  begin_ += given;
  return static_cast<ssize_t>(given);
}

Connection::Clock::time_point Connection::write_until() {
  if (!write_until_) {
    answer_until_ = Clock::now() + limits_.answer;
    write_until_ = std::min(Clock::now() + limits_.writing, answer_until_);
  }
  return *write_until_;
}

void Connection::renew_writing() {
  // The server's destructor waits for one time limit, not for several in a row.
  if (stopping_ != nullptr && *stopping_) return;
  write_until_ = std::min(Clock::now() + limits_.writing, answer_until_);
}

int Connection::queued() const {
  int bytes = 0;
  return ioctl(socket_, SIOCOUTQ, &bytes) == 0 ? bytes : 0;
}

bool Connection::can_write() {
  // Space becomes available only after megabytes have left, which takes a slow line many seconds.
  for (;;) {
    const auto until = write_until();
    if (wait(POLLOUT, std::min(until, Clock::now() + kLook))) return true;
    if (Clock::now() >= until) return false;
    const int left = queued();
    if (left < queued_) renew_writing();
    queued_ = left;
  }
}

ssize_t Connection::write(const char* from, size_t size) {
  for (size_t sent = 0; sent < size;) {
    if (!can_write()) return -1;
    // A client that has disconnected must not end the program by SIGPIPE.
    const ssize_t went = send(socket_, from + sent, size - sent, MSG_NOSIGNAL | MSG_DONTWAIT);
    if (went < 0 && errno != EAGAIN && errno != EINTR) return -1;
    if (went <= 0) continue;
    sent += static_cast<size_t>(went);
    renew_writing();
    queued_ = queued();
  }
  return static_cast<ssize_t>(size);
}

}  // namespace jade::serve
