# Libraries that bring dozens of others (ffmpeg, GDAL, GStreamer) cost each start of the program a third of a second, and
# few runs need them. vitreo_lazy_library makes a target that stands in for such a library: it defines each of its
# functions as a few instructions that open the library at the first call and go on there. Callers stay as they are; a
# function that the library does not have is an error of the linker, as ever. docs/decisions/0005-lazy-libraries.md.
# SPDX-License-Identifier: Apache-2.0

# vitreo_lazy_library(TARGET FILE): FILE is the shared library. Where the instructions are not known (they are for x86-64),
# and under sanitizers, which look at the library's types, TARGET is the library itself.
set(VITREO_LAZY OFF)
if(CMAKE_SYSTEM_PROCESSOR MATCHES "^(x86_64|AMD64)$" AND CMAKE_NM AND CMAKE_OBJDUMP AND NOT VITREO_SANITIZE)
  set(VITREO_LAZY ON)
endif()
function(vitreo_lazy_library target file)
  if(NOT VITREO_LAZY)
    add_library(${target} INTERFACE)
    target_link_libraries(${target} INTERFACE ${file})
    return()
  endif()
  execute_process(COMMAND ${CMAKE_OBJDUMP} -p ${file} OUTPUT_VARIABLE header COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCH "SONAME +([^\n ]+)" found "${header}")
  set(soname ${CMAKE_MATCH_1})
  execute_process(COMMAND ${CMAKE_NM} -D --defined-only --format=posix ${file} OUTPUT_VARIABLE table COMMAND_ERROR_IS_FATAL ANY)
  string(REGEX MATCHALL "[^\n]+ T [^\n]*" rows "${table}")
  set(functions "")
  foreach(row IN LISTS rows)
    string(REGEX REPLACE "[@ ].*" "" name "${row}")
    if(NOT name MATCHES "^_(init|fini)$")
      list(APPEND functions ${name})
    endif()
  endforeach()
  vitreo_lazy_stand_in(${target} ${soname} ${functions})
endfunction()

# vitreo_lazy_stand_in(TARGET SONAME function...): the stand-in itself. SONAME is what the loader is asked for at the first call.
function(vitreo_lazy_stand_in target soname)
  set(names "")
  set(entries "")
  set(index 0)
  foreach(name IN LISTS ARGN)
    string(APPEND names "    \"${name}\",\n")
    string(APPEND entries "    VITREO_ENTRY(\"${name}\", \"${index}\")\n")
    math(EXPR index "${index} + 1")
  endforeach()
  set(LAZY_NAME ${target})
  set(LAZY_SONAME ${soname})
  set(LAZY_COUNT ${index})
  set(LAZY_NAMES "${names}")
  set(LAZY_ENTRIES "${entries}")
  configure_file(${CMAKE_SOURCE_DIR}/cmake/lazy_library.cpp.in ${CMAKE_BINARY_DIR}/lazy/${target}.cpp @ONLY)
  add_library(${target} STATIC ${CMAKE_BINARY_DIR}/lazy/${target}.cpp)
  target_link_libraries(${target} PUBLIC ${CMAKE_DL_LIBS})
endfunction()
