// SPDX-License-Identifier: Apache-2.0
// Direct convolutions of few channels on CUDA: one layer of the router. No torch here. Not for use
// outside this room.
#pragma once

#include <cstdint>
#include <cuda_runtime_api.h>

namespace jade::router::cuda {

/// The layers that are compiled: input channels, output channels, kernel.
struct ConvShape {
  int in = 0, out = 0, kernel = 1;
};

/// out = relu(bias + w * replicate_pad(in)); all contiguous float32 on the device.
struct ConvLayer {
  ConvShape shape;
  int batch = 1, height = 0, width = 0;
  bool relu = false;
  const float* in = nullptr;       ///< [N,in,H,W]
  const float* weights = nullptr;  ///< [out,in,K,K]
  const float* bias = nullptr;     ///< [out]; null: none
  float* out = nullptr;            ///< [N,out,H,W]
};

/// Backward pass of a layer. Sums are taken in a fixed order, without atomics.
struct ConvGradient {
  ConvLayer layer;                ///< with `out` as the forward pass wrote it
  const float* of_out = nullptr;  ///< [N,out,H,W]
  float* padded = nullptr;        ///< [N,in,H+K-1,W+K-1], working memory; unused for K = 1
  float* of_in = nullptr;         ///< [N,in,H,W]; null: not wanted
  float* partial = nullptr;       ///< [partial_rows(), out·in·K·K + out], working memory
  float* of_weights = nullptr;    ///< [out·in·K·K + out]: of the weights, then of the bias
};

/// False for a shape that is not compiled.
bool is_compiled(const ConvShape& shape);
/// Rows of ConvGradient::partial.
int64_t partial_rows(const ConvLayer& layer);

void conv_forward(const ConvLayer& layer, cudaStream_t stream);
void conv_backward(const ConvGradient& gradient, cudaStream_t stream);

}  // namespace jade::router::cuda
