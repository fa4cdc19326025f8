# The static parts of the report, its page, its style sheet and its script, are edited as what they are (host/runs/report/) and embedded
# in the program as they stand there.
set(report_folder ${CMAKE_CURRENT_SOURCE_DIR}/host/runs/report)
set(report_source ${CMAKE_BINARY_DIR}/report/report_page.cpp)
add_custom_command(
  OUTPUT ${report_source}
  COMMAND ${CMAKE_COMMAND} -DFOLDER=${report_folder} -DSOURCE=${report_source} -P ${CMAKE_CURRENT_SOURCE_DIR}/host/runs/embed.cmake
  DEPENDS ${report_folder}/page.html ${report_folder}/style.css ${report_folder}/report.js ${CMAKE_CURRENT_SOURCE_DIR}/host/runs/embed.cmake
  COMMENT "Embedding the page of the report" VERBATIM)
target_sources(vitreo_host PRIVATE ${report_source})
set_source_files_properties(${report_source} PROPERTIES SKIP_PRECOMPILE_HEADERS ON SKIP_UNITY_BUILD_INCLUSION ON)
