# The page of the workbench: built by the Vite, and with the Preact, of the live view's page (host/view/page.cmake), and embedded
# in the program beside the description of its interface.
set(bench_source ${CMAKE_CURRENT_SOURCE_DIR}/host/serve/page)
set(bench_build ${CMAKE_BINARY_DIR}/workbench)
file(GLOB_RECURSE bench_files CONFIGURE_DEPENDS ${bench_source}/*.js ${bench_source}/*.jsx ${bench_source}/*.css ${bench_source}/*.html)
add_custom_command(
  OUTPUT ${bench_build}/assets.cpp
  COMMAND ${CMAKE_COMMAND} -DSOURCE=${bench_source} -DBUILD=${bench_build} -DMODULES=${CMAKE_BINARY_DIR}/page/node_modules
          -DNODE=${NODE} -DOPENAPI=${CMAKE_CURRENT_SOURCE_DIR}/docs/reference/openapi.json
          -P ${CMAKE_CURRENT_SOURCE_DIR}/host/serve/embed.cmake
  DEPENDS ${bench_files} ${page_build}/assets.cpp ${CMAKE_CURRENT_SOURCE_DIR}/docs/reference/openapi.json
          ${CMAKE_CURRENT_SOURCE_DIR}/host/serve/embed.cmake ${CMAKE_CURRENT_SOURCE_DIR}/host/view/embed_files.cmake
  COMMENT "Building the page of the workbench" VERBATIM)
target_sources(vitreo_host PRIVATE ${bench_build}/assets.cpp)
set_source_files_properties(${bench_build}/assets.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON SKIP_UNITY_BUILD_INCLUSION ON)
