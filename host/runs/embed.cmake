# Writes the files of FOLDER that the report is made of (page.html, style.css, report.js) as SOURCE, a C++ file with their bytes.
set(functions "")
foreach(name IN ITEMS page style script)
  set(file_script report.js)
  set(file_page page.html)
  set(file_style style.css)
  file(READ ${FOLDER}/${file_${name}} hex HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes "${hex}")
  string(APPEND functions "
std::string_view report_${name}() {
  static constexpr unsigned char kBytes[] = {${bytes}};
  return {reinterpret_cast<const char*>(kBytes), sizeof kBytes};
}
")
endforeach()
file(WRITE ${SOURCE} "// Made by host/runs/embed.cmake.
#include \"host/runs/report_page.h\"

namespace vitreo {
${functions}
}  // namespace vitreo
")
