// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// Reads an image file as [3,H,W] RGB float32 in [0,1] on the CPU. PNG, JPEG, TIFF, BMP, WebP, PNM
/// and whatever else the installed OpenCV reads, 8 or 16 bits per channel; gray becomes three equal
/// channels, alpha is left to read_alpha(), rotation tags are ignored. `.npy` files hold [3,H,W],
/// [1,H,W] or [H,W] of a floating type and are taken as they are.
/// @throws DataError naming the path of a missing, empty or foreign file, and of floats past [0,1].
torch::Tensor read_image(const std::filesystem::path& path);

/// How opaque an image is: [1,H,W] float32 in [0,1], 1 where it hides what is behind. Undefined for
/// files without alpha and where all of it is 1.
/// @throws DataError as read_image().
torch::Tensor read_alpha(const std::filesystem::path& path);

/// A mask that is kept as an image: [1,H,W] bool, true where any colour channel is not 0 and alpha,
/// if there is one, is at least half of full. Lossy formats (JPEG) count from half of full on.
/// @throws DataError as read_image().
torch::Tensor read_mask(const std::filesystem::path& path);

struct ImageWriteOptions {
  int bits = 8;           ///< 8, or 16 where the format has it (PNG, TIFF)
  int jpeg_quality = 95;  ///< 0 to 100
};

/// Writes [3,H,W] RGB or [1,H,W] gray, any floating type and device, in the format of the file's
/// extension. Values are clamped to [0,1] and rounded to the nearest step, NaN becomes 0; `.npy`
/// keeps float32 values as they are. Folders on the way are made.
/// @throws DataError naming the path when the format is unknown or writing fails.
void write_image(const std::filesystem::path& path, const torch::Tensor& image,
                 const ImageWriteOptions& options = {});

/// The PNG file of an image as bytes, for reports that embed it.
std::vector<uint8_t> encode_png(const torch::Tensor& image);

/// The JPEG file of an image as bytes.
/// @param quality  0 to 100
std::vector<uint8_t> encode_jpeg(const torch::Tensor& image, int quality);

/// The order of frames by their names: text, but runs of digits by their number, so that frame_2
/// comes before frame_10. Where the digits of all names are padded alike it is the order of text;
/// recordings and data sets of every layout go by it.
bool comes_before(const std::string& name, const std::string& other);

/// Image files directly in `folder` (extensions read_image knows, but not `.npy`), hidden ones left
/// out, in that order.
/// @throws DataError naming the folder when it is missing.
std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder);

}  // namespace jade::imaging
