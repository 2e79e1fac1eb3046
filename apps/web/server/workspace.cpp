// SPDX-License-Identifier: MIT
#include "workspace.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/image_probe.h"
#include "tarsier/media/model_store.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "child_process.h"
#include "router.h"
#include "verb_policy.h"
#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <set>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/statvfs.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;

constexpr std::size_t kMaxListed = 20'000;  // files of a job
constexpr int kMaxDepth = 8;
constexpr std::size_t kHeadBytes = 512U << 10U;  // of an image, to know its size
constexpr std::size_t kMaxThumbnails = 20'000;
constexpr auto kMeasureEvery = std::chrono::seconds(10);

constexpr auto kVideoEndings =
    std::to_array<std::string_view>({".mp4", ".m4v", ".mov", ".avi", ".mkv", ".webm"});
// What verbs read beside images and videos.
constexpr auto kDataEndings =
    std::to_array<std::string_view>({".txt", ".csv", ".json", ".jsonl", ".yaml", ".yml", ".xml",
                                     ".pts", ".asf", ".obj", ".ply", ".tri"});

bool has_ending(std::string_view name, const auto& endings) {
  std::string lower(name);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return std::any_of(endings.begin(), endings.end(),
                     [&](std::string_view ending) { return lower.ends_with(ending); });
}

void check_name(std::string_view what, const std::string& name) {
  if (is_good_name(name)) return;
  throw HttpError(400, fmt::format("'{}' is no good name of a {}: letters, digits, spaces and "
                                   "- _ . ( ), at most 120 bytes, no / * ? [ ] and no . at its "
                                   "beginning",
                                   printable(name.substr(0, 100)), what));
}

bool is_link(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISLNK(status.st_mode);
}
bool is_folder(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISDIR(status.st_mode);
}
bool is_file(const std::string& path) {
  struct stat status {};
  return ::lstat(path.c_str(), &status) == 0 && S_ISREG(status.st_mode);
}

// Bytes of all files below; links are not followed.
std::uint64_t bytes_below(const std::string& folder) {
  std::uint64_t sum = 0;
  std::error_code error;
  fs::recursive_directory_iterator it(folder, fs::directory_options::skip_permission_denied, error);
  for (; !error && it != fs::recursive_directory_iterator(); it.increment(error)) {
    struct stat status {};
    if (::lstat(it->path().c_str(), &status) == 0) {
      sum += static_cast<std::uint64_t>(status.st_blocks) * 512;
    }
  }
  return sum;
}

std::string head_of(const std::string& path, std::size_t most) {
  std::string bytes;
  const int fd = ::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK);
  if (fd < 0) return bytes;
  bytes.resize(most);
  std::size_t done = 0;
  while (done < most) {
    const ssize_t count = ::read(fd, bytes.data() + done, most - done);
    if (count <= 0) break;
    done += static_cast<std::size_t>(count);
  }
  ::close(fd);
  bytes.resize(done);
  return bytes;
}

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  return {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()};
}

bool is_video_head(std::string_view bytes) {
  const bool is_mp4 = bytes.size() >= 12 && bytes.substr(4, 4) == "ftyp";
  const bool is_avi =
      bytes.size() >= 12 && bytes.starts_with("RIFF") && bytes.substr(8, 4) == "AVI ";
  const bool is_matroska = bytes.starts_with("\x1a\x45\xdf\xa3");
  return is_mp4 || is_avi || is_matroska;
}

// Verbs follow the names of files in lists and sets; none of them may lead out of their folder.
// Words longer than a path can be are numbers and encoded bytes.
bool names_foreign_files(std::string_view text) {
  constexpr std::size_t kLongestPath = 4096;
  const auto is_break = [](char c) {
    return std::isspace(static_cast<unsigned char>(c)) != 0 || c == '"' || c == '\'' || c == ',' ||
           c == ';' || c == '>' || c == '=' || c == '[' || c == '(' || c == '\0';
  };
  for (std::size_t n = 0; n < text.size(); ++n) {
    if (text[n] == '\\' && n + 1 < text.size() && text[n + 1] == '/') return true;  // JSON's "\/"
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002f") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002F") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002e") return true;
    if (text[n] == '\\' && text.substr(n + 1, 5) == "u002E") return true;
    if (text[n] == '&' && n + 1 < text.size() && text[n + 1] == '#') return true;  // XML's &#47;
    if (text[n] == '.' && text.substr(n, 3) == "../") return true;
    const bool begins = n == 0 || is_break(text[n - 1]);
    if (!begins || (text[n] != '/' && text[n] != '~')) continue;
    std::size_t end = n + 1;
    while (end < text.size() && end - n <= kLongestPath && !is_break(text[end])) ++end;
    if (end - n > 1 && end - n <= kLongestPath) return true;
  }
  return false;
}

std::string sum_of(std::string_view text) {
  Sha256 sum;
  sum.add(text);
  return sum.hex();
}

// By which all thumbnails of a file are known.
std::string thumbnail_mark(const std::string& path) { return sum_of(path).substr(0, 24); }

double seconds_of(const struct timespec& time) {
  return static_cast<double>(time.tv_sec) + static_cast<double>(time.tv_nsec) * 1e-9;
}

}  // namespace

std::string_view name_of(FileType type) {
  switch (type) {
    case FileType::kImage:
      return "image";
    case FileType::kVideo:
      return "video";
    case FileType::kOther:
      break;
  }
  return "other";
}

nlohmann::json to_json(const FileInfo& file) {
  nlohmann::json json = {{"name", file.name},
                         {"bytes", file.bytes},
                         {"kind", name_of(file.type)},
                         {"modified", file.modified}};
  if (file.type == FileType::kImage) {
    json["width"] = file.width;
    json["height"] = file.height;
  }
  return json;
}

std::string find_upload_trouble(std::string_view name, std::string_view bytes,
                                std::int64_t max_pixels, FileType& type) {
  type = FileType::kOther;
  if (bytes.empty()) return "the file is empty";
  if (const auto format = image_format_of(bytes_of(bytes))) {
    type = FileType::kImage;
    if (*format == ImageFormat::kTiff) return "TIFF is not read; save it as PNG or JPEG";
    const auto header = probe_image(bytes_of(bytes));
    if (!header) return "the image is cut short or broken";
    const std::int64_t pixels = static_cast<std::int64_t>(header->width) * header->height;
    if (pixels <= 0 || pixels > max_pixels) {
      return fmt::format("the image has {}x{} px; at most {} million are taken", header->width,
                         header->height, max_pixels / 1'000'000);
    }
    std::vector<std::uint8_t> kept;
    if (std::string damage = find_image_damage(bytes_of(bytes), *header, kept); !damage.empty()) {
      return "the image is damaged: " + damage;
    }
    return {};
  }
  if (has_ending(name, kVideoEndings)) {
    type = FileType::kVideo;
    return is_video_head(bytes) ? "" : "the file is named like a video and is none";
  }
  if (has_ending(name, kDataEndings)) {
    if (!names_foreign_files(bytes)) return {};
    return "the file names others by absolute paths or '..'; give their names alone, and upload "
           "them into the same set";
  }
  return fmt::format(
      "{}; taken are images (JPEG, PNG, WebP, BMP, PNM), videos (MP4, AVI, MKV) and "
      "data (.txt .csv .json .jsonl .yaml .xml .pts .asf .obj .ply)",
      describe_not_a_picture(bytes_of(bytes)));
}

std::string media_type(std::string_view name) {
  constexpr auto kTypes = std::to_array<std::pair<std::string_view, std::string_view>>({
      {".jpg", "image/jpeg"},
      {".jpeg", "image/jpeg"},
      {".png", "image/png"},
      {".webp", "image/webp"},
      {".bmp", "image/bmp"},
      {".gif", "image/gif"},
      {".mp4", "video/mp4"},
      {".webm", "video/webm"},
  });
  for (const auto& [ending, type] : kTypes) {
    if (has_ending(name, std::array{ending})) return std::string(type);
  }
  return "application/octet-stream";
}

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
    return static_cast<int>(error.status());
  }
}

Workspace::Workspace(std::string folder, WorkspaceLimits limits) : limits_(limits) {
  std::error_code error;
  const bool is_new = !fs::exists(folder, error);
  make_folder(folder);
  if (is_new) fs::permissions(folder, fs::perms::owner_all, error);
  folder_ = fs::canonical(folder, error).string();
  if (error) throw OutputError(folder, error.message());
  for (const char* part :
       {"/.studio", "/.studio/uploads", "/.studio/thumbnails", "/.studio/runs", "/sets", "/jobs"}) {
    const std::string path = folder_ + part;
    if (::mkdir(path.c_str(), 0700) != 0 && errno != EEXIST) {
      throw OutputError(path, std::strerror(errno));
    }
    if (!is_folder(path)) throw OutputError(path, "is no folder");
  }
  const std::string lock = studio_folder() + "/lock";
  lock_ = ::open(lock.c_str(), O_RDWR | O_CREAT | O_CLOEXEC | O_NOFOLLOW, 0600);
  if (lock_ < 0) throw OutputError(lock, std::strerror(errno));
  if (::flock(lock_, LOCK_EX | LOCK_NB) != 0) {
    ::close(lock_);
    throw OutputError(folder_,
                      "another server has this workspace; stop it, or give another "
                      "--workspace");
  }
  // What a server that was killed was receiving, or asking, nobody counts on.
  for (const char* part : {"/uploads", "/runs"}) {
    for (const auto& entry : fs::directory_iterator(studio_folder() + part, error)) {
      fs::remove_all(entry.path(), error);
    }
  }
}

Workspace::~Workspace() {
  if (lock_ >= 0) ::close(lock_);
}

std::string Workspace::set_folder(const std::string& name) const {
  check_name("set", name);
  const std::string path = folder_ + "/sets/" + name;
  if (!is_folder(path)) throw HttpError(404, fmt::format("no set '{}'", name));
  return path;
}

std::vector<SetInfo> Workspace::sets() const {
  std::vector<SetInfo> sets;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_ + "/sets", error)) {
    const std::string path = entry.path().string();
    SetInfo set{entry.path().filename().string(), 0, 0};
    if (!is_good_name(set.name) || !is_folder(path)) continue;
    std::error_code inner;
    for (const auto& file : fs::directory_iterator(path, inner)) {
      struct stat status {};
      if (::lstat(file.path().c_str(), &status) != 0 || !S_ISREG(status.st_mode)) continue;
      if (!is_good_name(file.path().filename().string())) continue;
      ++set.files;
      set.bytes += static_cast<std::uint64_t>(status.st_size);
    }
    sets.push_back(std::move(set));
  }
  std::sort(sets.begin(), sets.end(),
            [](const SetInfo& a, const SetInfo& b) { return a.name < b.name; });
  return sets;
}

void Workspace::make_set(const std::string& name) {
  check_name("set", name);
  const std::lock_guard lock(mutex_);
  if (sets().size() >= limits_.sets) {
    throw HttpError(409, fmt::format("there are {} sets already; delete some", limits_.sets));
  }
  const std::string path = folder_ + "/sets/" + name;
  if (::mkdir(path.c_str(), 0700) != 0) {
    if (errno == EEXIST) throw HttpError(409, fmt::format("there is a set '{}' already", name));
    throw HttpError(507, fmt::format("the set cannot be made: {}", std::strerror(errno)));
  }
  sync_folder(path);
}

void Workspace::remove_set(const std::string& name) {
  const std::string path = set_folder(name);
  forget_thumbnails(path);
  const std::lock_guard lock(mutex_);
  std::error_code error;
  fs::remove_all(path, error);  // removes links, never what they lead to
  measured_.reset();
  if (error) throw HttpError(500, fmt::format("the set cannot be deleted: {}", error.message()));
}

FileInfo Workspace::look_at(const std::string& path, const std::string& name) const {
  struct stat status {};
  if (::lstat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw HttpError(404, fmt::format("no file '{}'", name));
  }
  const std::string mark =
      fmt::format("{} {} {}", status.st_size, status.st_mtim.tv_sec, status.st_mtim.tv_nsec);
  {
    const std::lock_guard lock(mutex_);
    const auto known = looked_at_.find(path);
    if (known != looked_at_.end() && known->second.first == mark) {
      FileInfo info = known->second.second;
      info.name = name;
      return info;
    }
  }
  FileInfo info;
  info.name = name;
  info.bytes = static_cast<std::uint64_t>(status.st_size);
  info.modified = seconds_of(status.st_mtim);
  const std::string head = head_of(path, kHeadBytes);
  if (const auto header = probe_image(bytes_of(head))) {
    info.type = FileType::kImage;
    info.width = header->width;
    info.height = header->height;
  } else if (has_ending(name, kVideoEndings) && is_video_head(head)) {
    info.type = FileType::kVideo;
  }
  const std::lock_guard lock(mutex_);
  if (looked_at_.size() > 100'000) looked_at_.clear();
  looked_at_[path] = {mark, info};
  return info;
}

std::vector<FileInfo> Workspace::files(const std::string& set) const {
  const std::string folder = set_folder(set);
  std::vector<FileInfo> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (!is_good_name(name) || !is_file(entry.path().string())) continue;
    files.push_back(look_at(entry.path().string(), name));
  }
  std::sort(files.begin(), files.end(),
            [](const FileInfo& a, const FileInfo& b) { return a.name < b.name; });
  return files;
}

std::string Workspace::file_path(const std::string& set, const std::string& name) const {
  check_name("file", name);
  const std::string path = set_folder(set) + '/' + name;
  if (!is_file(path)) throw HttpError(404, fmt::format("no file '{}' in the set '{}'", name, set));
  return path;
}

FileInfo Workspace::file_info(const std::string& set, const std::string& name) const {
  return look_at(file_path(set, name), name);
}

FileInfo Workspace::store(const std::string& set, const std::string& name,
                          const std::string& spooled, bool replace) {
  check_name("file", name);
  const std::string folder = set_folder(set);
  struct stat status {};
  if (::lstat(spooled.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) {
    throw HttpError(400, "the upload is empty");
  }
  const auto bytes = static_cast<std::uint64_t>(status.st_size);
  if (bytes > limits_.file_bytes) {
    throw HttpError(413, fmt::format("'{}' has {} MB; at most {} are taken", name, bytes >> 20U,
                                     limits_.file_bytes >> 20U));
  }
  check_space(bytes);
  FileType type = FileType::kOther;
  const std::string trouble = find_upload_trouble(
      name, head_of(spooled, static_cast<std::size_t>(bytes)), limits_.pixels, type);
  if (!trouble.empty()) throw HttpError(415, fmt::format("'{}': {}", name, trouble));

  const int fd = ::open(spooled.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  const bool synced = fd >= 0 && ::fsync(fd) == 0 && ::fchmod(fd, 0600) == 0;
  if (fd >= 0) ::close(fd);
  if (!synced)
    throw HttpError(507, fmt::format("'{}' cannot be written: {}", name, std::strerror(errno)));

  if (replace) forget_thumbnails(folder + '/' + name);
  const std::lock_guard lock(mutex_);
  std::size_t there = 0;
  std::error_code error;
  for (auto it = fs::directory_iterator(folder, error); !error && it != fs::directory_iterator();
       it.increment(error)) {
    ++there;
  }
  if (there >= limits_.files_of_set) {
    throw HttpError(409, fmt::format("the set has {} files already; make another", there));
  }
  std::string final_name = name;
  if (replace) {
    const std::string path = folder + '/' + final_name;
    if (is_folder(path) || ::rename(spooled.c_str(), path.c_str()) != 0) {
      throw HttpError(507, fmt::format("'{}' cannot be stored", name));
    }
  } else {
    const std::size_t dot = std::min(name.rfind('.'), name.size());
    for (int n = 2;; ++n) {
      if (::link(spooled.c_str(), (folder + '/' + final_name).c_str()) == 0) break;
      if (errno != EEXIST || n > 9999) {
        throw HttpError(507, fmt::format("'{}' cannot be stored: {}", name, std::strerror(errno)));
      }
      final_name = fmt::format("{} ({}){}", name.substr(0, dot), n, name.substr(dot));
      if (!is_good_name(final_name))
        throw HttpError(409, fmt::format("there is a '{}' already", name));
    }
    ::unlink(spooled.c_str());
  }
  sync_folder(folder + '/' + final_name);
  used_ += bytes;
  FileInfo info;
  info.name = final_name;
  info.bytes = bytes;
  info.type = type;
  if (::lstat((folder + '/' + final_name).c_str(), &status) == 0)
    info.modified = seconds_of(status.st_mtim);
  if (type == FileType::kImage) {
    if (const auto header = probe_image(bytes_of(head_of(folder + '/' + final_name, kHeadBytes)))) {
      info.width = header->width;
      info.height = header->height;
    }
  }
  return info;
}

void Workspace::remove_file(const std::string& set, const std::string& name) {
  const std::string path = file_path(set, name);
  forget_thumbnails(path);
  if (::unlink(path.c_str()) != 0) {
    throw HttpError(500, fmt::format("'{}' cannot be deleted: {}", name, std::strerror(errno)));
  }
  const std::lock_guard lock(mutex_);
  looked_at_.erase(path);
  measured_.reset();
}

std::string Workspace::thumbnail(const std::string& path, int width, const std::string& program) {
  const FileInfo info = look_at(path, fs::path(path).filename().string());
  if (info.type != FileType::kImage) throw HttpError(415, "only an image has a thumbnail");
  const std::string version =
      sum_of(fmt::format("{}\n{}", info.bytes, info.modified)).substr(0, 16);
  const std::string out = fmt::format("{}/thumbnails/{}-{}-{}.jpg", studio_folder(),
                                      thumbnail_mark(path), version, width);
  const std::lock_guard lock(thumbnails_);  // one at a time: a decoder may take 300 MB
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

std::vector<FileInfo> Workspace::states() const {
  std::vector<FileInfo> files;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder_, error)) {
    const std::string name = entry.path().filename().string();
    if (!is_good_name(name) || name == "sets" || name == "jobs") continue;
    if (is_file(entry.path().string())) files.push_back(look_at(entry.path().string(), name));
  }
  std::sort(files.begin(), files.end(),
            [](const FileInfo& a, const FileInfo& b) { return a.name < b.name; });
  return files;
}

std::string Workspace::state_path(const std::string& name) const {
  check_name("file", name);
  const std::string path = folder_ + '/' + name;
  if (name == "sets" || name == "jobs" || !is_file(path)) {
    throw HttpError(404, fmt::format("no file '{}' in the workspace", name));
  }
  return path;
}

void Workspace::remove_state(const std::string& name) {
  const std::string path = state_path(name);
  // Beside an SQLite file lie its journals, beside a set of annotations its own.
  for (const char* ending : {"-journal", "-wal", "-shm", ".journal"}) {
    ::unlink((path + ending).c_str());
  }
  if (::unlink(path.c_str()) != 0) {
    throw HttpError(500, fmt::format("'{}' cannot be deleted: {}", name, std::strerror(errno)));
  }
  const std::lock_guard lock(mutex_);
  measured_.reset();
}

std::string Workspace::job_folder(const std::string& id) const {
  const bool is_good =
      !id.empty() && id.size() <= 40 && std::all_of(id.begin(), id.end(), [](char c) {
        return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '-';
      });
  if (!is_good) throw HttpError(404, "no such job");
  return jobs_folder() + '/' + id;
}

std::string Workspace::job_file(const std::string& id, const std::string& path,
                                bool or_folder) const {
  std::string at = job_folder(id) + "/files";
  int depth = 0;
  for (std::size_t from = 0; from <= path.size(); ++depth) {
    const std::size_t end = std::min(path.find('/', from), path.size());
    const std::string segment = path.substr(from, end - from);
    check_name("file", segment);
    at += '/' + segment;
    if (is_link(at) || depth > kMaxDepth) throw HttpError(404, fmt::format("no file '{}'", path));
    from = end + 1;
  }
  if (!is_file(at) && !(or_folder && is_folder(at)))
    throw HttpError(404, fmt::format("no file '{}'", path));
  return at;
}

std::vector<FileInfo> Workspace::job_files(const std::string& id) const {
  std::vector<FileInfo> files;
  const std::string folder = job_folder(id) + "/files";
  std::error_code error;
  fs::recursive_directory_iterator it(folder, error);
  for (; !error && it != fs::recursive_directory_iterator() && files.size() < kMaxListed;
       it.increment(error)) {
    const std::string path = it->path().string();
    if (!is_good_name(it->path().filename().string())) {
      if (is_folder(path)) it.disable_recursion_pending();
      continue;
    }
    if (is_folder(path)) {
      if (it.depth() + 1 >= kMaxDepth) it.disable_recursion_pending();
      continue;
    }
    if (!is_file(path)) continue;
    try {
      files.push_back(look_at(path, path.substr(folder.size() + 1)));
    } catch (const HttpError&) {  // gone meanwhile: a temporary file of its writer
    }
  }
  std::sort(files.begin(), files.end(),
            [](const FileInfo& a, const FileInfo& b) { return a.name < b.name; });
  return files;
}

std::string Workspace::resolve(const std::string& reference, bool must_exist) const {
  const std::size_t colon = std::min(reference.find(':'), reference.size());
  const std::string kind = reference.substr(0, colon);
  const std::string rest = colon < reference.size() ? reference.substr(colon + 1) : "";
  try {
    if (kind == "set") {
      const std::size_t slash = std::min(rest.find('/'), rest.size());
      const std::string set = rest.substr(0, slash);
      return slash == rest.size() ? set_folder(set) : file_path(set, rest.substr(slash + 1));
    }
    if (kind == "job") {
      const std::size_t slash = rest.find('/');
      if (slash == std::string::npos) throw HttpError(400, "expected job:ID/FILE");
      return job_file(rest.substr(0, slash), rest.substr(slash + 1), true);
    }
    if (kind == "ws") {
      check_name("file", rest);
      const std::string path = folder_ + '/' + rest;
      if (rest == "sets" || rest == "jobs" || is_link(path)) {
        throw HttpError(400, fmt::format("ws:{} is no file", rest));
      }
      // gallery and plates.db are made by the verbs that use them.
      if (must_exist && !is_file(path) && !is_folder(path)) {
        throw HttpError(404, fmt::format("no file '{}' in the workspace", rest));
      }
      return path;
    }
    if (kind == "model") {
      check_name("model", rest);
      const ModelStore models = ModelStore::find();
      const std::string name = rest.find('.') == std::string::npos ? rest + ".json" : rest;
      if (!models.has(name)) throw HttpError(404, fmt::format("no model '{}'", rest));
      return models.path(name);
    }
  } catch (const HttpError& error) {
    throw UsageError(fmt::format("{}: {}", printable(reference.substr(0, 200)), error.what()));
  }
  throw UsageError(
      fmt::format("'{}' is no reference: set:NAME, set:NAME/FILE, job:ID/FILE, ws:NAME",
                  printable(reference.substr(0, 200))));
}

std::string Workspace::with_references(std::string text) const {
  const auto replace_all = [&](const std::string& from, std::string_view to) {
    for (std::size_t at = text.find(from); at != std::string::npos; at = text.find(from, at)) {
      text.replace(at, from.size(), to);
      at += to.size();
    }
  };
  if (text.find(folder_) == std::string::npos) return text;
  replace_all(folder_ + "/sets/", "set:");
  const std::string jobs = folder_ + "/jobs/";
  for (std::size_t at = text.find(jobs); at != std::string::npos; at = text.find(jobs, at)) {
    const std::size_t id = at + jobs.size();
    const std::size_t files = text.find("/files/", id);
    if (files != std::string::npos && files - id <= 40) text.replace(files, 7, "/");
    text.replace(at, jobs.size(), "job:");
  }
  replace_all(folder_ + '/', "ws:");
  return text;
}

Workspace::Space Workspace::space() const {
  Space space;
  space.quota = limits_.quota_bytes;
  {
    const std::lock_guard lock(mutex_);
    if (!measured_ || Clock::now() - *measured_ > kMeasureEvery) {
      // Uploads on their way are counted when they are stored.
      const std::uint64_t all = bytes_below(folder_);
      used_ = all - std::min(all, bytes_below(uploads_folder()));
      measured_ = Clock::now();
    }
    space.used = used_;
  }
  struct statvfs disk {};
  if (::statvfs(folder_.c_str(), &disk) == 0) {
    space.free = static_cast<std::uint64_t>(disk.f_bavail) * disk.f_frsize;
    space.total = static_cast<std::uint64_t>(disk.f_blocks) * disk.f_frsize;
  }
  return space;
}

void Workspace::check_space(std::uint64_t bytes) const {
  const Space now = space();
  if (now.used + bytes > now.quota) {
    throw HttpError(507, fmt::format("the workspace is full: {} of {} MB; delete sets or jobs",
                                     now.used / 1'000'000, now.quota / 1'000'000));
  }
  if (now.free < limits_.disk_reserve_bytes + bytes) {
    throw HttpError(507, fmt::format("the disk is nearly full: {} MB are left, of which {} stay "
                                     "free; delete sets or jobs",
                                     now.free / 1'000'000, limits_.disk_reserve_bytes / 1'000'000));
  }
}

}  // namespace tarsier::web
