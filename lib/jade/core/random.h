// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <ATen/core/Generator.h>
#include <cstdint>
#include <string>
#include <torch/types.h>

namespace jade {

/// Creates a CPU generator for one purpose ("view order", "pose draws", …). Generators of different
/// purposes are independent, so that more samples for one purpose never change another. Their state
/// is a tensor, `generator.get_state()`, and belongs in the checkpoint.
at::Generator make_generator(uint64_t seed, const std::string& purpose);

/// The seed that make_generator uses, for code with its own generator type.
uint64_t derive_seed(uint64_t seed, const std::string& purpose);

/// 64 uniform random bits.
uint64_t draw_bits(at::Generator& generator);

/// A uniform random integer in [0, bound).
int64_t draw_index(at::Generator& generator, int64_t bound);

}  // namespace jade
