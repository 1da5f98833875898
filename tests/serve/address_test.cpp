// SPDX-License-Identifier: Apache-2.0
#include "jade/serve/address.h"

#include "support/catch.h"

#include "jade/core/error.h"

using namespace jade;

TEST_CASE("address: an address, a port, or both", "[serve]") {
  const auto read = [](const std::string& text) {
    return serve::to_string(serve::parse_address(text, "--serve"));
  };
  CHECK(read("") == "127.0.0.1:8080");
  CHECK(read("9000") == "127.0.0.1:9000");
  CHECK(read("0") == "127.0.0.1:0");
  CHECK(read("0.0.0.0") == "0.0.0.0:8080");
  CHECK(read("10.0.0.3:65535") == "10.0.0.3:65535");
  CHECK(read("localhost:1") == "localhost:1");
  CHECK(read("::1") == "[::1]:8080");
  CHECK(read("[::1]") == "[::1]:8080");
  CHECK(read("[fe80::1]:81") == "[fe80::1]:81");
}

TEST_CASE("address: what is none is refused with what is expected", "[serve]") {
  for (const char* text :
       {"65536", "99999999999999999999", "-1", "127.0.0.1:", "127.0.0.1:x", "127.0.0.1:80x", ":80",
        "127.0.0.256:80", "example.org:80", "[127.0.0.1]:80", "[::1]:70000", "[::1", "8080 ",
        "http://127.0.0.1:80"}) {
    INFO(text);
    try {
      serve::parse_address(text, "--serve");
      FAIL("no error");
    } catch (const ConfigError& error) {
      CHECK_THAT(error.what(), Catch::Contains(concat("--serve ", text, ": expected")));
    }
  }
}

TEST_CASE("address: which ones other machines cannot reach", "[serve]") {
  for (const char* host : {"127.0.0.1", "127.9.8.7", "localhost", "::1"}) {
    CHECK(serve::is_loopback({host, 80}));
  }
  for (const char* host : {"0.0.0.0", "::", "10.0.0.127", "128.0.0.1", "fe80::1"}) {
    CHECK_FALSE(serve::is_loopback({host, 80}));
  }
}
