# tarsier_aruco: OpenCV's ArUco, for the build and for users of the installed libraries. Before OpenCV 4.7 it is part of
# contrib. Debian packs contrib's shared libraries into one package that needs Qt. A program without windows links the
# static archive instead, which needs none of them.
if(NOT TARGET tarsier_aruco)
  if(OpenCV_VERSION VERSION_LESS 4.7)
    find_library(TARSIER_ARUCO_ARCHIVE libopencv_aruco.a)
  endif()
  if(TARSIER_ARUCO_ARCHIVE)
    # For a static library, CMake puts its dependencies after it, also if others have named them before.
    add_library(tarsier_aruco STATIC IMPORTED)
    set_target_properties(tarsier_aruco PROPERTIES IMPORTED_LOCATION ${TARSIER_ARUCO_ARCHIVE}
      INTERFACE_LINK_LIBRARIES "opencv_calib3d;opencv_imgproc;opencv_core")
  else()
    add_library(tarsier_aruco INTERFACE IMPORTED)
    if(OpenCV_VERSION VERSION_LESS 4.7)
      find_package(OpenCV 4.6 REQUIRED COMPONENTS aruco)
      set_property(TARGET tarsier_aruco PROPERTY INTERFACE_LINK_LIBRARIES opencv_aruco)
    else()
      set_property(TARGET tarsier_aruco PROPERTY INTERFACE_LINK_LIBRARIES opencv_objdetect)
    endif()
  endif()
endif()
