// SPDX-License-Identifier: Apache-2.0
#include "jade/core/device.h"

#include "support/catch.h"

#include <ATen/Parallel.h>
#include <cstdlib>
#include <torch/types.h>

#include "jade/core/error.h"

namespace jade {
namespace {

TEST_CASE("trim_device_memory: gives back what no tensor holds, and only beyond what may be kept",
          "[core][cuda]") {
  constexpr int64_t kBytes = int64_t{256} << 20;
  const torch::Device device(torch::kCUDA, 0);
  const torch::Tensor held = torch::ones({1024}, device);
  torch::empty({kBytes}, torch::dtype(torch::kUInt8).device(device));
  CHECK(trim_device_memory(device, 4 * kBytes) == 0);
  CHECK(trim_device_memory(device, kBytes / 2) >= kBytes);
  CHECK(trim_device_memory(device, kBytes / 2) == 0);
  CHECK(held.sum().item<float>() == 1024);
}

TEST_CASE("trim_device_memory: has nothing to do on the CPU", "[core]") {
  CHECK(trim_device_memory(torch::kCPU, 0) == 0);
}

TEST_CASE("limit_threads_beside: a GPU leaves eight threads, unless the user said how many",
          "[core]") {
  const int before = at::get_num_threads();
  const char* said = std::getenv("OMP_NUM_THREADS");
  const std::string kept = said == nullptr ? "" : said;
  unsetenv("OMP_NUM_THREADS");
  at::set_num_threads(12);
  limit_threads_beside(torch::kCPU);
  CHECK(at::get_num_threads() == 12);
  setenv("OMP_NUM_THREADS", "12", 1);
  limit_threads_beside(torch::kCUDA);
  CHECK(at::get_num_threads() == 12);
  unsetenv("OMP_NUM_THREADS");
  limit_threads_beside(torch::kCUDA);
  CHECK(at::get_num_threads() == 8);
  at::set_num_threads(3);
  limit_threads_beside(torch::kCUDA);
  CHECK(at::get_num_threads() == 3);
  at::set_num_threads(before);
  if (said != nullptr) setenv("OMP_NUM_THREADS", kept.c_str(), 1);
}

TEST_CASE("FewerThreads: two of eight cores or more are free while a GPU may start", "[core]") {
  const int before = at::get_num_threads();
  const char* said = std::getenv("OMP_NUM_THREADS");
  const std::string kept = said == nullptr ? "" : said;
  const auto threads_of = [](int all, bool fewer) {
    at::set_num_threads(all);
    const FewerThreads beside(fewer);
    return at::get_num_threads();
  };
  unsetenv("OMP_NUM_THREADS");
  CHECK(threads_of(16, true) == 14);
  CHECK(at::get_num_threads() == 16);
  CHECK(threads_of(8, true) == 6);
  CHECK(threads_of(7, true) == 7);
  CHECK(threads_of(16, false) == 16);
  setenv("OMP_NUM_THREADS", "16", 1);
  CHECK(threads_of(16, true) == 16);
  unsetenv("OMP_NUM_THREADS");
  at::set_num_threads(before);
  if (said != nullptr) setenv("OMP_NUM_THREADS", kept.c_str(), 1);
}

TEST_CASE("select_device: words it does not know and GPUs that are not there are distinguished",
          "[core]") {
  CHECK(select_device("cpu").is_cpu());
  CHECK(select_device("auto").is_cuda() == (cuda_device_count() > 0));
  for (const char* word : {"gpu", "cuda:", "cuda:x", "cuda:-1", ""}) {
    CHECK_THROWS_AS(select_device(word), ConfigError);
  }
  CHECK_THROWS_AS(select_device("cuda:63"), DeviceError);
}

}  // namespace
}  // namespace jade
