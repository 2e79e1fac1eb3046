# tarsier_dlib: dlib by its files, for the build and for users of the installed libraries. The target of Debian's
# package names libraries (libjpeg.so ..) that the package does not depend on. dlib's headers call LAPACK and BLAS
# themselves.
if(NOT TARGET tarsier_dlib)
  find_path(DLIB_INCLUDE_DIR dlib/image_processing.h REQUIRED)
  find_library(DLIB_LIBRARY dlib REQUIRED)
  find_package(BLAS REQUIRED)
  find_package(LAPACK REQUIRED)
  add_library(tarsier_dlib INTERFACE IMPORTED)
  set_target_properties(tarsier_dlib PROPERTIES
    INTERFACE_SYSTEM_INCLUDE_DIRECTORIES "${DLIB_INCLUDE_DIR}"
    INTERFACE_INCLUDE_DIRECTORIES "${DLIB_INCLUDE_DIR}"
    INTERFACE_LINK_LIBRARIES "${DLIB_LIBRARY};LAPACK::LAPACK;BLAS::BLAS")
endif()
