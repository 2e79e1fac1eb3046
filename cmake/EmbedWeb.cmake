# tarsier_embed_web(<target> <folder>)
#
# Puts the files of <folder> (the bundle of the studio's client) into <target>. Each file is compressed by gzip at build
# time. One assembler file includes them by .incbin, and a table lists them with their SHA-256 (embedded_assets() of
# apps/web/server/assets.h). The same files give the same bytes.
#
# This file is also the script that writes both: cmake -DFOLDER=.. -DOUT=.. -P EmbedWeb.cmake
if(CMAKE_SCRIPT_MODE_FILE)
  cmake_minimum_required(VERSION 3.25)
  file(GLOB_RECURSE files RELATIVE ${FOLDER} ${FOLDER}/*)
  list(SORT files)
  file(MAKE_DIRECTORY ${OUT})
  set(assembler "# Made by cmake/EmbedWeb.cmake.\n.section .rodata\n")
  set(externs "")
  set(rows "")
  set(number 0)
  foreach(file IN LISTS files)
    if(file MATCHES "[\"\\\\\n]")
      message(FATAL_ERROR "${file}: such a name cannot be embedded")
    endif()
    set(packed ${OUT}/${number}.gz)
    file(SHA256 ${FOLDER}/${file} hash)
    # A time stamp in the gzip header would make every build different.
    file(ARCHIVE_CREATE OUTPUT ${packed} PATHS ${FOLDER}/${file} FORMAT raw COMPRESSION GZip COMPRESSION_LEVEL 9
         MTIME "1970-01-01")
    string(APPEND assembler ".balign 16\n.globl tarsier_web_asset_${number}\ntarsier_web_asset_${number}:\n"
           ".incbin \"${packed}\"\n.globl tarsier_web_asset_${number}_end\ntarsier_web_asset_${number}_end:\n.byte 0\n")
    string(APPEND externs "extern const char tarsier_web_asset_${number};\n"
           "extern const char tarsier_web_asset_${number}_end;\n")
    string(APPEND rows "      Asset{\"${file}\", span_of(tarsier_web_asset_${number}, tarsier_web_asset_${number}_end),\n"
           "            \"${hash}\"},\n")
    math(EXPR number "${number} + 1")
  endforeach()
  string(APPEND assembler ".section .note.GNU-stack,\"\",%progbits\n")
  file(WRITE ${OUT}/web_assets.S "${assembler}")
  file(WRITE ${OUT}/web_assets.cpp "// Made by cmake/EmbedWeb.cmake.
#include \"assets.h\"

#include <array>
#include <cstddef>

extern \"C\" {
${externs}}

namespace tarsier::web {
namespace {

std::string_view span_of(const char& first, const char& end) {
  return {&first, static_cast<std::size_t>(&end - &first)};
}

}  // namespace

std::span<const Asset> embedded_assets() {
  static const std::array<Asset, ${number}> kAssets{
${rows}  };
  return kAssets;
}

}  // namespace tarsier::web
")
  return()
endif()

enable_language(ASM)

function(tarsier_embed_web target folder)
  file(GLOB_RECURSE files CONFIGURE_DEPENDS ${folder}/*)
  set(out ${CMAKE_CURRENT_BINARY_DIR}/web_assets)
  add_custom_command(OUTPUT ${out}/web_assets.S ${out}/web_assets.cpp
    COMMAND ${CMAKE_COMMAND} -DFOLDER=${folder} -DOUT=${out} -P ${PROJECT_SOURCE_DIR}/cmake/EmbedWeb.cmake
    DEPENDS ${files} ${PROJECT_SOURCE_DIR}/cmake/EmbedWeb.cmake VERBATIM)
  target_sources(${target} PRIVATE ${out}/web_assets.S ${out}/web_assets.cpp)
  set_source_files_properties(${out}/web_assets.cpp PROPERTIES SKIP_PRECOMPILE_HEADERS ON)
  # The compiler's dependency list does not contain the files of .incbin.
  set_source_files_properties(${out}/web_assets.S PROPERTIES OBJECT_DEPENDS ${out}/web_assets.cpp)
endfunction()
