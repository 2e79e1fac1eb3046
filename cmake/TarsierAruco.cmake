# tarsier_aruco: OpenCV's ArUco, for the build and for those who use the installed libraries. Before OpenCV 4.7 it is a
# part of contrib, whose shared libraries Debian packs into one package that needs Qt; a program without windows takes
# it from the archive, which needs nothing of them.
if(NOT TARGET tarsier_aruco)
  if(OpenCV_VERSION VERSION_LESS 4.7)
    find_library(TARSIER_ARUCO_ARCHIVE libopencv_aruco.a)
  endif()
  if(TARSIER_ARUCO_ARCHIVE)
    # Of a static library CMake knows that what it needs comes after it, also where others have named it before.
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
