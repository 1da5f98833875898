// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/server.h"

#include "support/catch.h"

#include <arpa/inet.h>
#include <atomic>
#include <functional>
#include <httplib.h>
#include <memory>
#include <netinet/in.h>
#include <nlohmann/json.hpp>
#include <string>
#include <sys/socket.h>
#include <thread>
#include <torch/types.h>
#include <unistd.h>
#include <vector>

#include "jade/core/error.h"

using namespace jade;

namespace {

const std::string kAskFrame =
    "/frame?layer=color&pose=1,0,0,0,0,1,0,0,0,0,1,0&camera=50,50,20,15,40,30&viewer=";

/// A server with a thread that renders all requests.
struct Live {
  serve::Server server;
  std::atomic<bool> going{true};
  std::atomic<int64_t> rendered{0};
  std::thread artist;

  explicit Live(const std::string& host = "127.0.0.1", int64_t width = 40)
      : server({host, 0}, "--serve"), artist([this, width] {
          while (going) {
            if (!server.queue().wait(serve::RenderQueue::Seconds(0.01))) continue;
            server.queue().render_one([&](const serve::Wanted& wanted) {
              serve::Rendered picture;
              if (wanted.kind == serve::Wanted::Kind::kCamera) {
                picture.json = R"({"poses":[]})";
                return picture;
              }
              if (wanted.view == "test.0") picture.psnr = [] { return 27.25; };
              picture.image = torch::rand({3, 3 * width / 4, width});
              picture.step = ++rendered;
              picture.gaussians = 7;
              return picture;
            });
          }
        }) {
    server.show("<p>the page</p>");
  }
  ~Live() {
    going = false;
    artist.join();
  }

  int port() const {
    const std::string url = server.url();
    return std::stoi(url.substr(url.rfind(':') + 1));
  }
  std::string token() const {
    const std::string url = server.url();
    const size_t at = url.find("?token=");
    return at == std::string::npos ? "" : url.substr(at + 7);
  }
};

httplib::Result get(const Live& live, const std::string& path,
                    const httplib::Headers& headers = {}) {
  httplib::Client client("127.0.0.1", live.port());
  return client.Get(path.c_str(), headers);
}

int status(const Live& live, const std::string& path, const httplib::Headers& headers = {}) {
  const httplib::Result result = get(live, path, headers);
  return result ? result->status : -1;
}

/// A client with full control over its connection.
struct Socket {
  int fd = ::socket(AF_INET, SOCK_STREAM, 0);

  explicit Socket(const Live& live) {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(static_cast<uint16_t>(live.port()));
    inet_pton(AF_INET, "127.0.0.1", &to.sin_addr);
    REQUIRE(connect(fd, reinterpret_cast<sockaddr*>(&to), sizeof to) == 0);
  }
  ~Socket() { close(fd); }
  bool say(const std::string& text) const {
    return ::send(fd, text.data(), text.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(text.size());
  }
  /// Reads the answer to its end.
  std::string hear() const {
    std::string all, part(4096, '\0');
    for (ssize_t got = 0; (got = recv(fd, part.data(), part.size(), 0)) > 0;) {
      all.append(part, 0, static_cast<size_t>(got));
    }
    return all;
  }
};

std::string request(const std::string& line, const std::string& more = "") {
  return line + " HTTP/1.1\r\nHost: 127.0.0.1\r\n" + more + "\r\n";
}

double seconds_to(const std::function<void()>& action) {
  const auto start = std::chrono::steady_clock::now();
  action();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
}

}  // namespace

TEST_CASE("server: page, frame, picture, state and pause", "[serve]") {
  Live live;
  const auto page = get(live, "/");
  REQUIRE(page);
  CHECK(page->body == "<p>the page</p>");
  CHECK(page->get_header_value("Cache-Control") == "no-store");
  const auto frame = get(live, kAskFrame + "a");
  REQUIRE(frame);
  CHECK(frame->status == 200);
  CHECK(frame->get_header_value("Content-Type") == "image/jpeg");
  CHECK(frame->get_header_value("X-Step") == "1");
  CHECK(frame->get_header_value("X-Gaussians") == "7");
  CHECK(frame->body.substr(0, 2) == "\xff\xd8");
  CHECK_FALSE(frame->has_header("X-Psnr"));
  const auto judged = get(live, kAskFrame + "a&view=test.0");
  REQUIRE(judged);
  CHECK(std::stod(judged->get_header_value("X-Psnr")) == 27.25);
  const auto camera = get(live, "/camera?view=test.0&viewer=a");
  REQUIRE(camera);
  CHECK(camera->get_header_value("Content-Type") == "application/json");
  CHECK(camera->body == R"({"poses":[]})");
  const auto picture = get(live, "/picture?view=train.0&name=EDI&viewer=a");
  REQUIRE(picture);
  CHECK(picture->body.substr(1, 3) == "PNG");
  live.server.board().set({3, 9, 7, "training"});
  const auto state = get(live, "/state?viewer=a");
  REQUIRE(state);
  CHECK(nlohmann::json::parse(state->body)["step"] == 3);
  CHECK(nlohmann::json::parse(state->body)["viewers"] == 1);

  httplib::Client client("127.0.0.1", live.port());
  CHECK(client.Post("/pause?on=1&viewer=a")->status == 204);
  CHECK(live.server.queue().paused());
  CHECK(client.Post("/pause?on=0&viewer=a")->status == 204);
  CHECK_FALSE(live.server.queue().paused());
  CHECK(client.Post("/pause?on=maybe&viewer=a")->status == 400);
  // A link or a picture on another site can only send GET.
  CHECK(status(live, "/pause?on=1&viewer=a") == 404);
}

TEST_CASE("server: what nobody serves, and what is asked wrongly", "[serve]") {
  Live live;
  for (const char* path : {"/../etc/passwd", "/..%2f..%2fetc%2fpasswd", "//etc/passwd",
                           "/config.yaml", "/frame/../../etc/passwd", "/favicon.ico"}) {
    INFO(path);
    const Socket socket(live);
    REQUIRE(socket.say(request(concat("GET ", path))));
    CHECK_THAT(socket.hear(), Catch::StartsWith("HTTP/1.1 404"));
  }
  CHECK(status(live, kAskFrame) == 400);
  CHECK(status(live, "/frame?viewer=a") == 400);
  CHECK(status(live, "/picture?viewer=a") == 400);
  CHECK(status(live, "/camera?viewer=a") == 400);
  CHECK(live.rendered == 0);
}

TEST_CASE("server: foreign Host, foreign Origin and a missing token are refused", "[serve]") {
  Live live;
  CHECK(status(live, "/", {{"Host", "evil.example"}}) == 421);
  CHECK(status(live, "/state?viewer=a", {{"Origin", "http://evil.example"}}) == 403);
  CHECK(status(live, kAskFrame + "a", {{"Sec-Fetch-Site", "cross-site"}}) == 403);
  CHECK(live.token().empty());
  Live open("0.0.0.0");
  REQUIRE(open.token().size() == 32);
  CHECK(status(open, "/") == 401);
  CHECK(status(open, kAskFrame + "a&token=" + std::string(32, '0')) == 401);
  CHECK(open.rendered == 0);
  CHECK(status(open, "/?token=" + open.token()) == 200);
  CHECK(status(open, kAskFrame + "a&token=" + open.token()) == 200);
}

TEST_CASE("server: a large request is refused, an endless one left", "[serve]") {
  Live live;
  const std::string large = "Content-Length: 1000000\r\n";
  for (const std::string& line :
       {std::string("POST /pause?on=1&viewer=a"), "GET " + kAskFrame + "a"}) {
    const Socket socket(live);
    socket.say(request(line, large) + std::string(5000, 'x'));
    CHECK_THAT(socket.hear(), Catch::StartsWith("HTTP/1.1 413"));
  }
  const Socket chunked(live);
  chunked.say(request("POST /pause?on=1&viewer=a", "Transfer-Encoding: chunked\r\n") +
              "5\r\nhello");
  CHECK_THAT(chunked.hear(), Catch::StartsWith("HTTP/1.1 413"));
  CHECK_FALSE(live.server.queue().paused());
  // Neither the request line nor the headers end.
  for (const std::string& part :
       {std::string(1000, 'A'), "X: " + std::string(1000, 'A') + "\r\n"}) {
    const Socket endless(live);
    endless.say(part.front() == 'A' ? "" : "GET / HTTP/1.1\r\nHost: localhost\r\n");
    int64_t sent = 0;
    while (sent < 100000000 && endless.say(part)) sent += 1000;
    CHECK(sent < 100000000);
  }
  CHECK(status(live, "/") == 200);
}

TEST_CASE("server: answers are whole and as they are, whatever ranges and packing are asked for",
          "[serve]") {
  Live live;
  std::string ranges = "Range: bytes=0-";
  for (int i = 1; i < 2600; ++i) ranges += ",0-";
  const std::string page = "<p>the page</p>";
  for (const std::string& asked :
       {ranges, std::string("Range: bytes=3-5"), std::string("Range: bytes=99-"),
        std::string("Accept-Encoding: br, gzip")}) {
    INFO(asked.substr(0, 40));
    const Socket socket(live);
    REQUIRE(socket.say(request("GET /", asked + "\r\n")));
    const std::string heard = socket.hear();
    CHECK_THAT(heard, Catch::StartsWith("HTTP/1.1 200") &&
                          Catch::Contains(concat("Content-Length: ", page.size(), "\r\n")) &&
                          Catch::EndsWith("\r\n\r\n" + page) &&
                          !Catch::Contains("Content-Encoding"));
  }
  const Socket state(live);
  REQUIRE(state.say(request("GET /state?viewer=a", "Accept-Encoding: br, gzip\r\n")));
  CHECK_THAT(state.hear(), Catch::EndsWith("}"));
}

TEST_CASE("server: who reads a large page slowly gets it, unless the server stops", "[serve]") {
  auto live = std::make_unique<Live>();
  const std::string page(size_t{16} << 20, 'x');
  live->server.show(page);
  const auto read_slowly = [&](const Socket& socket) {
    const int room = 1 << 17;  // so that little data is in transit
    setsockopt(socket.fd, SOL_SOCKET, SO_RCVBUF, &room, sizeof room);
    size_t got = 0;
    std::string part(size_t{1} << 20, '.');
    for (ssize_t more = 0; (more = recv(socket.fd, part.data(), part.size(), MSG_WAITALL)) > 0;) {
      got += static_cast<size_t>(more);
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    return got;
  };
  {
    const Socket socket(*live);
    REQUIRE(socket.say(request("GET /")));
    CHECK(read_slowly(socket) > page.size());
  }
  const Socket socket(*live);
  REQUIRE(socket.say(request("GET /")));
  size_t got = 0;
  std::thread reader([&] { got = read_slowly(socket); });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  CHECK(seconds_to([&] { live.reset(); }) < 2.5);
  reader.join();
  CHECK(got < page.size());
}

TEST_CASE("server: two viewers both see, one that stalls or leaves holds nobody up", "[serve]") {
  Live live("127.0.0.1", 1600);
  std::vector<std::unique_ptr<Socket>> stalled;
  for (int i = 0; i < 4; ++i) {
    stalled.push_back(std::make_unique<Socket>(live));
    REQUIRE(stalled.back()->say(request("GET " + kAskFrame + concat("stalled", i))));
    const Socket leaves(live);
    REQUIRE(leaves.say(request("GET " + kAskFrame + concat("leaves", i))));
  }
  std::vector<std::thread> viewers;
  std::atomic<int> seen{0};
  for (const char* name : {"a", "b"}) {
    viewers.emplace_back([&live, &seen, name] {
      for (int i = 0; i < 5; ++i) seen += status(live, kAskFrame + name) == 200 ? 1 : 0;
    });
  }
  for (std::thread& viewer : viewers) viewer.join();
  CHECK(seen == 10);
  CHECK(live.rendered <= 10 + 8);
}

TEST_CASE("server: ten thousand requests", "[serve]") {
  Live live;
  std::atomic<int> answered{0};
  std::vector<std::thread> threads;
  for (int t = 0; t < 4; ++t) {
    threads.emplace_back([&] {
      httplib::Client client("127.0.0.1", live.port());
      for (int i = 0; i < 2500; ++i) {
        const auto result = client.Get("/state?viewer=a");
        if (result && result->status == 200) ++answered;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  CHECK(answered == 10000);
}

TEST_CASE("server: stops at once with viewers that wait, and one that says nothing", "[serve]") {
  auto server = std::make_unique<serve::Server>(serve::Address{"127.0.0.1", 0}, "--serve");
  const std::string url = server->url();
  const int port = std::stoi(url.substr(url.rfind(':') + 1));
  std::vector<std::thread> viewers;
  for (int i = 0; i < 3; ++i) {
    viewers.emplace_back([port, i] {
      httplib::Client client("127.0.0.1", port);
      client.Get((kAskFrame + std::to_string(i)).c_str());
    });
  }
  while (!server->queue().asked()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  CHECK(seconds_to([&] { server.reset(); }) < 1);
  for (std::thread& viewer : viewers) viewer.join();
}

TEST_CASE("server: a port that is taken is named, and found free again afterwards", "[serve]") {
  int port = 0;
  {
    const Live live;
    port = live.port();
    try {
      const serve::Server second({"127.0.0.1", port}, "--serve");
      FAIL("two servers on one port");
    } catch (const ConfigError& error) {
      CHECK_THAT(error.what(), Catch::Contains(concat("--serve 127.0.0.1:", port, ": expected")) &&
                                   Catch::Contains("Address already in use"));
    }
    CHECK(status(live, "/") == 200);
  }
  CHECK_NOTHROW(serve::Server({"127.0.0.1", port}, "--serve"));
  CHECK_THROWS_AS(serve::Server({"203.0.113.7", 0}, "--serve"), ConfigError);
}
