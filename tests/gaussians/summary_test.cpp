// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/summary.h"

#include "support/catch.h"

#include <limits>
#include <torch/types.h>

#include "support/naming.h"

namespace jade::gaussians {
namespace {

splat::Gaussians row_of(int64_t count) {
  splat::Gaussians g;
  g.means = torch::zeros({count, 3});
  g.means.select(1, 0) = torch::arange(count);
  g.rotations = torch::tensor({1.F, 0.F, 0.F, 0.F}).repeat({count, 1});
  g.log_scales = torch::tensor({0.F, -1.F, -2.F}).repeat({count, 1});
  g.logit_opacities = torch::zeros({count});
  g.sh = torch::zeros({count, 4, 3});
  return g;
}

TEST_CASE("spread_of: quantiles of what is finite", "[gaussians]") {
  torch::Tensor values = torch::arange(102, torch::kFloat32);
  values[101] = std::numeric_limits<float>::infinity();
  const Spread spread = spread_of(values);
  CHECK(spread.min == 0);
  CHECK(spread.low == 1);
  CHECK(spread.median == 50);
  CHECK(spread.high == 99);
  CHECK(spread.max == 100);
  CHECK(spread_of(torch::full({3}, NAN)).max == 0);
}

TEST_CASE("summarize: what Gaussians are like", "[gaussians]") {
  const GaussianSummary summary = summarize(row_of(101));
  CHECK(summary.count == 101);
  CHECK(summary.sh_degree == 1);
  CHECK(summary.x.max == 100);
  CHECK(summary.opacity.median == 0.5);
  CHECK(summary.scale.median == Approx(1));
  CHECK(summary.elongation.median == Approx(std::exp(2.0)));
  CHECK(summary.transparent == 0);
  CHECK(summary.problems.empty());
}

TEST_CASE("bulk: without strays, and a small scene has a near plane of its size", "[gaussians]") {
  splat::Gaussians g = row_of(101);
  g.means[100][1] = 1e6;
  const Bulk bulk = bulk_of(g);
  CHECK(bulk.middle[0] == Approx(50));
  CHECK(bulk.radius == Approx(49));
  CHECK(near_plane_of(g, 0.01) == 0.01);
  g.means = g.means * 1e-3;
  CHECK(near_plane_of(g, 0.01) == Approx(0.01 * 0.049));
  // Without a size, the usual numbers of a camera work.
  CHECK(bulk_of(row_of(1)).radius > 0);
  CHECK(bulk_of(row_of(0)).radius > 0);
}

TEST_CASE("summarize: each thing that is wrong is one problem", "[gaussians]") {
  const auto only_problem = [](const splat::Gaussians& g) {
    const GaussianSummary summary = summarize(g);
    REQUIRE(summary.problems.size() == 1);
    return summary.problems[0];
  };
  CHECK_THAT(only_problem(row_of(0)), test::naming("no Gaussian"));
  splat::Gaussians g = row_of(100);
  g.sh[3][0][0] = NAN;
  CHECK_THAT(only_problem(g), test::naming("1 of 100", "NaN or Inf", "colours"));
  g = row_of(100);
  g.rotations[5].zero_();
  CHECK_THAT(only_problem(g), test::naming("1 of 100", "zero quaternion"));
  g = row_of(100);
  g.log_scales[5][1] = 31;
  CHECK_THAT(only_problem(g), test::naming("1 of 100", "log scales", "30"));
  g = row_of(100);
  g.logit_opacities.fill_(-9);
  CHECK_THAT(only_problem(g), test::naming("transparent"));
  g = row_of(100);
  g.log_scales.fill_(6);
  CHECK_THAT(only_problem(g), test::naming("fog"));
  g = row_of(1000);
  g.means[0][1] = 1e7;
  CHECK_THAT(only_problem(g), Catch::Contains("floaters"));
}

TEST_CASE("undrawable_warning: counts a Gaussian once, whatever is wrong with it", "[gaussians]") {
  splat::Gaussians g = row_of(100);
  CHECK(undrawable_warning(g, "a.ply").empty());
  CHECK(undrawable_warning(row_of(0), "a.ply").empty());
  g.sh[3][0][0] = NAN;
  g.means[3][0] = NAN;
  g.logit_opacities[7] = INFINITY;
  CHECK_THAT(undrawable_warning(g, "a.ply"),
             Catch::StartsWith("a.ply: 2 of 100 Gaussians have NaN or Inf"));
  g = row_of(4);
  g.logit_opacities.fill_(-6);
  CHECK(count_visible(g) == 0);
  CHECK_THAT(undrawable_warning(g, "a.ply"), test::naming("all of 4"));
}

TEST_CASE("drawable: what splatting rejects is left out, and why is counted", "[gaussians]") {
  splat::Gaussians g = row_of(10);
  g.log_scales[1][0] = 40;
  g.log_scales[2][0] = 40;
  g.rotations[3].zero_();
  g.logit_opacities[4] = 2e4;
  g.means[5][2] = -1e13;
  CHECK(drawable(g).size() == 5);
  CHECK_THAT(undrawable_reasons(g), test::naming("2 have log scales", "30"));
  CHECK(undrawable_reasons(row_of(3)).empty());
}

}  // namespace
}  // namespace jade::gaussians
