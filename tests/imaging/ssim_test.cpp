// SPDX-License-Identifier: Apache-2.0
#include "jade/imaging/ssim.h"

#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <torch/csrc/autograd/autograd.h>
#include <torch/csrc/autograd/custom_function.h>

#include "jade/core/error.h"
#include "jade/imaging/ssim_band.h"

using namespace jade::imaging;

namespace {

using Sizes = std::vector<int64_t>;
using Pair = std::function<torch::Tensor(const torch::Tensor&, const torch::Tensor&)>;

torch::Tensor image(const Sizes& sizes, torch::ScalarType type = torch::kFloat64) {
  return torch::rand(sizes, type);
}

/// SSIM as in the papers' code: five depthwise 11x11 convolutions with zero padding.
torch::Tensor reference(const torch::Tensor& a, const torch::Tensor& b) {
  const auto x = torch::arange(11, a.options()) - 5;
  auto taps = (-x * x / (2 * 1.5 * 1.5)).exp();
  taps = taps / taps.sum();
  const auto window = torch::outer(taps, taps).view({1, 1, 11, 11});
  const auto mean = [&](const torch::Tensor& v) {
    return torch::conv2d(v.reshape({-1, 1, v.size(-2), v.size(-1)}), window, {}, 1, 5);
  };
  const auto ma = mean(a), mb = mean(b);
  const auto va = mean(a * a) - ma * ma, vb = mean(b * b) - mb * mb, vab = mean(a * b) - ma * mb;
  return ((2 * ma * mb + 1e-4) * (2 * vab + 9e-4) / ((ma * ma + mb * mb + 1e-4) * (va + vb + 9e-4)))
      .mean();
}

/// Largest difference between the gradient of f by its first or second argument and central
/// differences, over the largest central difference.
double gradient_error(const Pair& f, torch::Tensor a, torch::Tensor b, bool second) {
  a = a.clone().requires_grad_(!second);
  b = b.clone().requires_grad_(second);
  const auto varied = second ? b : a;
  f(a, b).backward();
  const auto analytic = varied.grad().clone().flatten();
  const torch::NoGradGuard no_grad;
  auto flat = varied.view(-1);
  double worst = 0, largest = 0;
  for (int64_t i = 0; i < flat.numel(); ++i) {
    const double value = flat[i].item<double>(), step = 1e-5;
    flat[i] = value + step;
    const double up = f(a, b).item<double>();
    flat[i] = value - step;
    const double down = f(a, b).item<double>();
    flat[i] = value;
    const double numeric = (up - down) / (2 * step);
    worst = std::max(worst, std::abs(numeric - analytic[i].item<double>()));
    largest = std::max(largest, std::abs(numeric));
  }
  return worst / largest;
}

const std::vector<Sizes> kShapes{{1, 1, 1},   {3, 4, 3},   {1, 10, 11},  {2, 3, 11, 12},
                                 {3, 37, 53}, {1, 130, 7}, {4, 2, 5, 80}};

/// Correct value, but the derivative by the first argument is too small by a tenth.
struct Broken : torch::autograd::Function<Broken> {
  static torch::Tensor forward(torch::autograd::AutogradContext* ctx, const torch::Tensor& a,
                               const torch::Tensor& b) {
    const torch::AutoGradMode enable(true);
    const auto leaf = a.detach().requires_grad_(true);
    const auto value = ssim(leaf, b);
    value.backward();
    ctx->save_for_backward({leaf.grad() * 0.9});
    return value.detach();
  }
  static torch::autograd::variable_list backward(torch::autograd::AutogradContext* ctx,
                                                 torch::autograd::variable_list grads) {
    return {ctx->get_saved_variables()[0] * grads[0], {}};
  }
};

}  // namespace

TEST_CASE("ssim: value and both gradients equal the slow reference at any size", "[imaging]") {
  torch::manual_seed(1);
  for (const auto& shape : kShapes) {
    INFO(torch::IntArrayRef(shape));
    auto a = image(shape).requires_grad_(true), b = image(shape).requires_grad_(true);
    const auto expected = reference(a, b);
    const auto grads = torch::autograd::grad({expected}, {a, b});
    const auto value = ssim(a, b);
    CHECK(value.item<double>() == Approx(expected.item<double>()).margin(1e-12));
    CHECK(ssim_map(a, b).sizes() == a.sizes());
    CHECK(ssim_map(a, b).mean().item<double>() == Approx(expected.item<double>()).margin(1e-12));
    value.backward();
    CHECK(a.grad().sub(grads[0]).abs().max().item<double>() <
          1e-9 * std::max(1.0, grads[0].abs().max().item<double>()));
    CHECK(b.grad().sub(grads[1]).abs().max().item<double>() <
          1e-9 * std::max(1.0, grads[1].abs().max().item<double>()));
    const auto single = ssim(a.detach().to(torch::kFloat32), b.detach().to(torch::kFloat32));
    CHECK(single.item<float>() == Approx(expected.item<double>()).margin(2e-4));
  }
}

TEST_CASE("ssim: values outside [0,1] count as they are, and have their gradient", "[imaging]") {
  torch::manual_seed(8);
  const auto wide = [] { return (3 * image({3, 14, 12}) - 1).requires_grad_(true); };
  const auto a = wide(), b = wide();
  const auto expected = reference(a, b);
  const auto grads = torch::autograd::grad({expected}, {a, b});
  const auto value = ssim(a, b);
  CHECK(value.item<double>() == Approx(expected.item<double>()).margin(1e-12));
  value.backward();
  CHECK(torch::allclose(a.grad(), grads[0], 1e-7, 1e-12));
  CHECK(torch::allclose(b.grad(), grads[1], 1e-7, 1e-12));
}

TEST_CASE("ssim: gradients agree with central differences, and a wrong one would not",
          "[imaging]") {
  torch::manual_seed(2);
  const auto a = image({2, 7, 13}), b = image({2, 7, 13});
  const Pair value = [](const auto& x, const auto& y) { return ssim(x, y); };
  CHECK(gradient_error(value, a, b, false) < 1e-6);
  CHECK(gradient_error(value, a, b, true) < 1e-6);
  const Pair broken = [](const auto& x, const auto& y) { return Broken::apply(x, y); };
  CHECK(gradient_error(broken, a, b, false) > 1e-2);
}

TEST_CASE("l1 ssim: D is the weighted sum of both parts, with its gradients", "[imaging]") {
  torch::manual_seed(3);
  for (const double lambda : {0.0, 0.2, 0.3, 1.0}) {
    const auto a = image({3, 9, 12}), b = image({3, 9, 12});
    const double expected = (1 - lambda) * (a - b).abs().mean().item<double>() +
                            lambda * (1 - reference(a, b).item<double>());
    CHECK(l1_ssim(a, b, lambda).item<double>() == Approx(expected).epsilon(1e-10));
    const Pair d = [&](const auto& x, const auto& y) { return l1_ssim(x, y, lambda); };
    CHECK(gradient_error(d, a, b, false) < 1e-5);
    CHECK(gradient_error(d, a, b, true) < 1e-5);
  }
}

TEST_CASE("ssim: a fixed target gives the same value and gradient", "[imaging]") {
  torch::manual_seed(4);
  for (const auto& shape : kShapes) {
    auto a = image(shape).requires_grad_(true), twin = a.detach().clone().requires_grad_(true);
    const auto b = image(shape);
    const auto target = ssim_target(b);
    const auto fixed = l1_ssim(a, target, 0.3), free = l1_ssim(twin, b, 0.3);
    CHECK(fixed.item<double>() == Approx(free.item<double>()).margin(1e-13));
    fixed.backward();
    free.backward();
    CHECK(a.grad().sub(twin.grad()).abs().max().item<double>() < 1e-12);
  }
}

TEST_CASE("ssim: one image has similarity 1 with itself and no gradient", "[imaging]") {
  auto a = image({3, 20, 31}).requires_grad_(true);
  const auto b = a.detach().clone();
  CHECK(ssim(a, b).item<double>() == Approx(1.0).epsilon(1e-12));
  l1_ssim(a, b, 0.3).backward();
  CHECK(a.grad().abs().max().item<double>() < 1e-12);
}

TEST_CASE("ssim: the same bits for any number of threads", "[imaging]") {
  const auto b = image({3, 130, 97}, torch::kFloat32);
  const auto run = [&](int threads) {
    at::set_num_threads(threads);
    auto a =
        (b + 0.1 * torch::linspace(0, 1, b.numel()).view(b.sizes())).detach().requires_grad_(true);
    auto value = l1_ssim(a, b, 0.3);
    value.backward();
    return std::pair{value.detach(), a.grad()};
  };
  const int before = at::get_num_threads();
  const auto one = run(1);
  for (const int threads : {2, 5}) {
    const auto many = run(threads);
    CHECK(torch::equal(many.first, one.first));
    CHECK(torch::equal(many.second, one.second));
  }
  at::set_num_threads(before);
}

TEST_CASE("ssim: every instruction set gives the portable value and gradients", "[imaging]") {
  using jade::kernel::ForcedIsa;
  using jade::kernel::Isa;
  const auto a = image({2, 3, 53, 37}, torch::kFloat32);
  const auto b = image({2, 3, 53, 37}, torch::kFloat32);
  const auto all = [&] {
    const auto x = a.clone().requires_grad_(), y = b.clone().requires_grad_();
    const auto value = l1_ssim(x, y, 0.3);
    value.backward();
    const SsimTarget target = ssim_target(b);
    return std::vector<torch::Tensor>{value.detach(), x.grad(), y.grad(), target.mean,
                                      target.square};
  };
  std::vector<torch::Tensor> portable;
  for (const Isa isa : jade::kernel::kIsas) {
    if (!jade::kernel::can_run(isa)) continue;
    INFO(jade::kernel::name(isa));
    const ForcedIsa forced(isa);
    CHECK((&ssim_kernels() == &jade::imaging::portable::kSsimKernels) == (isa == Isa::kPortable));
    const auto now = all();
    if (isa == Isa::kPortable) portable = now;
    for (size_t i = 0; i < now.size(); ++i) {
      CHECK(((now[i] - portable[i]).norm() / portable[i].norm()).item<double>() < 1e-5);
    }
  }
}

namespace {

/// Four pairs in three terms: free, fixed and one-sided, of three channels and of one.
struct SumCase {
  torch::Tensor a, b, c, gray_a, gray_b, scale;
  SsimTarget target;

  explicit SumCase(torch::ScalarType type, torch::Device device = torch::kCPU,
                   const Sizes& size = {21, 34}) {
    const auto make = [&](int64_t channels) {
      return image({channels, size[0], size[1]}, torch::kFloat64).to(type).to(device);
    };
    a = make(3).requires_grad_(true);
    b = make(3).requires_grad_(true);
    c = make(3);
    gray_a = make(1).requires_grad_(true);
    gray_b = make(1).requires_grad_(true);
    scale = torch::full({}, 0.75, torch::TensorOptions(torch::kFloat32).device(device));
    target = ssim_target(c);
  }

  std::vector<torch::Tensor> leaves() const { return {a, b, gray_a, gray_b}; }

  L1SsimSum sum() const {
    return l1_ssim_sum({{{{a, {b, {}, {}}}, {gray_a, {gray_b, {}, {}}}}, 2, {}},
                        {{{a, target}}, 1, {}},
                        {{{b, {c, {}, {}}}}, 1, scale}},
                       0.3);
  }

  /// The terms from the slow reference.
  torch::Tensor expected() const {
    const auto d = [](const torch::Tensor& x, const torch::Tensor& y) {
      return 0.7 * (x - y).abs().mean() + 0.3 * (1 - reference(x, y));
    };
    return torch::stack({2 * (d(a, b) + d(gray_a, gray_b)), d(a, c), d(b, c) * scale});
  }
};

double apart(const std::vector<torch::Tensor>& a, const std::vector<torch::Tensor>& b) {
  double worst = 0;
  for (size_t i = 0; i < a.size(); ++i) {
    worst = std::max(worst, ((a[i] - b[i]).norm() / b[i].norm()).item<double>());
  }
  return worst;
}

}  // namespace

TEST_CASE("l1 ssim sum: terms, total and gradients are those of the slow reference", "[imaging]") {
  torch::manual_seed(6);
  const SumCase one(torch::kFloat64);
  const auto sum = one.sum();
  const auto expected = one.expected();
  CHECK(torch::allclose(sum.terms, expected, 1e-10, 0));
  CHECK(torch::allclose(sum.total, expected.sum(), 1e-10, 0));
  const auto of_total = torch::autograd::grad({sum.total}, one.leaves(), {}, true);
  CHECK(apart(of_total, torch::autograd::grad({expected.sum()}, one.leaves(), {}, true)) < 1e-9);
  // Both outputs at once, with different weights.
  const auto weights = torch::tensor({1.0, -2.0, 0.5}, torch::kFloat64);
  const auto both = 3 * one.sum().total + (one.sum().terms * weights).sum();
  const auto slow = 3 * expected.sum() + (expected * weights).sum();
  CHECK(apart(torch::autograd::grad({both}, one.leaves()),
              torch::autograd::grad({slow}, one.leaves(), {}, true)) < 1e-9);
  // The negative control: other weights give other gradients.
  CHECK(apart(of_total, torch::autograd::grad({slow}, one.leaves())) > 1e-2);
}

TEST_CASE("l1 ssim sum: pairs in a sum have the bits that they have alone", "[imaging]") {
  torch::manual_seed(7);
  const SumCase in(torch::kFloat32);
  const auto terms = in.sum().terms;
  CHECK(terms[0].equal(2 * (l1_ssim(in.a, in.b, 0.3) + l1_ssim(in.gray_a, in.gray_b, 0.3))));
  CHECK(terms[1].equal(l1_ssim(in.a, in.target, 0.3)));
  CHECK(terms[2].equal(l1_ssim(in.b, in.c, 0.3) * in.scale));
}

TEST_CASE("l1 ssim sum: without a gradient nothing is kept, and a pass can be taken twice",
          "[imaging]") {
  torch::manual_seed(8);
  const SumCase in(torch::kFloat64);
  {
    const torch::NoGradGuard no_grad;
    CHECK_FALSE(in.sum().total.requires_grad());
  }
  const auto total = in.sum().total;
  const auto first = torch::autograd::grad({total}, in.leaves(), {}, /*retain_graph=*/true);
  CHECK(apart(torch::autograd::grad({2 * total}, in.leaves()), first) == Approx(1));
}

TEST_CASE("l1 ssim sum: images of several sizes are refused", "[imaging]") {
  const auto one = image({3, 4, 4}), other = image({3, 4, 5});
  CHECK_THROWS_AS(
      l1_ssim_sum({{{{one, {one, {}, {}}}}, 1, {}}, {{{other, {other, {}, {}}}}, 1, {}}}, 0.3),
      jade::ContractError);
  CHECK_THROWS_AS(l1_ssim_sum({}, 0.3), jade::ContractError);
}

TEST_CASE("l1 ssim sum: a GPU agrees with the CPU in values and gradients", "[imaging][cuda]") {
  for (const auto& size : {Sizes{21, 34}, Sizes{1, 1}, Sizes{130, 67}}) {
    INFO(torch::IntArrayRef(size));
    torch::manual_seed(9);
    const SumCase on_cpu(torch::kFloat32, torch::kCPU, size);
    torch::manual_seed(9);
    const SumCase on_gpu(torch::kFloat32, torch::kCUDA, size);
    const auto weights = torch::tensor({1.0f, -2.0f, 0.5f});
    const auto run = [&](const SumCase& in) {
      const auto sum = in.sum();
      const auto value = 3 * sum.total + (sum.terms * weights.to(in.a.device())).sum();
      auto out = torch::autograd::grad({value}, in.leaves());
      out.push_back(sum.terms.detach());
      out.push_back(sum.total.detach());
      for (auto& each : out) each = each.cpu();
      return out;
    };
    const auto cpu = run(on_cpu), gpu = run(on_gpu), again = run(on_gpu);
    CHECK(apart(gpu, cpu) < 2e-3);
    for (size_t i = 0; i < gpu.size(); ++i) CHECK(gpu[i].equal(again[i]));
  }
}

TEST_CASE("ssim: views with strides and incoming gradients are respected", "[imaging]") {
  auto base = image({12, 9, 3}).requires_grad_(true);
  const auto b = image({3, 12, 9});
  auto copy = base.detach().clone().requires_grad_(true);
  (5 * ssim(base.permute({2, 0, 1}), b)).backward();
  (5 * reference(copy.permute({2, 0, 1}), b)).backward();
  CHECK(base.grad().sub(copy.grad()).abs().max().item<double>() < 1e-12);
}

TEST_CASE("ssim: images that do not fit are refused", "[imaging]") {
  CHECK_THROWS_AS(ssim(torch::zeros({3, 4, 4}), torch::zeros({3, 4, 5})), jade::ContractError);
  CHECK_THROWS_AS(ssim(torch::zeros({4, 4}), torch::zeros({4, 4})), jade::ContractError);
  CHECK_THROWS_AS(ssim(torch::zeros({3, 4, 4}), torch::zeros({3, 4, 4}, torch::kFloat64)),
                  jade::ContractError);
}

TEST_CASE("ssim: a GPU agrees with the CPU in value and both gradients", "[imaging][cuda]") {
  torch::manual_seed(5);
  for (const auto& shape : kShapes) {
    INFO(torch::IntArrayRef(shape));
    auto a = image(shape, torch::kFloat32).requires_grad_(true),
         b = image(shape, torch::kFloat32).requires_grad_(true);
    auto ga = a.detach().cuda().requires_grad_(true), gb = b.detach().cuda().requires_grad_(true);
    const auto expected = l1_ssim(a, b, 0.3), value = l1_ssim(ga, gb, 0.3);
    expected.backward();
    value.backward();
    CHECK(value.item<float>() == Approx(expected.item<float>()).margin(1e-4));
    const double scale = a.grad().abs().max().item<double>();
    CHECK(ga.grad().cpu().sub(a.grad()).abs().max().item<double>() < 2e-3 * scale);
    CHECK(gb.grad().cpu().sub(b.grad()).abs().max().item<double>() < 2e-3 * scale);
    auto gc = a.detach().cuda().requires_grad_(true);
    l1_ssim(gc, ssim_target(gb.detach()), 0.3).backward();
    CHECK(gc.grad().sub(ga.grad()).abs().max().item<double>() < 2e-3 * scale);
    CHECK(torch::equal(l1_ssim(ga, gb, 0.3), value));
  }
}
