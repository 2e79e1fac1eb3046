// SPDX-License-Identifier: MIT
#include "tarsier/cartoon/cartoonizer.h"
#include "tarsier/core/timer.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "framework/bind.h"
#include "framework/cli.h"
#include "framework/run_session.h"
#include "ui/cartoon/cartoon_session.h"
#include <array>
#include <charconv>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::cli {
namespace {

using cartoon::CartoonOptions;

struct NamedColor {
  const char* name;
  std::array<int, 3> rgb;
};
// About as strong as the default. Glow adds the colour to the skin, tint uses its hue.
constexpr NamedColor kColors[] = {
    {"green", {0, 70, 0}},   {"blue", {0, 0, 90}},    {"red", {80, 0, 0}},
    {"yellow", {60, 60, 0}}, {"cyan", {0, 60, 60}},   {"magenta", {70, 0, 70}},
    {"orange", {80, 40, 0}}, {"purple", {45, 0, 80}}, {"pink", {80, 20, 50}},
    {"white", {60, 60, 60}},
};

struct CartoonFlags {
  RunFlags run;
  CartoonOptions options;
  std::string save_folder = ".";
  bool timings = false;
  // As typed; parsed to `options` when the verb runs.
  std::string mode{cartoon::name_of(CartoonOptions().mode)};
  std::string quality{cartoon::name_of(CartoonOptions().quality)};
  std::string evil_axes = CartoonOptions().evil.both_axes ? "xy" : "x";
  std::string skin_color = "green";
  std::string skin_style =
      CartoonOptions().skin.style == cartoon::SkinStyle::kGlow ? "glow" : "tint";
  std::string face = CartoonOptions().skin.face == cartoon::FaceMode::kOutline ? "outline" : "auto";
  std::string skin_lower = fmt::format("{}", fmt::join(CartoonOptions().skin.lower, ","));
  std::string skin_upper = fmt::format("{}", fmt::join(CartoonOptions().skin.upper, ","));
};

// Parses three numbers 0..255, "60,25,20".
std::array<int, 3> parse_triple(std::string_view flag, std::string_view text) {
  std::array<int, 3> numbers{};
  const char* at = text.data();
  const char* end = at + text.size();
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    const auto [after, error] = std::from_chars(at, end, numbers[i]);
    const bool last = i + 1 == numbers.size();
    if (error != std::errc() || numbers[i] < 0 || numbers[i] > 255 ||
        (last ? after != end : after == end) || (!last && *after != ',')) {
      throw UsageError(
          fmt::format("{} '{}': three numbers 0..255 are expected, as in 60,25,20", flag, text));
    }
    at = after + 1;
  }
  return numbers;
}

// Parses a name, #rrggbb or r,g,b.
cv::Scalar parse_color(std::string_view flag, std::string_view text) {
  std::vector<std::string_view> names;
  for (const NamedColor& color : kColors) {
    if (text == color.name) return {1.0 * color.rgb[2], 1.0 * color.rgb[1], 1.0 * color.rgb[0]};
    names.emplace_back(color.name);
  }
  if (text.size() == 7 && text[0] == '#') {
    unsigned value = 0;
    const auto [after, error] = std::from_chars(text.data() + 1, text.data() + 7, value, 16);
    if (error == std::errc() && after == text.data() + 7) {
      return {1.0 * (value & 255), 1.0 * (value >> 8 & 255), 1.0 * (value >> 16 & 255)};
    }
  } else if (text.find(',') != std::string_view::npos) {
    const std::array<int, 3> rgb = parse_triple(flag, text);
    return {1.0 * rgb[2], 1.0 * rgb[1], 1.0 * rgb[0]};
  }
  throw UsageError(fmt::format("{} '{}': expected #rrggbb, r,g,b or one of {}", flag, text,
                               fmt::join(names, ", ")));
}

void add_cartoon_flags(Command& verb, CartoonFlags& flags) {
  add_run_flags(verb, flags.run);
  CartoonOptions& options = flags.options;
  std::vector<std::string> modes;
  for (const cartoon::Mode mode : cartoon::all_modes()) modes.emplace_back(cartoon::name_of(mode));
  verb.add_option("--mode", flags.mode, fmt::format("{}", fmt::join(modes, " ")))
      .suggest(modes)
      .show_default();
  verb.add_option("--quality", flags.quality,
                  "reference: exact; fast: same image, faster; draft: for small machines")
      .suggest({"reference", "fast", "draft"})
      .show_default();
  verb.add_flag("--steady", options.steady.on, "reduce flicker of lines in videos");
  verb.add_option("--save-dir", flags.save_folder, "folder for images saved with the key w")
      .show_default();
  verb.add_flag("--timings", flags.timings, "print the time of each stage to stderr at the end");

  constexpr const char* kLines = "Lines";
  bind_field(verb, options.sketch, options.sketch.threshold).group(kLines);
  bind_field(verb, options.sketch, options.sketch.median_size).group(kLines);
  bind_field(verb, options.sketch, options.sketch.laplacian_size).group(kLines);
  bind_field(verb, options.sketch, options.sketch.remove_pepper)
      .show_default(options.sketch.remove_pepper ? "on" : "off")
      .group(kLines);
  verb.add_option("--evil-axes", flags.evil_axes, "gradient axes: x or xy")
      .check(one_of({"x", "xy"}))
      .show_default()
      .group(kLines);
  bind_all(verb, options.evil, kLines);
  bind_all(verb, options.steady, kLines);
  bind_all(verb, options.paint, "Painting");

  const auto skin = [](Flag& flag) { flag.show_default().group("Skin (alien, smooth)"); };
  skin(verb.add_option("--skin-color", flags.skin_color, "a name, #rrggbb or r,g,b"));
  skin(verb.add_option("--skin-style", flags.skin_style,
                       "glow: add the colour; tint: change only the hue")
           .check(one_of({"glow", "tint"})));
  skin(verb.add_option("--face", flags.face,
                       "outline: the user moves the face into an outline; auto: detect faces")
           .check(one_of({"outline", "auto"})));
  skin(verb.add_option("--skin-lower", flags.skin_lower,
                       "tolerance Y',Cr,Cb below the seed colour, each 0..255"));
  skin(verb.add_option("--skin-upper", flags.skin_upper,
                       "tolerance Y',Cr,Cb above the seed colour, each 0..255"));
  bind_all(verb, options.skin, "Skin (alien, smooth)");
}

CartoonOptions parsed_options(const CartoonFlags& flags) {
  CartoonOptions options = flags.options;
  options.mode = cartoon::parse_mode(flags.mode);
  options.quality = cartoon::parse_quality(flags.quality);
  options.evil.both_axes = flags.evil_axes == "xy";
  options.skin.color = parse_color("--skin-color", flags.skin_color);
  options.skin.style =
      flags.skin_style == "tint" ? cartoon::SkinStyle::kTint : cartoon::SkinStyle::kGlow;
  options.skin.face = flags.face == "auto" ? cartoon::FaceMode::kAuto : cartoon::FaceMode::kOutline;
  options.skin.lower = parse_triple("--skin-lower", flags.skin_lower);
  options.skin.upper = parse_triple("--skin-upper", flags.skin_upper);
  return options;
}

ExitStatus run_cartoon(const CartoonFlags& flags, Context& context) {
  Timers timers;
  DebugFolder debug(context.debug_dir);
  CartoonSessionOptions options;
  options.save_folder = flags.save_folder;
  options.overlay = opens_window(flags.run);
  options.debug = debug.sink();
  options.stop = context.stop;
  if (flags.timings) options.timers = &timers;
  CartoonSession session(cartoon::Cartoonizer::load(ModelStore::find(), parsed_options(flags)),
                         options);

  RunHooks hooks;
  hooks.title = "cartoon";
  hooks.debug = &debug;
  hooks.describe = [](const View& view, nlohmann::ordered_json& line) {
    for (const char* key : {"mode", "ms", "faces"}) line[key] = view.state.at(key);
  };
  const ExitStatus status = run_session(session, flags.run, context, hooks);
  if (flags.timings) {
    const std::string report = timers.report();
    std::fwrite(report.data(), 1, report.size(), stderr);
  }
  return status;
}

}  // namespace

void add_cartoon(Command& app, Context& context) {
  Command& area = app.add_subcommand("cartoon", "cartoons of images, videos and live cameras");
  area.require_subcommand(1);
  add_debug_flag(add_verb<CartoonFlags>(area, "run", "convert images to cartoons", context,
                                        add_cartoon_flags, run_cartoon),
                 context);
}

}  // namespace tarsier::cli
