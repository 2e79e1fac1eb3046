// SPDX-License-Identifier: MIT
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/run_session.h"
#include "framework/security_flags.h"
#include <algorithm>
#include <filesystem>

namespace tarsier::cli {

namespace fs = std::filesystem;

std::vector<Flag*> add_security_flags(Command& verb, StreamSecurity& security) {
  Flag& ca_file =
      verb.add_option("--ca-file", security.ca_file,
                      "https, rtsps: trusted certificates (PEM) instead of the system's");
  Flag& insecure =
      verb.add_flag("--insecure", security.insecure,
                    "https, rtsps: skip the certificate check; passwords may reach an impostor");
  insecure.excludes(ca_file);
  return {&ca_file, &insecure};
}

void add_run_flags(Command& verb, RunFlags& flags, bool batches) {
  verb.add_option("INPUT", flags.inputs,
                  "image, folder, glob, @list.txt, video, camera number, URL, picam:, synth:NAME")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output,
                  "image, folder, .mp4 .avi .mkv, http://127.0.0.1:8080/, none [the window]")
      .headless_value("none");
  verb.add_flag("--window", flags.window, "show the result in a window (h: keys)");
  verb.add_flag("--fullscreen", flags.fullscreen, "show the window in full screen");
  verb.add_option("--actions", flags.actions, "-: read actions by name from stdin, one a line")
      .check(one_of({"-"}));
  verb.add_option("--frames", flags.frames, "stop after this many frames; 0: all")
      .check(at_least(0))
      .show_default();
  verb.add_option("--every", flags.every, "process every N-th frame")
      .check(above(0))
      .show_default();

  if (batches) add_batch_flags(verb, flags.batch);

  constexpr const char* kSource = "Source";
  bind_all(verb, flags.source, kSource);
  for (Flag* flag : add_security_flags(verb, flags.source.security)) flag->group(kSource);

  const auto sink = [](Flag& flag) { flag.group("Output"); };
  sink(verb.add_option(
      "--segment", flags.segment,
      "video output: start a new file every 10m, 1h ..: NAME-0001.mp4, NAME-0002.mp4 .."));
  sink(bind_field(verb, flags.sink, flags.sink.jpeg_quality));
  sink(bind_field(verb, flags.sink, flags.sink.listen_all));
  Flag& token = bind_field(verb, flags.sink, flags.sink.token);
  sink(token);
  Flag& token_file =
      verb.add_option("--token-file", flags.token_file, "file that contains the token");
  sink(token_file);
  token_file.excludes(token);
}

void default_to_headless(RunFlags& flags) {
  if (flags.output.empty() && !flags.window && !flags.fullscreen) flags.output = "none";
}

HttpAccess http_access(const RunFlags& flags) {
  HttpAccess access{flags.sink.listen_all, flags.sink.token};
  if (flags.token_file.empty()) return access;
  access.token = read_file(flags.token_file, 4096);
  while (access.token.ends_with('\n') || access.token.ends_with('\r')) access.token.pop_back();
  return access;
}

bool opens_window(const RunFlags& flags) {
  return flags.window || flags.fullscreen || flags.output.empty();
}

void DebugFolder::begin(const Frame& frame) {
  std::string name = fmt::format("{:06}", frame.index);
  if (frame.still) {
    name = fmt::format("{:04}-{}", frame.index + 1,
                       fs::path(frame.name).stem().string().substr(0, 180));
  }
  frame_folder_ = (fs::path(folder_) / name).string();
  number_ = 0;
  is_still_ = frame.still;
  stages_.clear();
}

void DebugFolder::end() {
  if (stages_.empty() || window_ == nullptr) return;
  window_->show_stages(stages_);
  stages_.clear();
}

void DebugFolder::image(std::string_view name, const cv::Mat& image) {
  if (image.empty()) return;
  const bool plain = image.depth() == CV_8U && (image.channels() == 1 || image.channels() == 3);
  if (is_shown()) {
    stages_.push_back({std::string(name.substr(0, 100)),
                       plain ? image.clone() : image::draw::letterbox(image, image.size())});
  }
  if (folder_.empty()) return;
  if (number_ == 0) make_folder(frame_folder_);
  // Names of stages may contain words from files, for example the name of a target.
  std::string file = fmt::format("{:02}-{}", ++number_, name.substr(0, 100));
  const auto is_plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z');
  };
  std::replace_if(
      file.begin(), file.end(), [&](char c) { return !is_plain(c); }, '-');
  file += ".png";
  const std::string path = (fs::path(frame_folder_) / file).string();
  write_image(path, plain ? image : image::draw::letterbox(image, image.size()));
}

}  // namespace tarsier::cli
