// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <torch/types.h>
#include <vector>

namespace jade::imaging {

/// Reads an image file as [3,H,W] RGB float32 in [0,1] on the CPU. Supports PNG, JPEG, TIFF, BMP,
/// WebP, PNM and other formats of the installed OpenCV, 8 or 16 bits per channel. Gray becomes
/// three equal channels; alpha (see read_alpha) and rotation tags are ignored. `.npy` files contain
/// [3,H,W], [1,H,W] or [H,W] of a floating type and are not rescaled.
/// @param fault  receives a line about data that are read but may be wrong, such as values above
///   the white level of a PGM, else becomes empty; null: such a file is a DataError
/// @throws DataError naming the path of a missing, empty or unsupported file, and for floats beyond
///   [0,1].
torch::Tensor read_image(const std::filesystem::path& path, std::string* fault = nullptr);

/// One line for all faults that read_image() found in several files, some of which may be empty;
/// empty if all are.
std::string fault_of_all(const std::vector<std::string>& faults);

/// Opacity of an image: [1,H,W] float32 in [0,1], 1 is opaque. Undefined for files without alpha or
/// with alpha 1 everywhere.
/// @throws DataError as read_image().
torch::Tensor read_alpha(const std::filesystem::path& path);

/// Reads a mask stored as an image: [1,H,W] bool, true if any colour channel is not 0 and alpha, if
/// there is one, is at least half of full. In lossy formats (JPEG) a channel must be at least half
/// of full.
/// @throws DataError as read_image().
torch::Tensor read_mask(const std::filesystem::path& path);

struct ImageWriteOptions {
  int bits = 8;           ///< 8, or 16 if the format supports it (PNG, TIFF)
  int jpeg_quality = 95;  ///< 0 to 100
};

/// Writes [3,H,W] RGB or [1,H,W] gray, any floating type and device, in the format of the file's
/// extension. Values are clamped to [0,1] and rounded to the nearest step, NaN becomes 0; `.npy`
/// stores float32 values unchanged. Creates missing folders.
/// @throws DataError naming the path if the format is unknown or writing fails.
void write_image(const std::filesystem::path& path, const torch::Tensor& image,
                 const ImageWriteOptions& options = {});

/// Encodes an image as a PNG file in memory, for reports that embed it.
std::vector<uint8_t> encode_png(const torch::Tensor& image);

/// Encodes an image as a JPEG file in memory.
/// @param quality  0 to 100
std::vector<uint8_t> encode_jpeg(const torch::Tensor& image, int quality);

/// Sort order of frames by name: runs of digits compare as numbers, so that frame_2 precedes
/// frame_10. If all names are zero-padded alike it is the order of text. All readers of recordings
/// and data sets use it.
bool comes_before(const std::string& name, const std::string& other);

/// Whether the names of files are numbers that count behind their point, as 3.001, 3.002, or 1.9,
/// 1.10: no fractions. False with fewer than two files.
bool counts_fractions(const std::vector<std::filesystem::path>& files);

/// Number of pages of a TIFF, 1 if its second page has another size (as a thumbnail) and for other
/// files. read_image() reads the first page.
size_t count_pages(const std::filesystem::path& path);

/// Writes the pages of a TIFF, unchanged, as 00000000.tif, 00000001.tif, … into a folder, which it
/// creates.
/// @throws DataError if a page cannot be decoded or written.
std::vector<std::filesystem::path> split_pages(const std::filesystem::path& path,
                                               const std::filesystem::path& folder);

/// Whether the file's extension is that of an image that read_image() reads, except `.npy`.
bool is_image_file(const std::filesystem::path& path);

/// Image files directly in `folder` (extensions of read_image, except `.npy`), without hidden ones,
/// in that order. Names that all are decimal fractions and do not count are in the order of their
/// values: 0.17 before 0.4.
/// @throws DataError naming the folder if it is missing.
std::vector<std::filesystem::path> list_images(const std::filesystem::path& folder);

}  // namespace jade::imaging
