// SPDX-License-Identifier: Apache-2.0
#include "jade/core/error.h"
#include "jade/serve/server.h"

namespace jade::serve {

struct Server::Impl {
  RenderQueue queue;
  Board board;
};

bool can_serve() { return false; }

Server::Server(const Address& address, const std::string& flag) {
  throw ConfigError(concat(flag, " ", to_string(address),
                           ": this build has no web server; install libcpp-httplib-dev "
                           "(scripts/setup.sh), configure and build again"));
}

Server::~Server() = default;
std::string Server::url() const { return {}; }
void Server::show(std::string) {}
RenderQueue& Server::queue() { return impl_->queue; }
Board& Server::board() { return impl_->board; }

}  // namespace jade::serve
