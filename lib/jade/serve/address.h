// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace jade::serve {

/// Address and port on which a server listens.
struct Address {
  std::string host = "127.0.0.1";  ///< an IPv4 or IPv6 address, or localhost
  int port = 8080;                 ///< 0: any free one
};

/// Parses ADDRESS:PORT, ADDRESS or PORT; an IPv6 address must be in brackets. Empty is the default.
/// Rejects host names other than localhost, because their meaning may change after the check.
/// @param flag  name of the option for messages
/// @throws ConfigError.
Address parse_address(const std::string& text, const std::string& flag);

/// True for 127.0.0.0/8, ::1 and localhost, which other machines cannot reach.
bool is_loopback(const Address& address);

/// "127.0.0.1:8080", "[::1]:8080".
std::string to_string(const Address& address);

/// True for an IPv4 address, or an IPv6 address without brackets.
bool is_ip(const std::string& host);

}  // namespace jade::serve
