# The headers that most sources read, parsed once a folder: this takes a quarter off a build. Only in the release preset: the
# sanitizers' builds go without, so that a header which a source forgot to include is missed there; and clang-tidy reads the
# sources as they are. GCC 12 takes the standard library's code in a precompiled header for ours, so its guesses about sizes
# are silenced there; the other presets keep them. ccache must know that a precompiled header may stand for its text.
option(VITREO_PRECOMPILE "precompile the heavy headers" OFF)
if(VITREO_PRECOMPILE AND CCACHE)
  set(CMAKE_CXX_COMPILER_LAUNCHER ${CMAKE_COMMAND} -E env CCACHE_SLOPPINESS=pch_defines,time_macros ${CCACHE})
endif()
set(guesses_about_sizes -Wno-stringop-overflow -Wno-stringop-overread -Wno-array-bounds -Wno-maybe-uninitialized)
set(precompiled_std <algorithm> <atomic> <chrono> <cmath> <condition_variable> <filesystem> <functional> <map> <memory>
    <mutex> <optional> <span> <sstream> <string> <thread> <variant> <vector>)

# vitreo_precompile(TARGET header...): these beside the standard library's.
function(vitreo_precompile target)
  if(VITREO_PRECOMPILE)
    target_precompile_headers(${target} PRIVATE ${precompiled_std} ${ARGN})
    target_compile_options(${target} PRIVATE ${guesses_about_sizes})
  endif()
endfunction()
function(vitreo_precompile_as target other)
  if(VITREO_PRECOMPILE)
    target_precompile_headers(${target} REUSE_FROM ${other})
    target_compile_options(${target} PRIVATE ${guesses_about_sizes})
  endif()
endfunction()
