// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/gate.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <random>
#include <unistd.h>
#include <utility>

#include "jade/core/error.h"
#include "jade/core/text.h"

namespace jade::serve {
namespace {

/// "localhost:8080", "[::1]:8080" or "10.0.0.3" without port and brackets.
std::string name_of(const std::string& host) {
  if (!host.empty() && host.front() == '[') {
    const size_t end = host.find(']');
    return end == std::string::npos ? std::string() : host.substr(1, end - 1);
  }
  return host.substr(0, host.rfind(':'));
}

/// Host names are case-insensitive; browsers send lower case.
std::string machine_name() {
  std::array<char, 256> name{};
  return gethostname(name.data(), name.size() - 1) == 0 ? in_small_letters(name.data()) : "";
}

bool is_large(const std::string& content_length) {
  if (content_length.empty()) return false;
  long length = -1;
  const char* end = content_length.data() + content_length.size();
  const auto parsed = std::from_chars(content_length.data(), end, length);
  return parsed.ec != std::errc() || parsed.ptr != end || length < 0 || length > Gate::kLargestBody;
}

/// Takes constant time, independent of the number of matching characters.
bool same(const std::string& a, const std::string& b) {
  unsigned char difference = a.size() == b.size() ? 0 : 1;
  for (size_t i = 0; i < std::min(a.size(), b.size()); ++i) {
    difference = static_cast<unsigned char>(difference | (a[i] ^ b[i]));
  }
  return difference == 0;
}

}  // namespace

std::string make_token() {
  std::random_device source;
  std::string token;
  for (int i = 0; i < 32; ++i) token += "0123456789abcdef"[source() % 16];
  return token;
}

Gate::Gate(const Address& address, std::string token)
    : loopback_(is_loopback(address)), token_(std::move(token)), machine_(machine_name()) {}

bool Gate::is_ours(const std::string& host) const {
  const std::string name = in_small_letters(name_of(host));
  // A tunnel changes the port, so any port is allowed; other host names are not.
  if (name == "localhost") return true;
  if (is_ip(name)) return !loopback_ || is_loopback({name, 0});
  if (loopback_ || machine_.empty()) return false;
  return name == machine_ || name.rfind(machine_ + ".", 0) == 0;
}

std::optional<Refusal> Gate::refuse(const Knock& knock) const {
  if (!is_ours(knock.host)) {
    return Refusal{421, concat("expected this server's address as Host, found '", knock.host, "'")};
  }
  if (!knock.origin.empty() && knock.origin != "http://" + knock.host) {
    return Refusal{403, "a page of another site may not ask"};
  }
  // A link from another site may open the page, nothing else.
  const bool opens_page = knock.path == "/" && knock.fetch_mode == "navigate";
  const std::string& site = knock.fetch_site;
  if (!site.empty() && site != "same-origin" && site != "none" && !opens_page) {
    return Refusal{403, "a page of another site may not ask"};
  }
  if (!token_.empty() && !same(knock.token, token_)) {
    return Refusal{401, "the address needs the token that the program has printed: /?token=..."};
  }
  if (!knock.transfer_encoding.empty() || is_large(knock.content_length)) {
    return Refusal{413, concat("expected at most ", kLargestBody, " bytes")};
  }
  return std::nullopt;
}

}  // namespace jade::serve
