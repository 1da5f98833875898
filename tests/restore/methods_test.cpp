// SPDX-License-Identifier: Apache-2.0
#include "jade/restore/methods.h"

#include "support/catch.h"

#include <torch/types.h>

#include "jade/core/error.h"
#include "support/naming.h"

namespace jade::restore {
namespace {

/// Two pixels: EDI is right at the first, EFNet at the second.
Candidates two_pixels() {
  Candidates c;
  c.truth = torch::tensor({0.5F, 0.5F}).view({1, 1, 2}).expand({3, 1, 2});
  c.edi = torch::tensor({0.5F, 0.9F}).view({1, 1, 2}).expand({3, 1, 2});
  c.efnet = torch::tensor({0.1F, 0.5F}).view({1, 1, 2}).expand({3, 1, 2});
  c.alpha = torch::tensor({0.25F, 1.F}).view({1, 1, 2});
  return c;
}

torch::Tensor restored(const char* method) {
  return find_method(method).restore(two_pixels())[0].flatten();
}

TEST_CASE("methods: each mixes the two restorations as it says", "[restore]") {
  CHECK(torch::allclose(restored("edi"), torch::tensor({0.5F, 0.9F})));
  CHECK(torch::allclose(restored("efnet"), torch::tensor({0.1F, 0.5F})));
  CHECK(torch::allclose(restored("mean"), torch::tensor({0.3F, 0.7F})));
  CHECK(torch::allclose(restored("oracle"), torch::tensor({0.5F, 0.5F})));
  CHECK(torch::allclose(restored("router"), torch::tensor({0.2F, 0.9F})));
}

TEST_CASE("methods: the oracle compares what can be shown", "[restore]") {
  Candidates c = two_pixels();
  c.truth = torch::ones_like(c.truth);
  c.edi = torch::full_like(c.edi, 1.5F);  // white once it is clamped
  c.efnet = torch::full_like(c.efnet, 0.9F);
  CHECK(edi_is_better(c).all().item<bool>());
}

TEST_CASE("methods: an unknown one is refused with those that there are", "[restore]") {
  CHECK_THROWS_WITH(find_method("magic"),
                    Catch::Contains("edi, efnet, mean, oracle, router") && test::naming("'magic'"));
}

}  // namespace
}  // namespace jade::restore
