# SPDX-License-Identifier: Apache-2.0
# cpack --config build/CPackConfig.cmake -G DEB: jade-gs_VERSION_ARCH.deb with the programs, what they read, man pages and
# shell completion. Its dependencies are those that dpkg-shlibdeps finds. LibTorch is none of Debian's packages:
# jade_link_torch, which the package brings, points the programs to one.

set(CPACK_PACKAGE_NAME jade-gs)
# As CITATION.cff names them, without an address. A distributor gives its own: cpack -D "CPACK_PACKAGE_CONTACT=NAME <ADDRESS>".
set(CPACK_PACKAGE_CONTACT "The JADE-GS maintainers")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "Sharp 3D Gaussian scenes from blurry frames and events")
set(CPACK_PACKAGE_DESCRIPTION "Programs that import recordings of event cameras, train 3D Gaussian scenes from their blurry
frames and events, and render, export and show them. They need LibTorch ${JADE_TORCH_VERSION}: run jade_link_torch.")
set(CPACK_RESOURCE_FILE_LICENSE "${CMAKE_SOURCE_DIR}/LICENSE")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_COMPONENTS_ALL programs data debian)
set(CPACK_COMPONENTS_GROUPING ALL_COMPONENTS_IN_ONE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS_PRIVATE_DIRS ${jade_runtime_dirs})
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "python3-venv, ffmpeg")
set(CPACK_DEBIAN_PACKAGE_CONTROL_EXTRA "${CMAKE_CURRENT_LIST_DIR}/debian/postrm")
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
configure_file(cmake/debian/jade_link_torch.in "${CMAKE_BINARY_DIR}/cmake/jade_link_torch" @ONLY)
install(PROGRAMS "${CMAKE_BINARY_DIR}/cmake/jade_link_torch" DESTINATION bin COMPONENT debian EXCLUDE_FROM_ALL)
include(CPack)
