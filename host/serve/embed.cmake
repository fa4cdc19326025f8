# Builds the page (SOURCE) in BUILD by the Vite in MODULES, and writes its files and OPENAPI as BUILD/assets.cpp. Without Node, or
# where the live view's page had no packages, a notice is written in the page's place.
file(MAKE_DIRECTORY ${BUILD})
set(DIST ${BUILD}/dist)
file(REMOVE_RECURSE ${DIST} ${BUILD}/src)
if(NODE AND EXISTS ${MODULES}/vite/bin/vite.js)
  file(COPY ${SOURCE}/ DESTINATION ${BUILD} PATTERN node_modules EXCLUDE PATTERN dist EXCLUDE)
  file(CREATE_LINK ${MODULES} ${BUILD}/node_modules SYMBOLIC)
  execute_process(COMMAND ${NODE} ${MODULES}/vite/bin/vite.js build WORKING_DIRECTORY ${BUILD}
                  RESULT_VARIABLE failed OUTPUT_VARIABLE said ERROR_VARIABLE said)
  if(failed)
    message(WARNING "The workbench gets no page, for Vite failed:\n${said}")
    file(REMOVE_RECURSE ${DIST})
  endif()
endif()
if(NOT EXISTS ${DIST}/index.html)
  file(WRITE ${DIST}/index.html "<!doctype html><html lang='en'><meta charset='utf-8'><title>Vitreo</title>
<h1>This program has no page of the workbench</h1><p>Node was not found, or npm failed, when it was built. Its interface for programs works:
<a href='/openapi.json'>openapi.json</a>.</p></html>")
endif()
file(COPY ${OPENAPI} DESTINATION ${DIST})
set(NAMESPACE vitreo::serve)
set(HEADER host/serve/assets.h)
set(FUNCTION workbench_assets)
include(${CMAKE_CURRENT_LIST_DIR}/../view/embed_files.cmake)
