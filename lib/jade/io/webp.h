// SPDX-License-Identifier: Apache-2.0
// WebP images as containers of bytes, which they keep exactly.
#pragma once

#include <string>
#include <string_view>
#include <torch/types.h>

namespace jade::io {

/// A lossless WebP file of uint8 [H,W,4] on the CPU; also pixels whose fourth byte is 0 keep the
/// others. Sides of 1 to 16383.
/// @throws DataError if the library fails.
std::string encode_webp(const torch::Tensor& rgba);

/// The pixels of a WebP file, uint8 [H,W,4].
/// @param name  stands for the file in messages
/// @throws DataError for damaged bytes and for other files.
torch::Tensor decode_webp(std::string_view bytes, const std::string& name);

}  // namespace jade::io
