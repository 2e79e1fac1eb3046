// SPDX-License-Identifier: MIT
#include "tarsier/media/crop_server.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"

#include <algorithm>
#include <filesystem>
#include <microhttpd.h>
#include <span>
#include <system_error>
#include <utility>
#include <vector>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

constexpr int kMaxConnections = 32;
constexpr int kMaxConnectionsPerAddress = 16;
constexpr std::int64_t kMaxCropBytes = 10'000'000;
constexpr std::string_view kEnding = ".jpg";
constexpr std::string_view kPath = "/crop/";

bool is_hash(std::string_view text) {
  return text.size() == 64 && std::all_of(text.begin(), text.end(), [](char c) {
           return (c >= '0' && c <= '9') || (c >= 'a' && c <= 'f');
         });
}

// The hashes of the existing images, oldest first.
std::deque<std::string> hashes_in(const std::string& folder) {
  std::vector<std::pair<fs::file_time_type, std::string>> files;
  std::error_code error;
  for (fs::directory_iterator entry(folder, error), end; !error && entry != end;
       entry.increment(error)) {
    const fs::path& path = entry->path();
    if (path.extension() == kEnding && is_hash(path.stem().string()))
      files.emplace_back(entry->last_write_time(error), path.stem().string());
  }
  if (error) throw OutputError(folder, error.message());
  std::sort(files.begin(), files.end());
  std::deque<std::string> hashes;
  for (auto& [time, hash] : files) hashes.push_back(std::move(hash));
  return hashes;
}

}  // namespace

CropServer::CropServer(const CropServerOptions& options) : options_(options) {
  options.check();
  make_folder(options.folder);
  std::error_code error;
  fs::permissions(options.folder, fs::perms::owner_all, error);
  hashes_ = hashes_in(options.folder);
  server_ = std::make_unique<HttpService>(
      options.url, options.access, kMaxConnections, kMaxConnectionsPerAddress,
      [this](MHD_Connection* connection, std::string_view path) {
        return respond(connection, path);
      });
}

std::string CropServer::add(const cv::Mat& image) {
  const std::vector<std::uint8_t> jpeg = encode_image(".jpg", image, options_.folder);
  Sha256 sum;
  sum.add(jpeg);
  std::string hash = sum.hex();
  const fs::path folder(options_.folder);
  const std::lock_guard lock(mutex_);
  if (std::find(hashes_.begin(), hashes_.end(), hash) != hashes_.end()) return hash;
  write_file_atomically((folder / (hash + std::string(kEnding))).string(),
                        std::span<const std::uint8_t>(jpeg));
  hashes_.push_back(hash);
  while (hashes_.size() > static_cast<std::size_t>(options_.max_crops)) {
    std::error_code ignored;
    fs::remove(folder / (hashes_.front() + std::string(kEnding)), ignored);
    hashes_.pop_front();
  }
  return hash;
}

std::string CropServer::url_of(const std::string& hash) const {
  return server_->url() + std::string(kPath.substr(1)) + hash + std::string(kEnding);
}

bool CropServer::respond(MHD_Connection* connection, std::string_view path) const {
  std::string hash;
  if (path.starts_with(kPath) && path.ends_with(kEnding))
    hash = path.substr(kPath.size(), path.size() - kPath.size() - kEnding.size());
  if (!is_hash(hash))
    return HttpService::refuse(connection, MHD_HTTP_NOT_FOUND, "there is /crop/SHA256.jpg");
  try {
    const std::string jpeg = read_file(
        (fs::path(options_.folder) / (hash + std::string(kEnding))).string(), kMaxCropBytes);
    return HttpService::send(connection, MHD_HTTP_OK, jpeg, "image/jpeg");
  } catch (const InputError&) {
    return HttpService::refuse(connection, MHD_HTTP_NOT_FOUND, "no such image, or no longer");
  }
}

}  // namespace tarsier
