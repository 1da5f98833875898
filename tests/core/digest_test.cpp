// SPDX-License-Identifier: Apache-2.0
#include "jade/core/digest.h"

#include "support/catch.h"

#include <string>
#include <utility>

#include "jade/core/error.h"
#include "support/temp_dir.h"

namespace jade {
namespace {

TEST_CASE("Sha256: gives the published digest of 'abc' (FIPS 180-4)", "[core]") {
  const test::TempDir dir;
  const std::string expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
  CHECK(file_sha256(dir.write("file", "abc")) == expected);
  Sha256 pieces;
  pieces.update("a");
  pieces.update("bc");
  CHECK(pieces.hex() == expected);
  CHECK_THROWS_AS(file_sha256(dir.path() / "missing"), DataError);
}

TEST_CASE("base64: the vectors of RFC 4648, and bytes beyond 127", "[core]") {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, text] : vectors) CHECK(base64(bytes) == text);
  CHECK(base64(std::string("\xff\0\xfe\x80", 4)) == "/wD+gA==");
}

}  // namespace
}  // namespace jade
