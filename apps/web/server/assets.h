// SPDX-License-Identifier: MIT
#pragma once

#include "router.h"
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace tarsier::web {

// A file of the client, carried within the program (cmake/EmbedWeb.cmake).
struct Asset {
  std::string_view path;  // "index.html", "assets/app-1a2b3c.js"
  std::string_view gzip;  // its bytes, compressed
  std::string_view sha256;
};
[[nodiscard]] std::span<const Asset> embedded_assets();

// The routes of the pages: /assets/.. and other files by their names, index.html for every other
// path that is none of the API. With `folder` files are read from there each time (development).
void add_asset_routes(Router& router, const std::string& folder);

// "text/javascript; charset=utf-8" of "x.js"; "application/octet-stream" of unknown endings.
[[nodiscard]] std::string_view type_of_file(std::string_view path);

}  // namespace tarsier::web
