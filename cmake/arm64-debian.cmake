# Cross-builds for arm64 against the root of a Debian for arm64. scripts/arm64.sh makes one in build/arm64-root, or in
# $TARSIER_ARM64_ROOT. Programs of the build run under qemu-user.
set(CMAKE_SYSTEM_NAME Linux)
set(CMAKE_SYSTEM_PROCESSOR aarch64)
set(CMAKE_C_COMPILER aarch64-linux-gnu-gcc)
set(CMAKE_CXX_COMPILER aarch64-linux-gnu-g++)

set(root "$ENV{TARSIER_ARM64_ROOT}")
if(NOT root)
  set(root ${CMAKE_CURRENT_LIST_DIR}/../build/arm64-root)
endif()
get_filename_component(root ${root} REALPATH)
set(CMAKE_SYSROOT ${root})
set(CMAKE_LIBRARY_ARCHITECTURE aarch64-linux-gnu)
set(CMAKE_FIND_ROOT_PATH ${root})
set(CMAKE_FIND_ROOT_PATH_MODE_PROGRAM NEVER)
set(CMAKE_FIND_ROOT_PATH_MODE_LIBRARY ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_INCLUDE ONLY)
set(CMAKE_FIND_ROOT_PATH_MODE_PACKAGE ONLY)
set(ENV{PKG_CONFIG_SYSROOT_DIR} ${root})
set(ENV{PKG_CONFIG_LIBDIR} ${root}/usr/lib/aarch64-linux-gnu/pkgconfig:${root}/usr/share/pkgconfig)

# The root was only unpacked, so the links that packages make during installation are missing.
set(libraries /usr/lib/aarch64-linux-gnu)
set(CMAKE_CROSSCOMPILING_EMULATOR
    "qemu-aarch64-static;-L;${root};-E;LD_LIBRARY_PATH=${libraries}/blas:${libraries}/lapack")
string(JOIN " " CMAKE_EXE_LINKER_FLAGS_INIT
       "-Wl,-rpath-link,${root}${libraries}" "-Wl,-rpath-link,${root}${libraries}/blas" "-Wl,-rpath-link,${root}${libraries}/lapack")
