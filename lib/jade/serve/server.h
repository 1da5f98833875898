// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "jade/serve/address.h"
#include "jade/serve/board.h"
#include "jade/serve/render_queue.h"

namespace jade::serve {

/// The live page over HTTP, on separate threads:
///
///   GET /            the page of show(), or a note that it is being prepared
///   GET /frame       JPEG of the request in wanted_frame(); headers X-Step, X-Gaussians and, if
///   there
///                    is a true sharp image, X-Psnr in dB
///   GET /picture     PNG of the request in wanted_picture(), with the same headers
///   GET /camera      Rendered::json of the request in wanted_camera()
///   GET /state       Board::json(); parameters generation and from
///   POST /pause      parameter on: 1 or 0
///
/// and nothing else: no file is read. All but / name their viewer (viewer_of()). 204: not rendered
/// in time, retry; 400, 401, 403, 404, 413, 421, 503: one line of text with the reason (gate.h).
/// One request per connection, a limited number at a time.
class Server {
 public:
  /// Starts listening. If other machines can reach the address, requests need a token.
  /// @param flag  name of the address option for messages
  /// @throws ConfigError if the address is unavailable, or in a build without a web server.
  Server(const Address& address, const std::string& flag);
  /// Answers waiting requests and stops; takes at most 2 s, for a client that does not read.
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

/// False in a build without cpp-httplib; the constructor of Server then throws.
bool can_serve();

}  // namespace jade::serve
