// SPDX-License-Identifier: MIT
#include "tarsier/face/shape/import.h"

#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"

#include <fmt/format.h>

#include "verbs/landmarks/landmarks.h"
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <set>

namespace tarsier::cli {
namespace {

using face::shape::ImportFormat;

const std::map<std::string, ImportFormat> kFormats{{"auto", ImportFormat::kAuto},
                                                   {"pts", ImportFormat::kPts},
                                                   {"asf", ImportFormat::kAsf},
                                                   {"muct", ImportFormat::kMuct},
                                                   {"dlib", ImportFormat::kDlib}};
constexpr std::size_t kMaxWarnings = 10;

struct ImportFlags {
  std::string input;
  std::string output;
  std::string format = "auto";
  face::shape::ImportOptions options;
};

ExitStatus import_set(ImportFlags& flags, const Context& context) {
  flags.options.format = kFormats.at(flags.format);
  const face::shape::Imported imported = [&] {
    const EndOnSignals at_once;  // nothing is written yet
    return face::shape::import_landmarks(flags.input, flags.options);
  }();
  face::shape::write_landmark_set(flags.output, imported.set, "");

  std::int64_t missing = 0;
  std::set<std::string> people;
  for (const face::shape::LandmarkSample& sample : imported.set.samples) {
    for (int i = 0; i < static_cast<int>(sample.points.cols()); ++i)
      missing += sample.is_missing(i) ? 1 : 0;
    if (!sample.person.empty()) people.insert(sample.person);
  }
  if (context.json) {
    nlohmann::ordered_json line{{"output", flags.output},
                                {"samples", imported.set.samples.size()},
                                {"points", imported.set.points()},
                                {"missing", missing},
                                {"people", people.size()},
                                {"connections", imported.set.connections.size()},
                                {"symmetry", !imported.set.mirror.empty()},
                                {"skipped", imported.skipped}};
    print_json(line);
    return ExitStatus::kDone;
  }
  for (std::size_t i = 0; i < std::min(kMaxWarnings, imported.skipped.size()); ++i)
    log_warning("left out: {}", imported.skipped[i]);
  if (imported.skipped.size() > kMaxWarnings)
    log_warning("left out: {} more (--json lists them)", imported.skipped.size() - kMaxWarnings);
  print_text(
      fmt::format("{}: {} samples of {} points{}{}, {} connections, symmetry {}, {} left out\n",
                  flags.output, imported.set.samples.size(), imported.set.points(),
                  missing > 0 ? fmt::format(" ({} missing)", missing) : std::string(),
                  people.empty() ? std::string() : fmt::format(", {} people", people.size()),
                  imported.set.connections.size(),
                  imported.set.mirror.empty() ? "not known" : "known", imported.skipped.size()));
  return ExitStatus::kDone;
}

void add_flags(Command& verb, ImportFlags& flags) {
  verb.add_option("INPUT", flags.input,
                  "folder, list (.txt: one image a line), .pts, .asf, MUCT .csv, dlib .xml")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output, "output file of the annotated set").required();
  verb.add_option("--format", flags.format, "format of INPUT; auto: from the file extension")
      .check(one_of({"auto", "pts", "asf", "muct", "dlib"}))
      .show_default();
  verb.add_option("--offset", flags.options.pts_offset,
                  ".pts: pixel offset of the coordinates, px; 1 for files from Matlab")
      .check(one_of({0, 1}))
      .show_default();
  verb.add_option("--images", flags.options.images, "folder of the images, if different (MUCT)");
}

}  // namespace

void add_landmarks_import(Command& area, Context& context) {
  add_verb<ImportFlags>(area, "import", "import annotations of other programs", context, add_flags,
                        import_set);
}

}  // namespace tarsier::cli
