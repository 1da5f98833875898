// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cuda_runtime_api.h>

#include "jade/splat/tensor.h"
#ifdef JADE_STABLE_ABI
#include <torch/csrc/stable/accelerator.h>
#else
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#endif

namespace jade::splat::cuda {

/// Makes a tensor's GPU the current device during the object's lifetime.
class DeviceStream {
 public:
#ifdef JADE_STABLE_ABI
  explicit DeviceStream(const Tensor& tensor) : guard_(tensor.get_device_index()) {
    void* stream = nullptr;
    TORCH_ERROR_CODE_CHECK(aoti_torch_get_current_cuda_stream(tensor.get_device_index(), &stream));
    stream_ = static_cast<cudaStream_t>(stream);
  }
#else
  explicit DeviceStream(const Tensor& tensor)
      : guard_(tensor.device()), stream_(c10::cuda::getCurrentCUDAStream()) {}
#endif

  /// The stream that torch currently uses on this GPU.
  cudaStream_t stream() const { return stream_; }

 private:
#ifdef JADE_STABLE_ABI
  torch::stable::accelerator::DeviceGuard guard_;
#else
  c10::cuda::CUDAGuard guard_;
#endif
  cudaStream_t stream_ = nullptr;
};

}  // namespace jade::splat::cuda
