# SPDX-License-Identifier: Apache-2.0
# jade_splat_kernels: all sources of the op that know nothing of torch, compiled once for the programs and for the Python
# package (python/jade_splat).
set(sources cpu/bin.cpp cpu/dispatch.cpp)
if(JADE_WITH_CUDA)
  list(APPEND sources cuda/capacity.cpp cuda/chunk_size.cpp cuda/project.cu cuda/chunk.cu cuda/bin.cu cuda/blend.cu)
endif()
list(TRANSFORM sources PREPEND "${CMAKE_CURRENT_LIST_DIR}/")
add_library(jade_splat_kernels OBJECT ${sources})
get_filename_component(jade_lib "${CMAKE_CURRENT_LIST_DIR}/../.." ABSOLUTE)
target_include_directories(jade_splat_kernels PUBLIC "${jade_lib}")
if(JADE_WITH_CUDA)
  target_include_directories(jade_splat_kernels SYSTEM PRIVATE ${CUDAToolkit_INCLUDE_DIRS})
endif()

# Multiplications and additions are fused where the source says so and nowhere else: forward and
# backward pass must take the same decisions. Packs wider than a register never leave their object.
jade_add_isa_sources(splat cpu/kernels_impl.h TARGET jade_splat_kernels ISAS portable avx2 avx512
  FLAGS -O3 -ffp-contract=off -fno-math-errno -Wno-psabi)
