// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/densify.h"

#include "support/catch.h"

#include <cmath>

#include "jade/gaussians/mcmc.h"
#include "random_gaussians.h"

namespace jade::gaussians {
namespace {

using test::random_gaussians;

struct CloneAndSplit : DensifyOptions {
  CloneAndSplit() { strategy = DensifyStrategy::kAdc; }
};

/// Five small, opaque Gaussians and an optimiser whose moments are the row's index + 1.
struct Fixture {
  GaussianModel model;
  GaussianAdam adam;

  explicit Fixture(int64_t count = 5) {
    splat::Gaussians g = random_gaussians(count, 16);
    g.log_scales.fill_(std::log(0.005));
    g.logit_opacities.fill_(1);
    model = GaussianModel(g, 1, torch::kCPU);
    adam = GaussianAdam(model, {});
    const auto tagged = [&](const torch::Tensor& value) {
      torch::Tensor rows = torch::arange(1, count + 1, torch::kFloat32);
      for (int64_t d = 1; d < value.dim(); ++d) rows = rows.unsqueeze(-1);
      return rows.expand_as(value).contiguous();
    };
    const splat::Gaussians tags = map_parameters(model.detached(), tagged);
    for (int i = 0; i < kParameterCount; ++i) {
      parameter(adam.first_moments(), i).copy_(parameter(tags, i));
      parameter(adam.second_moments(), i).copy_(parameter(tags, i));
    }
  }

  Densifier densifier(const DensifyOptions& options) {
    return Densifier(options, model, make_generator(3, "densification"));
  }
  /// The tags of the moments, by row; 0 for new rows.
  std::vector<float> tags() const {
    const torch::Tensor t = adam.first_moments().sh.select(2, 0).select(1, 5).contiguous();
    return {t.data_ptr<float>(), t.data_ptr<float>() + t.numel()};
  }
};

void set_statistics(const Densifier& densifier, const std::vector<float>& gradient) {
  const splat::ScreenStatistics statistics = densifier.accumulated();
  statistics.gradient_norm.copy_(torch::tensor(gradient) * 4);
  statistics.visible_count.fill_(4);
}

TEST_CASE("densify: small Gaussians with large gradients are cloned as they are", "[gaussians]") {
  Fixture f;
  Densifier densifier = f.densifier(CloneAndSplit());
  set_statistics(densifier, {0, 3e-4f, 0, 0, 1e-4f});
  const torch::Tensor means = f.model.detached().means.clone();
  const DensifyReport report = densifier.update(600, f.model, f.adam);
  CHECK(report.cloned == 1);
  CHECK(report.split == 0);
  CHECK(report.pruned == 0);
  REQUIRE(f.model.size() == 6);
  CHECK(torch::equal(f.model.detached().means.slice(0, 0, 5), means));
  CHECK(torch::equal(f.model.detached().means[5], means[1]));
  CHECK(f.tags() == std::vector<float>{1, 2, 3, 4, 5, 0});
  CHECK(densifier.accumulated().gradient_norm.sum().item<double>() == 0);
  CHECK(densifier.accumulated().gradient_norm.size(0) == 6);
}

TEST_CASE("densify: large Gaussians become two smaller ones sampled from them", "[gaussians]") {
  Fixture f;
  f.model.parameters().log_scales.detach()[2].fill_(std::log(0.05));
  Densifier densifier = f.densifier(CloneAndSplit());
  set_statistics(densifier, {0, 0, 1, 0, 0});
  const torch::Tensor mean = f.model.detached().means[2].clone();
  const DensifyReport report = densifier.update(600, f.model, f.adam);
  CHECK(report.split == 1);
  REQUIRE(f.model.size() == 6);
  CHECK(f.tags() == std::vector<float>{1, 2, 4, 5, 0, 0});
  for (const int64_t row : {4, 5}) {
    CHECK(f.model.detached().log_scales[row][0].item<double>() ==
          Approx(std::log(0.05 / 1.6)).epsilon(1e-5));
    const double moved = (f.model.detached().means[row] - mean).norm().item<double>();
    CHECK(moved > 0);
    CHECK(moved < 0.05 * 5);
  }
}

TEST_CASE("densify: faint, not finite and, late, overlarge Gaussians go", "[gaussians]") {
  for (const int64_t step : {600, 3000, 3100}) {  // opacities are first reset at 3000
    INFO(step);
    const bool late = step == 3100;
    Fixture f;
    f.model.parameters().logit_opacities.detach()[0].fill_(-6);
    f.model.parameters().means.detach()[1][2].fill_(std::nan(""));
    f.model.parameters().log_scales.detach()[3][1].fill_(std::log(0.2));
    Densifier densifier = f.densifier(CloneAndSplit());
    const DensifyReport report = densifier.update(step, f.model, f.adam);
    CHECK(report.pruned == (late ? 3 : 2));
    CHECK(f.tags() == (late ? std::vector<float>{3, 5} : std::vector<float>{3, 4, 5}));
  }
}

TEST_CASE("densify: max_gaussians keeps the strongest gradients", "[gaussians]") {
  Fixture f;
  CloneAndSplit options;
  options.max_gaussians = 7;
  Densifier densifier = f.densifier(options);
  set_statistics(densifier, {5e-4f, 2e-3f, 3e-4f, 1e-3f, 4e-4f});
  const torch::Tensor means = f.model.detached().means.clone();
  CHECK(densifier.update(600, f.model, f.adam).cloned == 2);
  REQUIRE(f.model.size() == 7);
  CHECK(torch::equal(f.model.detached().means[5], means[1]));
  CHECK(torch::equal(f.model.detached().means[6], means[3]));
}

TEST_CASE("densify: the calendar is the inherited one", "[gaussians]") {
  Fixture f;
  const Densifier densifier = f.densifier(CloneAndSplit());
  CHECK_FALSE(densifier.due(500));
  CHECK(densifier.due(600));
  CHECK_FALSE(densifier.due(601));
  CHECK(densifier.due(14900));
  CHECK_FALSE(densifier.due(15000));
  CHECK(keeps_statistics(densifier.options(), 14999));
  CHECK_FALSE(keeps_statistics(densifier.options(), 15000));
  CHECK(densifier.counted_poses(9) == 9);
  CloneAndSplit first;
  first.statistics = CountedPoses::kFirst;
  CHECK(f.densifier(first).counted_poses(9) == 1);
}

TEST_CASE("densify: opacities are reset to at most 0.01 and their moments forgotten",
          "[gaussians]") {
  Fixture f;
  f.model.parameters().logit_opacities.detach()[0].fill_(-5);
  const DensifyReport report = f.densifier(CloneAndSplit()).update(3000, f.model, f.adam);
  CHECK(report.opacity_reset);
  const torch::Tensor opacities = f.model.detached().logit_opacities.sigmoid();
  CHECK(opacities.max().item<double>() == Approx(0.01));
  CHECK(opacities[0].item<double>() == Approx(1 / (1 + std::exp(5.0))));
  CHECK(f.adam.first_moments().logit_opacities.abs().sum().item<double>() == 0);
  CHECK(f.adam.second_moments().logit_opacities.abs().sum().item<double>() == 0);
  CHECK(f.adam.first_moments().means.abs().sum().item<double>() > 0);
}

TEST_CASE("densify: nothing happens without a reason", "[gaussians]") {
  Fixture f;
  const splat::Gaussians before = f.model.detached();
  CHECK_FALSE(f.densifier(CloneAndSplit()).update(600, f.model, f.adam).changed());
  CHECK(f.model.detached().means.data_ptr() == before.means.data_ptr());
  DensifyOptions none;
  none.strategy = DensifyStrategy::kNone;
  Densifier densifier = f.densifier(none);
  CHECK_FALSE(densifier.due(600));
  CHECK_FALSE(densifier.accumulated().defined());
  CHECK_FALSE(keeps_statistics(densifier.options(), 600));
  CHECK_FALSE(densifier.update(600, f.model, f.adam).changed());
}

TEST_CASE("densify: the same generator state splits the same way", "[gaussians]") {
  std::vector<torch::Tensor> results;
  for (int run = 0; run < 2; ++run) {
    Fixture f;
    f.model.parameters().log_scales.detach().fill_(-2);
    Densifier densifier = f.densifier(CloneAndSplit());
    set_statistics(densifier, {1, 1, 1, 1, 1});
    densifier.update(600, f.model, f.adam);
    results.push_back(f.model.detached().means);
  }
  CHECK(torch::equal(results[0], results[1]));
}

TEST_CASE("world_offsets: scales act along the rotated axes", "[gaussians]") {
  // A quarter turn about z maps x to y.
  const float h = std::sqrt(0.5f);
  const torch::Tensor offsets =
      world_offsets(torch::tensor({{2 * h, 0.f, 0.f, 2 * h}}),
                    torch::tensor({{std::log(3.f), 0.f, 0.f}}), torch::tensor({{1.f, 0.f, 5.f}}));
  CHECK(torch::allclose(offsets, torch::tensor({{0.f, 3.f, 5.f}}), 1e-5, 1e-5));
}

TEST_CASE("mcmc: dead Gaussians move onto living ones, which share their opacity", "[gaussians]") {
  Fixture f;
  f.model.parameters().logit_opacities.detach().copy_(torch::tensor({-9.f, 2.f, -9.f, -9.f, -9.f}));
  at::Generator generator = make_generator(1, "mcmc");
  CHECK(relocate_dead({0.005}, f.model, f.adam, generator) == 4);
  REQUIRE(f.model.size() == 5);
  const splat::Gaussians g = f.model.detached();
  const double o = 1 / (1 + std::exp(-2.0));
  const double shared = 1 - std::pow(1 - o, 1.0 / 5);
  for (int64_t row = 0; row < 5; ++row) {
    CHECK(torch::equal(g.means[row], g.means[1]));
    CHECK(g.logit_opacities.sigmoid()[row].item<double>() == Approx(shared).epsilon(1e-4));
  }
  for (const float tag : f.tags()) CHECK(tag == 0);
}

TEST_CASE("mcmc: relocation keeps the tensors, so that a recorded step stays valid",
          "[gaussians]") {
  Fixture f(4);
  f.model.parameters().logit_opacities.detach().copy_(torch::tensor({2.f, 2.f, -9.f, 2.f}));
  const splat::Gaussians before = f.model.detached(), moments = f.adam.first_moments();
  at::Generator generator = make_generator(1, "mcmc");
  CHECK(relocate_dead({0.005, true, {}}, f.model, f.adam, generator) == 1);
  for (int i = 0; i < kParameterCount; ++i) {
    INFO(kParameterNames[i]);
    CHECK(parameter(f.model.parameters(), i).data_ptr() == parameter(before, i).data_ptr());
    CHECK(parameter(f.adam.first_moments(), i).data_ptr() == parameter(moments, i).data_ptr());
    CHECK(parameter(f.model.parameters(), i).requires_grad());
  }
  CHECK(f.model.detached().logit_opacities[2].item<double>() > 0);
}

TEST_CASE("mcmc: rows are sampled by their weights, late ones among millions too", "[gaussians]") {
  at::Generator generator = make_generator(1, "rows");
  const torch::Tensor few = drawn_rows(torch::tensor({0.f, 1.f, 0.f, 3.f, 0.f}), 4000, generator);
  const torch::Tensor counts = few.bincount({}, 5);
  CHECK(counts[1].item<int64_t>() + counts[3].item<int64_t>() == 4000);
  CHECK(std::abs(counts[3].item<int64_t>() - 3000) < 4 * 28);  // deviation sqrt(4000 · 3/16)
  // In float32 a sum of 2^24 does not change when 1 is added.
  torch::Tensor weights = torch::ones({(1 << 20) + 1});
  weights[0] = float(1 << 24);
  const torch::Tensor late = drawn_rows(weights, 10000, generator) > 0;
  CHECK(std::abs(late.sum().item<int64_t>() - 588) < 4 * 24);  // 1 of 17, deviation 23.5
}

TEST_CASE("mcmc: two that share a place look like the one before at its centre", "[gaussians]") {
  Fixture f(1);
  at::Generator generator = make_generator(1, "mcmc");
  const double o = f.model.detached().logit_opacities.sigmoid()[0].item<double>();
  const double scale = f.model.detached().log_scales.exp()[0][0].item<double>();
  CHECK(add_on_living(1, {0.005}, f.model, f.adam, generator) == 1);
  REQUIRE(f.model.size() == 2);
  const double shared = f.model.detached().logit_opacities.sigmoid()[1].item<double>();
  CHECK(1 - (1 - shared) * (1 - shared) == Approx(o).epsilon(1e-4));
  // Σ over i = 1..2: o' for i = 1, o' − o'²/√2 for i = 2.
  const double factor = o / (2 * shared - shared * shared / std::sqrt(2.0));
  CHECK(f.model.detached().log_scales.exp()[1][0].item<double>() ==
        Approx(scale * factor).epsilon(1e-4));
  CHECK(f.adam.first_moments().means.size(0) == 2);
}

TEST_CASE("mcmc: spread copies are sampled from their Gaussian and smaller, by the weights given",
          "[gaussians]") {
  Fixture f(4);
  f.model.parameters().logit_opacities.detach().copy_(torch::tensor({2.f, 2.f, -9.f, -9.f}));
  at::Generator generator = make_generator(1, "mcmc");
  const splat::Gaussians before =
      map_parameters(f.model.detached(), [](const torch::Tensor& value) { return value.clone(); });
  // The weight of a dead one is ignored.
  CopyRule rule{0.005, true, torch::tensor({0.f, 1.f, 5.f, 0.f})};
  CHECK(relocate_dead(rule, f.model, f.adam, generator) == 2);
  const splat::Gaussians after = f.model.detached();
  CHECK(after.means[0].equal(before.means[0]));
  CHECK(after.means[1].equal(before.means[1]));
  for (const int64_t row : {2, 3}) {
    const auto moved = (after.means[row] - before.means[1]).norm().item<double>();
    CHECK(moved > 0);
    CHECK(moved < 5 * 0.005);
    CHECK(after.log_scales[row].allclose(after.log_scales[1] - std::log(1.6f)));
    CHECK(after.logit_opacities[row].equal(after.logit_opacities[1]));
  }
  CHECK_FALSE(after.means[2].equal(after.means[3]));
  // Without a positive weight the opacity decides, as without weights.
  rule.weights = torch::zeros({4});
  CHECK(add_on_living(3, rule, f.model, f.adam, generator) == 3);
  CHECK(f.model.size() == 7);
}

TEST_CASE("mcmc: noise moves faint Gaussians along their axes and leaves opaque ones",
          "[gaussians]") {
  Fixture f(2);
  f.model.parameters().logit_opacities.detach().copy_(torch::tensor({-9.f, 9.f}));
  const torch::Tensor before = f.model.detached().means.clone();
  at::Generator generator = make_generator(1, "mcmc");
  add_noise(1.0, f.model, generator);
  const torch::Tensor moved = (f.model.detached().means - before).norm(2, 1);
  CHECK(moved[0].item<double>() > 0);
  CHECK(moved[0].item<double>() < 0.005 * 0.005 * 10);
  CHECK(moved[1].item<double>() == 0);
}

TEST_CASE("mcmc: update grows by the given share up to max_gaussians and regularises",
          "[gaussians]") {
  Fixture f(100);
  DensifyOptions options;
  options.strategy = DensifyStrategy::kMcmc;
  options.max_gaussians = 107;
  options.mcmc.copies = McmcCopies::kStacked;
  Densifier densifier = f.densifier(options);
  CHECK(densifier.due(17));
  CHECK_FALSE(densifier.accumulated().defined());
  CHECK_FALSE(keeps_statistics(densifier.options(), 600));
  CHECK(densifier.update(600, f.model, f.adam).added == 5);
  CHECK(densifier.update(700, f.model, f.adam).added == 2);
  CHECK(f.model.size() == 107);
  const torch::Tensor loss = densifier.regularization(f.model);
  loss.backward();
  CHECK(f.model.parameters().log_scales.grad().min().item<double>() > 0);
  CHECK_FALSE(f.densifier(CloneAndSplit()).regularization(f.model).defined());
}

TEST_CASE("mcmc: relocated Gaussians spread over the largest screen gradient", "[gaussians]") {
  Fixture f;
  f.model.parameters().logit_opacities.detach().copy_(torch::tensor({-9.f, 2.f, 2.f, 2.f, -9.f}));
  const torch::Tensor there = f.model.detached().means[3].clone();
  DensifyOptions options;
  options.strategy = DensifyStrategy::kMcmc;
  options.max_gaussians = 5;
  options.mcmc.noise_lr = 0;
  Densifier densifier = f.densifier(options);
  CHECK(keeps_statistics(options, 14999));
  CHECK_FALSE(keeps_statistics(options, 15000));
  set_statistics(densifier, {1, 0, 0, 1e-3f, 1});
  CHECK(densifier.update(600, f.model, f.adam).relocated == 2);
  for (const int64_t row : {0, 4}) {
    CHECK((f.model.detached().means[row] - there).norm().item<double>() < 5 * 0.005);
  }
  CHECK(densifier.accumulated().gradient_norm.sum().item<float>() == 0);
}

TEST_CASE("mcmc: growth beyond any integer stops at max_gaussians", "[gaussians]") {
  Fixture f(100);
  DensifyOptions options;
  options.strategy = DensifyStrategy::kMcmc;
  options.max_gaussians = 250;
  options.mcmc.growth = 1;
  options.from = 2;
  options.until = 4;
  options.every = 1;
  REQUIRE(100 * mcmc_growth(options) > 1e19);
  CHECK(f.densifier(options).update(3, f.model, f.adam).added == 150);
}

TEST_CASE("mcmc: a run of any length has time for as many new Gaussians", "[gaussians]") {
  const auto total = [](int64_t budget) {
    DensifyOptions options;
    for (Steps* steps : {&options.from, &options.until, &options.every}) steps->settle(budget);
    const double count = static_cast<double>(options.until - options.from) /
                         static_cast<double>(static_cast<int64_t>(options.every));
    return count * std::log(mcmc_growth(options));
  };
  CHECK(mcmc_growth({}) == 1.05);
  for (const int64_t budget : {1000, 3000, 8000, 12000}) {
    CHECK(total(budget) == Approx(total(25000)).epsilon(1e-9));
  }
  DensifyOptions often;
  often.every = 25;
  CHECK(mcmc_growth(often) == 1.05);
}

}  // namespace
}  // namespace jade::gaussians
