// SPDX-License-Identifier: Apache-2.0
#include "jade/gaussians/codebook.h"

#include "support/catch.h"

namespace jade::gaussians {
namespace {

torch::Tensor rows_of(const Palette& palette) {
  return palette.rows.index_select(0, palette.labels);
}

TEST_CASE("codebook: nearest of 256 numbers, finer than even steps", "[gaussians]") {
  torch::manual_seed(4);
  const torch::Tensor numbers = torch::randn({5000, 3}).to(torch::kFloat64);
  const Codebook book = codebook_of(numbers);
  REQUIRE(book.labels.sizes() == numbers.sizes());
  const torch::Tensor coded =
      book.values.index_select(0, book.labels.flatten().to(torch::kInt64)).reshape({5000, 3});
  const torch::Tensor best =
      std::get<0>((numbers.flatten().unsqueeze(1) - book.values.unsqueeze(0)).abs().min(1));
  CHECK(torch::allclose((numbers - coded).abs().flatten(), best));
  const double range = (numbers.max() - numbers.min()).item<double>();
  const double even = range / 255 / std::sqrt(12.0);  // root mean square of even steps
  CHECK((numbers - coded).square().mean().sqrt().item<double>() < 0.8 * even);
  // Few numbers are stored exactly.
  const torch::Tensor few = torch::tensor({-3.0, 5.0, 5.0, 0.25}, torch::kFloat64);
  const Codebook exact = codebook_of(few);
  CHECK(torch::allclose(exact.values.index_select(0, exact.labels.to(torch::kInt64)), few));
}

TEST_CASE("palette: few rows as they are, many by near ones", "[gaussians]") {
  torch::manual_seed(5);
  const torch::Tensor few = torch::randn({40, 6});
  CHECK(rows_of(palette_of(few, 40)).equal(few));
  // Clusters far apart: each row's palette row belongs to its own cluster.
  const torch::Tensor centres = torch::randn({8, 6}) * 100;
  const torch::Tensor owner = torch::arange(3000) % 8;
  const torch::Tensor rows = centres.index_select(0, owner) + torch::randn({3000, 6});
  for (const int64_t at_most : {64, 600}) {
    const Palette palette = palette_of(rows, at_most);
    CHECK(palette.rows.size(0) <= at_most);
    CHECK(palette.rows.size(0) > at_most / 2);
    CHECK((rows - rows_of(palette)).norm(2, 1).max().item<double>() < 10);
  }
  const auto error = [&](int64_t at_most) {
    return (rows - rows_of(palette_of(rows, at_most))).square().mean().item<double>();
  };
  CHECK(error(600) < error(64));
  CHECK(palette_of(rows, 600).rows.equal(palette_of(rows, 600).rows));
}

}  // namespace
}  // namespace jade::gaussians
