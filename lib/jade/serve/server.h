// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "jade/serve/address.h"
#include "jade/serve/board.h"
#include "jade/serve/render_queue.h"

namespace jade::serve {

/// The live page over HTTP, from threads of its own:
///
///   GET /            the page of show(), or a note that it is on its way
///   GET /frame       JPEG of what wanted_frame() reads; headers X-Step, X-Gaussians and, where a
///                    sharp truth tells, X-Psnr in dB
///   GET /picture     PNG of what wanted_picture() reads, with the same headers
///   GET /camera      Rendered::json of what wanted_camera() reads
///   GET /state       Board::json(); parameters generation and from
///   POST /pause      parameter on: 1 or 0
///
/// and nothing else: no file is read. All but / name their viewer (viewer_of()). 204: not rendered
/// in time, ask again; 400, 401, 403, 404, 413, 421, 503: one line of text with the reason
/// (gate.h). One request per connection, a bounded number at a time.
class Server {
 public:
  /// Listens at once. Where others than this machine can reach the address, requests need a token.
  /// @param flag  what a message calls the address
  /// @throws ConfigError where the address cannot be had, or in a build without a web server.
  Server(const Address& address, const std::string& flag);
  /// Answers who waits and stops; takes 2 s at most, for a viewer that does not read.
  ~Server();
  Server(const Server&) = delete;
  Server& operator=(const Server&) = delete;

  /// URL to open, with the chosen port and the token.
  std::string url() const;
  void show(std::string html);
  RenderQueue& queue();
  Board& board();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

/// False in a build that found no cpp-httplib; Server says so.
bool can_serve();

}  // namespace jade::serve
