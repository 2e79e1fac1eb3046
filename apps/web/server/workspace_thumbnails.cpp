// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "child_process.h"
#include "framework/exit_status.h"
#include "router.h"
#include "workspace.h"
#include "workspace_paths.h"
#include <algorithm>
#include <cmath>
#include <filesystem>
#include <set>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxThumbnails = 20'000;

std::string sum_of(std::string_view text) {
  Sha256 sum;
  sum.add(text);
  return sum.hex();
}

// The common prefix of all thumbnails of a file.
std::string thumbnail_mark(const std::string& path) { return sum_of(path).substr(0, 24); }

}  // namespace

int make_thumbnail(const std::string& file, const std::string& out, int width) {
  try {
    const cv::Mat image = read_image(file);
    const double scale = std::min(1.0, static_cast<double>(width) / image.cols);
    cv::Mat small = image;
    if (scale < 1) {
      const int height = std::max(1, static_cast<int>(std::lround(image.rows * scale)));
      cv::resize(image, small, {width, std::min(height, 4 * width)}, 0, 0, cv::INTER_AREA);
    }
    write_image(out, small, 80);
    return 0;
  } catch (const Error& error) {
    log_error("{}", error.what());
    return static_cast<int>(exit_status(error.kind()));
  }
}

std::string Workspace::thumbnail(const std::string& path, int width, const std::string& program) {
  const FileInfo info = inspect(path, fs::path(path).filename().string());
  if (info.type != FileType::kImage) throw HttpError(415, "only images have thumbnails");
  const std::string version =
      sum_of(fmt::format("{}\n{}", info.bytes, info.modified)).substr(0, 16);
  const std::string out = fmt::format("{}/thumbnails/{}-{}-{}.jpg", studio_folder(),
                                      thumbnail_mark(path), version, width);
  const std::lock_guard lock(thumbnails_);  // one at a time: a decoder may need 300 MB
  if (is_file(out)) return out;
  check_space(100'000);
  if (++thumbnail_count_ > kMaxThumbnails) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(studio_folder() + "/thumbnails", error)) {
      fs::remove(entry.path(), error);
    }
    thumbnail_count_ = 0;
  }
  ChildOptions options;
  options.arguments = {program, "--thumbnail", path, out, std::to_string(width)};
  options.niceness = 5;
  ChildProcess child(std::move(options), [](const ChildEnd&) {});
  const auto end = child.wait(std::chrono::seconds(20));
  if (!end) child.kill();
  if (!end || end->exit != 0 || !is_file(out)) {
    throw HttpError(415, fmt::format("'{}' cannot be read as an image", info.name));
  }
  return out;
}

void Workspace::forget_thumbnails(const std::string& path) {
  std::set<std::string> marks = {thumbnail_mark(path)};
  std::error_code error;
  for (fs::recursive_directory_iterator it(path, error);
       !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    marks.insert(thumbnail_mark(it->path().string()));
  }
  const std::lock_guard lock(thumbnails_);
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(studio_folder() + "/thumbnails", ignored)) {
    const std::string name = entry.path().filename().string();
    if (marks.contains(name.substr(0, std::min(name.find('-'), name.size())))) {
      fs::remove(entry.path(), ignored);
    }
  }
}

}  // namespace tarsier::web
