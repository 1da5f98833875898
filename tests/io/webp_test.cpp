// SPDX-License-Identifier: Apache-2.0
#include "jade/io/webp.h"

#include "support/catch.h"

#include <webp/encode.h>

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

TEST_CASE("webp: an image with losses is refused", "[io]") {
  torch::Tensor pixels = torch::full({2, 2, 4}, 200, torch::kUInt8);
  uint8_t* output = nullptr;
  const size_t size = WebPEncodeRGBA(pixels.data_ptr<uint8_t>(), 2, 2, 8, 50, &output);
  REQUIRE(size > 0);
  const std::string bytes(reinterpret_cast<const char*>(output), size);
  WebPFree(output);
  CHECK_THROWS_WITH(decode_webp(bytes, "a"), Catch::Contains("expected a lossless WebP"));
}

}  // namespace
}  // namespace jade::io
