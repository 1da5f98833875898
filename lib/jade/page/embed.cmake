# SPDX-License-Identifier: Apache-2.0
# Writes OUTPUT, a C++ source with the front end in FRONT: the page, the style and the modules joined
# in the order of modules.txt. cmake -DFRONT=… -DOUTPUT=… -P embed.cmake
file(STRINGS "${FRONT}/modules.txt" modules)
set(script "")
foreach(module ${modules})
  file(READ "${FRONT}/${module}" text)
  # Semicolons would split a list.
  string(REGEX REPLACE "\nimport [^\n]*" "" text "\n${text}")
  string(REGEX REPLACE "\nexport " "\n" text "${text}")
  string(APPEND script "${text}")
endforeach()
file(READ "${FRONT}/page.html" html)
file(READ "${FRONT}/page.css" css)
file(WRITE "${OUTPUT}.new" "// Made by lib/jade/page/embed.cmake.
#include \"jade/page/front.h\"
namespace jade::page {
const char* const kHtml = R\"FRONT(${html})FRONT\";
const char* const kStyle = R\"FRONT(${css})FRONT\";
const char* const kScript = R\"FRONT(${script})FRONT\";
}  // namespace jade::page
")
file(COPY_FILE "${OUTPUT}.new" "${OUTPUT}" ONLY_IF_DIFFERENT)
file(REMOVE "${OUTPUT}.new")
