# Files that `cmake --install` installs in addition to programs and libraries (those install themselves). The components
# are the Debian packages: program, gui, onnx, dev, models.
include(CMakePackageConfigHelpers)

set(TARSIER_CMAKE_DESTINATION ${CMAKE_INSTALL_LIBDIR}/cmake/tarsier)
set(TARSIER_MODELS_DESTINATION share/tarsier/models)  # ModelStore::find() looks there

install(DIRECTORY models/ DESTINATION ${TARSIER_MODELS_DESTINATION} COMPONENT models)
# Downloads models that this project may not distribute.
install(PROGRAMS scripts/get-model.sh DESTINATION share/tarsier/scripts COMPONENT program)

configure_package_config_file(cmake/tarsierConfig.cmake.in ${PROJECT_BINARY_DIR}/tarsierConfig.cmake
  INSTALL_DESTINATION ${TARSIER_CMAKE_DESTINATION} PATH_VARS TARSIER_MODELS_DESTINATION)
# Before 1.0 a minor version may change interfaces.
write_basic_package_version_file(${PROJECT_BINARY_DIR}/tarsierConfigVersion.cmake COMPATIBILITY SameMinorVersion)
install(FILES ${PROJECT_BINARY_DIR}/tarsierConfig.cmake ${PROJECT_BINARY_DIR}/tarsierConfigVersion.cmake
              cmake/TarsierAruco.cmake cmake/TarsierDlib.cmake
        DESTINATION ${TARSIER_CMAKE_DESTINATION} COMPONENT dev)
install(EXPORT tarsierTargets NAMESPACE tarsier:: DESTINATION ${TARSIER_CMAKE_DESTINATION} COMPONENT dev)

# Examples, systemd units (not enabled), and the desktop mirror (docs/pi.md).
install(DIRECTORY examples/find_package DESTINATION share/doc/libtarsier-dev/examples COMPONENT dev)
file(GLOB programs CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/examples/*.cpp)
install(FILES ${programs} DESTINATION share/doc/libtarsier-dev/examples COMPONENT dev)
if(CMAKE_INSTALL_PREFIX STREQUAL "/usr")  # packages only: elsewhere systemd does not look, and the units name /usr/bin
  install(DIRECTORY packaging/systemd/ DESTINATION lib/systemd/system COMPONENT program)
  install(DIRECTORY packaging/systemd-user/ DESTINATION lib/systemd/user COMPONENT program)
  # The studio's entry in the desktop menu: starts the user's unit and opens a browser.
  install(FILES packaging/tarsier-studio.desktop DESTINATION share/applications COMPONENT program)
  install(FILES packaging/tarsier.svg DESTINATION share/icons/hicolor/scalable/apps COMPONENT program)
  install(PROGRAMS packaging/open-studio.sh DESTINATION libexec/tarsier RENAME open-studio COMPONENT program)
endif()
install(FILES packaging/tarsier-cartoon-mirror.desktop packaging/tarsier-cartoon-mirror.service
        DESTINATION share/doc/tarsier/examples COMPONENT program)
