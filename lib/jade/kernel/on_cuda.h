// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <type_traits>

#include "jade/core/error.h"

namespace jade::kernel {

/// Whether this build has CUDA kernels.
#ifdef JADE_WITH_CUDA
constexpr bool kWithCuda = true;
#else
constexpr bool kWithCuda = false;
#endif

/// Returns call(), which runs kernels on a GPU. Builds without CUDA kernels do not instantiate
/// `call`, so the functions that it calls need not exist there.
/// @param what  the work, "SSIM"
/// @throws DeviceError in a build without CUDA kernels.
template <class Call>
std::invoke_result_t<const Call&> on_cuda([[maybe_unused]] const char* what,
                                          [[maybe_unused]] const Call& call) {
  if constexpr (kWithCuda) {
    return call();
  } else {
    throw DeviceError(concat(what, " on a GPU needs CUDA kernels, and this build has none: ",
                             "configure with -DJADE_CUDA=ON or use --device cpu"));
  }
}

}  // namespace jade::kernel
