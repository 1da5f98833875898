// SPDX-License-Identifier: Apache-2.0
// The only file that includes cpp-httplib.
#include "jade/serve/server.h"

#include <algorithm>
#include <atomic>
#include <cerrno>
#include <condition_variable>
#include <cstring>
#include <httplib.h>
#include <mutex>
#include <thread>
#include <unistd.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/imaging/image_io.h"
#include "jade/serve/connection.h"
#include "jade/serve/gate.h"

namespace jade::serve {
namespace {

constexpr size_t kThreads = 16;
constexpr int kJpegQuality = 85;
constexpr RenderQueue::Seconds kFrameWait{2.0};     // then the viewer retries
constexpr RenderQueue::Seconds kPictureWait{10.0};  // a picture is requested once
// Reloads by a script: a refresh by <meta> does nothing if the URL ends in #camera=...
constexpr char kOnItsWay[] =
    "<!doctype html><html lang=\"en\"><meta charset=\"utf-8\"><link rel=\"icon\" "
    "href=\"data:,\"><title>JADE-GS</title><p>The views are being prepared; this page comes by "
    "itself.<script>setTimeout(() => location.reload(), 1000);</script></html>";

/// Excess connections wait in the kernel, where they use none of this process's memory or file
/// descriptors, which the trainer needs.
class BoundedPool : public httplib::TaskQueue {
  // bool since httplib 0.14, void before.
  using Enqueued = decltype(std::declval<httplib::TaskQueue&>().enqueue({}));

 public:
  Enqueued enqueue(std::function<void()> task) override {
    std::unique_lock<std::mutex> lock(mutex_);
    free_.wait(lock, [&] { return busy_ < kThreads; });
    ++busy_;
    lock.unlock();
    pool_.enqueue([this, task = std::move(task)] {
      try {
        task();
      } catch (...) {
        // For example out of memory: only this connection is closed. An exception that leaves the
        // thread would end the program.
      }
      const std::lock_guard<std::mutex> done(mutex_);
      --busy_;
      free_.notify_one();
    });
    return static_cast<Enqueued>(true);
  }
  void shutdown() override { pool_.shutdown(); }

 private:
  httplib::ThreadPool pool_{kThreads};
  std::mutex mutex_;
  std::condition_variable free_;
  size_t busy_ = 0;
};

/// Stream of httplib that enforces the limits of a Connection. Newer versions have more virtual
/// functions than older ones, so no function here is marked `override`.
class LimitedStream : public httplib::Stream {
 public:
  explicit LimitedStream(Connection& connection) : connection_(connection) {}

  bool is_readable() const { return connection_.can_read(); }
  bool is_writable() const { return connection_.can_write(); }
  ssize_t read(char* into, size_t size) { return connection_.read(into, size); }
  ssize_t write(const char* from, size_t size) { return connection_.write(from, size); }
  void get_remote_ip_and_port(std::string&, int&) const {}
  void get_local_ip_and_port(std::string&, int&) const {}
  socket_t socket() const { return connection_.socket(); }

 private:
  Connection& connection_;
};

/// One request per connection: unread bytes of a rejected request are never parsed as the next one,
/// and a viewer that only keeps its connection open occupies no thread.
class LimitedServer : public httplib::Server {
 public:
  /// Gives slow clients no more time; call it before stop().
  void hurry() { stopping_ = true; }

 private:
  bool process_and_close_socket(socket_t socket) override {
    Connection connection(socket, {}, &stopping_);
    LimitedStream stream(connection);
    return process(&LimitedServer::process_request, stream);
  }

  // Since 0.16 the library's process_request takes both ends' addresses, which are unused here.
  using Setup = const std::function<void(httplib::Request&)>&;
  using Old = bool (httplib::Server::*)(httplib::Stream&, bool, bool&, Setup);
  using New = bool (httplib::Server::*)(httplib::Stream&, const std::string&, int,
                                        const std::string&, int, bool, bool&, Setup);

  bool process(Old request, httplib::Stream& stream) {
    bool closed = false;
    return (this->*request)(stream, /*close_connection=*/true, closed, answer_whole);
  }

  bool process(New request, httplib::Stream& stream) {
    bool closed = false;
    return (this->*request)(stream, "", 0, "", 0, /*close_connection=*/true, closed, answer_whole);
  }

  /// Sends answers whole and uncompressed. For range requests the library would combine all ranges,
  /// of which a request can contain thousands; and its compression takes seconds for a page of
  /// pictures, which are already compressed.
  static void answer_whole(httplib::Request& request) {
    request.ranges.clear();
    request.headers.erase("Accept-Encoding");
  }

  std::atomic<bool> stopping_{false};
};

/// Replaces the library's options, whose SO_REUSEPORT would let two programs share one port.
void set_socket_options(socket_t socket) {
  const int yes = 1;
  setsockopt(socket, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes);
}

Knock knock_of(const httplib::Request& request) {
  const auto header = [&](const char* name) { return request.get_header_value(name); };
  return {request.path,
          header("Host"),
          header("Origin"),
          header("Sec-Fetch-Site"),
          header("Sec-Fetch-Mode"),
          request.get_param_value("token"),
          header("Content-Length"),
          header("Transfer-Encoding")};
}

void say(httplib::Response& response, int status, const std::string& text) {
  response.status = status;
  response.set_content(text + "\n", "text/plain; charset=utf-8");
}

/// Sends in pieces from the original buffer: a slow client causes no copy, and the server can stop
/// between pieces.
void send(httplib::Response& response, std::shared_ptr<const std::string> page) {
  const size_t size = page->size();
  response.set_content_provider(
      size, "text/html; charset=utf-8",
      [page = std::move(page)](size_t offset, size_t left, httplib::DataSink& sink) {
        sink.write(page->data() + offset, std::min(left, size_t{64} << 10));
        return true;
      });
}

int64_t number_of(const httplib::Request& request, const char* name) {
  const std::string text = request.get_param_value(name);
  return text.empty() || text.size() > 18 ? -1 : std::strtoll(text.c_str(), nullptr, 10);
}

/// Sets an error status if nothing was rendered.
bool was_rendered(const Answer& answer, httplib::Response& response) {
  switch (answer.kind) {
    case Answer::Kind::kTooLate:
      response.status = 204;
      return false;
    case Answer::Kind::kFull:
      say(response, 503, "too many viewers wait; try again");
      return false;
    case Answer::Kind::kFailed:
      say(response, 503, answer.reason);
      return false;
    case Answer::Kind::kRendered:
      break;
  }
  return true;
}

void send(httplib::Response& response, const Answer& answer, bool lossless) {
  if (!was_rendered(answer, response)) return;
  const Rendered& rendered = answer.rendered;
  if (rendered.finish) rendered.finish();
  const std::vector<uint8_t> bytes = lossless ? imaging::encode_png(rendered.image)
                                              : imaging::encode_jpeg(rendered.image, kJpegQuality);
  response.set_header("X-Step", std::to_string(rendered.step));
  response.set_header("X-Gaussians", std::to_string(rendered.gaussians));
  if (rendered.psnr) response.set_header("X-Psnr", std::to_string(rendered.psnr()));
  response.set_content(reinterpret_cast<const char*>(bytes.data()), bytes.size(),
                       lossless ? "image/png" : "image/jpeg");
}

}  // namespace

bool can_serve() { return true; }

struct Server::Impl {
  Address address;
  std::string token;
  Gate gate;
  RenderQueue queue;
  Board board;
  std::mutex page_mutex;
  std::shared_ptr<const std::string> page = std::make_shared<const std::string>(kOnItsWay);
  LimitedServer http;
  std::thread thread;

  explicit Impl(const Address& where)
      : address(where), token(is_loopback(where) ? "" : make_token()), gate(where, token) {}

  using Handler = std::function<void(const httplib::Request&, httplib::Response&)>;

  /// A handler whose request names a viewer, and whose errors become answers.
  Handler for_viewer(Handler handler) {
    return [this, handler](const httplib::Request& request, httplib::Response& response) {
      try {
        queue.note(viewer_of(parameters(request)));
        handler(request, response);
      } catch (const ConfigError& problem) {
        say(response, 400, problem.what());
      } catch (const std::exception& problem) {
        say(response, 503, problem.what());
      }
    };
  }

  static Parameter parameters(const httplib::Request& request) {
    return [&request](const char* name) { return request.get_param_value(name); };
  }

  void limit() {
    http.new_task_queue = [] { return new BoundedPool; };  // the library deletes it
    http.set_socket_options(set_socket_options);
    http.set_tcp_nodelay(true);
    http.set_default_headers({{"Cache-Control", "no-store"},
                              {"X-Content-Type-Options", "nosniff"},
                              {"X-Frame-Options", "DENY"},
                              {"Cross-Origin-Resource-Policy", "same-origin"},
                              {"Referrer-Policy", "no-referrer"}});
    http.set_pre_routing_handler(
        [this](const httplib::Request& request, httplib::Response& response) {
          const auto refusal = gate.refuse(knock_of(request));
          if (!refusal) return httplib::Server::HandlerResponse::Unhandled;
          say(response, refusal->status, refusal->reason);
          return httplib::Server::HandlerResponse::Handled;
        });
  }

  void route() {
    http.Get("/", [this](const httplib::Request&, httplib::Response& response) {
      const std::lock_guard<std::mutex> lock(page_mutex);
      send(response, page);
    });
    http.Get("/frame", for_viewer([this](const auto& request, auto& response) {
               const Parameter parameter = parameters(request);
               const Wanted wanted = wanted_frame(parameter);
               send(response, queue.ask(viewer_of(parameter) + "/frame", wanted, kFrameWait),
                    /*lossless=*/false);
             }));
    http.Get("/picture", for_viewer([this](const auto& request, auto& response) {
               const Parameter parameter = parameters(request);
               const Wanted wanted = wanted_picture(parameter);
               const std::string key =
                   viewer_of(parameter) + "/" + wanted.view + "/" + wanted.picture;
               send(response, queue.ask(key, wanted, kPictureWait), /*lossless=*/true);
             }));
    http.Get("/camera", for_viewer([this](const auto& request, auto& response) {
               const Parameter parameter = parameters(request);
               const Wanted wanted = wanted_camera(parameter);
               const Answer answer =
                   queue.ask(viewer_of(parameter) + "/camera", wanted, kFrameWait);
               if (was_rendered(answer, response)) {
                 response.set_content(answer.rendered.json, "application/json");
               }
             }));
    http.Get("/state", for_viewer([this](const auto& request, auto& response) {
               response.set_content(board.json(number_of(request, "generation"),
                                               number_of(request, "from"), queue.viewers()),
                                    "application/json");
             }));
    const Handler pause = for_viewer([this](const auto& request, auto& response) {
      const std::string on = request.get_param_value("on");
      if (on != "0" && on != "1") throw ConfigError("on: expected 1 or 0");
      queue.set_paused(on == "1");
      response.status = 204;
    });
    // Uses a content reader, which is ignored, so that the library does not wait for a body.
    http.Post("/pause", [pause](const httplib::Request& request, httplib::Response& response,
                                const httplib::ContentReader&) { pause(request, response); });
  }

  void listen(const std::string& flag) {
    errno = 0;
    const char* const host = address.host.c_str();  // type required by cpp-httplib 0.10
    if (address.port == 0) {
      address.port = http.bind_to_any_port(host);
    } else if (!http.bind_to_port(host, address.port)) {
      address.port = -1;
    }
    if (address.port < 0) {
      const int reason = errno;
      throw ConfigError(concat(flag, ": expected an address where this machine can listen, found: ",
                               reason == 0 ? "none" : std::strerror(reason),
                               "; choose another port, or 0 for any free one"));
    }
    thread = std::thread([this] { http.listen_after_bind(); });
    while (!http.is_running()) std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
};

Server::Server(const Address& address, const std::string& flag)
    : impl_(std::make_unique<Impl>(address)) {
  impl_->limit();
  impl_->route();
  impl_->listen(concat(flag, " ", to_string(address)));
}

Server::~Server() {
  impl_->queue.close();
  impl_->http.hurry();
  impl_->http.stop();
  impl_->thread.join();
}

std::string Server::url() const {
  Address shown = impl_->address;
  std::array<char, 256> machine{};
  const bool any = shown.host == "0.0.0.0" || shown.host == "::";
  if (any && gethostname(machine.data(), machine.size() - 1) == 0) shown.host = machine.data();
  return concat("http://", to_string(shown), "/",
                impl_->token.empty() ? "" : "?token=" + impl_->token);
}

void Server::show(std::string html) {
  auto page = std::make_shared<const std::string>(std::move(html));
  const std::lock_guard<std::mutex> lock(impl_->page_mutex);
  impl_->page = std::move(page);
}

RenderQueue& Server::queue() { return impl_->queue; }
Board& Server::board() { return impl_->board; }

}  // namespace jade::serve
