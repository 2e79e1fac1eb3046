# The Debian packages that `cpack -G DEB` makes from the install components (scripts/package.sh runs all steps):
#   tarsier (program), tarsier-gui (the window), tarsier-onnx (the user's own networks), libtarsier-dev (dev), tarsier-models (models).
set(TARSIER_MAINTAINER "Tarsier maintainers <maintainers@tarsier.example>" CACHE STRING "Maintainer field of the packages")
set(release 1)  # packaging release of one version

set(CPACK_GENERATOR DEB)
set(CPACK_PACKAGE_NAME tarsier)
set(CPACK_PACKAGE_CONTACT ${TARSIER_MAINTAINER})
set(CPACK_PACKAGE_DIRECTORY ${PROJECT_BINARY_DIR}/packages)
set(CPACK_PACKAGING_INSTALL_PREFIX /usr)
set(CPACK_COMPONENTS_ALL program gui dev models)
if(TARGET tarsier_onnx_module)
  list(APPEND CPACK_COMPONENTS_ALL onnx)
endif()
set(CPACK_COMPONENTS_GROUPING IGNORE)
set(CPACK_DEB_COMPONENT_INSTALL ON)
set(CPACK_STRIP_FILES ON)
set(CPACK_INSTALL_DEFAULT_DIRECTORY_PERMISSIONS
    OWNER_READ OWNER_WRITE OWNER_EXECUTE GROUP_READ GROUP_EXECUTE WORLD_READ WORLD_EXECUTE)
# Compresses pages and adds copyright and changelogs to each package.
set(CPACK_PRE_BUILD_SCRIPTS ${PROJECT_SOURCE_DIR}/cmake/PackageDocs.cmake)
set(CPACK_TARSIER_SOURCE ${PROJECT_SOURCE_DIR})
# Time of the changelog: that of the last commit, which scripts/package.sh passes, or now.
string(TIMESTAMP CPACK_TARSIER_DATE "%a, %d %b %Y %H:%M:%S +0000" UTC)

set(CPACK_DEBIAN_FILE_NAME DEB-DEFAULT)
set(CPACK_DEBIAN_PACKAGE_RELEASE ${release})
set(CPACK_DEBIAN_PACKAGE_CONTROL_STRICT_PERMISSION ON)
set(CPACK_DEBIAN_COMPRESSION_TYPE xz)
set(version "${PROJECT_VERSION}-${release}")

# The models were trained on images for research only. So the packages that contain or need them are outside Debian's
# main.
set(CPACK_DEBIAN_PROGRAM_PACKAGE_NAME tarsier)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SECTION contrib/graphics)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_PROGRAM_PACKAGE_DEPENDS "tarsier-models (>= ${PROJECT_VERSION}), opencv-data")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_RECOMMENDS "ca-certificates, libmosquitto1, fonts-dejavu-core, fonts-opendin, fonts-urw-base35, fonts-freefont-ttf")
set(CPACK_DEBIAN_PROGRAM_PACKAGE_SUGGESTS "tarsier-gui (= ${version}), tarsier-onnx (= ${version}), mosquitto, opencv-doc, bash-completion")
set(CPACK_COMPONENT_PROGRAM_DESCRIPTION "classical computer vision on an ordinary CPU, offline
Tarsier turns images and live cameras into cartoons, rebuilds scenes in 3D
from images, reads number plates, tracks the points of faces, fits
appearance models, tells where heads look, recognises people, calibrates
cameras and prints markers. It needs no GPU and no network.
.
Without tarsier-gui results go to files, to JSON lines and to browsers.")

set(CPACK_DEBIAN_GUI_PACKAGE_NAME tarsier-gui)
set(CPACK_DEBIAN_GUI_PACKAGE_SECTION contrib/graphics)
set(CPACK_DEBIAN_GUI_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_GUI_PACKAGE_DEPENDS "tarsier (= ${version})")
set(CPACK_COMPONENT_GUI_DESCRIPTION "window for tarsier's live sessions
The module that tarsier loads for --window: live cameras, annotating points,
playing with models, calibrating. It brings OpenCV's window toolkit (Qt).")

set(CPACK_DEBIAN_ONNX_PACKAGE_NAME tarsier-onnx)
set(CPACK_DEBIAN_ONNX_PACKAGE_SECTION contrib/graphics)
set(CPACK_DEBIAN_ONNX_PACKAGE_SHLIBDEPS ON)
set(CPACK_DEBIAN_ONNX_PACKAGE_DEPENDS "tarsier (= ${version})")
set(CPACK_COMPONENT_ONNX_DESCRIPTION "networks of your own for tarsier's people
The module that tarsier loads for people --embedding and
--detector-model: it runs ONNX files by OpenCV's dnn. No network comes with it.")

set(CPACK_DEBIAN_DEV_PACKAGE_NAME libtarsier-dev)
set(CPACK_DEBIAN_DEV_PACKAGE_SECTION libdevel)
string(JOIN ", " CPACK_DEBIAN_DEV_PACKAGE_DEPENDS libopencv-dev libfmt-dev nlohmann-json3-dev libmicrohttpd-dev libgnutls28-dev
  libjpeg-dev libpng-dev libfreetype-dev libsqlite3-dev libeigen3-dev libdlib-dev libblas-dev liblapack-dev pkg-config)
set(CPACK_DEBIAN_DEV_PACKAGE_SUGGESTS "tarsier-models (>= ${PROJECT_VERSION})")
set(CPACK_COMPONENT_DEV_DESCRIPTION "libraries of tarsier for programs of your own
Headers, static libraries and the CMake package tarsier, whose targets
tarsier::cartoon, tarsier::plate_networks, tarsier::face_landmarks and so on are the modules
that the program tarsier is made of. An example is in
/usr/share/doc/libtarsier-dev/examples.")

set(CPACK_DEBIAN_MODELS_PACKAGE_NAME tarsier-models)
set(CPACK_DEBIAN_MODELS_PACKAGE_SECTION non-free/graphics)
set(CPACK_DEBIAN_MODELS_PACKAGE_ARCHITECTURE all)
set(CPACK_COMPONENT_MODELS_DESCRIPTION "trained models of tarsier
Models that find the points of faces, faces' appearance, heads in 3D, people
and number plates, each with a card that tells its data, terms and accuracy,
and the layouts of number plates of 49 countries.
.
Some were learnt from images that are for non-commercial research only;
their cards and the copyright file say which.")

include(CPack)
