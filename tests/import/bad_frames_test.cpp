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

}  // namespace

TEST_CASE("bad frames: blank and half-written ones are found", "[import]") {
  CHECK(import::bad_frames({}).empty());
  auto frames = pictures();
  CHECK(import::bad_frames(frames).empty());
  frames[1].zero_();
  frames[2].fill_(1);
  frames[4].slice(1, 24).fill_(0.5);
  frames[6].slice(1, 0, 5).zero_();
  CHECK(import::bad_frames(frames) == std::vector<size_t>{1, 2, 4, 6});
}

TEST_CASE("bad frames: borders, bright skies and dark corners are none", "[import]") {
  auto frames = pictures();
  for (torch::Tensor& frame : frames) frame.slice(1, 40).zero_();
  CHECK(import::bad_frames(frames).empty());
  frames[3].slice(1, 20).zero_();
  CHECK(import::bad_frames(frames) == std::vector<size_t>{3});
  // A sky that only one frame sees, and a place that gets dark gradually.
  frames = pictures();
  frames[2].slice(1, 0, 12).fill_(1);
  frames[5] = frames[5] * torch::linspace(0, 1, 48).sub(0.4).clamp_min(0).unsqueeze(1);
  CHECK(import::bad_frames(frames).empty());
  // All frames of a test picture.
  for (torch::Tensor& frame : frames) frame.fill_(0.5);
  CHECK(import::bad_frames(frames).empty());
}
