// SPDX-License-Identifier: Apache-2.0
// Shapes of the router's convolutions, forward and backward, and the memory layout of their
// weights.
#pragma once

#include "jade/router/conv_layer.h"
#include "jade/router/conv_tile.cuh"

namespace jade::router::cuda {

/// Splits a convolution's sums into products of depth 16. The tile in shared memory is
/// [row][column][pair of channels], so that the pairs of a pixel and of its right neighbours, the
/// taps of one kernel row, are contiguous: a step takes the next eight words. With eight pairs a
/// step is one tap.
template <int IN, int OUT, int K>
struct Shape {
  static constexpr int kIn = IN, kOut = OUT, kKernel = K;
  static constexpr int kPairs = (IN + 1) / 2;
  /// Words from a pixel to the next. If it is odd, a product's pixels are four apart, so that eight
  /// pixels' four words are in 32 different banks. For four, consecutive pixels are conflict-free.
  static constexpr int kStride = kPairs % 2 == 0 && kPairs != 4 ? kPairs + 1 : kPairs;
  static constexpr bool kSpread = kStride % 2 == 1;
  static constexpr bool kStepPerTap = kPairs == 8;
  static constexpr int kRun = K * kStride;
  static constexpr int kSteps = kStepPerTap ? K : round_up(kRun, 8) / 8;
  static constexpr int kAdvance = kStepPerTap ? kStride : 8;
  static constexpr int kWide = kTileX + K - 1, kHigh = kTileY + K - 1, kPixels = kWide * kHigh;
  static constexpr int kBehind = kStepPerTap ? 0 : kSteps * 8 - kRun;  ///< read by the last pixels
  static constexpr int kWords = round_up(kPixels * kStride + kBehind, 4);
  static constexpr int kColumns = round_up(OUT, 8) / 8;
  static constexpr int kFragments = kSteps * K * kColumns * 32;
};

/// Weights of a convolution in the order of the tensor cores: [step][kernel row][eight
/// outputs][lane] of the two words of B.
struct Prepared {
  int in, out, kernel, stride, steps, columns;
  bool step_per_tap;
  int layer;
  bool turned;   ///< the layer's input gradient: weights rotated by 180 degrees
  int first;     ///< of the layer's inputs, if `turned`
  int layer_in;  ///< the layer's own size
  int layer_out;
  int begin;  ///< of the fragments, in pairs of words
};

/// Convolutions: layers by their own numbers, except head3, which is not one; then gradients of a
/// layer's input.
enum Product {
  kOfHead1 = kHead3,
  kOfFeatures,
  kOfEvent1,
  kOfImage1,
  kHeadOfBlurry,
  kOfBlurry,
  kOfPsi,
  kProducts
};

constexpr int kInverses = round_up(kProducts, 2);  ///< words at the start: 1 / the weights' scale

using Event1 = Shape<2, 16, 5>;
using Event2 = Shape<16, 6, 5>;
using Image1 = Shape<3, 10, 5>;
using Image2 = Shape<10, 8, 5>;
using Head1 = Shape<17, 9, 3>;
using Head2 = Shape<9, 24, 3>;
using Head3 = Shape<24, 1, 1>;
using OfHead1 = Shape<24, 9, 3>;
using OfFeatures = Shape<9, 14, 3>;
using OfEvent1 = Shape<6, 16, 5>;
using OfImage1 = Shape<8, 10, 5>;
using HeadOfBlurry = Shape<9, 3, 3>;
using OfBlurry = Shape<10, 3, 5>;
using OfPsi = Shape<16, 2, 5>;

struct Plans {
  Prepared of[kProducts] = {};
  int end = kInverses / 2;

  /// For the gradient of a subset of a layer's inputs: index of the first, and the total number.
  template <class S>
  constexpr void add(int product, int layer, bool turned = false, int first = 0,
                     int layer_in = S::kOut) {
    of[product] = {S::kIn,
                   S::kOut,
                   S::kKernel,
                   S::kStride,
                   S::kSteps,
                   S::kColumns,
                   S::kStepPerTap,
                   layer,
                   turned,
                   first,
                   turned ? layer_in : S::kIn,
                   turned ? S::kIn : S::kOut,
                   end};
    end += S::kFragments;
  }
};

constexpr Plans make_plans() {
  Plans plans;
  plans.add<Event1>(kEvent1, kEvent1);
  plans.add<Event2>(kEvent2, kEvent2);
  plans.add<Image1>(kImage1, kImage1);
  plans.add<Image2>(kImage2, kImage2);
  plans.add<Head1>(kHead1, kHead1);
  plans.add<Head2>(kHead2, kHead2);
  plans.add<OfHead1>(kOfHead1, kHead2, true);
  plans.add<OfFeatures>(kOfFeatures, kHead1, true, 3, 17);
  plans.add<OfEvent1>(kOfEvent1, kEvent2, true);
  plans.add<OfImage1>(kOfImage1, kImage2, true);
  plans.add<HeadOfBlurry>(kHeadOfBlurry, kHead1, true, 0, 17);
  plans.add<OfBlurry>(kOfBlurry, kImage1, true);
  plans.add<OfPsi>(kOfPsi, kEvent1, true);
  return plans;
}
inline constexpr Plans kPlans = make_plans();

}  // namespace jade::router::cuda
