// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/image/draw/tile.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/model_store.h"
#include "tarsier/plate/classic/classic.h"

#include <fmt/format.h>

#include "framework/input_schemes.h"
#include "verbs/plate/plate.h"
#include <chrono>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
constexpr std::size_t kMaxOnSheet = 200;

struct SegmentFlags {
  std::vector<std::string> inputs;
  std::string output;
  std::string detector;
  std::string reader;
  bool unsorted = false;
  bool characters = false;
};

std::string model_path(const std::string& given, const char* name) {
  return ModelStore::find().path_or(given, name);
}

struct SegmentWriter {
  const SegmentFlags& flags;
  Context& context;
  const plate::ClassicModel& model;
  plate::ClassicOptions options;
  std::vector<cv::Mat> sheet;
  std::vector<std::string> labels;
  int saved = 0;

  void save(const fs::path& folder, const std::string& name, const cv::Mat& image,
            nlohmann::ordered_json line) {
    make_folder(folder.string());
    const std::string path = (folder / name).string();
    write_image(path, image);
    ++saved;
    if (sheet.size() < kMaxOnSheet) {
      sheet.push_back(image);
      labels.push_back(folder.filename().string());
    }
    line["output"] = path;
    if (context.json) print_json(line);
  }

  void take(const Frame& frame) {
    const std::string stem = frame.still ? fs::path(frame.name).stem().string().substr(0, 100)
                                         : fmt::format("frame-{:06}", frame.index);
    int number = 0;
    for (const plate::ClassicCandidate& candidate :
         plate::find_classic_candidates(frame.image, options, nullptr)) {
      const double probability = model.svm.platt.probability(model.svm.margin(candidate.gray));
      const cv::Rect box = plate::bounding_box(candidate.corners, frame.image.size());
      nlohmann::ordered_json line{{"image", frame.name},
                                  {"box", {box.x, box.y, box.width, box.height}},
                                  {"plate", probability}};
      if (!flags.characters) {
        const char* kind = flags.unsorted ? "unsorted" : probability > 0.5 ? "plate" : "no-plate";
        save(fs::path(flags.output) / kind,
             fmt::format("{}-{:02}-{}-{}.png", stem, ++number, box.x, box.y), candidate.gray, line);
        continue;
      }
      if (probability < 0.5) continue;
      const plate::ClassicText text = plate::read_candidate(candidate, model.reader, options);
      for (std::size_t i = 0; i < text.segments.size(); ++i) {
        const std::string kind = flags.unsorted ? "unsorted" : std::string(1, text.text[i]);
        line["text"] = std::string(1, text.text[i]);
        save(fs::path(flags.output) / kind,
             fmt::format("{}-{:02}-{}-{}.png", stem, ++number, box.x, i),
             text.segments[i].character, line);
      }
    }
  }
};

ExitStatus run_segment(const SegmentFlags& flags, Context& context) {
  const auto model = plate::read_classic_model(model_path(flags.detector, "plate-svm.json"),
                                               model_path(flags.reader, "plate-hog.json"));
  const auto source = open_sources(flags.inputs, {}, input_schemes());
  make_folder(flags.output);
  plate::ClassicOptions options;
  options.seed = context.seed;
  SegmentWriter writer{flags, context, *model, options, {}, {}, 0};
  context.progress->begin("segment", source->count(), "images");
  while (!source->ended()) {
    throw_if_stopped(context.stop);
    if (auto frame = source->next(std::chrono::milliseconds(200), context.stop)) {
      writer.take(*frame);
      context.progress->advance();
    }
  }
  context.progress->end();
  if (writer.saved == 0) return ExitStatus::kNothingFound;
  write_image((fs::path(flags.output) / "sheet.png").string(),
              image::draw::tile(writer.sheet, writer.labels, {1600, 1200}));
  if (!context.json)
    log_info("{}: {} images, the first {} on sheet.png", flags.output, writer.saved,
             writer.sheet.size());
  return ExitStatus::kDone;
}

void add_flags(Command& verb, SegmentFlags& flags) {
  verb.add_option("INPUT", flags.inputs, "images, folders, globs, videos").required().type_name("");
  verb.add_option("-o,--output", flags.output, "output folder").required();
  verb.add_flag("--no-sort", flags.unsorted, "save all into unsorted/");
  verb.add_flag("--characters", flags.characters, "save the characters of plates, 20x20 px");
  verb.add_option("--detector", flags.detector, "SVM file [the shipped one]");
  verb.add_option("--reader", flags.reader, "model file [the shipped model]");
}

}  // namespace

void add_plate_segment(Command& plate, Context& context) {
  add_verb<SegmentFlags>(
      plate, "segment",
      "save plate candidates, or their characters, sorted into folders for labelling", context,
      add_flags, run_segment);
}

}  // namespace tarsier::cli
