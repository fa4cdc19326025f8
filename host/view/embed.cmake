# Builds the page (SOURCE) in BUILD by NPM, and writes its files, gzipped, as BUILD/assets.cpp. Where NPM is empty, or fails (no
# network), a notice is written in the page's place: the program works without it.
file(MAKE_DIRECTORY ${BUILD})
set(dist ${BUILD}/dist)
file(REMOVE_RECURSE ${dist} ${BUILD}/notice)
set(failed "Node was not found when this program was built")
if(NPM)
  file(COPY ${SOURCE}/ DESTINATION ${BUILD} PATTERN node_modules EXCLUDE PATTERN dist EXCLUDE)
  execute_process(COMMAND ${NPM} ci --ignore-scripts --no-audit --no-fund WORKING_DIRECTORY ${BUILD}
                  RESULT_VARIABLE failed OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(NOT failed)
    execute_process(COMMAND ${NPM} run build WORKING_DIRECTORY ${BUILD} RESULT_VARIABLE failed OUTPUT_VARIABLE said ERROR_VARIABLE said)
  endif()
  if(failed)
    message(WARNING "The live view gets no page, for npm failed:\n${said}")
    file(REMOVE_RECURSE ${dist})
    set(failed "npm failed when this program was built")
  endif()
endif()
if(NOT EXISTS ${dist}/index.html)
  get_filename_component(build_folder ${BUILD} DIRECTORY)
  get_filename_component(preset ${build_folder} NAME)
  file(WRITE ${BUILD}/notice "${failed}")  # the next configuration tries again
  file(WRITE ${dist}/index.html "<!doctype html><html lang='en'><meta charset='utf-8'><title>Vitreo live view</title>
<h1>This program has no live view page</h1><p>${failed}. With Node 18 or newer and npm (<code>make setup</code> installs them) remove
<code>build/${preset}/CMakeCache.txt</code> and build again.</p></html>")
endif()
set(DIST ${dist})
set(NAMESPACE vitreo::view)
set(HEADER host/view/assets.h)
set(FUNCTION page_assets)
include(${CMAKE_CURRENT_LIST_DIR}/embed_files.cmake)
