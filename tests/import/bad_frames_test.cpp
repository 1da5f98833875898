// SPDX-License-Identifier: Apache-2.0
#include "jade/import/bad_frames.h"

#include "support/catch.h"

#include <torch/types.h>

using namespace jade;

namespace {

std::vector<torch::Tensor> pictures() {
  torch::manual_seed(5);
  std::vector<torch::Tensor> frames;
  for (int i = 0; i < 8; ++i) frames.push_back(0.1 + 0.7 * torch::rand({3, 48, 64}));
  return frames;
}

/// Frames without a whole picture where all rows see changes.
std::vector<size_t> bad_of(const std::vector<torch::Tensor>& frames) {
  return import::bad_frames(frames, [](size_t, int64_t, int64_t) { return true; });
}

}  // namespace

TEST_CASE("bad frames: blank and half-written ones are found", "[import]") {
  CHECK(bad_of({}).empty());
  auto frames = pictures();
  CHECK(bad_of(frames).empty());
  frames[1].zero_();
  frames[2].fill_(1);
  frames[4].slice(1, 24).fill_(0.5);
  frames[6].slice(1, 0, 5).zero_();
  CHECK(bad_of(frames) == std::vector<size_t>{1, 2, 4, 6});
}

TEST_CASE("bad frames: borders, bright skies and dark corners are none", "[import]") {
  auto frames = pictures();
  for (torch::Tensor& frame : frames) frame.slice(1, 40).zero_();
  CHECK(bad_of(frames).empty());
  frames[3].slice(1, 20).zero_();
  CHECK(bad_of(frames) == std::vector<size_t>{3});
  // A place that gets dark gradually, and a dark picture.
  frames = pictures();
  frames[2] = (frames[2] * 5).round() / 255;
  frames[5] = frames[5] * torch::linspace(0, 1, 48).sub(0.4).clamp_min(0).unsqueeze(1);
  CHECK(bad_of(frames).empty());
  // All frames of a test picture.
  for (torch::Tensor& frame : frames) frame.fill_(0.5);
  CHECK(bad_of(frames).empty());
}

TEST_CASE("bad frames: a flat part without events is a sky", "[import]") {
  auto frames = pictures();
  for (int i = 0; i < 8; ++i) frames[size_t(i)].slice(1, 0, 4 * i).fill_(i % 2 == 0 ? 0.0 : 0.9);
  CHECK(bad_of(frames) == std::vector<size_t>{6, 7});
  std::vector<int64_t> asked;
  const auto none = [&](size_t, int64_t begin, int64_t end) {
    CHECK(begin == 0);
    asked.push_back(end);
    return false;
  };
  CHECK(import::bad_frames(frames, none).empty());
  CHECK(asked == std::vector<int64_t>{24, 28});
}
