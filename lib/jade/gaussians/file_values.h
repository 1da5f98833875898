// SPDX-License-Identifier: Apache-2.0
// Conversions of numbers that several file formats of Gaussians share. Private to this folder.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <torch/types.h>
#include <vector>

#include "jade/geometry/pose.h"
#include "jade/splat/gaussians.h"

namespace jade::gaussians {

/// Replaces opacities and scales that exceed float's range or every renderer's limits by the
/// nearest equivalent values. Returns the number of flat Gaussians.
int64_t make_finite(splat::Gaussians& gaussians);

/// An origin near the points if they are far from their own; else zero.
/// @param places  [P,3]
geometry::Vector3 found_origin(const torch::Tensor& places);

/// The SH degree with that many coefficients: 1, 4, 9 or 16.
int sh_degree_of(int64_t coefficients);

/// Values rounded to bytes and clamped to 0 to 255.
torch::Tensor to_bytes(const torch::Tensor& values);

/// The bytes of a tensor.
std::string content_of(const torch::Tensor& tensor);

/// Converts bytes to a float32 tensor of that shape. @pre the sizes match.
torch::Tensor numbers_of(std::string_view bytes, const std::vector<int64_t>& shape);

/// The little-endian unsigned number at `at`. @pre it lies within the bytes.
uint64_t unsigned_at(std::string_view bytes, size_t at, size_t size);

/// Appends a little-endian number.
void put_unsigned(std::string& out, uint64_t value, size_t size);

}  // namespace jade::gaussians
