# Contents of `make install` and of the Debian package: the program, its protocols, scripts, templates and docs, and what the
# program prints about itself (man page, completion, stubs for editors), so that none of these can differ from it.
include(GNUInstallDirs)
install(TARGETS vitreo vitreo_guardian RUNTIME)
# A folder below lib/vitreo: of a library right in it cpack believes that the system's loader is to know it (ldconfig).
install(TARGETS vitreo_loopback LIBRARY DESTINATION lib/vitreo/preload)
foreach(folder protocols scripts templates docs)
  install(DIRECTORY ${folder} DESTINATION ${CMAKE_INSTALL_DATADIR}/vitreo)
endforeach()
install(FILES packaging/copyright DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES packaging/60-vitreo.rules DESTINATION lib/udev/rules.d)
# The workbench: as a service of a user, and in the desktop's menu.
install(FILES packaging/vitreo.service DESTINATION lib/systemd/user)
install(FILES packaging/vitreo.desktop DESTINATION ${CMAKE_INSTALL_DATADIR}/applications)

set(VITREO_PRINTED ${CMAKE_BINARY_DIR}/printed)
install(CODE "
  set(ENV{VITREO_ROOT} \"${CMAKE_SOURCE_DIR}\")
  file(MAKE_DIRECTORY \"${VITREO_PRINTED}\")
  foreach(words \"docs;man;vitreo.1\" \"completion;bash;vitreo\" \"completion;zsh;_vitreo\" \"completion;fish;vitreo.fish\" \"docs;api;api.md\"
          \"docs;luacheck;luacheckrc\")
    list(POP_BACK words file)
    execute_process(COMMAND \"$<TARGET_FILE:vitreo>\" \${words} OUTPUT_FILE \"${VITREO_PRINTED}/\${file}\" COMMAND_ERROR_IS_FATAL ANY)
  endforeach()
  execute_process(COMMAND \"$<TARGET_FILE:vitreo>\" docs stubs \"${VITREO_PRINTED}/stubs\" COMMAND_ERROR_IS_FATAL ANY)
  file(COPY \"${CMAKE_SOURCE_DIR}/packaging/vitreo_guardian.1\" \"${CMAKE_SOURCE_DIR}/packaging/changelog\"
       DESTINATION \"${VITREO_PRINTED}\")
  execute_process(COMMAND gzip -9nf vitreo.1 vitreo_guardian.1 changelog WORKING_DIRECTORY \"${VITREO_PRINTED}\"
                  COMMAND_ERROR_IS_FATAL ANY)
")
install(FILES ${VITREO_PRINTED}/vitreo.1.gz ${VITREO_PRINTED}/vitreo_guardian.1.gz DESTINATION ${CMAKE_INSTALL_MANDIR}/man1)
install(FILES ${VITREO_PRINTED}/changelog.gz DESTINATION ${CMAKE_INSTALL_DOCDIR})
install(FILES ${VITREO_PRINTED}/vitreo DESTINATION ${CMAKE_INSTALL_DATADIR}/bash-completion/completions)
install(FILES ${VITREO_PRINTED}/_vitreo DESTINATION ${CMAKE_INSTALL_DATADIR}/zsh/vendor-completions)
install(FILES ${VITREO_PRINTED}/vitreo.fish DESTINATION ${CMAKE_INSTALL_DATADIR}/fish/vendor_completions.d)
install(DIRECTORY ${VITREO_PRINTED}/stubs DESTINATION ${CMAKE_INSTALL_DATADIR}/vitreo)
install(FILES ${VITREO_PRINTED}/luacheckrc ${VITREO_PRINTED}/api.md DESTINATION ${CMAKE_INSTALL_DATADIR}/vitreo)

# cpack -G DEB. The libraries that are opened at their first call (decision 5) are not seen by dpkg-shlibdeps.
set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME vitreo)
set(CPACK_PACKAGE_VERSION ${PROJECT_VERSION})
# There is no address to write to; of .invalid everyone knows it (RFC 2606).
set(CPACK_PACKAGE_CONTACT "Vitreo's developers <developers@vitreo.invalid>")
set(CPACK_PACKAGE_DESCRIPTION_SUMMARY "instrument control for magnetic microrobots inside the eye")
set(CPACK_DEBIAN_PACKAGE_DESCRIPTION
"A runtime for laboratories that steer magnetic microrobots inside the eye:
it drives cameras, stages and coils, knows the optics of the eye, tracks and
localizes the robot, and closes the servo loop. Experiments are Lua scripts.
A simulated laboratory comes with it, so they run with no hardware.")
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_STRIP_FILES ON)
set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_SECTION science)
set(CPACK_DEBIAN_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PACKAGE_DEPENDS "libopencv-imgcodecs406, libopencv-videoio406, libopencv-video406, libopencv-dnn406, libaravis-0.8-0")
# Its fonts come with Debian's fontconfig.
# Without it a run is exported all the same, only not as a film that every player shows.
set(CPACK_DEBIAN_PACKAGE_RECOMMENDS "ffmpeg")
# The workbench opens a browser by xdg-open, and posts to webhooks by curl.
set(CPACK_DEBIAN_PACKAGE_SUGGESTS
    "librsvg2-bin, vitreo-doc, python3-vitreo, curl, xdg-utils, default-mta | mail-transport-agent")
include(CPack)
