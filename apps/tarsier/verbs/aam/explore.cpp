// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/face/shape/text_files.h"
#include "tarsier/media/image_file.h"

#include <fmt/format.h>

#include "framework/browse_session.h"
#include "ui/face/explore_session.h"
#include "verbs/aam/aam.h"
#include "window.h"
#include <charconv>
#include <cmath>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

namespace tarsier::cli {
namespace {

struct ExploreFlags {
  std::string model;
  std::string image;
  std::string output;
  std::string grid;
  std::vector<std::string> set;
  bool random = false;
  bool mesh = false;
  bool window = false;
  bool fullscreen = false;
  int modes = 4;
  int cell = 130;
  AamFlags aam;
};

// Converts "shape 1=2" (also "shape1=2") to a slider event.
Event parse_set(const std::string& text) {
  const std::size_t equals = text.find('=');
  const auto fail = [&]() -> Event {
    throw UsageError(fmt::format(
        "--set {}: expected NAME NUMBER=DEVIATIONS, such as 'shape 1=2', 'look 3=-1', 'mode 2=1'",
        text));
  };
  if (equals == std::string::npos) return fail();
  double value = 0;
  const char* end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data() + equals + 1, end, value);
  if (error != std::errc() || stop != end || !std::isfinite(value)) return fail();
  std::string name = text.substr(0, equals);
  const std::size_t digit = name.find_first_of("0123456789");
  if (digit == std::string::npos || digit == 0) return fail();
  if (name[digit - 1] != ' ') name.insert(digit, " ");
  return slider_event(name, value);
}

void print_result(const std::string& output, const Session& session, const View& view,
                  const Context& context) {
  static_cast<void>(session);
  if (context.json) {
    nlohmann::ordered_json line{{"output", output}, {"state", view.state}};
    print_json(line);
  } else if (!context.quiet) {
    print_text(fmt::format("{}: {}\n", output, view.status));
  }
}

// Writes the session's image to a file, or shows the session in a window.
template <class Explored>
ExitStatus show(Explored& session, const ExploreFlags& flags, const std::string& title,
                Context& context) {
  View view = session.on_idle({});
  for (const std::string& text : flags.set) {
    const Event event = parse_set(text);
    const auto known = session.sliders();
    const nlohmann::json before = view.state;
    view = session.on_event(event);
    if (view.state == before && event.value != 0 &&
        std::none_of(known.begin(), known.end(),
                     [&](const Slider& slider) { return slider.name == event.name; }))
      throw UsageError(fmt::format("--set {}: there is no such mode", text));
  }
  if (flags.random) view = session.on_event(action_event("random"));
  if (flags.mesh) view = session.on_event(action_event("mesh"));
  if (!flags.output.empty()) {
    write_image(flags.output, session.image());
    print_result(flags.output, session, view, context);
    if (!flags.window) return ExitStatus::kDone;
  }
  window::prepare();
  return browse_session(session, title, flags.fullscreen, context, {});
}

ExitStatus explore_points(const ExploreFlags& flags, Context& context) {
  const std::vector<Eigen::Matrix2Xd> shapes = face::shape::read_text_shapes(flags.model);
  face::shape::LandmarkSet set;
  for (const Eigen::Matrix2Xd& points : shapes) {
    set.samples.emplace_back();
    set.samples.back().points = points;
  }
  if (const auto markup = face::shape::known_markup(set.points()))
    set.connections = markup->connections;
  face::shape::ShapeModel model;
  try {
    model = face::shape::train_shape_model(set, {});
  } catch (const std::invalid_argument& error) {
    throw InputError(flags.model, error.what());
  }
  if (!flags.grid.empty() || !flags.image.empty())
    throw UsageError("--grid and --on need an appearance model, not shapes");
  ShapeSpaceSession session(std::move(model), shapes);
  return show(session, flags, "Tarsier shapes", context);
}

// The best object of the image, fitted.
ExploredImage fit_to_image(const ExploreFlags& flags) {
  AamFlags aam = flags.aam;
  aam.model = flags.model;
  const face::AppearanceTracker tracker = load_appearance_tracker(aam);
  ExploredImage result{read_image(flags.image), {}};
  face::appearance::FitWorkspace workspace;
  const auto found = face::appearance::find_objects(tracker.fitter(), tracker.find_starts(),
                                                    result.image, 1, workspace);
  if (found.empty()) throw InputError(flags.image, "the model finds no object in it");
  result.points = found.front().fit.points;
  return result;
}

ExitStatus explore(ExploreFlags& flags, Context& context) {
  if (flags.model.empty()) flags.model = shipped_appearance_model();
  if (flags.model.ends_with(".txt")) return explore_points(flags, context);
  const face::appearance::AppearanceModel model =
      face::appearance::read_appearance_model(flags.model);
  if (!model.colour && !face::appearance::has_offset(model.levels.front().channels))
    throw ModelError(flags.model, "has no texture that can be drawn: train it with colour");
  if (!flags.grid.empty()) {
    write_image(flags.grid,
                face::appearance::draw_mode_grid(model, flags.modes, flags.cell, context.seed));
    if (context.json)
      print_json(nlohmann::ordered_json{{"output", flags.grid}, {"modes", flags.modes}});
    else if (!context.quiet)
      print_text(fmt::format("{}: {} modes of shape and of texture\n", flags.grid, flags.modes));
    if (flags.output.empty() && !flags.window) return ExitStatus::kDone;
  }
  std::optional<ExploredImage> image;
  if (!flags.image.empty()) image = fit_to_image(flags);
  ExploreSession session(model, std::move(image), context.seed);
  return show(session, flags, "Tarsier appearance model", context);
}

void add_flags(Command& verb, ExploreFlags& flags) {
  verb.add_option("MODEL", flags.model,
                  "appearance model, or shapes as text (.txt: 'N 2k', then N lines x1 y1 ..) "
                  "[aam68.json, shipped]")
      .type_name("");
  verb.add_option("--on", flags.image, "image to draw the face on");
  verb.add_option("--set", flags.set,
                  "value of a mode, in standard deviations: 'shape 1=2', 'look 3=-1'; text shapes: "
                  "'mode 1=2'")
      .one_value_each();
  verb.add_flag("--random", flags.random, "start with a random face (--seed)");
  verb.add_flag("--mesh", flags.mesh, "start with the mesh shown");
  verb.add_option("-o,--output", flags.output, "output image instead of a window");
  verb.add_option("--grid", flags.grid,
                  "output image of the modes at -3 .. 3 standard deviations, and of random faces");
  verb.add_option("--modes", flags.modes, "--grid: number of modes of shape, and of texture")
      .check(range(1, 50))
      .show_default();
  verb.add_option("--cell", flags.cell, "--grid: side of a face, px")
      .check(range(40, 1000))
      .show_default();
  verb.add_flag("--window", flags.window, "show in a window (default without -o and --grid)");
  verb.add_flag("--fullscreen", flags.fullscreen, "show the window in full screen");
}

}  // namespace

void add_aam_explore(Command& area, Context& context) {
  add_verb<ExploreFlags>(area, "explore", "explore a model with sliders for its modes", context,
                         add_flags, explore);
}

}  // namespace tarsier::cli
