// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/address.h"

#include <algorithm>
#include <arpa/inet.h>
#include <charconv>

#include "jade/core/error.h"

namespace jade::serve {
namespace {

constexpr int kLargestPort = 65535;

bool only_digits(const std::string& text) {
  return !text.empty() && std::all_of(text.begin(), text.end(),
                                      [](unsigned char c) { return c >= '0' && c <= '9'; });
}

bool is_ipv6(const std::string& host) {
  in6_addr parsed{};
  return inet_pton(AF_INET6, host.c_str(), &parsed) == 1;
}

/// -1 for an invalid port.
int port_of(const std::string& text) {
  int port = -1;
  if (!only_digits(text)) return -1;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), port);
  const bool whole = error == std::errc() && end == text.data() + text.size();
  return whole && port <= kLargestPort ? port : -1;
}

}  // namespace

bool is_ip(const std::string& host) {
  in_addr parsed{};
  return inet_pton(AF_INET, host.c_str(), &parsed) == 1 || is_ipv6(host);
}

Address parse_address(const std::string& text, const std::string& flag) {
  Address address;
  if (text.empty()) return address;
  std::string host = address.host, port;
  if (only_digits(text)) {
    port = text;
  } else if (is_ip(text)) {
    host = text;
  } else {
    const size_t colon = text.rfind(':');
    // In "[::1]" the last colon belongs to the address.
    const bool has_port = colon != std::string::npos && text.back() != ']';
    host = text.substr(0, has_port ? colon : text.size());
    if (has_port) port = text.substr(colon + 1);
    if (host.size() > 2 && host.front() == '[' && host.back() == ']') {
      host = host.substr(1, host.size() - 2);
      if (!is_ipv6(host)) host.clear();
    }
    if (has_port && port.empty()) host.clear();
  }
  address.host = host;
  if (!port.empty()) address.port = port_of(port);
  if (address.port < 0 || !(is_ip(host) || host == "localhost")) {
    throw ConfigError(concat(flag, " ", text,
                             ": expected an IP address and a port from 0 to 65535, such as "
                             "127.0.0.1:8080, [::1]:8080 or 8080"));
  }
  return address;
}

bool is_loopback(const Address& address) {
  in_addr parsed{};
  if (inet_pton(AF_INET, address.host.c_str(), &parsed) == 1) {
    return (ntohl(parsed.s_addr) >> 24) == 127;
  }
  in6_addr six{};
  return address.host == "localhost" ||
         (inet_pton(AF_INET6, address.host.c_str(), &six) == 1 && IN6_IS_ADDR_LOOPBACK(&six));
}

std::string to_string(const Address& address) {
  const bool six = is_ipv6(address.host);
  return concat(six ? "[" : "", address.host, six ? "]:" : ":", address.port);
}

}  // namespace jade::serve
