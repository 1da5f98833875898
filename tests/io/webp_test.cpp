// SPDX-License-Identifier: Apache-2.0
#include "jade/io/webp.h"

#include "support/catch.h"

#include "jade/core/error.h"

namespace jade::io {
namespace {

TEST_CASE("webp: every byte is restored, also under alpha 0", "[io]") {
  torch::manual_seed(1);
  torch::Tensor pixels = torch::randint(0, 256, {9, 17, 4}, torch::kUInt8);
  pixels.select(2, 3).slice(0, 0, 4).zero_();
  const std::string bytes = encode_webp(pixels);
  CHECK(bytes.substr(0, 4) == "RIFF");
  CHECK(decode_webp(bytes, "a").equal(pixels));
  CHECK_THROWS_AS(decode_webp(bytes.substr(0, bytes.size() / 2), "a"), DataError);
  CHECK_THROWS_AS(decode_webp("", "a"), DataError);
}

}  // namespace
}  // namespace jade::io
