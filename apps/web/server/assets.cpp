// SPDX-License-Identifier: MIT
#include "assets.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/words.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <utility>
#include <zlib.h>

namespace tarsier::web {
namespace {

constexpr auto kTypes = std::to_array<std::pair<std::string_view, std::string_view>>({
    {".html", "text/html; charset=utf-8"},
    {".js", "text/javascript; charset=utf-8"},
    {".mjs", "text/javascript; charset=utf-8"},
    {".css", "text/css; charset=utf-8"},
    {".svg", "image/svg+xml"},
    {".png", "image/png"},
    {".jpg", "image/jpeg"},
    {".jpeg", "image/jpeg"},
    {".webp", "image/webp"},
    {".ico", "image/x-icon"},
    {".json", "application/json"},
    {".map", "application/json"},
    {".webmanifest", "application/manifest+json"},
    {".woff2", "font/woff2"},
    {".wasm", "application/wasm"},
    {".txt", "text/plain; charset=utf-8"},
    {".mp4", "video/mp4"},
    {".mkv", "video/x-matroska"},
    {".avi", "video/x-msvideo"},
    {".csv", "text/csv; charset=utf-8"},
});

// Whether a file name contains a hash: "app-1A2B3C4D.js". The content of such a file never changes.
bool has_hash(std::string_view path) {
  const std::size_t slash = path.find_last_of('/');
  const std::string_view name = path.substr(slash == std::string_view::npos ? 0 : slash + 1);
  const std::size_t dash = name.find_last_of('-');
  if (!path.starts_with("assets/") || dash == std::string_view::npos) return false;
  const std::string_view rest = name.substr(dash + 1);
  const std::string_view hash = rest.substr(0, rest.find('.'));
  return hash.size() >= 8 && std::all_of(hash.begin(), hash.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z');
         });
}

std::string inflated(std::string_view gzip) {
  std::string text;
  z_stream stream{};
  if (inflateInit2(&stream, 15 + 16) != Z_OK) throw HttpError(503, "out of memory");
  stream.next_in = reinterpret_cast<Bytef*>(const_cast<char*>(gzip.data()));
  stream.avail_in = static_cast<uInt>(gzip.size());
  std::array<char, 65536> buffer;
  int status = Z_OK;
  while (status == Z_OK) {
    stream.next_out = reinterpret_cast<Bytef*>(buffer.data());
    stream.avail_out = buffer.size();
    status = inflate(&stream, Z_NO_FLUSH);
    text.append(buffer.data(), buffer.size() - stream.avail_out);
  }
  inflateEnd(&stream);
  return text;
}

bool takes_gzip(std::string_view accepted) {
  for (std::string_view rest = accepted; !rest.empty();) {
    const std::size_t comma = rest.find(',');
    const std::string item = lower_case(trimmed(rest.substr(0, comma)));
    rest.remove_prefix(comma == std::string_view::npos ? rest.size() : comma + 1);
    if (!item.starts_with("gzip")) continue;
    const std::size_t quality = item.find("q=");
    return quality == std::string::npos || to_number(item.substr(quality + 2)).value_or(1) > 0;
  }
  return false;
}

void set_caching(Response& response, std::string_view path, std::string_view sha256) {
  response.headers.emplace_back("ETag", fmt::format("\"{}\"", sha256.substr(0, 32)));
  response.headers.emplace_back(
      "Cache-Control", has_hash(path) ? "public, max-age=31536000, immutable" : "no-cache");
  response.headers.emplace_back("Vary", "Accept-Encoding");
}

const Asset* find_embedded(std::string_view path) {
  for (const Asset& asset : embedded_assets()) {
    if (asset.path == path) return &asset;
  }
  return nullptr;
}

bool answer_embedded(const Request& request, std::string_view path, Response& response) {
  const Asset* asset = find_embedded(path);
  if (asset == nullptr) return false;
  response.type = type_of_file(path);
  set_caching(response, path, asset->sha256);
  if (takes_gzip(request.header("accept-encoding"))) {
    response.memory = asset->gzip;
    response.headers.emplace_back("Content-Encoding", "gzip");
  } else {
    response.body = inflated(asset->gzip);
  }
  return true;
}

bool answer_from_folder(const std::string& folder, std::string_view path, Response& response) {
  const std::filesystem::path file = std::filesystem::path(folder) / path;
  std::error_code error;
  if (!std::filesystem::is_regular_file(file, error)) return false;
  std::ifstream stream(file, std::ios::binary);
  response.body.assign((std::istreambuf_iterator<char>(stream)), std::istreambuf_iterator<char>());
  response.type = type_of_file(path);
  Sha256 sum;
  sum.add(response.body);
  set_caching(response, path, sum.hex());
  return true;
}

}  // namespace

std::string_view type_of_file(std::string_view path) {
  const std::size_t dot = path.find_last_of('.');
  const std::string extension = dot == std::string_view::npos ? "" : lower_case(path.substr(dot));
  for (const auto& [known, type] : kTypes) {
    if (known == extension) return type;
  }
  return "application/octet-stream";
}

void add_asset_routes(Router& router, const std::string& folder) {
  const Handler handler = [folder](const Request& request) {
    std::string path = request.path.substr(1);
    Response response;
    const auto found = [&] {
      return folder.empty() ? answer_embedded(request, path, response)
                            : answer_from_folder(folder, path, response);
    };
    if (path.starts_with("api/"))
      throw HttpError(404, "no such address; /api/openapi.json lists them all");
    if (!path.empty() && found()) return response;
    const std::size_t slash = path.find_last_of('/');
    const std::string_view name =
        std::string_view(path).substr(slash == std::string::npos ? 0 : slash + 1);
    // Pages have other paths, which only the client knows.
    if (path.starts_with("assets/") || name.find('.') != std::string_view::npos)
      throw HttpError(404, "there is no such file");
    path = "index.html";
    if (!found()) throw HttpError(404, "the pages are missing in this build");
    return response;
  };
  router.add("GET", "/", handler, Access::kPublic);
  router.add("GET", "/{page...}", handler, Access::kPublic);
}

}  // namespace tarsier::web
