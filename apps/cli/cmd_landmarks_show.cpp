// SPDX-License-Identifier: MIT
#include "tarsier/draw/tile.h"
#include "tarsier/io/archive.h"
#include "tarsier/io/image_file.h"
#include "tarsier/landmarks/model.h"
#include "tarsier/session/landmark_show_session.h"
#include "tarsier/sfm_view/animation.h"
#include "tarsier/shape/landmark_set.h"
#include "tarsier/shape/shape_model.h"
#include "tarsier/shape/show.h"

#include <fmt/format.h>

#include "browse_session.h"
#include "cmd_landmarks.h"
#include "window.h"
#include <chrono>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

struct ShowFlags {
  std::string file;
  std::string output;
  bool window = false;
  bool fullscreen = false;
  bool numbers = false;
  bool mirrored = false;
  bool plain = false;  // without the colours of the symmetry
  int cell = 160;
  int columns = 0;
  int most = 100;
  int modes = 4;
};

constexpr ArchiveLimits kLimits{512'000'000, 64, 50'000'000};
constexpr double kGifRate = 20;
constexpr int kGifFramesPerMode = 32;

bool ends_with(const std::string& path, const char* ending) {
  return std::filesystem::path(path).extension() == ending;
}

void say(const nlohmann::ordered_json& line, const std::string& text, const Context& context) {
  if (context.json) {
    print_json_line(line.dump(-1, ' ', false, nlohmann::json::error_handler_t::replace));
  } else {
    print_text(text);
  }
}

ExitStatus show_set(const ShowFlags& flags, Context& context) {
  shape::LandmarkSet set = shape::read_landmark_set(flags.file);
  if (set.samples.empty()) throw InputError(flags.file, "holds no samples");
  shape::LandmarkStyle style;
  style.numbers = flags.numbers;
  style.symmetry = !flags.plain && !set.mirror.empty();
  if (flags.output.empty()) {
    window::prepare();
    SetSession session(set, flags.file, style, flags.mirrored);
    return browse_session(session, session.on_idle({}), "Tarsier landmarks", flags.fullscreen,
                          context, {});
  }
  write_image(flags.output,
              shape::contact_sheet(set, flags.file, flags.cell, flags.columns, flags.most, style));
  say({{"output", flags.output}, {"samples", set.samples.size()}, {"points", set.points()}},
      fmt::format("{}: {} of {} samples\n", flags.output,
                  std::min<std::size_t>(set.samples.size(), static_cast<std::size_t>(flags.most)),
                  set.samples.size()),
      context);
  return ExitStatus::kDone;
}

ExitStatus show_shape_model(const ShowFlags& flags, Context& context) {
  const shape::ShapeModel model = shape::read_shape_model(flags.file);
  if (flags.output.empty()) {
    window::prepare();
    ShapeModelSession session(model);
    const auto between = [&](std::chrono::milliseconds& wait) -> std::optional<View> {
      wait = std::chrono::milliseconds(40);
      return session.on_idle({});
    };
    return browse_session(session, session.on_idle({}), "Tarsier shape model", flags.fullscreen,
                          context, between);
  }
  const int modes = std::min(flags.modes, model.mode_count());
  if (ends_with(flags.output, ".gif")) {
    sfm::write_gif(
        flags.output,
        shape::animate_modes(model, modes, {flags.cell * 2, flags.cell * 2}, kGifFramesPerMode),
        kGifRate);
  } else {
    write_image(flags.output, shape::draw_modes(model, modes, flags.cell));
  }
  say({{"output", flags.output},
       {"points", model.points()},
       {"modes", model.mode_count()},
       {"variance", model.variance_kept},
       {"trained_on", model.trained_on}},
      fmt::format("{}: {} of {} modes, {} points, {:.1f} % of the variance of {} shapes\n",
                  flags.output, modes, model.mode_count(), model.points(),
                  100 * model.variance_kept, model.trained_on),
      context);
  return ExitStatus::kDone;
}

// The parts of a tracker that can be seen: the shape's modes, and the patches on the mean face.
ExitStatus show_tracker(const ShowFlags& flags, Context& context) {
  const landmarks::LandmarkModel model = landmarks::read_landmark_model(flags.file);
  if (flags.output.empty()) {
    throw UsageError("-o: a tracker is shown as a picture (.png ..), its shape's modes as .gif");
  }
  const int modes = std::min(flags.modes, model.shape.mode_count());
  if (ends_with(flags.output, ".gif")) {
    sfm::write_gif(flags.output,
                   shape::animate_modes(model.shape, modes, {flags.cell * 2, flags.cell * 2},
                                        kGifFramesPerMode),
                   kGifRate);
  } else {
    std::vector<cv::Mat> parts{shape::draw_modes(model.shape, modes, flags.cell)};
    std::vector<std::string> names{"shape modes"};
    if (model.patches) {
      parts.push_back(landmarks::draw_patches(*model.patches, model.shape, -1, 4));
      names.emplace_back("patches");
    }
    write_image(flags.output, draw::tile(parts, names, {1400, 700}));
  }
  nlohmann::ordered_json about = {{"output", flags.output}, {"points", model.points()}};
  std::string has;
  for (const landmarks::FitMethod method :
       {landmarks::FitMethod::kTrees, landmarks::FitMethod::kDescent,
        landmarks::FitMethod::kPatches}) {
    if (model.has(method)) has += fmt::format("{}{}", has.empty() ? "" : ", ", name_of(method));
  }
  about["methods"] = has;
  say(about, fmt::format("{}: {} points; methods: {}\n", flags.output, model.points(), has),
      context);
  return ExitStatus::kDone;
}

// What can be shown, by the type that its file states. Other models add a line.
using Show = ExitStatus (*)(const ShowFlags&, Context&);
const std::map<std::string, Show>& shows() {
  static const std::map<std::string, Show> table{
      {"landmark-set", show_set},
      {"landmark-tracker", show_tracker},
      {"shape-model", show_shape_model},
  };
  return table;
}

ExitStatus show(const ShowFlags& flags, Context& context) {
  std::string type;
  try {
    type = read_any_archive(flags.file, kLimits).type;
  } catch (const ModelError& error) {  // most often a set; its own words are the same
    const std::string prefix = flags.file + ": ";
    std::string reason = error.what();
    if (reason.starts_with(prefix)) reason.erase(0, prefix.size());
    throw InputError(flags.file, reason);
  }
  const auto found = shows().find(type);
  if (found == shows().end()) {
    std::string known;
    for (const auto& [name, unused] : shows()) known += (known.empty() ? "" : ", ") + name;
    throw InputError(flags.file,
                     fmt::format("is a '{}', which cannot be shown; known: {}", type, known));
  }
  return found->second(flags, context);
}

}  // namespace

void add_landmarks_show(CLI::App& area, Context& context) {
  auto flags = std::make_shared<ShowFlags>();
  CLI::App& verb = *area.add_subcommand("show", "looks into a set or a model");
  verb.add_option("FILE", flags->file, "a set, a shape model or a tracker")
      ->required()
      ->type_name("");
  verb.add_option("-o,--output", flags->output,
                  "a set: contact sheet (.png ..); a shape model: its modes (.png ..) or their "
                  "animation (.gif); without it: a window");
  verb.add_flag("--window", flags->window, "in a window (as without -o)");
  verb.add_flag("--fullscreen", flags->fullscreen, "the window fills the screen");
  const auto of_set = [](CLI::Option* option) { option->group("Sets"); };
  of_set(verb.add_flag("--numbers", flags->numbers, "numbers of the points"));
  of_set(verb.add_flag("--mirrored", flags->mirrored, "window: begin with the mirrored view"));
  of_set(verb.add_flag("--plain", flags->plain, "left and right points in one colour"));
  of_set(verb.add_option("--columns", flags->columns, "of the sheet; 0: what fits")
             ->check(CLI::Range(0, 100))
             ->capture_default_str());
  of_set(verb.add_option("--most", flags->most, "samples on the sheet")
             ->check(CLI::Range(1, 10000))
             ->capture_default_str());
  verb.add_option("--cell", flags->cell, "px, side of a cell of the sheet or strip")
      ->check(CLI::Range(40, 1000))
      ->capture_default_str();
  verb.add_option("--modes", flags->modes, "shape model: modes to show")
      ->check(CLI::Range(1, 1000))
      ->capture_default_str();
  add_common_flags(verb, context);
  verb.callback(
      [flags, &context] { context.run = [flags, &context] { return show(*flags, context); }; });
}

}  // namespace tarsier::cli
