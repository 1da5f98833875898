// SPDX-License-Identifier: Apache-2.0
// One pixel's splats through the shared step, in scalars.
#include "support/catch.h"

#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "jade/splat/math/blend.h"

using namespace jade::splat;
using math::PlainArithmetic;

namespace {

constexpr double kCap = math::kMaxAlpha;

struct Pixel {
  std::vector<double> exponents;  ///< log2 of each α before clamping
  std::vector<double> values;     ///< ⟨dL/dC, c⟩
  double background = -0.7;       ///< ⟨dL/dC, background⟩
};

struct Blended {
  double loss = 0;
  double transmittance = 1;
  std::vector<double> weights;
};

template <bool kSmooth>
Blended blend(const Pixel& pixel) {
  Blended result;
  for (size_t i = 0; i < pixel.exponents.size(); ++i) {
    const auto step =
        math::blend_step<PlainArithmetic, kSmooth>(pixel.exponents[i], kCap, &result.transmittance);
    result.weights.push_back(step.weight);
    result.loss += step.weight * pixel.values[i];
  }
  result.loss += std::abs(result.transmittance) * pixel.background;
  return result;
}

template <bool kSmooth>
std::vector<double> adjoint(const Pixel& pixel) {
  double behind = blend<kSmooth>(pixel).loss, transmittance = 1;
  std::vector<double> gradient;
  for (size_t i = 0; i < pixel.exponents.size(); ++i) {
    const auto step =
        math::blend_step<PlainArithmetic, kSmooth>(pixel.exponents[i], kCap, &transmittance);
    gradient.push_back(
        math::blend_step_adjoint<PlainArithmetic, kSmooth>(step, pixel.values[i], kCap, &behind));
  }
  return gradient;
}

/// dL/d ln α by central differences.
template <bool kSmooth>
double difference(Pixel pixel, size_t i) {
  const double step = 1e-5, middle = pixel.exponents[i];
  pixel.exponents[i] = middle + step;
  const double above = blend<kSmooth>(pixel).loss;
  pixel.exponents[i] = middle - step;
  return (above - blend<kSmooth>(pixel).loss) / (2 * step * std::log(2.0));
}

template <bool kSmooth>
void check_gradients(const Pixel& pixel) {
  const auto gradient = adjoint<kSmooth>(pixel);
  for (size_t i = 0; i < gradient.size(); ++i) {
    INFO("splat " << i);
    CHECK(gradient[i] == Approx(difference<kSmooth>(pixel, i)).epsilon(1e-7).margin(1e-9));
  }
}

/// The first is clamped, the third not visible.
const Pixel kPixel = {{0.5, -1, -9, -3, -0.2}, {1.5, -2, 3, 0.25, 0.8}};

}  // namespace

TEST_CASE("blend step: weights and transmittance are those of the sum", "[splat]") {
  const Blended blended = blend<false>(kPixel);
  const double alphas[] = {0.99, 0.5, 0, 0.125, std::exp2(-0.2)};
  double transmittance = 1;
  for (size_t i = 0; i < 5; ++i) {
    CHECK(blended.weights[i] == Approx(alphas[i] * transmittance));
    transmittance *= 1 - alphas[i];
  }
  CHECK(blended.transmittance == Approx(transmittance));
}

TEST_CASE("blend step: a splat that takes too much stops the pixel before it", "[splat]") {
  const Pixel pixel = {{0, 0, -1, -6}, {1, 1, 1, 1}};
  const Blended blended = blend<false>(pixel);  // T: 0.01, then 1e-4, which is too little
  CHECK(blended.weights == std::vector<double>{0.99, 0, 0, 0});
  CHECK(blended.transmittance == Approx(-0.01));
}

TEST_CASE("blend step: the adjoint matches central differences", "[splat][gradcheck]") {
  check_gradients<false>(kPixel);
  Pixel dark = kPixel;
  dark.values.assign(5, 0);  // only the transmitted background remains
  check_gradients<false>(dark);
  check_gradients<false>({{0, 0, -1, -6}, {1, 2, 3, 4}});  // stops at once
  check_gradients<true>({{0.5, -1, -9, -7.5, -3, -7.2}, {1.5, -2, 3, 0.25, 0.8, -4}});
}

TEST_CASE("blend step: capped, invisible and stopped splats get no gradient", "[splat]") {
  const auto gradient = adjoint<false>(kPixel);
  CHECK(gradient[0] == 0);
  CHECK(gradient[1] != 0);
  CHECK(gradient[2] == 0);
  const auto stopped = adjoint<false>({{-0.1, -0.1, -0.02, -1}, {1, 2, 3, 4}});
  CHECK(stopped[1] != 0);
  CHECK(stopped[2] == 0);
  CHECK(stopped[3] == 0);
}

TEST_CASE("replay step: pixels of the forward pass, told apart by their alpha", "[splat]") {
  std::mt19937 random(3);
  const auto uniform = [&](float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random);
  };
  int stopped = 0, after_end = 0;  // pixels; splats that would change a pixel without the bound
  for (int pixel = 0; pixel < 3000; ++pixel) {
    const float opaque = uniform(-9, 1), cap = static_cast<float>(kCap);
    float t = 1, replayed = 1;
    std::vector<float> exponents(uniform(1, 400)), weights;
    for (float& exponent : exponents) {
      exponent = uniform(-9, opaque);
      weights.push_back(math::blend_step<PlainArithmetic, false>(exponent, cap, &t).weight);
    }
    stopped += t < 0;
    const float bound = math::replay_bound(1 - std::abs(t));
    for (size_t i = 0; i < exponents.size(); ++i) {
      const auto step =
          math::replay_step<PlainArithmetic, true>(exponents[i], cap, bound, &replayed);
      if (step.weight != weights[i]) FAIL_CHECK("pixel " << pixel << ", splat " << i);
      after_end += !step.goes_on && math::is_visible(exponents[i]);
      float behind = 0.5f;
      const float u = math::blend_step_adjoint<PlainArithmetic, false>(step, 2.0f, cap, &behind);
      if (weights[i] == 0 && (u != 0 || behind != 0.5f)) FAIL_CHECK("a gradient of splat " << i);
    }
    if (replayed != std::abs(t)) FAIL_CHECK("pixel " << pixel << ": " << replayed << ", " << t);
  }
  CHECK(stopped > 300);
  CHECK(after_end > 3000);
}

TEST_CASE("blend step: the exponent about a point is the same polynomial", "[splat]") {
  const auto falloff = math::make_falloff(7.0, -2.5, 3.0, 7.0 * 3.0 - 2.5 * 2.5);
  const double log2_opacity = -0.4, dx = 3.7, dy = -5.2;
  const auto local = math::about(falloff, log2_opacity, dx, dy);
  for (double y = -3.5; y < 4; ++y) {
    for (double x = -3.5; x < 4; ++x) {
      const auto row = math::at_row(falloff, log2_opacity, dy + y);
      CHECK(math::exponent(math::at_row(local, y), x) ==
            Approx(math::exponent(row, dx + x)).epsilon(1e-13));
    }
  }
}

TEST_CASE("blend step: no rounding lifts an exponent above its bound", "[splat]") {
  // Splats of the smallest width, up to 33,000 px long (sigma), seen at points near their axis.
  std::mt19937 random(1);
  const auto uniform = [&](float low, float high) {
    return std::uniform_real_distribution<float>(low, high)(random);
  };
  int above = 0;  // without an allowance for rounding
  for (int i = 0; i < 20000; ++i) {
    const float angle = uniform(0, 3.2f), c = std::cos(angle), s = std::sin(angle);
    const float length = std::exp2(uniform(0, 30)), width = 0.3f;
    const auto falloff =
        math::make_falloff(length * c * c + width * s * s, (length - width) * c * s,
                           length * s * s + width * c * c, length * width);
    const float along = uniform(-1, 1) * std::sqrt(length), log2_opacity = -0.02f;
    const float dx = along * c + uniform(-4, 4), dy = along * s + uniform(-4, 4);
    const float bound = math::exponent_bound(falloff, log2_opacity, dx, dy);
    const auto local = math::about(falloff, log2_opacity, dx, dy);
    float most = -1e30f;
    for (float y = -3.5f; y < 4; ++y) {
      for (float x = -3.5f; x < 4; ++x) {
        most = std::max(most, math::exponent(math::at_row(local, y), x));
      }
    }
    above += most > log2_opacity;
    if (most > bound) FAIL_CHECK("length " << length << ": " << most << " > " << bound);
  }
  CHECK(above > 100);
}
