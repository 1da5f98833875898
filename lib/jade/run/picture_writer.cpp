// SPDX-License-Identifier: Apache-2.0
#include "jade/run/picture_writer.h"

#include <ATen/Parallel.h>

#include "jade/imaging/image_io.h"

namespace jade::run {

void PictureWriter::add(const std::filesystem::path& path, const torch::Tensor& image) {
  const torch::Tensor kept = image.detach().to(torch::kCPU, torch::kFloat32, false, /*copy=*/true);
  bytes_ += static_cast<int64_t>(kept.nbytes());
  added_.emplace_back(path, kept);
  if (bytes_ > max_bytes_) begin();
}

void PictureWriter::begin() {
  wait();
  if (added_.empty()) return;
  bytes_ = 0;
  writing_ = std::async(std::launch::async, [files = std::exchange(added_, {})] {
    at::parallel_for(0, static_cast<int64_t>(files.size()), 1, [&](int64_t begin, int64_t end) {
      for (int64_t i = begin; i < end; ++i) {
        const auto& [path, image] = files[static_cast<size_t>(i)];
        imaging::write_image(path, image);
      }
    });
  });
}

void PictureWriter::wait() {
  if (writing_.valid()) writing_.get();
}

}  // namespace jade::run
