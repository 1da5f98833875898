# SPDX-License-Identifier: Apache-2.0
# jade_add_isa_sources(NAME impl.h [TARGET library] ISAS portable avx2 avx512 FLAGS …)
#
# Compiles impl.h of module NAME for its library (default: what jade_add_module() has made), once per instruction set of
# jade/kernel/isa.h (elsewhere than on x86-64: portable only) by sources that include it and nothing
# else: in these, JADE_ISA is the set's name and JADE_VECTOR_BYTES the size of its registers. They
# share no compiled header. FLAGS are those of the op, the same for every set.
set(jade_isa_template "${CMAKE_CURRENT_LIST_DIR}/isa.cpp.in")
set(jade_isa_flags_portable "")
set(jade_isa_flags_avx2 -mavx2 -mfma -mbmi -mbmi2 -mlzcnt)
set(jade_isa_flags_avx512 ${jade_isa_flags_avx2} -mavx512f -mavx512dq -mavx512vl -mavx512bw)
set(jade_isa_bytes_portable 16)
set(jade_isa_bytes_avx2 32)
set(jade_isa_bytes_avx512 64)
function(jade_add_isa_sources name header)
  cmake_parse_arguments(arg "" "TARGET" "ISAS;FLAGS" ${ARGN})
  if(NOT arg_TARGET)
    set(arg_TARGET jade_lib_${name})
  endif()
  if(NOT CMAKE_SYSTEM_PROCESSOR MATCHES "x86_64|AMD64")
    set(arg_ISAS portable)
  endif()
  get_filename_component(stem ${header} NAME_WE)
  foreach(isa ${arg_ISAS})
    set(vector_bytes ${jade_isa_bytes_${isa}})
    set(source "${CMAKE_CURRENT_BINARY_DIR}/${stem}_${isa}.cpp")
    configure_file("${jade_isa_template}" ${source} @ONLY)
    set_source_files_properties(${source} PROPERTIES
      SKIP_PRECOMPILE_HEADERS ON COMPILE_OPTIONS "${arg_FLAGS};${jade_isa_flags_${isa}}")
    target_sources(${arg_TARGET} PRIVATE ${source})
  endforeach()
endfunction()
