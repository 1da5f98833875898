// SPDX-License-Identifier: Apache-2.0
// Parts of the .npy format that npy.cpp and npz.cpp share. Private to this folder.
#pragma once

#include <cstddef>
#include <string>
#include <torch/types.h>

namespace jade::io {

struct NpyType {
  torch::ScalarType dtype = torch::kFloat32;  ///< Type of the tensor.
  size_t item_size = 0;                       ///< Size of a stored item in bytes.
  bool widened = false;                       ///< Stored unsigned, converted to a wider signed
                                              ///< type.
  bool swapped = false;                       ///< Stored big-endian.
};

/// Fills `type` for a NumPy kind letter ('i', 'u', 'f', 'b') and size digit; false if unknown.
bool npy_scalar(char kind, char size, NpyType* type);

/// The bytes before the data of a contiguous CPU tensor.
std::string npy_header(const torch::Tensor& tensor, const std::string& name);

}  // namespace jade::io
