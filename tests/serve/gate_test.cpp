// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/gate.h"

#include "support/catch.h"

using namespace jade;
using serve::Gate;
using serve::Knock;

namespace {

/// Status of the refusal; 0 for none.
int status_of(const Gate& gate, const Knock& knock) {
  const auto refusal = gate.refuse(knock);
  return refusal ? refusal->status : 0;
}

Knock knock_at(const std::string& host) {
  Knock knock;
  knock.path = "/frame";
  knock.host = host;
  return knock;
}

}  // namespace

TEST_CASE("gate: on loopback only names of this machine's loopback pass, on any port", "[serve]") {
  const Gate gate({"127.0.0.1", 8080}, "");
  for (const char* host : {"127.0.0.1:8080", "localhost:9000", "LocalHost:80", "localhost",
                           "[::1]:8080", "127.0.0.2"}) {
    INFO(host);
    CHECK(status_of(gate, knock_at(host)) == 0);
  }
  for (const char* host : {"", "evil.example", "evil.example:8080", "localhost.evil.example:8080",
                           "10.0.0.1:8080", "127.0.0.1.evil.example", "[::1", "[evil]:80"}) {
    INFO(host);
    CHECK(status_of(gate, knock_at(host)) == 421);
  }
}

TEST_CASE("gate: a page of another site reaches nothing; a link may open the page", "[serve]") {
  const Gate gate({"127.0.0.1", 8080}, "");
  Knock knock = knock_at("127.0.0.1:8080");
  knock.origin = "http://127.0.0.1:8080";
  CHECK(status_of(gate, knock) == 0);
  for (const char* origin : {"http://evil.example", "null", "http://127.0.0.1:9000",
                             "https://127.0.0.1:8080", "http://127.0.0.1:8080.evil.example"}) {
    INFO(origin);
    knock.origin = origin;
    CHECK(status_of(gate, knock) == 403);
  }
  knock.origin.clear();
  for (const char* site : {"cross-site", "same-site"}) {
    knock.fetch_site = site;
    knock.fetch_mode = "no-cors";
    knock.path = "/frame";
    CHECK(status_of(gate, knock) == 403);
    knock.path = "/";
    CHECK(status_of(gate, knock) == 403);
    knock.fetch_mode = "navigate";
    CHECK(status_of(gate, knock) == 0);
    knock.path = "/frame";
    CHECK(status_of(gate, knock) == 403);
  }
  knock.fetch_site = "same-origin";
  CHECK(status_of(gate, knock) == 0);
}

TEST_CASE("gate: elsewhere than on loopback every request knows the token", "[serve]") {
  const std::string token = serve::make_token();
  CHECK(token.size() == 32);
  CHECK(token != serve::make_token());
  const Gate gate({"0.0.0.0", 8080}, token);
  Knock knock = knock_at("10.0.0.3:8080");
  for (const std::string& wrong :
       {std::string(), token.substr(1), token + "0", std::string(token.rbegin(), token.rend())}) {
    knock.token = wrong;
    CHECK(status_of(gate, knock) == 401);
  }
  knock.token = token;
  CHECK(status_of(gate, knock) == 0);
  knock.host = "evil.example:8080";
  CHECK(status_of(gate, knock) == 421);
}

TEST_CASE("gate: a body is small and says how small", "[serve]") {
  const Gate gate({"127.0.0.1", 8080}, "");
  Knock knock = knock_at("127.0.0.1:8080");
  for (const char* length : {"", "0", "1024"}) {
    knock.content_length = length;
    CHECK(status_of(gate, knock) == 0);
  }
  for (const char* length : {"1025", "99999999999999999999", "-1", "12x", "1e9"}) {
    knock.content_length = length;
    CHECK(status_of(gate, knock) == 413);
  }
  knock.content_length.clear();
  knock.transfer_encoding = "chunked";
  CHECK(status_of(gate, knock) == 413);
}
