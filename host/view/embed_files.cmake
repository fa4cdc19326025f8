# Writes the files of DIST, gzipped, as BUILD/assets.cpp: NAMESPACE::FUNCTION(), which HEADER declares.
file(GLOB files RELATIVE ${DIST} ${DIST}/*)
set(arrays "")
set(rows "")
set(index 0)
foreach(file IN LISTS files)
  string(REGEX REPLACE ".*\\." "" ending ${file})
  set(type_html "text/html; charset=utf-8")
  set(type_js "text/javascript; charset=utf-8")
  set(type_css "text/css; charset=utf-8")
  set(type_json "application/json")
  execute_process(COMMAND gzip -9 -n -c ${DIST}/${file} OUTPUT_FILE ${BUILD}/packed COMMAND_ERROR_IS_FATAL ANY)
  file(READ ${BUILD}/packed hex HEX)
  string(REGEX REPLACE "(..)" "0x\\1," bytes ${hex})
  string(APPEND arrays "const unsigned char file${index}[] = {${bytes}};\n")
  string(APPEND rows "    asset(\"/${file}\", \"${type_${ending}}\", file${index}, sizeof file${index}),\n")
  math(EXPR index "${index} + 1")
endforeach()
file(WRITE ${BUILD}/assets.cpp "// Made by host/view/embed_files.cmake.
#include \"${HEADER}\"

namespace ${NAMESPACE} {
namespace {

${arrays}
view::Asset asset(const char* path, const char* type, const unsigned char* bytes, std::size_t count) {
  return {path, type, {reinterpret_cast<const char*>(bytes), count}, true};
}

}  // namespace

std::vector<view::Asset> ${FUNCTION}() {
  return {
${rows}  };
}

}  // namespace ${NAMESPACE}
")
