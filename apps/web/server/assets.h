// SPDX-License-Identifier: MIT
#pragma once

#include "router.h"
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

namespace tarsier::web {

// A file of the client, embedded in the program (cmake/EmbedWeb.cmake).
struct Asset {
  std::string_view path;  // "index.html", "assets/app-1a2b3c.js"
  std::string_view gzip;  // compressed content
  std::string_view sha256;
};
[[nodiscard]] std::span<const Asset> embedded_assets();

// Adds the routes of the pages: /assets/.. and other files by name, index.html for every other path
// outside the API. If `folder` is set, files are read from there on each request (development).
void add_asset_routes(Router& router, const std::string& folder);

// "text/javascript; charset=utf-8" for "x.js"; "application/octet-stream" for unknown extensions.
[[nodiscard]] std::string_view type_of_file(std::string_view path);

}  // namespace tarsier::web
