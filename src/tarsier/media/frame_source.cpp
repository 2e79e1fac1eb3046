// SPDX-License-Identifier: MIT
#include "tarsier/media/frame_source.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/file_extension.h"
#include "tarsier/core/log.h"
#include "tarsier/core/name_table.h"
#include "tarsier/core/require.h"
#include "tarsier/core/words.h"
#include "tarsier/media/cameras.h"
#include "tarsier/media/child_capture.h"
#include "tarsier/media/http_protocol.h"
#include "tarsier/media/http_stream.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/live_source.h"
#include "tarsier/media/still_source.h"
#include "tarsier/media/video_source.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <optional>
#include <span>
#include <system_error>
#include <utility>

namespace tarsier {
namespace {

constexpr NameTable<SourceState, 5> kStates{"state of a source",
                                            {{{SourceState::kConnecting, "connecting"},
                                              {SourceState::kLive, "live"},
                                              {SourceState::kStale, "stale"},
                                              {SourceState::kLost, "lost"},
                                              {SourceState::kEnded, "ended"}}}};

namespace fs = std::filesystem;

constexpr std::string_view kExpected =
    "expected an image, folder, glob, @list.txt, video, camera number, picam:, http://, https://, "
    "rtsp://, rtsps://";

// "http" for "HTTP://.."; empty if the text does not begin with a word and a colon.
std::string scheme_of(std::string_view text) {
  const std::size_t colon = text.find(':');
  if (colon == std::string_view::npos || colon == 0 || colon > 32) return {};
  const std::string_view word = text.substr(0, colon);
  const bool is_word = std::all_of(word.begin(), word.end(), [](char c) {
    return std::isalnum(static_cast<unsigned char>(c)) != 0 || c == '+' || c == '-' || c == '.';
  });
  return is_word ? lower_case(word) : std::string();
}

const Scheme* find_scheme(const std::string& name, const std::vector<Scheme>& schemes) {
  const auto found = std::find_if(schemes.begin(), schemes.end(),
                                  [&](const Scheme& scheme) { return scheme.name == name; });
  return found != schemes.end() ? &*found : nullptr;
}

std::optional<int> small_number(std::string_view text) {
  int value = 0;
  if (text.empty() || text.size() > 3) return std::nullopt;
  const auto result = std::from_chars(text.data(), text.data() + text.size(), value);
  if (result.ec != std::errc() || result.ptr != text.data() + text.size() || value < 0) {
    return std::nullopt;
  }
  return value;
}

bool has_device_path(const std::string& text) {
  return text.starts_with("/dev/video") || text.starts_with("/dev/v4l/");
}

bool has_video_ending(const std::string& path) {
  static constexpr std::array<std::string_view, 18> kEndings = {
      ".avi",   ".mp4", ".mkv",  ".mov", ".webm", ".m4v", ".mpg", ".mpeg", ".mjpg",
      ".mjpeg", ".ts",  ".m2ts", ".wmv", ".flv",  ".ogv", ".3gp", ".y4m",  ".h264"};
  const std::string ending = lowercase_extension(path);
  return std::find(kEndings.begin(), kEndings.end(), ending) != kEndings.end();
}

// The kind of a regular file, by its first bytes. Its name decides only if these are ambiguous, and
// in error messages.
SourceKind classify_file(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw InputError(path, fmt::format("cannot be read: {}", errno_text(errno)));
  std::array<char, 4096> bytes{};
  file.read(bytes.data(), bytes.size());
  const std::span<const std::uint8_t> head(reinterpret_cast<const std::uint8_t*>(bytes.data()),
                                           static_cast<std::size_t>(file.gcount()));
  const bool is_mjpeg = lowercase_extension(path).starts_with(".mjp");
  if (!is_mjpeg && (probe_image(head) || has_image_extension(path))) return SourceKind::kImage;
  if (looks_like_video(head)) {
    // A JPEG whose header is longer than the bytes read (a large thumbnail) is also an image.
    const bool is_jpeg = head.size() > 2 && head[0] == 0xff && head[1] == 0xd8;
    return is_jpeg && !is_mjpeg && !has_video_ending(path) ? SourceKind::kImage
                                                           : SourceKind::kVideo;
  }
  if (has_video_ending(path)) throw InputError(path, head.empty() ? "is empty" : "is not a video");
  throw InputError(path, head.empty() ? "is empty" : "is neither an image nor a video");
}

SourceKind classify_on_disk(const std::string& path, const fs::file_status& status) {
  switch (status.type()) {
    case fs::file_type::directory:
      return SourceKind::kFolder;
    case fs::file_type::regular:
      return classify_file(path);
    case fs::file_type::fifo:
      // An image from another program: /dev/stdin. A pipe with a name may never get a writer.
      if (path.starts_with("/dev/")) return SourceKind::kImage;
      [[fallthrough]];
    default:
      throw InputError(path, "is neither a file, nor a folder, nor a camera");
  }
}

// Reads several sources in turn. Sources that cannot be opened or give no frame are skipped like
// unreadable images.
class ChainSource final : public FrameSource {
 public:
  struct Part {
    std::string name;
    std::function<std::unique_ptr<FrameSource>()> open;
    std::int64_t count = 0;  // 0: not known
  };
  explicit ChainSource(std::vector<Part> parts) : parts_(std::move(parts)) {}

  std::optional<Frame> next(std::chrono::milliseconds timeout,
                            const std::stop_token& stop) override {
    while (at_ < parts_.size() && !stop.stop_requested()) {
      std::optional<Frame> frame;
      try {
        if (!current_) current_ = parts_[at_].open();
        frame = current_->next(timeout, stop);
      } catch (const InputError& error) {
        if (current_ && current_->is_live()) throw;
        if (!current_ || current_->skipped().empty()) {  // else each image was reported
          log_warning("{}; skipped", error.what());
          skipped_.emplace_back(error.what());
        }
        leave_part();
        if (at_ == parts_.size() && index_ == 0) {
          throw InputError(parts_.front().name, "none of the inputs could be read");
        }
        continue;
      }
      if (frame) {
        if (!frame->still) {
          frame->time += start_time_;
          frame->start_time += start_time_;
          end_time_ = frame->time + 1 / (current_->fps() > 0 ? current_->fps() : 25);
        }
        const std::int64_t own_index = frame->index - frame->start_index;
        frame->start_index = index_ - own_index;
        frame->index = index_++;
        return frame;
      }
      if (!current_->ended()) return std::nullopt;
      leave_part();
    }
    return std::nullopt;
  }

  [[nodiscard]] bool ended() const override { return at_ >= parts_.size(); }
  [[nodiscard]] bool is_live() const override { return current_ && current_->is_live(); }
  [[nodiscard]] SourceStatus status() const override {
    SourceStatus status;
    if (current_) status = current_->status();
    status.state = ended()                                            ? SourceState::kEnded
                   : !current_ || status.state == SourceState::kEnded ? SourceState::kLive
                                                                      : status.state;
    if (!is_live()) status.received = index_;
    return status;
  }
  [[nodiscard]] double fps() const override { return current_ ? current_->fps() : 0; }
  [[nodiscard]] std::int64_t count() const override {
    std::int64_t sum = 0;
    for (const Part& part : parts_) {
      if (part.count == 0) return 0;
      sum += part.count;
    }
    return sum;
  }
  [[nodiscard]] const std::vector<std::string>& skipped() const override {
    all_skipped_ = skipped_;
    if (current_) {
      all_skipped_.insert(all_skipped_.end(), current_->skipped().begin(),
                          current_->skipped().end());
    }
    return all_skipped_;
  }

 private:
  void leave_part() {
    if (current_) {
      skipped_.insert(skipped_.end(), current_->skipped().begin(), current_->skipped().end());
      current_.reset();
    }
    start_time_ = end_time_;
    ++at_;
  }

  const std::vector<Part> parts_;
  std::size_t at_ = 0;
  std::unique_ptr<FrameSource> current_;
  std::int64_t index_ = 0;
  double start_time_ = 0;
  double end_time_ = 0;
  std::vector<std::string> skipped_;
  mutable std::vector<std::string> all_skipped_;
};

std::unique_ptr<FrameSource> open_camera(const std::string& text, const SourceOptions& options) {
  const auto number = small_number(text);
  const std::string path = number ? fmt::format("/dev/video{}", *number) : text;
  const std::string label = number ? fmt::format("camera {}", *number) : text;
  if (!options.wait) {
    if (const std::string error = camera_error(path); !error.empty()) {
      throw InputError(label, error);
    }
  }
  const ChildCommand command = camera_command(path, label, options);
  return make_live_source(
      text, label, [command] { return make_child_backend(command); }, options);
}

int pi_camera_index(const std::string& text) {
  const std::string_view rest = std::string_view(text).substr(std::strlen("picam:"));
  if (rest.empty()) return 0;
  const auto index = small_number(rest);
  if (!index || *index > 9)
    throw InputError(text, "expected picam: or picam:1 (the camera's number)");
  return *index;
}

// Files of a glob or list: consecutive images become one source, so that unreadable ones are
// skipped.
std::vector<ChainSource::Part> parts_of_files(const std::vector<std::string>& paths,
                                              const SourceOptions& options) {
  std::vector<ChainSource::Part> parts;
  std::vector<std::string> run;
  const auto end_run = [&] {
    if (run.empty()) return;
    const auto count = static_cast<std::int64_t>(run.size());
    parts.push_back(
        {run.front(), [run, options] { return make_still_source(run, options); }, count});
    run.clear();
  };
  for (const std::string& path : paths) {
    std::error_code ignored;
    bool is_video = false;
    if (!has_image_extension(path) && fs::is_regular_file(path, ignored)) {
      try {
        is_video = classify_file(path) == SourceKind::kVideo;
      } catch (const InputError&) {  // reported when it is opened
      }
    }
    if (!is_video) {
      run.push_back(path);
      continue;
    }
    end_run();
    parts.push_back({path, [path, options] { return make_video_source(path, options); }, 0});
  }
  end_run();
  return parts;
}

std::vector<ChainSource::Part> parts_of(const std::string& text, const SourceOptions& options,
                                        const std::vector<Scheme>& schemes) {
  switch (classify_source(text, schemes)) {
    case SourceKind::kImage:
      return parts_of_files({text}, options);
    case SourceKind::kFolder:
      return parts_of_files(images_in_folder(text), options);
    case SourceKind::kGlob:
      return parts_of_files(files_of_glob(text), options);
    case SourceKind::kList:
      return parts_of_files(paths_of_list(text.substr(1)), options);
    default:
      return {{masked(text),
               [text, options, schemes] { return open_source(text, options, schemes); }, 0}};
  }
}

std::unique_ptr<FrameSource> join(std::vector<ChainSource::Part> parts) {
  if (parts.size() == 1) return parts.front().open();
  return std::make_unique<ChainSource>(std::move(parts));
}

}  // namespace

std::string_view name_of(SourceState state) { return kStates.name(state); }

SourceKind classify_source(const std::string& text, const std::vector<Scheme>& schemes) {
  if (text.empty()) throw InputError("input", fmt::format("is empty; {}", kExpected));
  if (text.find('\0') != std::string::npos) throw InputError("input", "has a zero byte");
  if (text.front() == '@' && text.size() > 1) {
    std::error_code ignored;
    if (!fs::exists(text.substr(1), ignored)) throw InputError(text.substr(1), "no such list");
    return SourceKind::kList;
  }
  if (small_number(text)) return SourceKind::kCamera;
  if (has_device_path(text)) return SourceKind::kCamera;

  const std::string scheme = scheme_of(text);
  const bool has_slashes = !scheme.empty() && text.compare(scheme.size(), 3, "://") == 0;
  if (has_slashes && (scheme == "http" || scheme == "https")) {
    (void)parse_url(text, scheme, 80);
    return SourceKind::kHttp;
  }
  if (has_slashes && (scheme == "rtsp" || scheme == "rtsps")) {
    (void)parse_url(text, scheme, 443);
    return SourceKind::kFfmpegUrl;
  }
  if (find_scheme(scheme, schemes) != nullptr) return SourceKind::kScheme;
  if (scheme == "picam") {
    (void)pi_camera_index(text);
    return SourceKind::kPiCamera;
  }

  std::error_code error;
  const fs::file_status status = fs::status(text, error);
  if (fs::exists(status)) return classify_on_disk(text, status);
  // It may exist: no permission, name too long.
  if (status.type() != fs::file_type::not_found) {
    throw InputError(text, error ? error.message() : "cannot be inspected");
  }
  if (has_slashes) {
    throw InputError(masked(text),
                     fmt::format("unknown kind of address '{}:'; {}", scheme, kExpected));
  }
  if (text.find_first_of("*?[") != std::string::npos) return SourceKind::kGlob;
  throw InputError(text, "no such file or folder");
}

std::unique_ptr<FrameSource> open_source(const std::string& text, const SourceOptions& options,
                                         const std::vector<Scheme>& schemes) {
  options.check();
  const SourceKind kind = classify_source(text, schemes);
  switch (kind) {
    case SourceKind::kImage:
    case SourceKind::kFolder:
    case SourceKind::kGlob:
    case SourceKind::kList:
      return join(parts_of(text, options, schemes));
    case SourceKind::kVideo:
      return make_video_source(text, options);
    case SourceKind::kCamera:
      return open_camera(text, options);
    case SourceKind::kPiCamera: {
      const ChildCommand command = pi_camera_command(pi_camera_index(text), options);
      return make_live_source(
          text, text, [command] { return make_child_backend(command); }, options);
    }
    case SourceKind::kHttp:
      return make_live_source(
          masked(text), masked(text), [text, options] { return make_http_backend(text, options); },
          options);
    case SourceKind::kFfmpegUrl: {
      const ChildCommand command = ffmpeg_command(text, options);
      return make_live_source(
          masked(text), masked(text), [command] { return make_child_backend(command); }, options);
    }
    case SourceKind::kScheme:
      break;
  }
  const std::string name = scheme_of(text);
  return find_scheme(name, schemes)->open(std::string_view(text).substr(name.size() + 1), options);
}

std::unique_ptr<FrameSource> open_sources(const std::vector<std::string>& texts,
                                          const SourceOptions& options,
                                          const std::vector<Scheme>& schemes) {
  TARSIER_REQUIRE(!texts.empty(), "no inputs");
  options.check();
  if (texts.size() == 1) return open_source(texts.front(), options, schemes);
  std::vector<ChainSource::Part> parts;
  std::vector<std::string> files;
  const auto end_files = [&] {
    auto more = files.empty() ? std::vector<ChainSource::Part>() : parts_of_files(files, options);
    std::move(more.begin(), more.end(), std::back_inserter(parts));
    files.clear();
  };
  for (const std::string& text : texts) {
    // Images named one by one are one source.
    if (classify_source(text, schemes) == SourceKind::kImage) {
      files.push_back(text);
      continue;
    }
    end_files();
    auto more = parts_of(text, options, schemes);
    std::move(more.begin(), more.end(), std::back_inserter(parts));
  }
  end_files();
  return join(std::move(parts));
}

std::string masked(std::string_view url) {
  std::string text(url);
  const std::size_t slashes = text.find("://");
  if (slashes == std::string::npos) return text;
  const std::size_t begin = slashes + 3;
  const std::size_t end = std::min(text.find_first_of("/?#", begin), text.size());
  std::size_t at = text.rfind('@', end);
  if (end < text.size() && (at == std::string::npos || at < begin)) {
    // A password with '/', '?' or '#': mask too much rather than too little.
    const std::size_t later = text.rfind('@');
    const std::size_t colon = text.find(':', begin);
    if (later != std::string::npos && later > end && colon < end &&
        !std::all_of(text.begin() + static_cast<std::ptrdiff_t>(colon) + 1,
                     text.begin() + static_cast<std::ptrdiff_t>(end),
                     [](unsigned char c) { return std::isdigit(c) != 0; })) {
      at = later;
    }
  }
  if (at != std::string::npos && at >= begin) text.replace(begin, at - begin, "***");

  // Many cameras take their password in the query.
  static constexpr std::array<std::string_view, 10> kSecrets = {
      "user", "usr", "username", "password", "passwd", "pwd", "pass", "token", "key", "auth"};
  std::size_t place = text.find('?', begin);
  while (place != std::string::npos) {
    const std::size_t equals = text.find('=', place);
    if (equals == std::string::npos) break;
    const std::size_t next = std::min(text.find_first_of("&#", place + 1), text.size());
    if (equals < next) {
      const std::string name =
          lower_case(std::string_view(text).substr(place + 1, equals - place - 1));
      if (std::find(kSecrets.begin(), kSecrets.end(), name) != kSecrets.end()) {
        text.replace(equals + 1, next - equals - 1, "***");
      }
    }
    place = text.find('&', place + 1);
  }
  return text;
}

}  // namespace tarsier
