// SPDX-License-Identifier: Apache-2.0
// Lossless WebP images as byte containers.
#pragma once

#include <string>
#include <string_view>
#include <torch/types.h>

namespace jade::io {

/// Encodes uint8 [H,W,4] on the CPU as lossless WebP; pixels with a fourth byte of 0 keep the other
/// three. Sides of 1 to 16383.
/// @throws DataError if the library fails.
std::string encode_webp(const torch::Tensor& rgba);

/// The pixels of a lossless WebP file, uint8 [H,W,4].
/// @param name  of the file, for messages
/// @throws DataError for damaged bytes, for lossy images and for other files.
torch::Tensor decode_webp(std::string_view bytes, const std::string& name);

}  // namespace jade::io
