# The page of the live view: built by Vite where Node (18 or newer) and npm are there, and embedded in the program; elsewhere
# a notice takes its place. Its packages are those of package-lock.json.
option(VITREO_WEB "build the page of the live view (wants Node and npm)" ON)
find_program(NPM npm)
find_program(NODE NAMES node nodejs)
find_package(Boost 1.74 REQUIRED)  # Beast: headers only
set(page_source ${CMAKE_CURRENT_SOURCE_DIR}/host/view/page)
set(page_build ${CMAKE_BINARY_DIR}/page)
file(GLOB_RECURSE page_files CONFIGURE_DEPENDS ${page_source}/*.js ${page_source}/*.jsx ${page_source}/*.css
     ${page_source}/*.html ${page_source}/*.json)
list(FILTER page_files EXCLUDE REGEX "/(node_modules|dist)/")
if(VITREO_WEB AND NPM AND NODE)
  set(page_npm ${NPM})
  if(EXISTS ${page_build}/notice)
    file(REMOVE ${page_build}/assets.cpp)
  endif()
else()
  message(STATUS "The live view is built without its page: that wants Node 18 or newer and npm")
endif()
add_custom_command(
  OUTPUT ${page_build}/assets.cpp
  COMMAND ${CMAKE_COMMAND} -DSOURCE=${page_source} -DBUILD=${page_build} -DNPM=${page_npm}
          -P ${CMAKE_CURRENT_SOURCE_DIR}/host/view/embed.cmake
  DEPENDS ${page_files} ${CMAKE_CURRENT_SOURCE_DIR}/host/view/embed.cmake ${CMAKE_CURRENT_SOURCE_DIR}/host/view/embed_files.cmake
  COMMENT "Building the page of the live view" VERBATIM)
target_sources(vitreo_host PRIVATE ${page_build}/assets.cpp)
# Beast's templates: half the time to compile, and no slower where it waits for the network anyway.
set_property(SOURCE host/view/web_server.cpp host/view/control_socket.cpp host/view/control_client.cpp APPEND PROPERTY
             COMPILE_OPTIONS -O1)
set_source_files_properties(host/view/web_server.cpp host/view/control_socket.cpp host/view/control_client.cpp
                            ${page_build}/assets.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON
                            SKIP_UNITY_BUILD_INCLUSION ON)
