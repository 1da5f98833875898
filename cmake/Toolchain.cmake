# SPDX-License-Identifier: Apache-2.0
# What every target of ours is built with: faster tools when present, warnings, sanitizers, CUDA.

find_program(JADE_CCACHE ccache)
if(JADE_CCACHE AND NOT CMAKE_CXX_COMPILER_LAUNCHER)
  # Precompiled headers carry time stamps and defines that ccache must be told to overlook, and it
  # would read all 450 MB of ours for every file but for the checksum that lib/CMakeLists.txt writes.
  set(jade_launcher ${CMAKE_COMMAND} -E env CCACHE_PCH_EXTSUM=1
      CCACHE_SLOPPINESS=pch_defines,time_macros,include_file_mtime,include_file_ctime ${JADE_CCACHE})
  set(CMAKE_CXX_COMPILER_LAUNCHER ${jade_launcher})
  set(CMAKE_CUDA_COMPILER_LAUNCHER ${jade_launcher})
endif()
add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-Wall> $<$<COMPILE_LANGUAGE:CXX>:-Wextra>
                    $<$<COMPILE_LANGUAGE:CXX>:-Wshadow> $<$<COMPILE_LANGUAGE:CXX>:-Wno-sign-compare>)
# at::parallel_for is a template that runs serially wherever OpenMP is off.
find_package(OpenMP COMPONENTS CXX)
if(OpenMP_CXX_FOUND)
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:${OpenMP_CXX_FLAGS}>)
else()
  message(WARNING "OpenMP was not found (clang: apt install libomp-dev): the CPU code will use one thread")
endif()
if(JADE_WERROR)
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-Werror>)
endif()
# No binary names a folder of the machine that built it, as __FILE__ of our sources and of torch's headers would.
# jade_hide_folder(FOLDER NAME): FOLDER is called NAME in them; of nested folders the innermost comes last.
function(jade_hide_folder folder name)
  add_compile_options("$<$<COMPILE_LANGUAGE:CXX>:-ffile-prefix-map=${folder}=${name}>"
                      "$<$<COMPILE_LANGUAGE:CUDA>:-Xcompiler=-ffile-prefix-map=${folder}=${name}>")
endfunction()
if(JADE_SANITIZE)
  add_compile_options($<$<COMPILE_LANGUAGE:CXX>:-fsanitize=${JADE_SANITIZE}>
                      $<$<COMPILE_LANGUAGE:CXX>:-fno-omit-frame-pointer>
                      $<$<COMPILE_LANGUAGE:CXX>:-fno-sanitize-recover=undefined>)
  add_link_options(-fsanitize=${JADE_SANITIZE})
endif()

if(JADE_CUDA STREQUAL "AUTO")
  include(CheckLanguage)
  if(NOT CMAKE_CUDA_COMPILER AND EXISTS /usr/local/cuda/bin/nvcc)
    set(CMAKE_CUDA_COMPILER /usr/local/cuda/bin/nvcc)
  endif()
  check_language(CUDA)
  if(CMAKE_CUDA_COMPILER)
    set(JADE_WITH_CUDA ON)
  else()
    set(JADE_WITH_CUDA OFF)
  endif()
else()
  set(JADE_WITH_CUDA ${JADE_CUDA})
endif()
if(JADE_WITH_CUDA)
  if(NOT DEFINED CMAKE_CUDA_ARCHITECTURES)
    # Each one compiles every kernel once more, so: those of the GPUs that are here. Where there are none, one per
    # generation since Ampere: what is made for 80 runs on 86 and 89 too, and 90's intermediate code on what comes later.
    execute_process(COMMAND nvidia-smi --query-gpu=compute_cap --format=csv,noheader
                    OUTPUT_VARIABLE jade_capabilities ERROR_QUIET)
    string(REGEX MATCHALL "[0-9]+\\.[0-9]+" jade_capabilities "${jade_capabilities}")
    list(REMOVE_DUPLICATES jade_capabilities)
    string(REPLACE "." "" jade_capabilities "${jade_capabilities}")
    if(NOT jade_capabilities)
      set(jade_capabilities "80-real;90;120-real")
    endif()
    set(CMAKE_CUDA_ARCHITECTURES "${jade_capabilities}" CACHE STRING "GPU architectures to compile for")
  endif()
  set(CMAKE_CUDA_STANDARD 17)
  set(CMAKE_CUDA_STANDARD_REQUIRED ON)
  enable_language(CUDA)
endif()
message(STATUS "JADE-GS: CUDA kernels ${JADE_WITH_CUDA}")
