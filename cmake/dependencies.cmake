# Third-party libraries, each as one target whose headers are SYSTEM (their warnings are not ours to fix).
include(cmake/lazy_library.cmake)
find_package(Threads REQUIRED)
find_package(Eigen3 3.4 REQUIRED NO_MODULE)
find_package(Ceres REQUIRED)
find_package(SQLite3 REQUIRED)
find_package(fmt REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(OpenSSL REQUIRED COMPONENTS Crypto)  # digests of the records; libssl is not linked
find_package(ZLIB REQUIRED)                        # CRC-32 of the frames
find_package(yaml-cpp REQUIRED)                    # field calibrations in the layout of ETH's software
find_package(GTest REQUIRED)
find_package(benchmark REQUIRED)
find_package(PkgConfig REQUIRED)
pkg_check_modules(LUA REQUIRED lua5.4-c++)  # Lua built as C++: its errors unwind our destructors

add_library(vitreo_lua INTERFACE)
target_include_directories(vitreo_lua SYSTEM INTERFACE ${LUA_INCLUDE_DIRS})
target_link_libraries(vitreo_lua INTERFACE ${LUA_LINK_LIBRARIES})

# Only the header-only parts and the solver of Ceres; an INTERFACE wrapper keeps its headers SYSTEM.
add_library(vitreo_ceres INTERFACE)
target_link_libraries(vitreo_ceres INTERFACE Ceres::ceres)

# OpenCV by parts: its CMake package comes only with libopencv-dev, which would pull Qt and ffmpeg.
add_library(vitreo_opencv INTERFACE)
find_path(OPENCV_INCLUDE opencv2/core.hpp PATH_SUFFIXES opencv4 REQUIRED)
target_include_directories(vitreo_opencv SYSTEM INTERFACE ${OPENCV_INCLUDE})
foreach(part core imgproc)
  find_library(OPENCV_${part} opencv_${part} REQUIRED)
  target_link_libraries(vitreo_opencv INTERFACE ${OPENCV_${part}})
endforeach()
find_library(OPENCV_imgcodecs opencv_imgcodecs REQUIRED)
vitreo_lazy_library(vitreo_lazy_imgcodecs ${OPENCV_imgcodecs})
target_link_libraries(vitreo_opencv INTERFACE vitreo_lazy_imgcodecs)

# Background models; a target of its own, since only vision/ uses it.
add_library(vitreo_opencv_video INTERFACE)
find_library(OPENCV_video opencv_video REQUIRED)
vitreo_lazy_library(vitreo_lazy_video ${OPENCV_video})
target_link_libraries(vitreo_opencv_video INTERFACE vitreo_opencv vitreo_lazy_video)

# Networks of learned evidence; a target of its own, since only vision/ uses it.
add_library(vitreo_opencv_dnn INTERFACE)
find_library(OPENCV_dnn opencv_dnn REQUIRED)
vitreo_lazy_library(vitreo_lazy_dnn ${OPENCV_dnn})
target_link_libraries(vitreo_opencv_dnn INTERFACE vitreo_opencv vitreo_lazy_dnn)

# Recorded videos; a target of its own, since it brings ffmpeg, and optics, vision and control do without.
add_library(vitreo_video INTERFACE)
find_library(OPENCV_videoio opencv_videoio REQUIRED)
vitreo_lazy_library(vitreo_lazy_videoio ${OPENCV_videoio})
target_link_libraries(vitreo_video INTERFACE vitreo_opencv vitreo_lazy_videoio)

find_library(READLINE_LIBRARY readline REQUIRED)  # line editing at the prompt

find_package(CLI11 REQUIRED)
add_library(vitreo_cli INTERFACE)
target_link_libraries(vitreo_cli INTERFACE CLI11::CLI11)

# The buses of the instruments.
pkg_check_modules(SERIALPORT REQUIRED libserialport)
add_library(vitreo_serialport INTERFACE)
target_include_directories(vitreo_serialport SYSTEM INTERFACE ${SERIALPORT_INCLUDE_DIRS})
target_link_libraries(vitreo_serialport INTERFACE ${SERIALPORT_LINK_LIBRARIES})

# The serial C library of HDF5, for `vitreo export --hdf5` alone. OpenCV's image formats load it anyway.
pkg_check_modules(HDF5 REQUIRED hdf5-serial)
find_library(HDF5_LIBRARY hdf5 HINTS ${HDF5_LIBRARY_DIRS} REQUIRED)
pkg_check_modules(HIDAPI REQUIRED IMPORTED_TARGET hidapi-hidraw)  # its other back end has the same symbols: never both
pkg_check_modules(LIBUSB REQUIRED IMPORTED_TARGET libusb-1.0)
pkg_check_modules(LIBEVDEV REQUIRED IMPORTED_TARGET libevdev)
pkg_check_modules(ARAVIS REQUIRED aravis-0.8)
pkg_check_modules(GOBJECT REQUIRED IMPORTED_TARGET gobject-2.0)
find_library(ARAVIS_LIBRARY aravis-0.8 HINTS ${ARAVIS_LIBRARY_DIRS} REQUIRED)
vitreo_lazy_library(vitreo_lazy_aravis ${ARAVIS_LIBRARY})
add_library(vitreo_aravis INTERFACE)
target_include_directories(vitreo_aravis SYSTEM INTERFACE ${ARAVIS_INCLUDE_DIRS})
target_link_libraries(vitreo_aravis INTERFACE vitreo_lazy_aravis PkgConfig::GOBJECT)
pkg_check_modules(DC1394 IMPORTED_TARGET libdc1394-2)            # optional: FireWire cameras
pkg_check_modules(LIBMODBUS IMPORTED_TARGET libmodbus)            # tests only: Modbus by another hand
pkg_check_modules(UMOCKDEV IMPORTED_TARGET umockdev-1.0)          # optional: emulated instruments on the system's own path
