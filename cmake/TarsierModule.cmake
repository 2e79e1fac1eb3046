# tarsier_module(<path> DEPENDS <paths of tarsier modules...> LIBS <targets...> PRIVATE_LIBS <targets...>
#                HEADERS ... SOURCES ... TESTS ... TEST_LIBS ... [APP])
#
# Declares the library of the folder src/tarsier/<path>: face/landmarks is the target tarsier::face_landmarks. DEPENDS
# lists every other module that its files may include; the test architecture/layers checks it. The files of TESTS are
# linked into one program, face_landmarks_test. CTest runs each file as a separate test, face/landmarks/tracker_test. APP:
# the folder is apps/<path>, its headers are included as <path>/.., and it is not installed.
function(tarsier_module path)
  cmake_parse_arguments(arg "APP" "" "DEPENDS;LIBS;PRIVATE_LIBS;SOURCES;HEADERS;TESTS;TEST_LIBS" ${ARGN})
  string(REPLACE "/" "_" name ${path})
  list(TRANSFORM arg_DEPENDS REPLACE "/" "_" OUTPUT_VARIABLE modules)
  set(target tarsier_${name})
  if(arg_SOURCES)
    add_library(${target} STATIC ${arg_SOURCES})
    set(scope PUBLIC)
  else()
    add_library(${target} INTERFACE)
    set(scope INTERFACE)
  endif()
  add_library(tarsier::${name} ALIAS ${target})
  set(root src)
  if(arg_APP)
    set(root apps)
  endif()
  target_sources(${target} ${scope} FILE_SET HEADERS
                 BASE_DIRS ${PROJECT_SOURCE_DIR}/${root} FILES ${arg_HEADERS})
  set_target_properties(${target} PROPERTIES VERIFY_INTERFACE_HEADER_SETS ON EXPORT_NAME ${name})
  target_compile_features(${target} ${scope} cxx_std_20)
  list(TRANSFORM modules PREPEND tarsier::)
  target_link_libraries(${target} ${scope} ${modules} ${arg_LIBS})
  if(arg_SOURCES)
    target_link_libraries(${target} PRIVATE ${arg_PRIVATE_LIBS})
    tarsier_strict(${target})
    if(arg_APP)
      tarsier_quickly_compiled(${target})
    endif()
    tarsier_precompiled(${target})
  endif()
  if(NOT arg_APP)
    install(TARGETS ${target} EXPORT tarsierTargets
            ARCHIVE DESTINATION ${CMAKE_INSTALL_LIBDIR} COMPONENT dev
            FILE_SET HEADERS DESTINATION ${CMAKE_INSTALL_INCLUDEDIR} COMPONENT dev)
    foreach(header IN LISTS arg_HEADERS)
      file(APPEND ${PROJECT_BINARY_DIR}/headers.txt "${path}/${header}\n")
    endforeach()
  endif()
  list(JOIN arg_DEPENDS " " depends)
  file(APPEND ${PROJECT_BINARY_DIR}/layers.txt "${path}: ${depends}\n")

  if(TARSIER_BUILD_TESTS AND arg_TESTS)
    set(program ${name}_test)
    add_executable(${program} ${arg_TESTS})
    target_link_libraries(${program} PRIVATE ${target} ${arg_TEST_LIBS} tarsier::synth tarsier_unit_main
                          GTest::gmock GTest::gtest $<TARGET_NAME_IF_EXISTS:tarsier_tsan_threads>)
    target_compile_definitions(${program} PRIVATE TARSIER_SOURCE_MODELS="${PROJECT_SOURCE_DIR}/models")
    tarsier_strict(${program})
    tarsier_quickly_compiled(${program})
    tarsier_precompiled(${program})
    foreach(source IN LISTS arg_TESTS)
      cmake_path(GET source STEM stem)
      string(REPLACE "/" "_" report ${path}_${stem})
      add_test(NAME ${path}/${stem} COMMAND ${program} --file=${stem})
      set_tests_properties(${path}/${stem} PROPERTIES
        LABELS unit
        ENVIRONMENT "GTEST_OUTPUT=xml:${PROJECT_BINARY_DIR}/test-results/${report}.xml;TARSIER_DATA=${TARSIER_DATA};${TARSIER_TEST_ENVIRONMENT}")
      tarsier_test_cost(${path}/${stem})
    endforeach()
  endif()
endfunction()

# The measured processor time of each test (scripts/test-times.py --write). ctest starts the longest tests first, so
# that it does not wait for one of them at the end.
file(STRINGS ${PROJECT_SOURCE_DIR}/tests/costs.txt lines REGEX "^[^#]")
foreach(line IN LISTS lines)
  string(REGEX MATCH "^([^ ]+) ([0-9]+)$" _ "${line}")
  set(TARSIER_COST_OF_${CMAKE_MATCH_1} ${CMAKE_MATCH_2})
endforeach()
set_property(DIRECTORY APPEND PROPERTY CMAKE_CONFIGURE_DEPENDS ${PROJECT_SOURCE_DIR}/tests/costs.txt)
function(tarsier_test_cost name)
  if(DEFINED TARSIER_COST_OF_${name})
    set_tests_properties(${name} PROPERTIES COST ${TARSIER_COST_OF_${name}})
  endif()
endfunction()

# Warnings for our own code. Sanitizers are set for the whole build (top CMakeLists.txt).
function(tarsier_strict target)
  target_compile_options(${target} PRIVATE -Wall -Wextra -Wpedantic -Wconversion -Wshadow
                                           -Wnon-virtual-dtor)
  # GCC 12 wrongly reports overlaps and overflows in std::string's operator+ (GCC bug 105651).
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(${target} PRIVATE -Wno-restrict -Wno-stringop-overflow)
  endif()
  # GCC 13 and later take a reference to a part of the first argument for one to a temporary among the other arguments.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_GREATER_EQUAL 13)
    target_compile_options(${target} PRIVATE -Wno-dangling-reference)
  endif()
endfunction()

# Tests, verbs, windows and the server are not in inner loops: the library's modules are. Higher optimisation would take a
# fifth (of tests a third) of their compile time.
function(tarsier_quickly_compiled target)
  set_property(TARGET ${target} PROPERTY TARSIER_QUICKLY_COMPILED ON)
  target_compile_options(${target} PRIVATE $<$<CONFIG:Release>:-O1>)
  # With -O1, GCC 12 wrongly reports members of temporaries.
  if(CMAKE_CXX_COMPILER_ID STREQUAL "GNU" AND CMAKE_CXX_COMPILER_VERSION VERSION_LESS 13)
    target_compile_options(${target} PRIVATE -Wno-maybe-uninitialized)
  endif()
endfunction()

# Optimises these files of inner loops in all builds. Release optimises the whole library.
function(tarsier_always_optimised)
  if(NOT CMAKE_BUILD_TYPE STREQUAL "Release")
    set_source_files_properties(${ARGV} PROPERTIES COMPILE_OPTIONS "-O3")
  endif()
endfunction()

# The headers that nearly all files include, compiled once: for the library, for what is quickly compiled, and with the test
# headers. GCC 14 does not use them with another level of optimisation. They hide a missing #include, so the preset dev does not
# use them. The sanitizer presets do not use them either: GCC raises more false alarms in precompiled headers, and warnings are
# errors there.
# nlohmann/json.hpp is not among them: it has an inline function (operator""_json) whose templates each file would
# instantiate again, used or not, in 0.4 s. Headers include json_fwd.hpp where that suffices.
# Of our own headers, those that instantiate large class templates are (std::variant of options, Eigen::Matrix).
if(TARSIER_PCH)
  set(headers <algorithm> <array> <chrono> <cmath> <filesystem> <fstream> <functional> <limits> <map> <memory> <optional>
      <random> <set> <span> <string> <string_view> <thread> <variant> <vector> <fmt/format.h> <opencv2/core.hpp>
      <opencv2/imgproc.hpp> <Eigen/Core> ${PROJECT_SOURCE_DIR}/src/tarsier/core/option_fields.h
      ${PROJECT_SOURCE_DIR}/src/tarsier/geometry/rigid3.h)
  # An existing file is not touched; otherwise each configuration would compile everything again.
  file(CONFIGURE OUTPUT ${PROJECT_BINARY_DIR}/pch.cpp CONTENT "")
  foreach(kind IN ITEMS code quick test)
    if(kind STREQUAL test AND NOT TARSIER_BUILD_TESTS)
      continue()
    endif()
    add_library(tarsier_pch_${kind} OBJECT ${PROJECT_BINARY_DIR}/pch.cpp)
    target_compile_features(tarsier_pch_${kind} PRIVATE cxx_std_20)
    target_link_libraries(tarsier_pch_${kind} PRIVATE opencv_core fmt::fmt Eigen3::Eigen Threads::Threads)
    target_precompile_headers(tarsier_pch_${kind} PRIVATE ${headers})
    tarsier_strict(tarsier_pch_${kind})
    set_target_properties(tarsier_pch_${kind} PROPERTIES EXPORT_COMPILE_COMMANDS OFF)
    if(NOT kind STREQUAL code)
      tarsier_quickly_compiled(tarsier_pch_${kind})
    endif()
  endforeach()
  if(TARSIER_BUILD_TESTS)
    target_link_libraries(tarsier_pch_test PRIVATE GTest::gmock GTest::gtest)
    target_precompile_headers(tarsier_pch_test PRIVATE <gmock/gmock.h> <gtest/gtest.h>)
  endif()
endif()

# Files with their own compile options cannot use them.
function(tarsier_skip_precompiled target)
  get_target_property(sources ${target} SOURCES)
  foreach(source IN LISTS sources)
    get_source_file_property(options ${source} COMPILE_OPTIONS)
    if(options)
      set_source_files_properties(${source} PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
    endif()
  endforeach()
endfunction()

function(tarsier_precompiled target)
  tarsier_unity(${target})
  if(NOT TARSIER_PCH)
    return()
  endif()
  set(kind code)
  get_target_property(is_quick ${target} TARSIER_QUICKLY_COMPILED)
  if(target MATCHES "_test$")
    set(kind test)
  elseif(is_quick)
    set(kind quick)
  endif()
  target_precompile_headers(${target} REUSE_FROM tarsier_pch_${kind})
  cmake_language(EVAL CODE "cmake_language(DEFER CALL tarsier_skip_precompiled [[${target}]])")
endfunction()

# Unity build: several files of a target are compiled as one, up to TARSIER_UNITY_BYTES together (a property of targets with many
# templates). That saves a third of the processor time, since files of a module instantiate the same templates. File-local names
# are therefore unique within a module. Files with their own compile options or definitions are compiled alone, as are large
# ones. The presets dev, asan and tsan compile each file alone: they show what a file lacks.
set(TARSIER_UNITY_BYTES 32000)
function(tarsier_unity target)
  if(TARSIER_UNITY)
    set_target_properties(${target} PROPERTIES UNITY_BUILD ON UNITY_BUILD_MODE GROUP)
    cmake_language(EVAL CODE "cmake_language(DEFER CALL tarsier_group_sources [[${target}]])")
  endif()
endfunction()

function(tarsier_group_sources target)
  get_target_property(sources ${target} SOURCES)
  get_target_property(limit ${target} TARSIER_UNITY_BYTES)
  if(NOT limit)
    set(limit ${TARSIER_UNITY_BYTES})
  endif()
  set(bytes ${limit})
  foreach(source IN LISTS sources)
    get_source_file_property(options ${source} COMPILE_OPTIONS)
    get_source_file_property(is_alone ${source} SKIP_UNITY_BUILD_INCLUSION)
    cmake_path(ABSOLUTE_PATH source BASE_DIRECTORY ${CMAKE_CURRENT_SOURCE_DIR} OUTPUT_VARIABLE path)
    if(options OR is_alone OR NOT source MATCHES "\\.cpp$" OR NOT EXISTS ${path})
      continue()
    endif()
    file(SIZE ${path} size)
    math(EXPR bytes "${bytes} + ${size}")
    if(bytes GREATER limit) # begins a group, named after its first file
      string(REGEX REPLACE "\\.cpp$" "" group ${source})
      string(MAKE_C_IDENTIFIER ${group} group)
      set(bytes ${size})
    endif()
    set_source_files_properties(${source} PROPERTIES UNITY_GROUP ${group})
  endforeach()
endfunction()

# main() of the unit test programs.
if(TARSIER_BUILD_TESTS)
  add_library(tarsier_unit_main OBJECT ${PROJECT_SOURCE_DIR}/tests/unit/main.cpp)
  target_compile_features(tarsier_unit_main PRIVATE cxx_std_20)
  target_link_libraries(tarsier_unit_main PRIVATE GTest::gmock GTest::gtest)
  tarsier_strict(tarsier_unit_main)
  tarsier_quickly_compiled(tarsier_unit_main)
endif()

function(tarsier_add_layer_test)
  if(TARSIER_BUILD_TESTS)
    add_test(NAME architecture/layers
             COMMAND ${CMAKE_COMMAND} -DROOT=${PROJECT_SOURCE_DIR}/src/tarsier -DAPPS=${PROJECT_SOURCE_DIR}/apps
                     -DLAYERS=${PROJECT_BINARY_DIR}/layers.txt -DHEADERS=${PROJECT_BINARY_DIR}/headers.txt
                     -DTABLE=${PROJECT_SOURCE_DIR}/docs/architecture.md
                     -P ${PROJECT_SOURCE_DIR}/cmake/CheckLayers.cmake)
  endif()
endfunction()

file(WRITE ${PROJECT_BINARY_DIR}/layers.txt "")
file(WRITE ${PROJECT_BINARY_DIR}/headers.txt "")
