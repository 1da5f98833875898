// SPDX-License-Identifier: Apache-2.0
#include "jade/page/base64.h"

#include "support/catch.h"

#include <string>
#include <utility>

using namespace jade;

TEST_CASE("base64: the vectors of RFC 4648, and bytes beyond 127", "[page]") {
  const std::pair<const char*, const char*> vectors[] = {{"", ""},
                                                         {"f", "Zg=="},
                                                         {"fo", "Zm8="},
                                                         {"foo", "Zm9v"},
                                                         {"foob", "Zm9vYg=="},
                                                         {"fooba", "Zm9vYmE="},
                                                         {"foobar", "Zm9vYmFy"}};
  for (const auto& [bytes, text] : vectors) CHECK(page::base64(bytes) == text);
  CHECK(page::base64(std::string("\xff\0\xfe\x80", 4)) == "/wD+gA==");
}
