// SPDX-License-Identifier: Apache-2.0
#include <cstdio>
#include <jade/splat/render.h>

int main() {
  const auto means = torch::tensor({{0.0F, 0.0F, 3.0F}, {0.4F, 0.1F, 4.0F}}).requires_grad_();
  const auto rotations = torch::tensor({{1.0F, 0.0F, 0.0F, 0.0F}}).repeat({2, 1});
  const jade::splat::Gaussians gaussians{means, rotations, torch::full({2, 3}, -1.5F),
                                         torch::zeros({2}), torch::ones({2, 1, 3})};
  const jade::splat::CameraBatch cameras{torch::eye(4).unsqueeze(0),
                                         torch::tensor({{40.0F, 40.0F, 16.0F, 12.0F}}), 32, 24};
  const auto image = jade::splat::render(gaussians, cameras, {}).color;
  image.slice(/*dim=*/3, 0, 16).sum().backward();
  std::printf("image %.4f gradient %.4f\n", image.sum().item<double>(),
              means.grad().abs().sum().item<double>());
}
