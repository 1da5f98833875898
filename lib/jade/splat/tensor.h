// SPDX-License-Identifier: Apache-2.0
// The tensor of the backends: torch's own in the programs, and with JADE_STABLE_ABI, for the Python
// package, that of LibTorch's stable ABI. cpu/ and cuda/ use nothing of torch but what is named
// here and the members that both types have.
#pragma once

#include <cstdint>
#include <initializer_list>
#ifdef JADE_STABLE_ABI
#include <torch/csrc/stable/device.h>
#include <torch/csrc/stable/ops.h>
#include <torch/csrc/stable/tensor.h>
#else
#include <torch/types.h>
#endif

namespace jade::splat {

#ifdef JADE_STABLE_ABI
using Tensor = torch::stable::Tensor;
using Device = torch::stable::Device;
#else
using Tensor = torch::Tensor;
using Device = torch::Device;
#endif
using ScalarType = torch::headeronly::ScalarType;

/// Uninitialised, on the device of `like`.
inline Tensor new_tensor(std::initializer_list<int64_t> sizes, ScalarType type,
                         const Tensor& like) {
#ifdef JADE_STABLE_ABI
  return torch::stable::empty({sizes.begin(), sizes.size()}, type, std::nullopt, like.device());
#else
  return torch::empty(torch::IntArrayRef(sizes.begin(), sizes.size()),
                      torch::TensorOptions().dtype(type).device(like.device()));
#endif
}

/// Uninitialised, with the shape, type and device of `like`.
inline Tensor new_like(const Tensor& like) {
#ifdef JADE_STABLE_ABI
  return torch::stable::empty_like(like);
#else
  return torch::empty_like(like);
#endif
}

/// The elements of a contiguous tensor; null if it is undefined.
template <class T>
T* pointer_to(const Tensor& tensor) {
  if (!tensor.defined()) return nullptr;
#ifdef JADE_STABLE_ABI
  return tensor.mutable_data_ptr<T>();
#else
  return tensor.data_ptr<T>();
#endif
}

}  // namespace jade::splat
