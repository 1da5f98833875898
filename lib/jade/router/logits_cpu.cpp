// SPDX-License-Identifier: Apache-2.0
// torch's convolutions take three times as long for 2 to 24 channels, and replicate padding,
// concatenation and ReLU are separate passes over memory. Here each layer writes directly to the
// next layer's input, including borders.
#include <ATen/Dispatch.h>
#include <ATen/Parallel.h>
#include <algorithm>
#include <array>
#include <torch/csrc/autograd/custom_function.h>
#include <vector>

#include "jade/core/check.h"
#include "jade/router/conv_band.h"
#include "jade/router/logits.h"

namespace jade::router {

const ConvKernelSet& conv_kernels() {
  static constexpr kernel::IsaTable<ConvKernelSet> kTable = {
    &portable::kConvKernels,
#if defined(__x86_64__)
    &avx2::kConvKernels,
    &avx512::kConvKernels,
#endif
  };
  return kTable.chosen();
}

namespace cpu {
namespace {

using torch::autograd::AutogradContext;
using torch::autograd::variable_list;

/// Rows per task: constant, so that sums do not depend on the number of threads.
constexpr int64_t kBandRows = 8;

/// The order of the operation's tensors.
enum Input : size_t {
  kInput,
  kEvent1,
  kEvent2,
  kImage1,
  kImage1Bias,
  kImage2,
  kImage2Bias,
  kHead1,
  kHead2,
  kHead3,
  kHead3Bias,
  kInputs
};
constexpr Input kNoBias = kInputs;

template <class Work>
void for_bands(int64_t height, const Work& work) {
  const int64_t bands = (height + kBandRows - 1) / kBandRows;
  at::parallel_for(0, bands, 1, [&](int64_t begin, int64_t end) {
    for (int64_t i = begin; i < end; ++i) {
      work(i, Band{i * kBandRows, std::min(height, (i + 1) * kBandRows)});
    }
  });
}

/// Planes with the memory that they refer to.
template <class T>
struct Stored {
  Planes<T> planes;
  torch::Tensor memory;

  void attach(const torch::Tensor& tensor) {
    memory = tensor;
    planes.data = memory.mutable_data_ptr<T>();
  }
};

/// Replicates the image's edge in the border of a band's rows.
template <class T>
void replicate_border(const Planes<T>& planes, Band band) {
  const int64_t pad = planes.pad, width = planes.width, stride = planes.stride();
  for (int64_t c = 0; c < planes.channels; ++c) {
    for (int64_t y = band.begin; y < band.end; ++y) {
      T* const row = planes.row(c, y);
      std::fill(row - pad, row, row[0]);
      std::fill(row + width, row + stride - pad, row[width - 1]);
    }
    for (int64_t k = 1; k <= pad && band.begin == 0; ++k) {
      std::copy_n(planes.row(c, 0) - pad, stride, planes.row(c, -k) - pad);
    }
    for (int64_t k = 0; k < pad && band.end == planes.height; ++k) {
      std::copy_n(planes.row(c, band.end - 1) - pad, stride, planes.row(c, band.end + k) - pad);
    }
  }
}

/// Copies [C,H,W] into planes.
template <class T>
void copy_in(const T* image, const Planes<T>& planes, Band band) {
  for (int64_t c = 0; c < planes.channels; ++c) {
    for (int64_t y = band.begin; y < band.end; ++y) {
      std::copy_n(image + (c * planes.height + y) * planes.width, planes.width, planes.row(c, y));
    }
  }
  replicate_border(planes, band);
}

/// A gradient's border is zero: values outside the image have no gradient.
template <class T>
void zero_border(const Planes<T>& planes, Band band) {
  const int64_t pad = planes.pad, stride = planes.stride();
  for (int64_t c = 0; c < planes.channels; ++c) {
    for (int64_t y = band.begin; y < band.end; ++y) {
      T* const row = planes.row(c, y);
      std::fill(row - pad, row, T(0));
      std::fill(row + planes.width, row + stride - pad, T(0));
    }
    if (band.begin == 0) std::fill_n(planes.row(c, -pad) - pad, pad * stride, T(0));
    if (band.end == planes.height) std::fill_n(planes.row(c, band.end) - pad, pad * stride, T(0));
  }
}

/// Adds the border's gradients to the replicated edge, zeroes those that ReLU blocked, and writes
/// the rest into `out`, whose border becomes zero.
/// @param passed  output of ReLU; no data: there was none
template <class T>
void fold_border(const Planes<T>& padded, const Planes<T>& passed, const Planes<T>& out,
                 Band band) {
  const int64_t pad = padded.pad, width = padded.width, height = padded.height;
  for (int64_t c = 0; c < padded.channels; ++c) {
    for (int64_t y = band.begin; y < band.end; ++y) {
      T* const row = padded.row(c, y);
      const auto add_row = [&](int64_t other) {
        const T* const from = padded.row(c, other);
        for (int64_t x = -pad; x < width + pad; ++x) row[x] += from[x];
      };
      for (int64_t k = 1; k <= pad && y == 0; ++k) add_row(-k);
      for (int64_t k = 0; k < pad && y == height - 1; ++k) add_row(height + k);
      for (int64_t k = 1; k <= pad; ++k) row[0] += row[-k];
      for (int64_t k = 0; k < pad; ++k) row[width - 1] += row[width + k];
      T* __restrict to = out.row(c, y);
      const T* __restrict from = row;
      if (passed.data == nullptr) {
        std::copy_n(from, width, to);
        continue;
      }
      const T* __restrict value = passed.row(c, y);
      for (int64_t x = 0; x < width; ++x) to[x] = value[x] > 0 ? from[x] : T(0);
    }
  }
  zero_border(out, band);
}

/// Activations stored for the backward pass, in the order of Layers::make_shapes().
enum Activation : size_t { kMeasured, kEvents, kImage, kJoined, kHidden1, kHidden2, kActivations };

/// The layers of one pass. `inputs` must outlive it.
template <class T>
class Layers {
 public:
  using Activations = std::array<Stored<T>, kActivations>;

  explicit Layers(const variable_list& inputs) : in_(inputs) {}

  /// Borders are the pixels outside the image that the next layer reads.
  Activations make_shapes() const {
    const auto shape = [&](int64_t channels, int64_t pad) {
      return Stored<T>{{nullptr, channels, height(), width(), pad}, {}};
    };
    return {shape(5, 2), shape(16, 2), shape(10, 2), shape(17, 1), shape(9, 1), shape(24, 0)};
  }

  Activations make_activations() const {
    Activations made = make_shapes();
    for (Stored<T>& one : made) allocate(one);
    return made;
  }

  void forward(int64_t n, const Activations& to, torch::Tensor& logits) const {
    const T* const input = in_[kInput].const_data_ptr<T>() + n * 5 * height() * width();
    const Planes<T>& measured = to[kMeasured].planes;
    const Planes<T>& joined = to[kJoined].planes;
    for_bands(height(), [&](int64_t, Band band) {
      copy_in(input, measured, band);
      copy_in(input, joined.slice(0, 3), band);
    });
    layer(measured.slice(3, 2), to[kEvents].planes, kEvent1, kNoBias);
    layer(to[kEvents].planes, joined.slice(3, 6), kEvent2, kNoBias);
    layer(measured.slice(0, 3), to[kImage].planes, kImage1, kImage1Bias);
    layer(to[kImage].planes, joined.slice(9, 8), kImage2, kImage2Bias);
    layer(joined, to[kHidden1].planes, kHead1, kNoBias);
    layer(to[kHidden1].planes, to[kHidden2].planes, kHead2, kNoBias);
    const Stored<T> last = stored(1, 0);
    layer(to[kHidden2].planes, last.planes, kHead3, kHead3Bias, false);
    copy_out(last.planes, logits, n);
  }

  /// Adds sample n's weight gradients to `grads`, in double; writes that of the input.
  void backward(int64_t n, const Activations& at, const torch::Tensor& of_logits,
                variable_list& grads) const {
    const Stored<T> of_head3 = stored(1, 0);
    const T* const from = of_logits.const_data_ptr<T>() + n * height() * width();
    for_bands(height(), [&](int64_t, Band band) {
      for (int64_t y = band.begin; y < band.end; ++y) {
        std::copy_n(from + y * width(), width(), of_head3.planes.row(0, y));
      }
      zero_border(of_head3.planes, band);
    });
    const Stored<T> of_head2 = stored(24, 2), of_head1 = stored(9, 2);
    const Stored<T> of_events = stored(6, 4), of_image = stored(8, 4);
    const Stored<T> of_event1 = stored(16, 4), of_image1 = stored(10, 4);
    const Planes<T> joined = at[kJoined].planes;
    const Planes<T> blurry = at[kMeasured].planes.slice(0, 3);
    const Planes<T> psi = at[kMeasured].planes.slice(3, 2);

    weights(at[kHidden2].planes, of_head3.planes, kHead3, kHead3Bias, grads);
    inputs(of_head3.planes, kHead3, 0, at[kHidden2].planes, of_head2.planes);
    weights(at[kHidden1].planes, of_head2.planes, kHead2, kNoBias, grads);
    inputs(of_head2.planes, kHead2, 0, at[kHidden1].planes, of_head1.planes);
    weights(joined, of_head1.planes, kHead1, kNoBias, grads);
    inputs(of_head1.planes, kHead1, 3, joined.slice(3, 6), of_events.planes);
    inputs(of_head1.planes, kHead1, 9, joined.slice(9, 8), of_image.planes);
    weights(at[kEvents].planes, of_events.planes, kEvent2, kNoBias, grads);
    inputs(of_events.planes, kEvent2, 0, at[kEvents].planes, of_event1.planes);
    weights(psi, of_event1.planes, kEvent1, kNoBias, grads);
    weights(at[kImage].planes, of_image.planes, kImage2, kImage2Bias, grads);
    inputs(of_image.planes, kImage2, 0, at[kImage].planes, of_image1.planes);
    weights(blurry, of_image1.planes, kImage1, kImage1Bias, grads);

    if (!grads[kInput].defined()) return;
    const Stored<T> of_input = stored(5, 0), direct = stored(3, 0);
    inputs(of_image1.planes, kImage1, 0, without_relu(blurry), of_input.planes.slice(0, 3));
    inputs(of_event1.planes, kEvent1, 0, without_relu(psi), of_input.planes.slice(3, 2));
    inputs(of_head1.planes, kHead1, 0, without_relu(joined.slice(0, 3)), direct.planes);
    of_input.memory.narrow(0, 0, direct.memory.numel()).add_(direct.memory);
    copy_out(of_input.planes, grads[kInput], n);
  }

 private:
  int64_t height() const { return in_[kInput].size(2); }
  int64_t width() const { return in_[kInput].size(3); }

  Stored<T> stored(int64_t channels, int64_t pad) const {
    Stored<T> made{{nullptr, channels, height(), width(), pad}, {}};
    allocate(made);
    return made;
  }

  void allocate(Stored<T>& stored) const {
    stored.attach(torch::empty({stored.planes.size()}, in_[kInput].options().requires_grad(false)));
  }

  /// Planes of that shape without ReLU output.
  static Planes<T> without_relu(Planes<T> planes) {
    planes.data = nullptr;
    return planes;
  }

  static std::vector<T> packed(const torch::Tensor& weights) {
    std::vector<T> out(static_cast<size_t>(weights.numel()));
    pack_weights(weights.const_data_ptr<T>(), weights.size(0), weights.size(1), weights.size(2),
                 out.data());
    return out;
  }

  void layer(const Planes<T>& from, const Planes<T>& to, Input weight, Input bias,
             bool relu = true) const {
    const std::vector<T> weights = packed(in_[weight]);
    Convolution<T> convolution;
    convolution.in = from;
    convolution.out = to;
    convolution.weights = weights.data();
    if (bias != kNoBias) convolution.bias = in_[bias].const_data_ptr<T>();
    convolution.kernel = in_[weight].size(2);
    convolution.relu = relu;
    for_bands(height(), [&](int64_t, Band band) {
      kernels_.convolve(convolution, band);
      replicate_border(to, band);
    });
  }

  /// The layer's gradient by its input channels from `first` on: the convolution with the mirrored
  /// weights, including the border, which is then added to the edge.
  void inputs(const Planes<T>& gradient, Input weight, int64_t first, const Planes<T>& passed,
              const Planes<T>& out) const {
    const torch::Tensor mirrored =
        in_[weight].narrow(1, first, out.channels).transpose(0, 1).flip({2, 3}).contiguous();
    const std::vector<T> weights = packed(mirrored);
    const int64_t kernel = mirrored.size(2), pad = kernel / 2;
    const Stored<T> padded = stored(out.channels, pad);
    Convolution<T> convolution;
    convolution.in = gradient;
    convolution.out = padded.planes;
    convolution.weights = weights.data();
    convolution.kernel = kernel;
    convolution.reach = pad;
    for_bands(height(), [&](int64_t, Band band) {
      kernels_.convolve(convolution, {band.begin == 0 ? -pad : band.begin,
                                      band.end == height() ? height() + pad : band.end});
      fold_border(padded.planes, passed, out, band);
    });
  }

  void weights(const Planes<T>& from, const Planes<T>& gradient, Input weight, Input bias,
               variable_list& grads) const {
    if (!grads[weight].defined() && (bias == kNoBias || !grads[bias].defined())) return;
    const int64_t taps = in_[weight].numel();
    const int64_t values = taps + (bias != kNoBias ? gradient.channels : 0);
    const int64_t bands = (height() + kBandRows - 1) / kBandRows;
    std::vector<T> partial(static_cast<size_t>(bands * values));
    const WeightGradient<T> args{from, gradient, in_[weight].size(2)};
    for_bands(height(), [&](int64_t i, Band band) {
      T* const out = partial.data() + i * values;
      kernels_.weight_gradient(args, band, out, bias != kNoBias ? out + taps : nullptr);
    });
    const auto add_bands = [&](const torch::Tensor& grad, int64_t begin) {
      if (!grad.defined()) return;
      auto* const sums = grad.mutable_data_ptr<double>();
      for (int64_t i = 0; i < bands; ++i) {
        const T* const row = partial.data() + i * values + begin;
        for (int64_t k = 0; k < grad.numel(); ++k) sums[k] += static_cast<double>(row[k]);
      }
    };
    add_bands(grads[weight], 0);
    if (bias != kNoBias) add_bands(grads[bias], taps);
  }

  void copy_out(const Planes<T>& planes, torch::Tensor& images, int64_t n) const {
    T* const out = images.mutable_data_ptr<T>() + n * planes.channels * height() * width();
    for (int64_t c = 0; c < planes.channels; ++c) {
      for (int64_t y = 0; y < height(); ++y) {
        std::copy_n(planes.row(c, y), width(), out + (c * height() + y) * width());
      }
    }
  }

  const variable_list& in_;
  const ConvKernels<T>& kernels_ = conv_kernels().of<T>();
};

class RouterFunction : public torch::autograd::Function<RouterFunction> {
 public:
  static torch::Tensor forward(AutogradContext* context, at::TensorList given,
                               bool needs_backward) {
    variable_list inputs;
    for (const torch::Tensor& tensor : given) inputs.push_back(tensor.contiguous());
    auto shape = inputs[kInput].sizes().vec();
    shape[1] = 1;
    torch::Tensor logits = torch::empty(shape, inputs[kInput].options().requires_grad(false));
    variable_list saved = inputs;
    AT_DISPATCH_FLOATING_TYPES(logits.scalar_type(), "router", [&] {
      const Layers<scalar_t> layers(inputs);
      for (int64_t n = 0; n < shape[0]; ++n) {
        const auto activations = layers.make_activations();
        layers.forward(n, activations, logits);
        if (!needs_backward) continue;
        for (const auto& stored : activations) saved.push_back(stored.memory);
      }
    });
    if (needs_backward) context->save_for_backward(saved);
    return logits;
  }

  static variable_list backward(AutogradContext* context, variable_list gradients) {
    const variable_list saved = context->get_saved_variables();
    const variable_list inputs(saved.begin(), saved.begin() + kInputs);
    const torch::Tensor of_logits = gradients[0].contiguous();
    variable_list grads(kInputs + 1);
    for (size_t i = 0; i < kInputs; ++i) {
      // Sums over the image stay in double until they are complete.
      const auto type = i == kInput ? inputs[i].scalar_type() : torch::kFloat64;
      if (context->needs_input_grad(i)) grads[i] = torch::zeros_like(inputs[i], type);
    }
    AT_DISPATCH_FLOATING_TYPES(of_logits.scalar_type(), "router_backward", [&] {
      const Layers<scalar_t> layers(inputs);
      for (int64_t n = 0; n < of_logits.size(0); ++n) {
        auto activations = layers.make_shapes();
        for (size_t k = 0; k < activations.size(); ++k) {
          activations[k].attach(saved[kInputs + static_cast<size_t>(n) * activations.size() + k]);
        }
        layers.backward(n, activations, of_logits, grads);
      }
    });
    for (size_t i = 0; i < kInputs; ++i) {
      if (grads[i].defined()) grads[i] = grads[i].to(inputs[i].scalar_type());
    }
    return grads;
  }
};

}  // namespace

torch::Tensor router_logits(const torch::Tensor& input, const RouterWeights& w) {
  const variable_list inputs = {input,         w.event1, w.event2,      w.image1,
                                w.image1_bias, w.image2, w.image2_bias, w.head1,
                                w.head2,       w.head3,  w.head3_bias};
  bool needs_backward = false;
  for (const torch::Tensor& tensor : inputs) {
    check_dtype(tensor, "router: every tensor", input.scalar_type());
    needs_backward |= torch::GradMode::is_enabled() && tensor.requires_grad();
  }
  return RouterFunction::apply(at::TensorList(inputs), needs_backward);
}

}  // namespace cpu
}  // namespace jade::router
