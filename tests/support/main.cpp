// SPDX-License-Identifier: Apache-2.0
// The main function of every test program. With `--needs-gpu` a program that finds no GPU exits
// with 77, which ctest reports as skipped rather than passed.
#define CATCH_CONFIG_RUNNER
#include "support/catch.h"

#include <cstring>
#include <iostream>
#include <vector>

#include "support/devices.h"

int main(int argc, char** argv) {
  std::vector<char*> arguments;
  bool needs_gpu = false;
  for (int i = 0; i < argc; ++i) {
    if (std::strcmp(argv[i], "--needs-gpu") == 0) {
      needs_gpu = true;
    } else {
      arguments.push_back(argv[i]);
    }
  }
  if (needs_gpu && !jade::test::has_gpu()) {
    std::cout << "SKIPPED: these tests need a GPU and a build with CUDA kernels\n";
    return 77;
  }
  return Catch::Session().run(static_cast<int>(arguments.size()), arguments.data());
}
