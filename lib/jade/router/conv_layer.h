// SPDX-License-Identifier: Apache-2.0
// The router's seven convolutions on CUDA. Must not include torch. Private to this folder.
#pragma once

#include <cstdint>
#include <cuda_runtime_api.h>
#include <functional>

namespace jade::router::cuda {

enum Layer { kEvent1, kEvent2, kImage1, kImage2, kHead1, kHead2, kHead3, kLayers };

/// All contiguous float32 on the device. Layers write their outputs after ReLU, except the logits.
struct Network {
  int batch = 1, height = 0, width = 0;
  const float* input = nullptr;        ///< [N,5,H,W], X_in: B, then Ψ(V)
  const float* weights[kLayers] = {};  ///< [out,in,K,K]
  const float* bias[kLayers] = {};     ///< [out]: of image1, image2 and head3
  uint32_t* prepared = nullptr;        ///< [prepared_words()], the weights in the kernels' order
  float* event1 = nullptr;             ///< [N,16,H,W]
  float* image1 = nullptr;             ///< [N,10,H,W]
  float* features = nullptr;           ///< [N,14,H,W], of event2, then of image2
  float* head1 = nullptr;              ///< [N,9,H,W]
  float* head2 = nullptr;              ///< [N,24,H,W]; null: not stored
  float* logits = nullptr;             ///< [N,1,H,W]
};

struct NetworkGradient {
  const float* of_logits = nullptr;  ///< [N,1,H,W]
  float* of_head1 = nullptr;         ///< [N,9,H,W], scratch memory like all that follow
  float* of_features = nullptr;      ///< [N,14,H,W]
  float* of_event1 = nullptr;        ///< [N,16,H,W]
  float* of_image1 = nullptr;        ///< [N,10,H,W]
  float* partial = nullptr;          ///< [partial_rows(), weight_count()]
  float* of_weights = nullptr;       ///< [weight_count()]: each layer's weights, then its bias
  float* of_input = nullptr;         ///< [N,5,H,W]; null: not required
};

/// Words of Network::prepared, whose address must be a multiple of 16.
int64_t prepared_words();
/// Rows of NetworkGradient::partial.
int64_t partial_rows(const Network& network);
/// All weights and biases.
int64_t weight_count();
/// Offset of a layer's gradients in NetworkGradient::of_weights.
int64_t weights_begin(Layer layer);

/// Calls the work with a second stream, on which it runs after everything that backward() has
/// queued so far.
using Beside = std::function<void(const std::function<void(cudaStream_t)>&)>;

void forward(const Network& network, cudaStream_t stream);
/// Call after forward(), whose outputs and prepared weights it reads. Computes all but of_weights.
void backward(const Network& network, const NetworkGradient& gradient, cudaStream_t stream,
              const Beside& beside);
/// Call after backward(): sums `partial` to of_weights.
void sum_weights(const Network& network, const NetworkGradient& gradient, cudaStream_t stream);

/// The part of forward() that fills `prepared`.
void prepare_weights(const Network& network, cudaStream_t stream);
/// Layers whose weight gradients are computed together, after the gradients of their outputs.
enum class WeightGroup { kHeads, kSecond, kFirst };
/// The part of backward() that fills a group's columns of `partial`.
void weight_gradients(const Network& network, const NetworkGradient& gradient, WeightGroup group,
                      cudaStream_t stream);

}  // namespace jade::router::cuda
