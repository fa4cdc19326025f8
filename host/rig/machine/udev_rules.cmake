# The udev rules within the program: `vitreo docs udev` prints them, `vitreo doctor` holds those that are installed against them.
set(udev_rules ${CMAKE_CURRENT_SOURCE_DIR}/packaging/60-vitreo.rules)
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${udev_rules})
file(READ ${udev_rules} VITREO_UDEV_RULES)
configure_file(${CMAKE_CURRENT_SOURCE_DIR}/host/rig/machine/udev_rules.cpp.in ${CMAKE_BINARY_DIR}/udev_rules.cpp @ONLY)
target_sources(vitreo_host PRIVATE ${CMAKE_BINARY_DIR}/udev_rules.cpp)
set_source_files_properties(${CMAKE_BINARY_DIR}/udev_rules.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON SKIP_UNITY_BUILD_INCLUSION ON)
