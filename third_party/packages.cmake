# SPDX-License-Identifier: Apache-2.0
# Finds installed packages and wraps each in one jade::* target. Nothing is vendored or downloaded.

function(jade_missing what debian)
  message(FATAL_ERROR "${what} was not found. Run scripts/setup.sh, or install it yourself: ${debian}")
endfunction()

# --- LibTorch, from the project's virtual environment or -DJADE_TORCH_ROOT=/path/to/torch ---------
# The wheel's own CMake package insists on the whole CUDA toolkit even for CPU programs, so the
# libraries are named here: torch_cpu and c10 always, torch_cuda and c10_cuda with CUDA kernels.
file(GLOB jade_venv_torch "${CMAKE_SOURCE_DIR}/.venv/lib/python3*/site-packages/torch")
find_path(JADE_TORCH_ROOT include/torch/csrc/api/include/torch/torch.h
          HINTS ${jade_venv_torch} ENV JADE_TORCH_ROOT NO_DEFAULT_PATH)
if(NOT JADE_TORCH_ROOT)
  jade_missing("LibTorch 2.11" "pip install torch==2.11.0 into .venv, or pass -DJADE_TORCH_ROOT=DIR with include/ and lib/")
endif()
file(READ "${JADE_TORCH_ROOT}/version.py" jade_torch_version_py)
string(REGEX MATCH "__version__ = '([^']+)'" _ "${jade_torch_version_py}")
set(JADE_TORCH_VERSION "${CMAKE_MATCH_1}" CACHE INTERNAL "")
message(STATUS "JADE-GS: LibTorch ${JADE_TORCH_VERSION} in ${JADE_TORCH_ROOT}")

get_filename_component(jade_site_packages "${JADE_TORCH_ROOT}" DIRECTORY)
set(jade_torch_lib "${JADE_TORCH_ROOT}/lib")
# Where libcudart, libcupti and friends may be: the toolkit or the nvidia-* wheels.
set(jade_runtime_dirs "${jade_torch_lib}")
foreach(dir "${jade_site_packages}/nvidia/cu13/lib" "${jade_site_packages}/nvidia/cusparselt/lib"
            "${jade_site_packages}/nvidia/nvshmem/lib" /usr/local/cuda/lib64
            /usr/local/cuda/extras/CUPTI/lib64)
  if(IS_DIRECTORY "${dir}")
    list(APPEND jade_runtime_dirs "${dir}")
  endif()
endforeach()

add_library(jade_torch INTERFACE)
add_library(jade::torch ALIAS jade_torch)
target_include_directories(jade_torch SYSTEM INTERFACE
  "${JADE_TORCH_ROOT}/include" "${JADE_TORCH_ROOT}/include/torch/csrc/api/include")
target_link_libraries(jade_torch INTERFACE "${jade_torch_lib}/libtorch_cpu.so" "${jade_torch_lib}/libc10.so")
# The wheel brings its own OpenMP runtime; two in one process would each start their own threads.
if(EXISTS "${jade_torch_lib}/libgomp.so.1")
  target_link_libraries(jade_torch INTERFACE "${jade_torch_lib}/libgomp.so.1")
elseif(OpenMP_CXX_FOUND)
  target_link_libraries(jade_torch INTERFACE OpenMP::OpenMP_CXX)
endif()
foreach(dir ${jade_runtime_dirs})
  target_link_options(jade_torch INTERFACE "-Wl,-rpath-link,${dir}")
endforeach()
list(APPEND CMAKE_BUILD_RPATH ${jade_runtime_dirs})
if(JADE_WITH_CUDA)
  find_package(CUDAToolkit REQUIRED)
  target_include_directories(jade_torch SYSTEM INTERFACE ${CUDAToolkit_INCLUDE_DIRS})
  # Nothing refers to torch_cuda by symbol, yet its static initialisers register the CUDA backend.
  target_link_libraries(jade_torch INTERFACE
    "-Wl,--no-as-needed" "${jade_torch_lib}/libtorch_cuda.so" "${jade_torch_lib}/libc10_cuda.so"
    "-Wl,--as-needed" CUDA::cudart)
  target_compile_definitions(jade_torch INTERFACE JADE_WITH_CUDA=1)
endif()

# --- the rest: Debian and Ubuntu packages ----------------------------------------------------------
# Debian keeps OpenCVConfig.cmake in libopencv-dev, which pulls in 600 MB of modules we do not use;
# the three small -dev packages are found by their headers and libraries.
add_library(jade_opencv INTERFACE)
add_library(jade::opencv ALIAS jade_opencv)
find_package(OpenCV QUIET COMPONENTS core imgproc imgcodecs)
if(OpenCV_FOUND)
  target_include_directories(jade_opencv SYSTEM INTERFACE ${OpenCV_INCLUDE_DIRS})
  target_link_libraries(jade_opencv INTERFACE opencv_core opencv_imgproc opencv_imgcodecs)
else()
  find_path(JADE_OPENCV_INCLUDE opencv2/imgcodecs.hpp PATH_SUFFIXES opencv4)
  target_include_directories(jade_opencv SYSTEM INTERFACE ${JADE_OPENCV_INCLUDE})
  foreach(part imgcodecs imgproc core)
    find_library(JADE_OPENCV_${part} opencv_${part})
    if(NOT JADE_OPENCV_${part} OR NOT JADE_OPENCV_INCLUDE)
      jade_missing("OpenCV ${part}" "apt install libopencv-core-dev libopencv-imgproc-dev libopencv-imgcodecs-dev")
    endif()
    target_link_libraries(jade_opencv INTERFACE ${JADE_OPENCV_${part}})
  endforeach()
endif()

find_package(yaml-cpp QUIET)
if(NOT yaml-cpp_FOUND)
  jade_missing("yaml-cpp" "apt install libyaml-cpp-dev")
endif()
add_library(jade_yaml INTERFACE)
add_library(jade::yaml ALIAS jade_yaml)
# The target's name changed with yaml-cpp 0.8.
target_link_libraries(jade_yaml INTERFACE $<IF:$<TARGET_EXISTS:yaml-cpp::yaml-cpp>,yaml-cpp::yaml-cpp,yaml-cpp>)

find_package(CLI11 QUIET)
if(NOT CLI11_FOUND)
  jade_missing("CLI11" "apt install libcli11-dev")
endif()
add_library(jade::cli11 ALIAS CLI11::CLI11)

find_package(spdlog QUIET)
if(NOT spdlog_FOUND)
  jade_missing("spdlog" "apt install libspdlog-dev")
endif()
add_library(jade::spdlog ALIAS spdlog::spdlog)

find_package(nlohmann_json QUIET)
if(NOT nlohmann_json_FOUND)
  jade_missing("nlohmann-json" "apt install nlohmann-json3-dev")
endif()
add_library(jade::json ALIAS nlohmann_json::nlohmann_json)

find_package(PkgConfig QUIET)
find_package(ZLIB QUIET)
if(NOT ZLIB_FOUND)
  jade_missing("zlib" "apt install zlib1g-dev")
endif()
pkg_check_modules(LIBZIP QUIET IMPORTED_TARGET GLOBAL libzip)
if(NOT TARGET PkgConfig::LIBZIP)
  jade_missing("libzip" "apt install libzip-dev pkg-config")
endif()
add_library(jade_zip INTERFACE)
add_library(jade::zip ALIAS jade_zip)
target_link_libraries(jade_zip INTERFACE PkgConfig::LIBZIP ZLIB::ZLIB)

# What files of Gaussians are packed with: .spz version 4, and .sog.
foreach(part zstd webp)
  pkg_check_modules(${part} QUIET IMPORTED_TARGET GLOBAL lib${part})
  if(NOT TARGET PkgConfig::${part})
    jade_missing("lib${part}" "apt install lib${part}-dev pkg-config")
  endif()
  add_library(jade::${part} ALIAS PkgConfig::${part})
endforeach()

find_package(OpenSSL QUIET COMPONENTS Crypto)
if(NOT OPENSSL_FOUND)
  jade_missing("OpenSSL (libcrypto)" "apt install libssl-dev")
endif()
add_library(jade::crypto ALIAS OpenSSL::Crypto)

enable_language(C)  # FindHDF5 looks for the C interface
set(HDF5_PREFER_PARALLEL FALSE)
find_package(HDF5 QUIET COMPONENTS C)
if(NOT HDF5_FOUND)
  jade_missing("HDF5" "apt install libhdf5-dev")
endif()
add_library(jade_hdf5 INTERFACE)
add_library(jade::hdf5 ALIAS jade_hdf5)
target_include_directories(jade_hdf5 SYSTEM INTERFACE ${HDF5_C_INCLUDE_DIRS})
target_link_libraries(jade_hdf5 INTERFACE ${HDF5_C_LIBRARIES})

# cpp-httplib, of which the distributions have a compiled library with its macros in the .pc file, others only a header.
set(JADE_WITH_SERVER OFF)
if(NOT JADE_SERVE STREQUAL "OFF")
  pkg_check_modules(HTTPLIB QUIET IMPORTED_TARGET GLOBAL cpp-httplib>=0.10)
  if(NOT TARGET PkgConfig::HTTPLIB)
    find_package(httplib 0.10 QUIET)
  endif()
  add_library(jade_httplib INTERFACE)
  add_library(jade::httplib ALIAS jade_httplib)
  if(TARGET PkgConfig::HTTPLIB)
    target_link_libraries(jade_httplib INTERFACE PkgConfig::HTTPLIB)
    set(JADE_WITH_SERVER ON)
  elseif(TARGET httplib::httplib)
    target_link_libraries(jade_httplib INTERFACE httplib::httplib)
    set(JADE_WITH_SERVER ON)
  elseif(JADE_SERVE STREQUAL "ON")
    jade_missing("cpp-httplib 0.10 or newer" "apt install libcpp-httplib-dev")
  else()
    message(STATUS "JADE-GS: no cpp-httplib (apt install libcpp-httplib-dev), so --serve and jade_view will say that they cannot serve")
  endif()
endif()

if(JADE_BUILD_TESTS)
  find_package(Catch2 QUIET)
  if(NOT Catch2_FOUND)
    jade_missing("Catch2 (2.13 or 3)" "apt install catch2")
  endif()
  add_library(jade_catch2 INTERFACE)
  add_library(jade::catch2 ALIAS jade_catch2)
  target_link_libraries(jade_catch2 INTERFACE Catch2::Catch2)
  set(JADE_CATCH2_MAJOR ${Catch2_VERSION_MAJOR} CACHE INTERNAL "")
  if(NOT Catch2_VERSION_MAJOR)
    string(REGEX MATCH "^[0-9]+" major "${Catch2_VERSION}")
    set(JADE_CATCH2_MAJOR ${major} CACHE INTERNAL "")
  endif()
  target_compile_definitions(jade_catch2 INTERFACE JADE_CATCH2_MAJOR=${JADE_CATCH2_MAJOR})
endif()
