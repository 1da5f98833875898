// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/connection.h"

#include "support/catch.h"

#include <atomic>
#include <chrono>
#include <functional>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <unistd.h>

using namespace jade;
using serve::Connection;

namespace {

constexpr std::chrono::milliseconds kSoon{60};

struct Pair {
  int ours = -1, theirs = -1;
  Pair() {
    int both[2];
    REQUIRE(socketpair(AF_UNIX, SOCK_STREAM, 0, both) == 0);
    ours = both[0];
    theirs = both[1];
  }
  ~Pair() { close(theirs); }
  void say(const std::string& text) const {
    REQUIRE(::send(theirs, text.data(), text.size(), MSG_NOSIGNAL) == ssize_t(text.size()));
  }
};

double seconds_of(const std::function<void()>& action) {
  const auto start = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

/// An answer of 1 MB to a client that reads 16 kB every 50 ms, from a socket that has space again
/// only after a second of that.
struct Sent {
  bool all;
  double seconds;
};

Sent send_to_slow_reader(const Connection::Limits& limits,
                         const std::atomic<bool>* stopping = nullptr) {
  const Pair pair;
  const int room = 212992;  // allowed without privileges; the system doubles it
  REQUIRE(setsockopt(pair.ours, SOL_SOCKET, SO_SNDBUF, &room, sizeof room) == 0);
  std::atomic<bool> slow{true};
  std::thread reader([&] {
    std::string part(size_t{16} << 10, '.');
    while (recv(pair.theirs, part.data(), part.size(), MSG_WAITALL) > 0) {
      if (slow) std::this_thread::sleep_for(std::chrono::milliseconds(50));
    }
  });
  Sent sent{};
  {
    Connection connection(pair.ours, limits, stopping);
    const std::string much(size_t{1} << 20, 'x');
    sent.seconds = seconds_of([&] { sent.all = connection.write(much.data(), much.size()) > 0; });
    slow = false;
  }
  reader.join();
  return sent;
}

}  // namespace

TEST_CASE("connection: reads and writes as a socket does", "[serve]") {
  const Pair pair;
  Connection connection(pair.ours, {});
  pair.say("GET");
  std::string text(8, '.');
  CHECK(connection.read(text.data(), 1) == 1);
  CHECK(connection.can_read());
  CHECK(connection.read(text.data() + 1, 7) == 2);
  CHECK(text == "GET.....");
  CHECK(connection.write("200 OK", 6) == 6);
  char answer[6];
  CHECK(::read(pair.theirs, answer, 6) == 6);
  CHECK(std::string(answer, 6) == "200 OK");
  shutdown(pair.theirs, SHUT_WR);
  CHECK(connection.read(text.data(), 8) == 0);
}

TEST_CASE("connection: a request has an end, in bytes and in time", "[serve]") {
  {
    const Pair pair;
    Connection connection(pair.ours, {10, kSoon, kSoon});
    pair.say("0123456789abcdef");
    std::string text(16, '.');
    CHECK(connection.read(text.data(), 16) == 10);
    CHECK(connection.read(text.data(), 16) == -1);
  }
  const Pair pair;
  Connection connection(pair.ours, {1000, kSoon, kSoon});
  char letter = 0;
  // One byte every 20 ms, which a limit between bytes would allow.
  std::thread slow([&] {
    for (int i = 0; i < 60; ++i) {
      pair.say("x");
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
  });
  const double seconds = seconds_of([&] {
    while (connection.read(&letter, 1) > 0) {
    }
  });
  slow.join();
  CHECK(seconds < 1);
}

TEST_CASE("connection: who goes on after the answer is passed over so far and no further",
          "[serve]") {
  const Pair pair;
  Connection::Limits limits;
  limits.unread_bytes = 50000;
  int64_t sent = 0;
  std::thread flood([&] {
    const std::string part(1000, 'x');
    while (::send(pair.theirs, part.data(), part.size(), MSG_NOSIGNAL) > 0) sent += 1000;
  });
  { const Connection connection(pair.ours, limits); }
  flood.join();
  CHECK(sent >= 50000);
  CHECK(sent < 2000000);  // and what a socket holds
}

TEST_CASE("connection: who does not read is left after a while", "[serve]") {
  const Pair pair;
  Connection connection(pair.ours, {1000, kSoon, kSoon});
  const std::string much(size_t{1} << 24, 'x');
  ssize_t sent = 0;
  CHECK(seconds_of([&] { sent = connection.write(much.data(), much.size()); }) < 1);
  CHECK(sent == -1);
}

TEST_CASE("connection: who reads slowly gets all, within the limit of an answer", "[serve]") {
  Connection::Limits limits;
  limits.writing = std::chrono::milliseconds(600);
  const Sent whole = send_to_slow_reader(limits);
  CHECK(whole.all);
  CHECK(whole.seconds > 0.6);
  limits.answer = std::chrono::milliseconds(700);
  const Sent cut = send_to_slow_reader(limits);
  CHECK_FALSE(cut.all);
  CHECK(cut.seconds < 1.4);
}

TEST_CASE("connection: who reads slowly gets no more time once the server stops", "[serve]") {
  Connection::Limits limits;
  limits.writing = std::chrono::milliseconds(600);
  const std::atomic<bool> stopping{true};
  const Sent sent = send_to_slow_reader(limits, &stopping);
  CHECK_FALSE(sent.all);
  CHECK(sent.seconds < 1.4);
}
