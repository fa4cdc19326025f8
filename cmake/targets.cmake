# Warnings, sanitizers, and vitreo_library(): the one way in which a folder becomes a library.
find_program(CCACHE ccache)
if(CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CCACHE})
endif()

set(VITREO_SANITIZE "" CACHE STRING "sanitizers, as -fsanitize takes them")
add_library(vitreo_options INTERFACE)
# -Wno-restrict: GCC 12 warns wrongly about std::string's operator+ (its bug 105651).
target_compile_options(vitreo_options INTERFACE -Wall -Wextra -Wpedantic -Wshadow -Wconversion -Wno-sign-conversion
                       -Wnon-virtual-dtor -Woverloaded-virtual -Wno-restrict -Werror -ffp-contract=off)
target_include_directories(vitreo_options INTERFACE ${CMAKE_SOURCE_DIR})
# A program loads only the libraries that it calls: most tests want no buses.
target_link_options(vitreo_options INTERFACE -Wl,--as-needed)
if(VITREO_SANITIZE)
  target_compile_options(vitreo_options INTERFACE -fsanitize=${VITREO_SANITIZE} -fno-omit-frame-pointer
                         -fno-sanitize-recover=all)
  target_link_options(vitreo_options INTERFACE -fsanitize=${VITREO_SANITIZE})
endif()

# Unity builds: the sources of a room, a few at a time, as one source. The headers are read once for all of them, and templates
# made once. Only in the release preset; the others compile each source alone, so that an include which is missing is missed.
option(VITREO_UNITY "compile several sources of a folder at once" OFF)
set(VITREO_UNITY_SIZE 8 CACHE STRING "sources compiled at once")
function(vitreo_unity target)
  if(NOT VITREO_UNITY)
    return()
  endif()
  set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
  target_compile_options(${target} PRIVATE -Wno-subobject-linkage)  # GCC takes the sources that it includes for headers
  foreach(source ${ARGN})
    get_filename_component(room ${source} DIRECTORY)
    string(MAKE_C_IDENTIFIER ${room} room)
    math(EXPR group "0${count_${room}} / ${VITREO_UNITY_SIZE}")
    math(EXPR count_${room} "0${count_${room}} + 1")
    set_property(SOURCE ${source} PROPERTY UNITY_GROUP ${room}_${group})
  endforeach()
endfunction()
# The same of a test program: of the sources whose own is in namespace VITREO_TEST_FILE, so that it stays their own
# (tests/CMakeLists.txt). The others are compiled alone.
function(vitreo_unity_of_tests target)
  set(together)
  foreach(source ${ARGN})
    file(STRINGS ${source} own REGEX "^namespace VITREO_TEST_FILE" LIMIT_COUNT 1)
    if(own)
      list(APPEND together ${source})
    endif()
  endforeach()
  vitreo_unity(${target} ${together})
  set_target_properties(${target} PROPERTIES UNITY_BUILD_UNIQUE_ID VITREO_TEST_FILE)
endfunction()
# vitreo_alone(SOURCE option...): compiled by itself, with these options.
function(vitreo_alone source)
  set_property(SOURCE ${source} PROPERTY SKIP_UNITY_BUILD_INCLUSION ON)
  set_property(SOURCE ${source} APPEND PROPERTY COMPILE_OPTIONS ${ARGN})
endfunction()

# vitreo_library(FOLDER [EXCEPT sub...] USES target... [PRECOMPILE header...]): every .cpp of the folder, as vitreo::FOLDER.
function(vitreo_library folder)
  cmake_parse_arguments(ARG "" "" "EXCEPT;USES;PRECOMPILE" ${ARGN})
  string(REPLACE "/" "_" name ${folder})
  file(GLOB_RECURSE sources CONFIGURE_DEPENDS ${CMAKE_SOURCE_DIR}/${folder}/*.cpp)
  foreach(except ${ARG_EXCEPT})
    list(FILTER sources EXCLUDE REGEX "/${folder}/${except}(/|$)")
  endforeach()
  add_library(vitreo_${name} STATIC ${sources})
  if(NOT folder MATCHES "^(optics|vision|control)$")  # a precompiled Eigen gives them all the gain there is
    vitreo_unity(vitreo_${name} ${sources})
  endif()
  add_library(vitreo::${name} ALIAS vitreo_${name})
  target_link_libraries(vitreo_${name} PUBLIC ${ARG_USES} PRIVATE vitreo_options)
  target_include_directories(vitreo_${name} PUBLIC ${CMAKE_SOURCE_DIR})
  if(ARG_PRECOMPILE)
    vitreo_precompile(vitreo_${name} ${ARG_PRECOMPILE})
  endif()
endfunction()

# The program's version and the commit it was configured at, for the records.
function(vitreo_version source)
  vitreo_alone(${source})
  execute_process(COMMAND git describe --always --dirty WORKING_DIRECTORY ${CMAKE_SOURCE_DIR}
                  OUTPUT_VARIABLE commit OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
  set_property(SOURCE ${CMAKE_SOURCE_DIR}/${source} APPEND PROPERTY COMPILE_DEFINITIONS
               VITREO_VERSION="${PROJECT_VERSION}" VITREO_COMMIT="${commit}")
endfunction()
