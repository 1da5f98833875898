// SPDX-License-Identifier: Apache-2.0
#include "jade/response/identity_fit.h"

#include <ATen/CPUGeneratorImpl.h>
#include <algorithm>
#include <cmath>
#include <vector>

namespace jade::response {
namespace {

constexpr int kBatch = 64 * 3;
constexpr int kSteps = 3000;
constexpr uint64_t kSeed = 42;
constexpr float kRate = 1e-2f, kBeta1 = 0.9f, kBeta2 = 0.999f, kEps = 1e-8f;
constexpr float kGain = 0.1f;  ///< of the MLP inside the sigmoid

using Batch = std::array<float, kBatch>;

/// Values with their gradients and Adam moments.
struct Parameters {
  std::vector<float> value, gradient, first, second;

  explicit Parameters(const torch::Tensor& start)
      : value(start.data_ptr<float>(), start.data_ptr<float>() + start.numel()),
        gradient(value.size(), 0.f),
        first(value.size(), 0.f),
        second(value.size(), 0.f) {}

  void adam(float correction1, float correction2) {
    for (size_t i = 0; i < value.size(); ++i) {
      first[i] = kBeta1 * first[i] + (1 - kBeta1) * gradient[i];
      second[i] = kBeta2 * second[i] + (1 - kBeta2) * gradient[i] * gradient[i];
      value[i] -= kRate * (first[i] / correction1) / (std::sqrt(second[i] / correction2) + kEps);
    }
  }
};

/// out = W in + b, with ReLU unless it is the last layer. Activations are [neurons][batch].
struct Layer {
  size_t inputs, outputs;
  bool relu;
  Parameters weight, bias;
  std::vector<Batch> output, delta;

  Layer(size_t in, size_t out, bool with_relu, at::Generator& generator)
      : inputs(in),
        outputs(out),
        relu(with_relu),
        weight(draw({int64_t(out), int64_t(in)}, in, generator)),
        bias(draw({int64_t(out)}, in, generator)),
        output(out),
        delta(out) {}

  static torch::Tensor draw(const std::vector<int64_t>& shape, size_t fan_in,
                            at::Generator& generator) {
    const double bound = 1 / std::sqrt(static_cast<double>(fan_in));
    return torch::empty(shape, torch::kFloat32).uniform_(-bound, bound, generator);
  }

  void forward(const std::vector<Batch>& input) {
    for (size_t o = 0; o < outputs; ++o) {
      Batch& out = output[o];
      out.fill(bias.value[o]);
      for (size_t i = 0; i < inputs; ++i) {
        const float w = weight.value[o * inputs + i];
        for (size_t b = 0; b < kBatch; ++b) out[b] += w * input[i][b];
      }
      if (relu) {
        for (float& value : out) value = std::max(value, 0.f);
      }
    }
  }

  /// From `delta` (of the output) to the parameters' gradients and, unless null, the input's delta.
  void backward(const std::vector<Batch>& input, std::vector<Batch>* input_delta) {
    for (size_t o = 0; o < outputs; ++o) {
      if (relu) {
        for (size_t b = 0; b < kBatch; ++b) delta[o][b] = output[o][b] > 0 ? delta[o][b] : 0.f;
      }
      bias.gradient[o] = 0;
      for (size_t b = 0; b < kBatch; ++b) bias.gradient[o] += delta[o][b];
      for (size_t i = 0; i < inputs; ++i) {
        float sum = 0;
        for (size_t b = 0; b < kBatch; ++b) sum += delta[o][b] * input[i][b];
        weight.gradient[o * inputs + i] = sum;
      }
    }
    if (input_delta == nullptr) return;
    for (size_t i = 0; i < inputs; ++i) {
      Batch& into = (*input_delta)[i];
      into.fill(0);
      for (size_t o = 0; o < outputs; ++o) {
        const float w = weight.value[o * inputs + i];
        for (size_t b = 0; b < kBatch; ++b) into[b] += w * delta[o][b];
      }
    }
  }
};

/// One Adam step on the draws x.
void fit_step(std::vector<Layer>& layers, const std::vector<Batch>& x, int step) {
  const std::vector<Batch>* input = &x;
  for (Layer& layer : layers) {
    layer.forward(*input);
    input = &layer.output;
  }
  Layer& last = layers.back();
  for (size_t b = 0; b < kBatch; ++b) {
    const float phi = 1 / (1 + std::exp(-(kGain * last.output[0][b] + x[0][b])));
    last.delta[0][b] = 2.f / kBatch * (phi - x[0][b]) * phi * (1 - phi) * kGain;
  }
  for (size_t i = layers.size(); i-- > 0;) {
    layers[i].backward(i == 0 ? x : layers[i - 1].output, i == 0 ? nullptr : &layers[i - 1].delta);
  }
  const float correction1 = 1 - std::pow(kBeta1, static_cast<float>(step));
  const float correction2 = 1 - std::pow(kBeta2, static_cast<float>(step));
  for (Layer& layer : layers) {
    layer.weight.adam(correction1, correction2);
    layer.bias.adam(correction1, correction2);
  }
}

Weights fit() {
  at::Generator generator = at::detail::createCPUGenerator(kSeed);
  std::vector<Layer> layers;
  layers.emplace_back(1, 16, true, generator);
  layers.emplace_back(16, 16, true, generator);
  layers.emplace_back(16, 16, true, generator);
  layers.emplace_back(16, 1, false, generator);
  std::vector<Batch> x(1);
  for (int step = 1; step <= kSteps; ++step) {
    const torch::Tensor draws = at::rand({kBatch}, generator, torch::kFloat32);
    std::copy_n(draws.data_ptr<float>(), kBatch, x[0].begin());
    fit_step(layers, x, step);
  }
  Weights result;
  for (size_t i = 0; i < layers.size(); ++i) {
    const auto outputs = static_cast<int64_t>(layers[i].outputs);
    result.weight[i] = torch::tensor(layers[i].weight.value).view({outputs, -1}).contiguous();
    result.bias[i] = torch::tensor(layers[i].bias.value);
  }
  return result;
}

}  // namespace

const Weights& identity_response() {
  static const Weights fitted = fit();
  return fitted;
}

}  // namespace jade::response
