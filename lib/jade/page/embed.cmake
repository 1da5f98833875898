# SPDX-License-Identifier: Apache-2.0
# Writes OUTPUT, a C++ source with the front end in FRONT: the pages, their styles and their modules
# joined in the order of modules.txt and sweep_modules.txt. cmake -DFRONT=… -DOUTPUT=… -P embed.cmake
function(join_modules list result)
  file(STRINGS "${FRONT}/${list}" modules)
  set(script "")
  foreach(module ${modules})
    file(READ "${FRONT}/${module}" text)
    # Semicolons would split a list.
    string(REGEX REPLACE "\nimport [^\n]*" "" text "\n${text}")
    string(REGEX REPLACE "\nexport " "\n" text "${text}")
    string(APPEND script "${text}")
  endforeach()
  set(${result} "${script}" PARENT_SCOPE)
endfunction()
join_modules(modules.txt script)
join_modules(sweep_modules.txt sweep_script)
file(READ "${FRONT}/page.html" html)
file(READ "${FRONT}/page.css" css)
file(READ "${FRONT}/sweep.html" sweep_html)
file(READ "${FRONT}/sweep.css" sweep_css)
file(WRITE "${OUTPUT}.new" "// Made by lib/jade/page/embed.cmake.
#include \"jade/page/front.h\"
namespace jade::page {
const char* const kHtml = R\"FRONT(${html})FRONT\";
const char* const kStyle = R\"FRONT(${css})FRONT\";
const char* const kScript = R\"FRONT(${script})FRONT\";
const char* const kSweepHtml = R\"FRONT(${sweep_html})FRONT\";
const char* const kSweepStyle = R\"FRONT(${css}${sweep_css})FRONT\";
const char* const kSweepScript = R\"FRONT(${sweep_script})FRONT\";
}  // namespace jade::page
")
file(COPY_FILE "${OUTPUT}.new" "${OUTPUT}" ONLY_IF_DIFFERENT)
file(REMOVE "${OUTPUT}.new")
