// SPDX-License-Identifier: Apache-2.0
#include "jade/core/random.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"

namespace jade {
namespace {

TEST_CASE("make_generator: purposes are independent and repeatable", "[core]") {
  auto a = make_generator(7, "view order"), b = make_generator(7, "view order");
  auto other = make_generator(7, "pose draws"), seed = make_generator(8, "view order");
  const auto draw = [](at::Generator& g) { return torch::rand({16}, g); };
  const auto first = draw(a);
  CHECK(first.equal(draw(b)));
  CHECK_FALSE(first.equal(draw(other)));
  CHECK_FALSE(first.equal(draw(seed)));
}

TEST_CASE("make_generator: its state restores the stream", "[core]") {
  auto generator = make_generator(1, "test");
  draw_index(generator, 10);
  const auto state = generator.get_state();
  const auto expected = torch::rand({8}, generator);
  generator.set_state(state);
  CHECK(expected.equal(torch::rand({8}, generator)));
}

TEST_CASE("draw_index: covers its range evenly", "[core]") {
  auto generator = make_generator(3, "test");
  std::vector<int> counts(5);
  for (int i = 0; i < 5000; ++i) ++counts.at(static_cast<size_t>(draw_index(generator, 5)));
  for (const int count : counts) CHECK(std::abs(count - 1000) < 150);  // five standard deviations
  CHECK_THROWS_AS(draw_index(generator, 0), ContractError);
}

}  // namespace
}  // namespace jade
