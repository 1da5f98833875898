// SPDX-License-Identifier: Apache-2.0
#include "jade/io/zstd.h"

#include "support/catch.h"

#include "jade/core/error.h"

namespace jade::io {
namespace {

TEST_CASE("zstd: content is restored; damaged, longer and shorter content is rejected", "[io]") {
  std::string content(3'000'000, 'a');
  for (size_t i = 0; i < content.size(); i += 7) content[i] = static_cast<char>(i * i >> 5);
  for (const std::string& text : {content, std::string(), std::string("x")}) {
    CHECK(unzstd(zstd(text), text.size(), "a") == text);
  }
  const std::string packed = zstd(content);
  CHECK(packed.size() < content.size());
  CHECK_THROWS_AS(unzstd(packed, content.size() - 1, "a"), DataError);
  CHECK_THROWS_AS(unzstd(packed, content.size() + 1, "a"), DataError);
  CHECK_THROWS_AS(unzstd(packed.substr(0, packed.size() / 2), content.size(), "a"), DataError);
  CHECK_THROWS_AS(unzstd("no frame at all", 15, "a"), DataError);
  CHECK_THROWS_AS(unzstd("", 4, "a"), DataError);
}

}  // namespace
}  // namespace jade::io
