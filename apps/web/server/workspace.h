// SPDX-License-Identifier: MIT
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace tarsier::web {

struct WorkspaceLimits {
  std::uint64_t file_bytes = 64'000'000;             // of an upload
  std::int64_t pixels = 100'000'000;                 // of an image
  std::uint64_t quota_bytes = 20'000'000'000;        // of the whole workspace
  std::uint64_t disk_reserve_bytes = 1'000'000'000;  // free space that must remain on the disk
  std::size_t sets = 1000;
  std::size_t files_of_set = 20'000;
};

enum class FileType { kImage, kVideo, kOther };
[[nodiscard]] std::string_view name_of(FileType type);  // "image", "video", "other"

struct FileInfo {
  std::string name;  // or the path below the listed folder
  std::uint64_t bytes = 0;
  int width = 0;  // px; 0: not an image
  int height = 0;
  FileType type = FileType::kOther;
  double modified = 0;  // s since 1970
};
[[nodiscard]] nlohmann::json to_json(const FileInfo& file);

struct SetInfo {
  std::string name;
  std::size_t files = 0;
  std::uint64_t bytes = 0;
};

// The only folder that the studio writes to:
//
//   .studio/         of the server: token, audit log, lock, unfinished uploads, thumbnails
//   sets/NAME/FILE   uploads
//   models/          the user's own models
//   jobs/ID/         job.json, log.txt, lines.jsonl, files/
//   NAME             state shared by verbs: gallery, plates.db, camera.yml
//
// All objects are addressed by id, never by path. A name is one segment (is_good_name); symbolic
// links are refused. Errors are HttpError in plain words: 400 for an invalid name, 404, 409, 413,
// 415, 507. Thread-safe.
class Workspace {
 public:
  // Creates the folders (0700) and takes the lock. Throws OutputError if the folder is not writable
  // or another server uses it.
  explicit Workspace(std::string folder, WorkspaceLimits limits = {});
  ~Workspace();
  Workspace(const Workspace&) = delete;
  Workspace& operator=(const Workspace&) = delete;

  [[nodiscard]] const std::string& folder() const { return folder_; }
  [[nodiscard]] std::string studio_folder() const { return folder_ + "/.studio"; }
  [[nodiscard]] std::string uploads_folder() const { return studio_folder() + "/uploads"; }
  [[nodiscard]] const WorkspaceLimits& limits() const { return limits_; }

  // ---- Sets
  [[nodiscard]] std::vector<SetInfo> sets() const;
  void make_set(const std::string& name);
  void remove_set(const std::string& name);
  [[nodiscard]] std::vector<FileInfo> files(const std::string& set) const;
  // Checks the file `spooled` (type by its bytes, size, damage) and moves it to its place; it must
  // be on the same disk. It is on the disk when this returns. With `replace` an existing file is
  // replaced, else the new one is named "name (2).jpg".
  FileInfo store(const std::string& set, const std::string& name, const std::string& spooled,
                 bool replace);
  void remove_file(const std::string& set, const std::string& name);
  [[nodiscard]] FileInfo file_info(const std::string& set, const std::string& name) const;
  [[nodiscard]] std::string file_path(const std::string& set, const std::string& name) const;
  // A cached JPEG of the image, at most `width` px wide. `program --thumbnail FILE OUT WIDTH` makes
  // it in its own process, so that a crash of the decoder does no harm.
  [[nodiscard]] std::string thumbnail(const std::string& path, int width,
                                      const std::string& program);

  // Removes the thumbnails of a deleted file, or of all files below a deleted folder.
  void forget_thumbnails(const std::string& path);

  // ---- State
  [[nodiscard]] std::vector<FileInfo> states() const;
  [[nodiscard]] std::string state_path(const std::string& name) const;  // 404 if it is missing
  void remove_state(const std::string& name);

  // The user's own models, which all verbs use instead of shipped ones. `tarsier models install`
  // writes there.
  [[nodiscard]] std::string models_folder() const { return folder_ + "/models"; }

  // ---- Jobs
  [[nodiscard]] std::string jobs_folder() const { return folder_ + "/jobs"; }
  [[nodiscard]] std::string job_folder(const std::string& id) const;  // 400, never 404
  [[nodiscard]] std::string job_file(const std::string& id, const std::string& path,
                                     bool or_folder = false) const;
  [[nodiscard]] std::vector<FileInfo> job_files(const std::string& id) const;

  // ---- References: "set:NAME", "set:NAME/FILE", "job:ID/PATH", "ws:NAME", "model:NAME".
  // Throws UsageError.
  [[nodiscard]] std::string resolve(const std::string& reference, bool must_exist) const;
  // Replaces paths of the workspace in `text` by references, for pages.
  [[nodiscard]] std::string with_references(std::string text) const;

  // ---- Space
  struct Space {
    std::uint64_t used = 0;  // by the workspace
    std::uint64_t quota = 0;
    std::uint64_t free = 0;  // of the disk
    std::uint64_t total = 0;
  };
  [[nodiscard]] Space space() const;
  // Throws HttpError 507 if `bytes` more would exceed the quota or the disk's reserve.
  void check_space(std::uint64_t bytes) const;

 private:
  [[nodiscard]] std::string set_folder(const std::string& name) const;
  [[nodiscard]] FileInfo inspect(const std::string& path, const std::string& name) const;

  std::string folder_;
  const WorkspaceLimits limits_;
  int lock_ = -1;
  mutable std::mutex mutex_;  // protects the following members, and changes to sets
  mutable std::map<std::string, std::pair<std::string, FileInfo>> inspected_;  // by path
  mutable std::uint64_t used_ = 0;
  mutable std::optional<std::chrono::steady_clock::time_point> measured_;
  std::mutex thumbnails_;
  std::size_t thumbnail_count_ = 0;
};

// Why an uploaded file is refused, or "": unknown type, too many pixels, damaged, or a text that
// names files by absolute paths or "..", which a verb would open.
[[nodiscard]] std::string upload_error(std::string_view name, std::string_view bytes,
                                       std::int64_t max_pixels, FileType& type);

// "image/jpeg" etc. for files that browsers may show; "application/octet-stream" for all others.
[[nodiscard]] std::string media_type(std::string_view name);

// Runs `program --thumbnail FILE OUT WIDTH`; returns the exit status.
[[nodiscard]] int make_thumbnail(const std::string& file, const std::string& out, int width);

}  // namespace tarsier::web
