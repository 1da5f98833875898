// SPDX-License-Identifier: Apache-2.0
#include "jade/io/uri.h"

#include "support/catch.h"

namespace jade::io {
namespace {

TEST_CASE("uri: escapes are decoded, other percent signs stay", "[io]") {
  CHECK(unescaped("my%20sc%C3%A8ne%2fa.bin") == "my scène/a.bin");
  for (const char* const plain : {"", "a.bin", "100%", "100%.bin", "%2", "a%00b", "50%zz"}) {
    CHECK(unescaped(plain) == plain);
  }
}

}  // namespace
}  // namespace jade::io
