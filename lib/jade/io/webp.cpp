// SPDX-License-Identifier: Apache-2.0
#include "jade/io/webp.h"

#include <memory>
#include <webp/decode.h>
#include <webp/encode.h>

#include "jade/core/check.h"
#include "jade/core/error.h"

namespace jade::io {
namespace {

/// Frees the encoder's picture.
struct FreePicture {
  void operator()(WebPPicture* picture) const { WebPPictureFree(picture); }
};

}  // namespace

std::string encode_webp(const torch::Tensor& rgba) {
  JADE_CHECK(rgba.dim() == 3 && rgba.size(2) == 4 && rgba.scalar_type() == torch::kUInt8,
             "encode_webp: expected uint8 [H,W,4], found ", rgba.sizes());
  const torch::Tensor pixels = rgba.contiguous();
  WebPConfig config;
  WebPPicture picture;
  if (!WebPConfigInit(&config) || !WebPPictureInit(&picture)) {
    throw DataError("libwebp cannot start");
  }
  const std::unique_ptr<WebPPicture, FreePicture> free_picture(&picture);
  WebPMemoryWriter writer;
  WebPMemoryWriterInit(&writer);
  const std::unique_ptr<WebPMemoryWriter, decltype(&WebPMemoryWriterClear)> free_writer(
      &writer, &WebPMemoryWriterClear);
  // Level 6 of 0 to 9 is the library's default balance of time and size.
  WebPConfigLosslessPreset(&config, 6);
  config.exact = 1;
  picture.use_argb = 1;
  picture.width = static_cast<int>(pixels.size(1));
  picture.height = static_cast<int>(pixels.size(0));
  picture.writer = WebPMemoryWrite;
  picture.custom_ptr = &writer;
  const bool done =
      WebPPictureImportRGBA(&picture, pixels.data_ptr<uint8_t>(), 4 * picture.width) != 0 &&
      WebPEncode(&config, &picture) != 0;
  if (!done) throw DataError(concat("libwebp failed (", picture.error_code, ")"));
  return {reinterpret_cast<const char*>(writer.mem), writer.size};
}

torch::Tensor decode_webp(std::string_view bytes, const std::string& name) {
  constexpr int kLossless = 2;
  const auto* const data = reinterpret_cast<const uint8_t*>(bytes.data());
  WebPBitstreamFeatures features;
  if (WebPGetFeatures(data, bytes.size(), &features) == VP8_STATUS_OK &&
      features.format != kLossless) {
    throw DataError(concat(name, ": expected a lossless WebP image, found one whose compression ",
                           "changed its numbers; get the original file, or write it again"));
  }
  int width = 0, height = 0;
  const std::unique_ptr<uint8_t, decltype(&WebPFree)> pixels(
      WebPDecodeRGBA(data, bytes.size(), &width, &height), &WebPFree);
  if (!pixels) {
    throw DataError(
        concat(name, ": expected a WebP image, found a damaged or other file; copy it ", "again"));
  }
  return torch::from_blob(pixels.get(), {height, width, 4}, torch::kUInt8).clone();
}

}  // namespace jade::io
