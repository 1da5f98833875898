// SPDX-License-Identifier: Apache-2.0
// The tensor type of the backends: torch's own in the programs, and with JADE_STABLE_ABI, for the
// Python package, that of LibTorch's stable ABI. cpu/ and cuda/ use only the functions declared
// here and members that both types have.
#pragma once

#include <cstdint>
#include <initializer_list>
#ifdef JADE_STABLE_ABI
#include <torch/csrc/inductor/aoti_torch/c/shim.h>
#include <torch/csrc/stable/device.h>
#include <torch/csrc/stable/tensor.h>
#include <torch/headeronly/util/shim_utils.h>
#include <utility>
#include <vector>
#else
#include <torch/types.h>
#endif

namespace jade::splat {

#ifdef JADE_STABLE_ABI
/// All undefined tensors share one handle: the stable ABI's default constructor allocates twice.
class Tensor : public torch::stable::Tensor {
 public:
  Tensor() : Tensor(undefined()) {}
  explicit Tensor(AtenTensorHandle handle) : torch::stable::Tensor(handle) {}
  Tensor(torch::stable::Tensor tensor) : torch::stable::Tensor(std::move(tensor)) {}

 private:
  static const torch::stable::Tensor& undefined() {
    static const torch::stable::Tensor none;
    return none;
  }
};
using Device = torch::stable::Device;
#else
using Tensor = torch::Tensor;
using Device = torch::Device;
#endif
using ScalarType = torch::headeronly::ScalarType;

#ifdef JADE_STABLE_ABI
/// Uninitialised and contiguous. The stable ABI's own empty() looks its operator up by name in each
/// call, which is several times slower.
inline Tensor new_tensor(const int64_t* sizes, int64_t dim, int32_t type, const Tensor& like) {
  std::vector<int64_t> strides(static_cast<size_t>(dim));
  int64_t stride = 1;
  for (int64_t axis = dim - 1; axis >= 0; --axis) {
    strides[axis] = stride;
    stride *= sizes[axis] > 0 ? sizes[axis] : 1;
  }
  int32_t device_type = 0, device_index = 0;
  TORCH_ERROR_CODE_CHECK(aoti_torch_get_device_type(like.get(), &device_type));
  TORCH_ERROR_CODE_CHECK(aoti_torch_get_device_index(like.get(), &device_index));
  AtenTensorHandle made = nullptr;
  TORCH_ERROR_CODE_CHECK(
      aoti_torch_empty_strided(dim, sizes, strides.data(), type, device_type, device_index, &made));
  return Tensor(made);
}
#endif

/// Uninitialised, on the device of `like`.
inline Tensor new_tensor(std::initializer_list<int64_t> sizes, ScalarType type,
                         const Tensor& like) {
#ifdef JADE_STABLE_ABI
  return new_tensor(sizes.begin(), static_cast<int64_t>(sizes.size()), static_cast<int32_t>(type),
                    like);
#else
  return torch::empty(torch::IntArrayRef(sizes.begin(), sizes.size()),
                      torch::TensorOptions().dtype(type).device(like.device()));
#endif
}

/// Uninitialised, with the shape, type and device of `like`, which is contiguous.
inline Tensor new_like(const Tensor& like) {
#ifdef JADE_STABLE_ABI
  int64_t* sizes = nullptr;
  int32_t type = 0;
  TORCH_ERROR_CODE_CHECK(aoti_torch_get_sizes(like.get(), &sizes));
  TORCH_ERROR_CODE_CHECK(aoti_torch_get_dtype(like.get(), &type));
  return new_tensor(sizes, like.dim(), type, like);
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
