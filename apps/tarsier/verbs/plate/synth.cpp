// SPDX-License-Identifier: MIT
#include "tarsier/core/stop.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/plate/text/symbol_labels.h"
#include "tarsier/synth/glyphs.h"
#include "tarsier/synth/noise.h"
#include "tarsier/synth/street.h"

#include <fmt/format.h>
#include <opencv2/imgproc.hpp>

#include "framework/bind.h"
#include "framework/size_flag.h"
#include "verbs/plate/plate.h"
#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using synth::PlateKind;

const std::map<std::string, PlateKind>& kinds() {
  static const std::map<std::string, PlateKind> names{{"spain", PlateKind::kSpain},
                                                      {"spain-old", PlateKind::kSpainOld},
                                                      {"spain-square", PlateKind::kSpainSquare},
                                                      {"spain-moto", PlateKind::kSpainMoto},
                                                      {"europe", PlateKind::kEurope},
                                                      {"us", PlateKind::kUs},
                                                      {"brazil", PlateKind::kBrazil}};
  return names;
}

struct PlateSynthFlags {
  std::string output;
  int count = 100;
  std::vector<std::string> kinds{"spain"};
  std::string size = "1280x720";
  bool night = false;
  bool infrared = false;
  bool faces = false;
  bool plain = false;
  bool wild = false;
  double noise = 2;
  synth::StreetOptions street;
};

// Writes images of streets, truth.csv for `plate eval` and training, truth.jsonl with corners.
ExitStatus make_scenes(const PlateSynthFlags& flags, Context& context) {
  synth::StreetOptions options = flags.street;
  options.size = parse_size(flags.size, 64, 8192);
  options.seed = context.seed;
  options.light = flags.infrared ? synth::StreetLight::kInfrared
                  : flags.night  ? synth::StreetLight::kNight
                                 : synth::StreetLight::kDay;
  options.wild = flags.wild;
  options.kinds.clear();
  for (const std::string& name : flags.kinds) options.kinds.push_back(kinds().at(name));
  const fs::path folder = flags.output;
  make_folder((folder / "images").string());
  std::string csv = "image,x,y,w,h,text\n";
  std::string lines;
  context.progress->begin("synth", flags.count, "images");
  for (int i = 0; i < flags.count; ++i) {
    throw_if_stopped(context.stop);
    synth::StreetImage street = synth::render_car(options, static_cast<std::uint64_t>(i));
    synth::add_noise(street.image, flags.noise,
                     context.seed * 7919 + static_cast<std::uint64_t>(i));
    const std::string name = fmt::format("car-{:05}.jpg", i);
    write_image((folder / "images" / name).string(), street.image, 92);
    nlohmann::ordered_json line{{"image", name}, {"plates", nlohmann::ordered_json::array()}};
    for (const synth::StreetPlate& plate : street.plates) {
      if (!plate.visible) continue;
      const auto [left, right] = std::minmax(
          {plate.corners[0].x, plate.corners[1].x, plate.corners[2].x, plate.corners[3].x});
      const auto [top, bottom] = std::minmax(
          {plate.corners[0].y, plate.corners[1].y, plate.corners[2].y, plate.corners[3].y});
      csv += fmt::format("{},{:.1f},{:.1f},{:.1f},{:.1f},{}\n", name, left, top, right - left,
                         bottom - top, plate.text);
      nlohmann::ordered_json corners = nlohmann::ordered_json::array();
      for (const cv::Point2f& p : plate.corners) corners.push_back({p.x, p.y});
      line["plates"].push_back({{"text", plate.text}, {"corners", std::move(corners)}});
    }
    lines += line.dump() + "\n";
    if (context.json) print_json(line);
    context.progress->advance();
  }
  context.progress->end();
  write_file_atomically((folder / "truth.jsonl").string(), lines);
  write_file_atomically((folder / "truth.csv").string(), csv);
  return ExitStatus::kDone;
}

// Writes flat plates with a box for each character, as input of train-reader.
ExitStatus make_faces(const PlateSynthFlags& flags, Context& context) {
  const auto glyphs = flags.wild ? synth::draw_glyphs(context.seed, 60) : synth::load_glyphs();
  const fs::path folder = flags.output;
  make_folder(folder.string());
  const Rng base(context.seed);
  context.progress->begin("synth", flags.count, "plates");
  for (int i = 0; i < flags.count; ++i) {
    throw_if_stopped(context.stop);
    Rng rng = base.fork(static_cast<std::uint64_t>(i));
    const std::string& kind = flags.kinds[static_cast<std::size_t>(i) % flags.kinds.size()];
    synth::PlateFaceOptions options;
    options.kind = kinds().at(kind);
    options.random_style = !flags.plain;
    options.wild = flags.wild;
    options.infrared = flags.infrared;
    const synth::PlateFace face = synth::render_plate_face(*glyphs, options, rng);
    std::string symbols;
    std::vector<cv::Rect2f> boxes;
    for (const synth::PlateSymbol& symbol : face.symbols) {
      symbols += symbol.symbol;
      boxes.push_back(symbol.box);
    }
    std::string plain_kind = kind;
    std::erase(plain_kind, '-');
    const std::string name = fmt::format("{:05}_{}-{}", i, plain_kind, face.text);
    write_image((folder / (name + ".jpg")).string(), face.image, 92);
    write_file_atomically((folder / (name + ".txt")).string(),
                          plate::symbol_labels_text(symbols, boxes, face.image.size()));
    if (context.json)
      print_json(nlohmann::ordered_json{{"image", name + ".jpg"}, {"text", face.text}});
    context.progress->advance();
  }
  context.progress->end();
  return ExitStatus::kDone;
}

ExitStatus run_synth(const PlateSynthFlags& flags, Context& context) {
  return flags.faces ? make_faces(flags, context) : make_scenes(flags, context);
}

void add_flags(Command& verb, PlateSynthFlags& flags) {
  verb.add_option("-o,--output", flags.output, "output folder: images/, truth.csv, truth.jsonl")
      .required();
  verb.add_option("--count", flags.count, "number of images")
      .check(range(1, 1000000))
      .show_default();
  std::vector<std::string> names;
  for (const auto& [name, kind] : kinds()) names.push_back(name);
  verb.add_option("--kind", flags.kinds, "plate kinds, repeatable")
      .delimiter(',')
      .check(one_of(names))
      .show_default();
  verb.add_option("--size", flags.size, "image size, px").show_default();
  verb.add_option("--noise", flags.noise, "standard deviation of the image noise, grey levels")
      .check(range(0.0, 64.0))
      .show_default();
  bind_field(verb, flags.street, flags.street.max_distance_ratio);
  Flag& night = verb.add_flag("--night", flags.night, "night scenes: lamps on, plates illuminated");
  verb.add_flag("--infrared", flags.infrared,
                "infrared camera: grey images, retroreflective plates")
      .excludes(night);
  Flag& faces = verb.add_flag("--faces", flags.faces,
                              "draw plates without cars, with boxes of the characters");
  Flag& wild = verb.add_flag("--wild", flags.wild,
                             "draw worn plates with slogans in random typefaces (by --seed)");
  verb.add_flag("--plain", flags.plain, "with --faces: regular plates without random changes")
      .needs(faces)
      .excludes(wild);
}

}  // namespace

void add_plate_synth(Command& plate, Context& context) {
  add_verb<PlateSynthFlags>(
      plate, "synth",
      "render synthetic images of cars with plates, or of plates only, with ground truth", context,
      add_flags, run_synth);
}

}  // namespace tarsier::cli
