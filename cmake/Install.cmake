# SPDX-License-Identifier: Apache-2.0
# cmake --install build --prefix P: programs in P/bin, what they read in P/share/jade, the splatting op for
# find_package(jade) in P/include and P/lib. Everything finds the rest relative to itself, so P can be moved.
# Components: programs, data, development, and torch, which links to the LibTorch of this build.

include(CMakePackageConfigHelpers)

# What programs read at run time (core/asset.h). A build folder has the same layout, by links to the source tree.
set(jade_share "share/jade")
foreach(folder assets configs scripts)
  file(MAKE_DIRECTORY "${CMAKE_BINARY_DIR}/${jade_share}")
  file(RELATIVE_PATH target "${CMAKE_BINARY_DIR}/${jade_share}" "${CMAKE_SOURCE_DIR}/${folder}")
  file(CREATE_LINK "${target}" "${CMAKE_BINARY_DIR}/${jade_share}/${folder}" SYMBOLIC)
endforeach()
install(FILES assets/efnet_anytime.pt assets/identity_response.npy DESTINATION ${jade_share}/assets COMPONENT data)
install(DIRECTORY configs DESTINATION ${jade_share} COMPONENT data)
install(PROGRAMS
  scripts/aedat_legacy.py scripts/colmap.py scripts/compare_poses.py scripts/convert_aedat4.py scripts/convert_diet_gs.py
  scripts/evaluate_perceptual.py scripts/export_lpips.py scripts/read_recording.py scripts/recording_folder.py
  scripts/ros_bag.py scripts/to_tensorboard.py
  scripts/requirements-import.txt scripts/requirements-perceptual.txt
  DESTINATION ${jade_share}/scripts COMPONENT data)
install(FILES LICENSE DESTINATION ${jade_share} COMPONENT data)

# LibTorch and the libraries of CUDA stay where they are: P/lib/jade/NAME is a link to each of their folders, which a
# user may point elsewhere, and the programs know only these links.
set(jade_runtime_links "")
foreach(dir ${jade_runtime_dirs})
  string(REGEX REPLACE "/lib(64)?$" "" name "${dir}")
  get_filename_component(name "${name}" NAME)
  string(TOLOWER "${name}" name)
  list(APPEND jade_runtime_links "${name}")
  install(CODE "
    set(folder \"\$ENV{DESTDIR}\${CMAKE_INSTALL_PREFIX}/lib/jade\")
    file(MAKE_DIRECTORY \"\${folder}\")
    file(CREATE_LINK \"${dir}\" \"\${folder}/${name}\" SYMBOLIC)
    message(STATUS \"Linked: \${folder}/${name} -> ${dir}\")" COMPONENT torch)
endforeach()

# Another machine may have the libraries of CUDA from wheels where this one has the toolkit, or the other way.
# Modules that are libraries of their own (JADE_SHARED) lie beside the links.
set(jade_known_links ${jade_runtime_links} torch cu13 cusparselt nvshmem cudnn nccl cuda cupti)
list(REMOVE_DUPLICATES jade_known_links)
foreach(name ${jade_known_links})
  list(APPEND CMAKE_INSTALL_RPATH "$ORIGIN/../lib/jade/${name}")
endforeach()
list(APPEND CMAKE_INSTALL_RPATH "$ORIGIN/../lib/jade")

# jade_install_library(TARGET): an archive of the op, for jadeConfig.cmake.
function(jade_install_library target)
  if(NOT JADE_SHARED)
    install(TARGETS ${target} ARCHIVE DESTINATION lib COMPONENT development)
  endif()
endfunction()
if(JADE_SHARED)
  return()
endif()
# The public headers of the op, and those that they include.
foreach(room core geometry kernel splat)
  install(DIRECTORY lib/jade/${room} DESTINATION include/jade COMPONENT development FILES_MATCHING PATTERN "*.h"
          PATTERN cpu EXCLUDE PATTERN cuda EXCLUDE PATTERN math EXCLUDE)
endforeach()
configure_package_config_file(cmake/jadeConfig.cmake.in "${CMAKE_BINARY_DIR}/cmake/jadeConfig.cmake"
  INSTALL_DESTINATION lib/cmake/jade)
write_basic_package_version_file("${CMAKE_BINARY_DIR}/cmake/jadeConfigVersion.cmake" COMPATIBILITY SameMinorVersion)
install(FILES "${CMAKE_BINARY_DIR}/cmake/jadeConfig.cmake" "${CMAKE_BINARY_DIR}/cmake/jadeConfigVersion.cmake"
  DESTINATION lib/cmake/jade COMPONENT development)
