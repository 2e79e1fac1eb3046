// SPDX-License-Identifier: MIT
#include "files.h"

#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"

#include <fmt/format.h>

#include "audit_log.h"
#include "multipart.h"
#include "router.h"
#include "workspace.h"
#include <array>
#include <charconv>
#include <cstring>
#include <fcntl.h>
#include <nlohmann/json.hpp>
#include <unistd.h>

namespace tarsier::web {
namespace {

using Json = nlohmann::json;

constexpr std::uint64_t kMaxUploadForm = 512ULL << 20U;  // bytes of a form with several files

// For Content-Disposition (RFC 6266, RFC 8187).
std::string percent_encoded(const std::string& text) {
  std::string encoded;
  for (const char c : text) {
    const bool is_plain = (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') ||
                          (c >= '0' && c <= '9') || c == '-' || c == '_' || c == '.';
    encoded += is_plain ? std::string(1, c) : fmt::format("%{:02X}", static_cast<unsigned char>(c));
  }
  return encoded;
}

// The last segment of a browser's file name: some browsers send whole paths.
std::string last_segment(const std::string& path) {
  const std::size_t slash = path.find_last_of("/\\");
  return slash == std::string::npos ? path : path.substr(slash + 1);
}

// A file that is removed unless it was moved away.
class Upload {
 public:
  explicit Upload(const Workspace& workspace) : path_(workspace.uploads_folder() + "/part-XXXXXX") {
    fd_ = ::mkostemp(path_.data(), O_CLOEXEC);
    if (fd_ < 0)
      throw HttpError(507, fmt::format("the upload cannot be stored: {}", std::strerror(errno)));
  }
  ~Upload() {
    close();
    ::unlink(path_.c_str());
  }
  Upload(const Upload&) = delete;
  Upload& operator=(const Upload&) = delete;
  void add(std::string_view bytes) {
    size_ += bytes.size();
    write_all(fd_, bytes, path_);
  }
  void close() {
    if (fd_ >= 0) ::close(fd_);
    fd_ = -1;
  }
  [[nodiscard]] const std::string& path() const { return path_; }
  [[nodiscard]] std::uint64_t size() const { return size_; }

 private:
  std::string path_;
  int fd_ = -1;
  std::uint64_t size_ = 0;
};

Json store_form(Workspace& workspace, const std::string& set, const Request& request) {
  const auto boundary = multipart_boundary(std::string(request.header("content-type")));
  if (!boundary) throw HttpError(415, "expected multipart/form-data with a boundary");
  (void)workspace.files(set);  // 404 before anything is read
  Json files = Json::array();
  std::unique_ptr<Upload> upload;
  std::string name;
  // No exception may pass through the parser: it is stored and thrown afterwards.
  std::exception_ptr pending_error;
  const auto guarded = [&](const auto& work) {
    if (pending_error) return;
    try {
      work();
    } catch (...) {
      pending_error = std::current_exception();
    }
  };
  MultipartParser parser(
      *boundary, {[&](const MultipartPart& part) {
                    name = last_segment(part.file_name);
                    if (!part.file_name.empty())
                      guarded([&] { upload = std::make_unique<Upload>(workspace); });
                  },
                  [&](std::string_view bytes) {
                    if (!upload) return;
                    guarded([&] {
                      if (upload->size() + bytes.size() > workspace.limits().file_bytes) {
                        throw HttpError(413, fmt::format("'{}' is larger than {} MB", name,
                                                         workspace.limits().file_bytes >> 20U));
                      }
                      upload->add(bytes);
                    });
                  },
                  [&] {
                    if (!upload) return;
                    guarded([&] {
                      upload->close();
                      files.push_back(to_json(workspace.store(set, name, upload->path(), false)));
                    });
                    upload.reset();
                  }});
  const int fd = request.body_file.empty()
                     ? -1
                     : ::open(request.body_file.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW);
  bool is_good = true;
  if (fd < 0) {
    is_good = parser.feed(request.body);
  } else {
    std::array<char, 65536> buffer{};
    ssize_t count = 0;
    while (is_good && !pending_error && (count = ::read(fd, buffer.data(), buffer.size())) > 0) {
      is_good = parser.feed({buffer.data(), static_cast<std::size_t>(count)});
    }
    ::close(fd);
  }
  if (pending_error) std::rethrow_exception(pending_error);
  if (!is_good) throw HttpError(400, "the form is malformed: " + parser.error());
  if (!parser.is_complete()) throw HttpError(400, "the form is incomplete");
  if (files.empty()) throw HttpError(400, "the form has no file; its field needs a file name");
  return files;
}

void bind_sets(Router& router, Workspace& workspace, AuditLog& audit) {
  router.add("GET", "/api/sets", [&](const Request&) {
    Json sets = Json::array();
    for (const SetInfo& set : workspace.sets()) {
      sets.push_back({{"name", set.name}, {"files", set.files}, {"bytes", set.bytes}});
    }
    return json_response({{"sets", std::move(sets)}});
  });
  router.add("POST", "/api/sets", [&](const Request& request) {
    const std::string name = text_member(request.json(), "name");
    workspace.make_set(name);
    return json_response({{"name", name}, {"files", 0}, {"bytes", 0}}, 201);
  });
  router.add("DELETE", "/api/sets/{name}", [&](const Request& request) {
    workspace.remove_set(request.param("name"));
    audit.write("delete", request.address, {{"what", "set"}});
    return no_content();
  });
  router.add("GET", "/api/sets/{name}", [&](const Request& request) {
    Json files = Json::array();
    for (const FileInfo& file : workspace.files(request.param("name")))
      files.push_back(to_json(file));
    return json_response({{"name", request.param("name")}, {"files", std::move(files)}});
  });
}

void bind_set_files(Router& router, Workspace& workspace, AuditLog& audit,
                    const std::string& own_program) {
  router.add("PUT", "/api/sets/{name}/files/{file}",
             [&](const Request& request) {
               std::string path = request.body_file;
               std::unique_ptr<Upload> upload;
               if (path.empty()) {  // small bodies stay in memory
                 upload = std::make_unique<Upload>(workspace);
                 upload->add(request.body);
                 upload->close();
                 path = upload->path();
               }
               const FileInfo file =
                   workspace.store(request.param("name"), request.param("file"), path, true);
               return json_response(to_json(file), 201);
             },
             Access::kSignedIn, {workspace.limits().file_bytes, true, {}});
  router.add("POST", "/api/sets/{name}/files",
             [&](const Request& request) {
               Json files = store_form(workspace, request.param("name"), request);
               return json_response({{"files", std::move(files)}}, 201);
             },
             Access::kSignedIn, {kMaxUploadForm, true, {"multipart/form-data"}});
  router.add("GET", "/api/sets/{name}/files/{file}",
             [&workspace, own_program](const Request& request) {
               const std::string& name = request.param("file");
               return image_response(workspace, workspace.file_path(request.param("name"), name),
                                     name, request.query_value("width").value_or(""), own_program);
             });
  router.add("DELETE", "/api/sets/{name}/files/{file}", [&](const Request& request) {
    workspace.remove_file(request.param("name"), request.param("file"));
    audit.write("delete", request.address, {{"what", "file of a set"}});
    return no_content();
  });
}

void bind_state(Router& router, Workspace& workspace, AuditLog& audit) {
  router.add("GET", "/api/state", [&](const Request&) {
    Json files = Json::array();
    for (const FileInfo& file : workspace.states()) files.push_back(to_json(file));
    return json_response({{"files", std::move(files)}});
  });
  router.add("GET", "/api/state/{name}", [&](const Request& request) {
    const std::string& name = request.param("name");
    const std::string path = workspace.state_path(name);
    // Face templates and the plate log.
    if (name == "gallery" || name == "plates.db")
      audit.write("export", request.address, {{"what", name}});
    return file_response(path, name);
  });
  router.add("DELETE", "/api/state/{name}", [&](const Request& request) {
    workspace.remove_state(request.param("name"));
    audit.write("delete", request.address, {{"what", request.param("name")}});
    return no_content();
  });
}

}  // namespace

Response file_response(const std::string& path, const std::string& name) {
  Response response;
  response.type = media_type(name);
  response.file = path;
  const std::string_view how =
      response.type == "application/octet-stream" ? "attachment" : "inline";
  response.headers.emplace_back(
      "Content-Disposition",
      fmt::format("{}; filename*=UTF-8''{}", how, percent_encoded(last_segment(name))));
  return response;
}

Response image_response(Workspace& workspace, const std::string& path, const std::string& name,
                        const std::string& width, const std::string& own_program) {
  if (width.empty()) return file_response(path, name);
  int pixels = 0;
  const auto [end, error] = std::from_chars(width.data(), width.data() + width.size(), pixels);
  if (error != std::errc() || end != width.data() + width.size() || pixels < 16 || pixels > 2048) {
    throw HttpError(400, "width: expected 16..2048");
  }
  Response response;
  response.type = "image/jpeg";
  response.file = workspace.thumbnail(path, pixels, own_program);
  return response;
}

void bind_files(Router& router, Workspace& workspace, AuditLog& audit,
                const std::string& own_program) {
  bind_sets(router, workspace, audit);
  bind_set_files(router, workspace, audit, own_program);
  bind_state(router, workspace, audit);
}

}  // namespace tarsier::web
