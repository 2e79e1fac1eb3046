// SPDX-License-Identifier: MIT
#include "tarsier/media/still_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/require.h"
#include "tarsier/media/image_file.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <filesystem>
#include <glob.h>
#include <system_error>
#include <utility>

namespace tarsier {
namespace {

namespace fs = std::filesystem;

constexpr std::int64_t kMaxListBytes = 64'000'000;

int lower(char c) { return std::tolower(static_cast<unsigned char>(c)); }
bool is_digit(char c) { return c >= '0' && c <= '9'; }

using OnSkip = std::function<void(std::int64_t, const std::string&)>;

class StillSource final : public FrameSource {
 public:
  StillSource(std::vector<std::string> paths, const SourceOptions& options)
      : paths_(std::move(paths)),
        sequence_(options.sequence),
        fps_(options.fps > 0 ? options.fps : 25) {}
  StillSource(const std::vector<BatchImage>& images, OnSkip on_skip)
      : StillSource({}, SourceOptions{}) {
    on_skip_ = std::move(on_skip);
    for (const BatchImage& image : images) {
      paths_.push_back(image.path);
      numbers_.push_back(image.number);
    }
  }

  std::optional<Frame> next(std::chrono::milliseconds, const std::stop_token& stop) override {
    while (at_ < paths_.size() && !stop.stop_requested()) {
      const std::size_t place = at_++;
      const std::string& path = paths_[place];
      Frame frame;
      try {
        frame.image = read_image(path);
      } catch (const InputError& error) {
        if (paths_.size() == 1 && !on_skip_) throw;
        log_warning("{}; skipped", error.what());
        skipped_.emplace_back(error.what());
        if (on_skip_) {
          on_skip_(numbers_[place], error.what());
        } else if (at_ == paths_.size() && read_ == 0) {
          throw InputError(paths_.front(),
                           fmt::format("none of the {} images could be read", paths_.size()));
        }
        continue;
      }
      frame.index = on_skip_ ? numbers_[place] : read_;
      ++read_;
      frame.time = sequence_ ? static_cast<double>(frame.index) / fps_ : 0;
      frame.name = path;
      frame.still = !sequence_;
      frame.captured = std::chrono::steady_clock::now();
      detail_ = fmt::format("{}x{} image", frame.image.cols, frame.image.rows);
      return frame;
    }
    return std::nullopt;
  }

  [[nodiscard]] bool ended() const override { return at_ >= paths_.size(); }
  [[nodiscard]] bool is_live() const override { return false; }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    status.state = ended() ? SourceState::kEnded : SourceState::kLive;
    status.detail = detail_;
    status.received = read_;
    return status;
  }
  [[nodiscard]] double fps() const override { return sequence_ ? fps_ : 0; }
  [[nodiscard]] std::int64_t count() const override {
    return static_cast<std::int64_t>(paths_.size());
  }
  [[nodiscard]] const std::vector<std::string>& skipped() const override { return skipped_; }

 private:
  std::vector<std::string> paths_;
  std::vector<std::int64_t> numbers_;  // for a batch
  OnSkip on_skip_;                     // for a batch
  const bool sequence_;
  const double fps_;
  std::size_t at_ = 0;
  std::int64_t read_ = 0;
  std::string detail_ = "images";
  std::vector<std::string> skipped_;
};

void sort_naturally(std::vector<std::string>& paths) {
  std::sort(paths.begin(), paths.end(),
            [](const std::string& a, const std::string& b) { return natural_less(a, b); });
}

}  // namespace

bool has_image_extension(std::string_view path) {
  static constexpr std::array<std::string_view, 10> kExtensions = {
      ".jpg", ".jpeg", ".jpe", ".png", ".webp", ".bmp", ".ppm", ".pgm", ".pbm", ".pnm"};
  return std::any_of(kExtensions.begin(), kExtensions.end(), [&](std::string_view extension) {
    return path.size() > extension.size() &&
           std::equal(extension.begin(), extension.end(),
                      path.end() - static_cast<std::ptrdiff_t>(extension.size()),
                      [](char a, char b) { return a == lower(b); });
  });
}

std::string source_of(const Frame& frame) {
  if (frame.still || !has_image_extension(frame.name)) return frame.name;
  const fs::path folder = fs::path(frame.name).parent_path();
  return folder.empty() ? "." : folder.string();
}

bool natural_less(std::string_view a, std::string_view b) {
  std::size_t i = 0;
  std::size_t j = 0;
  while (i < a.size() && j < b.size()) {
    if (is_digit(a[i]) && is_digit(b[j])) {
      const auto number = [](std::string_view text, std::size_t& at) {
        while (at < text.size() && text[at] == '0') ++at;
        const std::size_t begin = at;
        while (at < text.size() && is_digit(text[at])) ++at;
        return text.substr(begin, at - begin);
      };
      const std::string_view x = number(a, i);
      const std::string_view y = number(b, j);
      if (x.size() != y.size()) return x.size() < y.size();
      if (x != y) return x < y;
      continue;
    }
    if (lower(a[i]) != lower(b[j])) return lower(a[i]) < lower(b[j]);
    ++i;
    ++j;
  }
  if (a.size() - i != b.size() - j) return a.size() - i < b.size() - j;
  return a < b;
}

std::vector<std::string> images_in_folder(const std::string& folder) {
  std::vector<std::string> paths;
  std::error_code error;
  fs::directory_iterator entries(folder, error);
  if (error) throw InputError(folder, fmt::format("cannot be read: {}", error.message()));
  for (; entries != fs::directory_iterator(); entries.increment(error)) {
    if (error) throw InputError(folder, fmt::format("cannot be read: {}", error.message()));
    const std::string name = entries->path().filename().string();
    std::error_code ignored;
    if (name.starts_with(".") || !has_image_extension(name)) continue;
    if (!entries->is_regular_file(ignored)) continue;
    paths.push_back((folder.ends_with("/") ? folder : folder + "/") + name);
  }
  if (paths.empty())
    throw InputError(folder, "no images in this folder (.jpg .png .webp .bmp .ppm)");
  sort_naturally(paths);
  return paths;
}

std::vector<std::string> files_of_glob(const std::string& pattern) {
  glob_t found{};
  const int result = ::glob(pattern.c_str(), GLOB_NOSORT, nullptr, &found);
  std::vector<std::string> paths;
  for (std::size_t i = 0; result == 0 && i < found.gl_pathc; ++i) {
    std::error_code ignored;
    if (fs::is_regular_file(found.gl_pathv[i], ignored)) paths.emplace_back(found.gl_pathv[i]);
  }
  ::globfree(&found);
  if (paths.empty()) throw InputError(pattern, "no file matches");
  sort_naturally(paths);
  return paths;
}

std::vector<std::string> paths_of_list(const std::string& list) {
  const std::string text = read_file(list, kMaxListBytes);
  if (text.find('\0') != std::string::npos)
    throw InputError(list, "is not a list of paths (not a text)");
  const fs::path folder = fs::path(list).parent_path();
  std::vector<std::string> paths;
  std::string_view rest = text;
  while (!rest.empty()) {
    const std::size_t end = std::min(rest.find('\n'), rest.size());
    std::string_view line = rest.substr(0, end);
    rest.remove_prefix(std::min(end + 1, rest.size()));
    while (!line.empty() && (line.back() == '\r' || line.back() == ' ' || line.back() == '\t')) {
      line.remove_suffix(1);
    }
    while (!line.empty() && (line.front() == ' ' || line.front() == '\t')) line.remove_prefix(1);
    if (line.empty() || line.front() == '#') continue;
    const fs::path path(line);
    std::error_code ignored;
    const fs::path in_list_folder = folder / path;
    const bool is_in_list_folder =
        path.is_relative() && !fs::exists(path, ignored) && fs::exists(in_list_folder, ignored);
    paths.push_back(is_in_list_folder ? in_list_folder.string() : path.string());
  }
  if (paths.empty()) throw InputError(list, "lists no images");
  return paths;
}

std::unique_ptr<FrameSource> make_still_source(std::vector<std::string> paths,
                                               const SourceOptions& options) {
  TARSIER_REQUIRE(!paths.empty(), "no paths");
  return std::make_unique<StillSource>(std::move(paths), options);
}

std::unique_ptr<FrameSource> make_batch_source(const std::vector<BatchImage>& images,
                                               OnSkip on_skip) {
  TARSIER_REQUIRE(on_skip, "nobody to tell what is skipped");
  return std::make_unique<StillSource>(images, std::move(on_skip));
}

}  // namespace tarsier
