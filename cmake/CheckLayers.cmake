# Fails when a file includes a module that its own module did not declare in tarsier_module(DEPENDS ...), when a file
# opens a namespace that is not its folder's, when a family of applications uses another one, when anything but a window
# host uses highgui, when a header lacks #pragma once, or when a header that is installed includes one that is not. Test
# files may also include tarsier/synth. Also when the table of docs/architecture.md lacks a module or names other modules
# that it uses.
# Run as: cmake -DROOT=<src/tarsier> -DAPPS=<apps> -DLAYERS=<build>/layers.txt -DHEADERS=<build>/headers.txt
#               -DTABLE=<architecture.md> -P CheckLayers.cmake
cmake_minimum_required(VERSION 3.25)

# The names of these stand everywhere, so they are in namespace tarsier itself.
set(unnamed core media ui)
set(applications cartoon face planar plate sfm)
# cartoon finds faces: the one exception.
set(allowed_between "cartoon face")

# The module of a path below src/tarsier: the longest declared folder that holds it.
function(module_of path result)
  set(found "")
  foreach(module IN LISTS modules)
    string(FIND "${path}" "${module}/" place)
    string(LENGTH "${module}" length)
    string(LENGTH "${found}" best)
    if(place EQUAL 0 AND length GREATER best)
      set(found ${module})
    endif()
  endforeach()
  set(${result} "${found}" PARENT_SCOPE)
endfunction()

file(STRINGS ${HEADERS} installed)
file(STRINGS ${LAYERS} lines)
set(modules "")
foreach(line IN LISTS lines)
  string(REGEX MATCH "^([a-z_/]+): ?(.*)$" _ "${line}")
  list(APPEND modules ${CMAKE_MATCH_1})
  set(depends_${CMAKE_MATCH_1} "${CMAKE_MATCH_2}")
endforeach()

foreach(module IN LISTS modules)
  separate_arguments(allowed UNIX_COMMAND "${depends_${module}}")
  set(uses "${depends_${module}}")
  if(module STREQUAL "core")
    set(uses "-")
  endif()
  string(REGEX REPLACE "/.*" "" family ${module})

  file(STRINGS ${TABLE} row REGEX "^\\| [0-9] \\| `(apps/)?${module}` \\|")
  string(FIND "${row}" "| ${uses} |" place)
  if(row STREQUAL "" OR (place EQUAL -1 AND NOT module STREQUAL "ui"))
    message(SEND_ERROR "${TABLE}: the table of modules does not say that '${module}' uses ${uses}")
  endif()

  if(family IN_LIST applications)
    foreach(used IN LISTS allowed)
      string(REGEX REPLACE "/.*" "" other ${used})
      if(other IN_LIST applications AND NOT other STREQUAL family AND NOT "${family} ${other}" IN_LIST allowed_between)
        message(SEND_ERROR "'${module}' depends on '${used}': families of applications do not use each other")
      endif()
    endforeach()
  endif()

  # face/landmarks: tarsier::face or tarsier::face::landmarks, and what is nested in them.
  if(module IN_LIST unnamed)
    set(namespaces "tarsier(::[a-z_]+)?")
  else()
    string(REPLACE "/" "::" whole ${module})
    set(namespaces "tarsier::(${family}|${whole})(::[a-z_]+)?")
  endif()

  # The one module of apps/: its headers are included as ui/.., what it uses as tarsier/..
  set(root ${ROOT})
  if(module STREQUAL "ui")
    set(root ${APPS})
  endif()
  file(GLOB_RECURSE files RELATIVE ${root} ${root}/${module}/*.h ${root}/${module}/*.cpp ${root}/${module}/*.inl)
  foreach(path IN LISTS files)
    module_of(${path} own)
    if(NOT own STREQUAL module)  # of a module in a folder below
      continue()
    endif()
    file(STRINGS ${root}/${path} code REGEX "^(#include [\"<]|#pragma once|namespace tarsier)")
    foreach(line IN LISTS code)
      if(line MATCHES "opencv2/highgui")
        message(SEND_ERROR "${path}: only apps/window may use highgui")
      elseif(line MATCHES "^namespace" AND NOT line MATCHES "^namespace ${namespaces} {")
        message(SEND_ERROR "${path}: '${line}' is not the namespace of its folder")
      elseif(line MATCHES "^#include \"tarsier/(.+)\"")
        set(included ${CMAKE_MATCH_1})
        module_of(${included} used)
        set(is_test_helper FALSE)
        if(path MATCHES "_test\\.cpp$|/testing_[a-z_]+\\.h$" AND used MATCHES "^synth")
          set(is_test_helper TRUE)
        endif()
        if(NOT used STREQUAL module AND NOT used IN_LIST allowed AND NOT is_test_helper)
          message(SEND_ERROR "${path}: module '${module}' may not include 'tarsier/${included}'")
        endif()
        if(path IN_LIST installed AND NOT included IN_LIST installed)
          message(SEND_ERROR "${path} is installed and includes '${included}', which is not: HEADERS lacks it")
        endif()
      endif()
    endforeach()
    if(path MATCHES "\\.h$" AND NOT "#pragma once" IN_LIST code)
      message(SEND_ERROR "${path}: no #pragma once")
    endif()
  endforeach()
endforeach()
