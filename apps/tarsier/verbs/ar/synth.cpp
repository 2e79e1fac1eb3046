// SPDX-License-Identifier: MIT
#include "tarsier/core/length.h"
#include "tarsier/core/rng.h"
#include "tarsier/core/stop.h"
#include "tarsier/geometry/camera_file.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/synth/planar_source.h"
#include "tarsier/synth/planar_worlds.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "framework/size_flag.h"
#include "verbs/ar/ar.h"
#include <algorithm>
#include <array>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

constexpr double kMinTarget = 80;  // px: smaller images cannot be recognised

struct PlanarSynthFlags {
  std::string what;
  std::string output;
  int count = 20;
  std::string size = "640x480";
  std::vector<std::string> families{"36h11"};
  std::string side = "10cm";
  std::vector<std::string> images;
  int posters = 3;
  std::string level = "all";
  const Flag* min_side = nullptr;
  synth::StillOptions still;
};

std::vector<synth::PlanarLevel> levels_of(const std::string& name) {
  using synth::PlanarLevel;
  const std::vector<PlanarLevel> all{PlanarLevel::kEasy, PlanarLevel::kMedium, PlanarLevel::kHard};
  std::vector<PlanarLevel> selected;
  std::copy_if(all.begin(), all.end(), std::back_inserter(selected),
               [&](PlanarLevel level) { return name == "all" || name_of(level) == name; });
  return selected;
}

// The given images, or synthetic posters; all are written to OUT/targets/.
std::vector<synth::PlanarPrint> targets_of(const PlanarSynthFlags& flags, const Context& context) {
  std::vector<synth::PlanarPrint> prints;
  if (flags.images.empty()) {
    for (int i = 0; i < flags.posters; ++i) prints.push_back(synth::poster_print(i, context.seed));
  }
  for (const std::string& path : flags.images) {
    synth::PlanarPrint print;
    print.id = static_cast<int>(prints.size());
    print.image = read_image(path);
    if (std::max(print.image.cols, print.image.rows) > 8192)
      throw InputError(path, "a target's image has at most 8192 px a side");
    print.width = 0.2;
    prints.push_back(std::move(print));
  }
  const fs::path folder = fs::path(flags.output) / "targets";
  make_folder(folder.string());
  for (synth::PlanarPrint& print : prints) {
    const std::string name = fmt::format("t{}.png", print.id);
    write_image((folder / name).string(), print.image);
    print.name = "targets/" + name;
  }
  return prints;
}

ExitStatus make_images(PlanarSynthFlags& flags, Context& context) {
  const bool is_planar = flags.what == "planar";
  flags.still.size = parse_size(flags.size, 64, 8192);
  if (is_planar && flags.min_side->count() == 0) flags.still.min_side_px = kMinTarget;
  if (flags.still.min_prints > flags.still.max_prints)
    throw UsageError(fmt::format("--min-markers {}, --max-markers {}", flags.still.min_prints,
                                 flags.still.max_prints));
  if (flags.still.min_side_px > flags.still.max_side_px)
    throw UsageError(fmt::format("--min-side {} px, --max-side {}", flags.still.min_side_px,
                                 flags.still.max_side_px));
  const double side = parse_length(flags.side, "--side");
  for (const std::string& family : flags.families) (void)planar::markers::find_dictionary(family);
  const fs::path folder = flags.output;
  make_folder((folder / "images").string());
  const std::vector<synth::PlanarPrint> prints =
      is_planar ? targets_of(flags, context) : std::vector<synth::PlanarPrint>();
  const std::vector<synth::PlanarLevel> levels = levels_of(flags.level);
  const Rng seeds(context.seed);
  std::string lines;
  std::size_t marker_count = 0;
  context.progress->begin("drawing", flags.count, "images");
  for (int i = 0; i < flags.count; ++i) {
    throw_if_stopped(context.stop);
    const auto n = static_cast<std::size_t>(i);
    const synth::PlanarLevel level = levels[n % levels.size()];
    const std::string& family = flags.families[n / levels.size() % flags.families.size()];
    const std::uint64_t seed = seeds.fork(n)();
    const synth::PlanarStill still =
        is_planar ? synth::print_still(prints, flags.still, level, seed)
                  : synth::marker_still(planar::markers::find_dictionary(family), side, flags.still,
                                        level, seed);
    synth::TruthLine line;
    line.family = family;
    line.targets = is_planar;
    line.image = fmt::format("images/{}_{:05}.jpg", is_planar ? "planar" : family, i);
    write_image((folder / line.image).string(), still.image, 95);
    const std::string text = truth_line(line, still, prints);
    lines += text + "\n";
    marker_count += still.truth.size();
    if (context.json) print_text(text + '\n');
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), lines);
  if (!context.json && !context.quiet)
    print_text(fmt::format("{}: {} images, {} {}, truth.jsonl\n", flags.output, flags.count,
                           marker_count, is_planar ? "targets" : "markers"));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, PlanarSynthFlags& flags) {
  verb.add_option("what", flags.what, "markers or planar (images as targets)")
      .required()
      .check(one_of({"markers", "planar"}));
  verb.add_option("-o,--output,output", flags.output, "output folder").required();
  verb.add_option("--count", flags.count, "number of images")
      .check(range(1, 100000))
      .show_default();
  verb.add_option("--size", flags.size, "image size, px").show_default();
  verb.add_option("--level", flags.level,
                  "level of light, blur and noise: easy, medium, hard or all")
      .check(one_of({"easy", "medium", "hard", "all"}))
      .show_default();
  bind_field(verb, flags.still, flags.still.tilt_deg);
  flags.min_side = &bind_field(verb, flags.still, flags.still.min_side_px);
  bind_field(verb, flags.still, flags.still.max_side_px);
  bind_field(verb, flags.still, flags.still.hidden_share);
  const auto markers = [](Flag& flag) { flag.group("Markers"); };
  markers(verb.add_option("--family", flags.families, "marker family, repeatable")
              .delimiter(',')
              .show_default());
  markers(verb.add_option("--side", flags.side, "side of a marker's black frame").show_default());
  markers(bind_field(verb, flags.still, flags.still.min_prints));
  markers(bind_field(verb, flags.still, flags.still.max_prints));
  const auto planar = [](Flag& flag) { flag.group("Image targets"); };
  planar(verb.add_option("--image", flags.images, "image of a target, repeatable [posters]")
             .delimiter(','));
  planar(verb.add_option("--posters", flags.posters, "number of synthetic posters without --image")
             .check(range(1, 50))
             .show_default());
}

}  // namespace

void add_ar_synth(Command& ar, Context& context) {
  add_verb<PlanarSynthFlags>(
      ar, "synth", "render synthetic images of markers or image targets: images/, truth.jsonl",
      context, add_flags, make_images);
}

}  // namespace tarsier::cli
