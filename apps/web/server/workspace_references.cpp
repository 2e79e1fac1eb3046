// SPDX-License-Identifier: MIT
// set:NAME/FILE, job:ID/PATH, ws:NAME, model:NAME, and their paths.
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/core/words.h"
#include "tarsier/media/model_store.h"

#include <fmt/format.h>

#include "router.h"
#include "verb_policy.h"
#include "workspace.h"
#include "workspace_paths.h"
#include <algorithm>
#include <filesystem>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kMaxListed = 20'000;  // files of a job
constexpr int kMaxDepth = 8;

}  // namespace

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
      files.push_back(inspect(path, path.substr(folder.size() + 1)));
    } catch (const HttpError&) {  // a temporary file that was deleted meanwhile
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
      if (is_folder_name(rest) || is_link(path)) {
        throw HttpError(400, fmt::format("ws:{} is not a file", rest));
      }
      // Verbs create gallery and plates.db when they use them.
      if (must_exist && !is_file(path) && !is_folder(path)) {
        throw HttpError(404, fmt::format("no file '{}' in the workspace", rest));
      }
      return path;
    }
    if (kind == "model") {
      check_name("model", rest);
      const ModelStore models = ModelStore::find().shipped();
      const std::string name = rest.find('.') == std::string::npos ? rest + ".json" : rest;
      if (!models.has(name)) throw HttpError(404, fmt::format("no model '{}'", rest));
      return models.path(name);
    }
  } catch (const HttpError& error) {
    throw UsageError(fmt::format("{}: {}", printable(reference.substr(0, 200)), error.what()));
  }
  throw UsageError(
      fmt::format("'{}' is not a reference; expected set:NAME, set:NAME/FILE, job:ID/FILE, ws:NAME",
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

}  // namespace tarsier::web
