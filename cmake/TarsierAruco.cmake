# tarsier_aruco: OpenCV's ArUco, for the build and for those who use the installed libraries. Before OpenCV 4.7 it is a
# part of contrib, whose shared libraries Debian packs into one package that needs Qt; a program without windows takes
# it from the archive, which needs nothing of them.
if(NOT TARGET tarsier_aruco)
  add_library(tarsier_aruco INTERFACE IMPORTED)
  if(OpenCV_VERSION VERSION_LESS 4.7)
    find_library(TARSIER_ARUCO_ARCHIVE libopencv_aruco.a)
    if(TARSIER_ARUCO_ARCHIVE)
      set(_aruco ${TARSIER_ARUCO_ARCHIVE} opencv_calib3d opencv_imgproc opencv_core)
    else()
      find_package(OpenCV 4.6 REQUIRED COMPONENTS aruco)
      set(_aruco opencv_aruco)
    endif()
  else()
    set(_aruco opencv_objdetect)
  endif()
  set_property(TARGET tarsier_aruco PROPERTY INTERFACE_LINK_LIBRARIES "${_aruco}")
endif()
