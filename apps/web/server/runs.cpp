// SPDX-License-Identifier: MIT
#include "runs.h"

#include "tarsier/core/base64.h"
#include "tarsier/core/errors.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/exit_status.h"
#include "multipart.h"
#include "router.h"
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <fcntl.h>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sys/stat.h>
#include <unistd.h>

namespace tarsier::web {
namespace {

namespace fs = std::filesystem;
using Clock = std::chrono::steady_clock;
using Json = nlohmann::json;

constexpr std::uint64_t kMaxForm = 96ULL << 20U;
constexpr std::size_t kMaxImages = 100;

struct ImageVerb {
  std::string_view verb;
  bool draws;  // -o writes an image
};
constexpr auto kImageVerbs = std::to_array<ImageVerb>({
    {"aam fit", true},
    {"ar markers", true},
    {"ar target-track", true},
    {"calibrate", false},
    {"cartoon run", true},
    {"landmarks fit", true},
    {"people enroll", false},
    {"people identify", true},
    {"people verify", false},
    {"plate read", true},
    {"pose track", true},
});

const ImageVerb* find_image_verb(std::string_view verb) {
  const auto found = std::find_if(kImageVerbs.begin(), kImageVerbs.end(),
                                  [&](const ImageVerb& row) { return row.verb == verb; });
  return found == kImageVerbs.end() ? nullptr : &*found;
}

Response status_with(Json body, int status) {
  Response response = json_response(body, status);
  if (status == 429) response.headers.emplace_back("Retry-After", "5");
  return response;
}

Json lines_json(const std::vector<std::string>& lines) {
  Json list = Json::array();
  for (const std::string& line : lines) {
    Json value = Json::parse(line, nullptr, false);
    if (!value.is_discarded()) list.push_back(std::move(value));
  }
  return list;
}

// Converts a flag of the URL, "--mode=sketch" or "mode=sketch", to JSON of its type.
Json flag_value(const Json& flag, const std::string& text) {
  if (flag.at("type") != "switch") return text;
  if (text.empty() || text == "true" || text == "1" || text == "on") return true;
  if (text == "false" || text == "0" || text == "off") return false;
  return text;  // the type check refuses it
}

std::string image_extension(const std::string& head) {
  const auto format =
      probe_image({reinterpret_cast<const std::uint8_t*>(head.data()), head.size()});
  if (!format) return {};
  switch (format->format) {
    case ImageFormat::kJpeg:
      return ".jpg";
    case ImageFormat::kPng:
      return ".png";
    case ImageFormat::kWebp:
      return ".webp";
    case ImageFormat::kBmp:
      return ".bmp";
    case ImageFormat::kPnm:
      return ".pnm";
    case ImageFormat::kTiff:
      break;
  }
  return {};
}

// The images of a request, checked like uploads, as files in the folder.
class ImagesOfRequest {
 public:
  ImagesOfRequest(const Request& request, const Workspace& workspace, const std::string& folder)
      : workspace_(workspace), folder_(folder) {
    if (request.content_type == "multipart/form-data") {
      read_form(request);
    } else {
      std::string bytes = request.body;
      if (!request.body_file.empty())
        bytes =
            read_file(request.body_file, static_cast<std::int64_t>(workspace.limits().file_bytes));
      add(bytes, "image");
    }
    if (images_.empty()) throw HttpError(400, "the body has no image");
  }
  [[nodiscard]] const std::vector<Runs::Image>& images() const { return images_; }

 private:
  void add(const std::string& bytes, std::string name) {
    if (bytes.empty()) throw HttpError(400, "the body is empty; send an image");
    const std::string extension = image_extension(bytes);
    FileType type = FileType::kOther;
    const std::string error =
        upload_error("image" + extension, bytes, workspace_.limits().pixels, type);
    if (type != FileType::kImage || !error.empty()) {
      throw HttpError(415, error.empty() ? "the body is not an image" : error);
    }
    if (images_.size() >= kMaxImages)
      throw HttpError(413, fmt::format("more than {} images; upload a set instead", kMaxImages));
    const std::string path = fmt::format("{}/input-{:03}{}", folder_, images_.size(), extension);
    write_file_atomically(path, bytes);
    if (!is_one_line(name, 200) || name.empty()) name = "image";
    images_.push_back({path, std::move(name)});
  }

  void read_form(const Request& request) {
    const auto boundary = multipart_boundary(std::string(request.header("content-type")));
    if (!boundary) throw HttpError(415, "expected multipart/form-data with a boundary");
    std::string bytes, name;
    bool is_file = false, is_large = false;
    std::vector<std::pair<std::string, std::string>> files;
    MultipartParser parser(*boundary, {[&](const MultipartPart& part) {
                                         is_file = !part.file_name.empty();
                                         name = part.file_name;
                                         bytes.clear();
                                       },
                                       [&](std::string_view more) {
                                         if (!is_file || is_large) return;
                                         is_large = bytes.size() + more.size() >
                                                    workspace_.limits().file_bytes;
                                         if (!is_large) bytes += more;
                                       },
                                       [&] {
                                         if (is_file && files.size() <= kMaxImages) {
                                           files.emplace_back(std::exchange(bytes, {}), name);
                                         }
                                       }});
    std::string body = request.body;
    if (!request.body_file.empty())
      body = read_file(request.body_file, static_cast<std::int64_t>(kMaxForm));
    if (!parser.feed(body)) throw HttpError(400, "the form is malformed: " + parser.error());
    if (!parser.is_complete()) throw HttpError(400, "the form is incomplete");
    if (is_large) throw HttpError(413, "an image is larger than 64 MB");
    for (const auto& [content, file_name] : files) {
      const std::size_t slash = file_name.find_last_of("/\\");
      add(content, slash == std::string::npos ? file_name : file_name.substr(slash + 1));
    }
  }

  const Workspace& workspace_;
  const std::string folder_;
  std::vector<Runs::Image> images_;
};

Response run_response(const Runs::Result& result) {
  Json files = Json::array();
  for (const auto& [name, bytes] : result.files) {
    files.push_back({{"name", name}, {"bytes", bytes.size()}, {"base64", to_base64(bytes)}});
  }
  return status_with({{"exit", result.exit},
                      {"lines", lines_json(result.lines)},
                      {"error", result.error.empty() ? Json(nullptr) : Json(result.error)},
                      {"ms", result.ms},
                      {"command", result.command},
                      {"files", std::move(files)}},
                     http_status_of(result.exit));
}

Response verb_response(const Request& request, Runs& runs, Workspace& workspace) {
  const std::string area = request.param("area");
  const std::string verb =
      request.params.contains("verb") ? area + ' ' + request.param("verb") : area;
  const ImageVerb* row = find_image_verb(verb);
  if (row == nullptr) {
    throw HttpError(
        404, fmt::format("'{}' accepts no images here; /api/openapi.json lists the verbs that do, "
                         "POST /api/run and /api/jobs start all verbs",
                         verb));
  }
  const std::string_view accept = request.header("accept");
  std::string drawing;
  if (accept.find("image/png") != std::string_view::npos) drawing = "drawing.png";
  if (accept.find("image/jpeg") != std::string_view::npos) drawing = "drawing.jpg";
  if (!drawing.empty() && !row->draws)
    throw HttpError(406, fmt::format("'{}' makes no drawing", verb));
  const Runs::Folder folder(workspace);
  const ImagesOfRequest images(request, workspace, folder.path());
  if (!drawing.empty() && images.images().size() != 1) {
    throw HttpError(400, "a drawing needs exactly one image");
  }
  const Runs::Result result =
      runs.run_on(verb, images.images(), request.query, drawing, request.address);
  const int status = http_status_of(result.exit);
  if (status != 200) return status_with({{"error", result.error}, {"exit", result.exit}}, status);
  if (!drawing.empty()) {
    if (result.files.empty()) throw HttpError(422, "nothing was drawn");
    Response response;
    response.type = media_type(drawing);
    response.body = result.files.front().second;
    return response;
  }
  Json lines = lines_json(result.lines);
  return lines.size() == 1 ? json_response(lines.front())
                           : json_response({{"lines", std::move(lines)}});
}

}  // namespace

int http_status_of(int exit) {
  switch (static_cast<ExitStatus>(exit)) {
    case ExitStatus::kDone:
    case ExitStatus::kNothingFound:
      return 200;
    case ExitStatus::kUsage:
      return 400;
    case ExitStatus::kBadInput:
    case ExitStatus::kSourceLost:
      return 422;
    case ExitStatus::kBadOutput:
      return 507;
    case ExitStatus::kBadModel:
    case ExitStatus::kInterrupted:
      break;
  }
  return 500;
}

std::vector<std::string> image_verbs() {
  std::vector<std::string> verbs;
  for (const ImageVerb& row : kImageVerbs) verbs.emplace_back(row.verb);
  return verbs;
}

Runs::Folder::Folder(const Workspace& workspace)
    : path_(workspace.studio_folder() + "/runs/XXXXXX") {
  workspace.check_space(0);
  if (::mkdtemp(path_.data()) == nullptr || ::mkdir((path_ + "/files").c_str(), 0700) != 0) {
    throw HttpError(507, fmt::format("the run's folder cannot be made: {}", std::strerror(errno)));
  }
}

Runs::Folder::~Folder() {
  std::error_code error;
  fs::remove_all(path_, error);
}

Runs::Result Runs::run(const Json& object, const std::string& address) {
  const VerbRequest request = verb_request(object);
  const Folder folder(host_.workspace);
  const CommandLine command = host_.command(request, Use::kRun, folder.path() + "/files");
  host_.write_audit(command, request, address);
  Result result = execute(command, folder);
  if (request.verb == "people forget" && !request.inputs.empty() && result.exit == 0 &&
      host_.forgotten) {
    host_.forgotten(request.inputs.front());
  }
  const std::string made = folder.path() + "/files";
  std::uint64_t sum = 0;
  const auto take = [&](const std::string& path) {
    struct stat status {};
    if (::lstat(path.c_str(), &status) != 0 || !S_ISREG(status.st_mode)) return;
    sum += static_cast<std::uint64_t>(status.st_size);
    if (sum > options_.file_bytes) {
      throw HttpError(413, "the results are too large for a response; start a job");
    }
    result.files.emplace_back(path.substr(made.size() + 1),
                              read_file(path, static_cast<std::int64_t>(options_.file_bytes)));
  };
  for (const std::string& name : command.outputs) {
    const std::string path = made + '/' + name;
    if (!fs::is_directory(path)) {
      take(path);
      continue;
    }
    std::vector<std::string> paths;
    for (const auto& entry : fs::recursive_directory_iterator(path))
      paths.push_back(entry.path().string());
    std::sort(paths.begin(), paths.end());
    for (const std::string& inner : paths) take(inner);
  }
  return result;
}

Runs::Result Runs::run_on(const std::string& verb, const std::vector<Image>& images,
                          const std::vector<std::pair<std::string, std::string>>& query,
                          const std::string& drawing, const std::string& address) {
  const Json* entry = host_.verbs.find(verb);
  if (entry == nullptr) throw HttpError(404, fmt::format("no verb '{}'", verb));
  VerbRequest request;
  request.verb = verb;
  const Json& inputs = entry->at("inputs");
  for (const auto& [key, value] : query) {
    const auto is_named = [&](const Json& input) { return input.at("names").front() == key; };
    if (std::any_of(inputs.begin(), inputs.end(), is_named)) continue;  // below
    const std::string name = key.starts_with('-') ? key : "--" + key;
    const Json* flag = VerbTable::find_flag(*entry, name);
    if (flag == nullptr) throw HttpError(400, fmt::format("'{}' has no flag {}", verb, name));
    const Json given = flag_value(*flag, value);
    if (request.flags.contains(name) && flag->at("repeatable").get<bool>()) {
      if (!request.flags[name].is_array()) request.flags[name] = Json::array({request.flags[name]});
      request.flags[name].push_back(given);
    } else {
      request.flags[name] = given;
    }
  }
  for (const Json& input : inputs) {  // NAME of `people verify`, then the images
    const std::string name = input.at("names").front();
    if (input_kind(verb, name) == InputKind::kSource || input_kind(verb, name) == InputKind::kFile)
      continue;
    const auto given = std::find_if(query.begin(), query.end(),
                                    [&](const auto& field) { return field.first == name; });
    if (given == query.end()) throw HttpError(400, fmt::format("'{}' needs ?{}=", verb, name));
    request.inputs.push_back(given->second);
  }
  for (const Image& image : images) request.inputs.push_back("set:" + image.path);
  const Folder folder(host_.workspace);
  if (!drawing.empty()) request.flags["--output"] = "out:" + drawing;
  CommandLine command = command_line(host_.verbs, request, Use::kRun,
                                     {[&](const std::string& reference, bool must_exist) {
                                        // The images are in a private folder, which no reference of
                                        // a page can name.
                                        for (const Image& image : images) {
                                          if (reference == "set:" + image.path) return image.path;
                                        }
                                        return host_.workspace.resolve(reference, must_exist);
                                      },
                                      host_.source, folder.path() + "/files"});
  for (const Image& image : images) command.secrets.emplace_back(image.path, image.name);
  host_.write_audit(command, request, address);
  Result result = execute(command, folder);
  if (const std::string path = folder.path() + "/files/" + drawing;
      !drawing.empty() && fs::is_regular_file(path)) {
    result.files.emplace_back(drawing, read_file(path, 256 << 20));
  }
  return result;
}

void Runs::stop() {
  {
    const std::lock_guard lock(mutex_);
    is_stopping_ = true;
  }
  freed_.notify_all();
}

Runs::Result Runs::execute(const CommandLine& command, const Folder& folder) {
  {
    std::unique_lock lock(mutex_);
    if (!freed_.wait_for(lock, options_.wait,
                         [&] { return is_stopping_ || running_ < options_.parallel; })) {
      throw HttpError(429, "too many runs at the same time; try again in some seconds");
    }
    if (is_stopping_) throw HttpError(503, "the server is stopping");
    ++running_;
  }
  const auto release_slot = [this](void*) {
    const std::lock_guard lock(mutex_);
    --running_;
    freed_.notify_one();
  };
  const std::unique_ptr<void, decltype(release_slot)> place(this, release_slot);

  Result result;
  result.command = command.shell_text;
  std::mutex mutex;
  std::size_t bytes = 0;
  bool is_large = false;
  const auto begin = Clock::now();
  ChildOptions options = host_.child(command, folder.path() + "/files");
  options.max_memory_bytes = options_.memory_bytes;
  options.max_line = options_.output_bytes;
  options.on_output = [&](std::string_view line) {
    const std::lock_guard lock(mutex);
    bytes += line.size();
    is_large = is_large || bytes > options_.output_bytes;
    if (!is_large) result.lines.push_back(host_.public_line(line, command));
  };
  options.on_message = [&](std::string_view line) {
    const std::lock_guard lock(mutex);
    if (line.starts_with(kErrorMark)) {
      result.error = host_.public_line(line.substr(kErrorMark.size()), command);
    }
  };
  ChildProcess child(std::move(options), [](const ChildEnd&) {});
  std::optional<ChildEnd> end;
  while (!end && Clock::now() - begin < options_.limit) {
    end = child.wait(std::chrono::milliseconds(50));
    {
      const std::lock_guard lock(mutex_);
      if (is_stopping_) throw HttpError(503, "the server is stopping");  // kills the child
    }
    const std::lock_guard lock(mutex);
    if (is_large) break;
  }
  if (!end) {
    child.interrupt(std::chrono::milliseconds(2000));
    (void)child.wait(std::chrono::milliseconds(3000));
  }
  {
    const std::lock_guard lock(mutex);
    if (is_large) throw HttpError(413, "the answer is too large; start it as a job");
  }
  if (!end) {
    throw HttpError(
        504, fmt::format("it took longer than {} s; start it as a job",
                         std::chrono::duration_cast<std::chrono::seconds>(options_.limit).count()));
  }
  result.exit = end->exit;
  result.ms = std::chrono::duration<double, std::milli>(Clock::now() - begin).count();
  if (result.error.empty() && end->exit > 1) result.error = "the program " + end->text();
  return result;
}

void bind_runs(Router& router, Runs& runs, Workspace& workspace) {
  router.add("POST", "/api/run", [&](const Request& request) {
    return run_response(runs.run(request.json(), request.address));
  });
  const RouteOptions options{
      kMaxForm,
      true,
      {"image/jpeg", "image/png", "image/webp", "image/bmp", "image/x-portable-anymap",
       "application/octet-stream", "multipart/form-data"}};
  for (const char* pattern : {"/api/v1/{area}/{verb}", "/api/v1/{area}"}) {
    router.add(
        "POST", pattern,
        [&](const Request& request) { return verb_response(request, runs, workspace); },
        Access::kSignedIn, options);
  }
}

}  // namespace tarsier::web
