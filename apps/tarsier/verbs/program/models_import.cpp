// SPDX-License-Identifier: MIT
#include "verbs/program/models_import.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/detect/anchor_detector.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/linalg/tensors.h"
#include "tarsier/media/sha256.h"
#include "tarsier/media/user_models.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <system_error>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ImportOptions {
  std::string manifest;
  std::string output;
  bool any_weights = false;
};

// The files of the npm package @vladmandic/face-api that contain the networks. All its versions
// from 2020 on have the same bytes.
constexpr std::array<std::pair<std::string_view, std::string_view>, 4> kKnownWeights{{
    {"face_recognition_model-weights_manifest.json",
     "cbaffa501b0b9275a12b63357a6843e7e30c054e1c9151e1a5f879b26e32986b"},
    {"face_recognition_model.bin",
     "b413e420d6840b2775fba32008db6f3cddb07d485967fb42cfcf379c16a8c589"},
    {"tiny_face_detector_model-weights_manifest.json",
     "5d1af4849ac48d5b985f4a9b16010c512353ddd6fcc63d50fd0bc9e9e64296e5"},
    {"tiny_face_detector_model.bin",
     "b7503ce7df31039b1c43316a9b865cab6a70dd748cc602d3fa28b551503c3871"},
}};

// Returns the checksum; throws ModelError for a file that is not one of those, unless `any`.
std::string verified_sha256(const fs::path& path, bool any) {
  const std::string sum = sha256_of_file(path.string());
  const std::string name = path.filename().string();
  const auto known = std::find_if(kKnownWeights.begin(), kKnownWeights.end(),
                                  [&](const auto& entry) { return entry.first == name; });
  if (any || (known != kKnownWeights.end() && known->second == sum)) return sum;
  throw ModelError(
      path.string(),
      known == kKnownWeights.end()
          ? "is not a known file of the face network (--any-weights accepts others)"
          : fmt::format(
                "its SHA-256 is {}, not {}: damaged, or other weights (--any-weights accepts them)",
                sum, known->second));
}

// What to write, its name, and a one-line description.
struct Imported {
  const Importable* model = nullptr;
  std::string data;
  std::string summary;
  json numbers;
};

Imported describe_network(const linalg::NamedTensors& tensors, const std::string& manifest) {
  using namespace face;
  Imported out;
  if (has_anchor_tensors(tensors)) {
    const AnchorDetector detector = build_anchor_detector(tensors, manifest);
    const int side = AnchorSearchOptions{}.side;
    const double cost = detector.network.cost({1, side, side});
    out.model = &kImportable[1];
    out.data = "tiny_face_detector of the npm package @vladmandic/face-api (Vincent Muehler)";
    out.summary = fmt::format("{:.0f} million multiplications an image of {} px", cost / 1e6, side);
    out.numbers = {{"type", kAnchorDetectorType}, {"multiplications", cost}};
    return out;
  }
  const recognition::DeepNetwork network = recognition::build_deep_network(tensors, manifest);
  const double cost = network.network.cost({3, recognition::kChipSize, recognition::kChipSize});
  out.model = &kImportable[0];
  out.data =
      "face_recognition_model of the npm package @vladmandic/face-api: the face network of dlib "
      "(Davis King)";
  out.summary = fmt::format("{} numbers a face, {:.0f} million multiplications", network.outputs(),
                            cost / 1e6);
  out.numbers = {
      {"type", "face-embedding"}, {"numbers", network.outputs()}, {"multiplications", cost}};
  return out;
}

ExitStatus import_model(const Context& context, const ImportOptions& options) {
  const fs::path manifest = options.manifest;
  const std::string folder = options.output.empty() ? user_models_folder() : "";
  if (options.output.empty() && folder.empty())
    throw UsageError("-o: name the model file to write (there is no $HOME)");
  json sums = {{manifest.filename().string(), verified_sha256(manifest, options.any_weights)}};
  for (const std::string& shard : linalg::shards_of_manifest(options.manifest))
    sums[shard] = verified_sha256(manifest.parent_path() / shard, options.any_weights);
  const linalg::NamedTensors tensors = linalg::read_weights_manifest(options.manifest);
  const Imported imported = describe_network(tensors, options.manifest);
  const std::string output =
      folder.empty() ? options.output : (fs::path(folder) / imported.model->file).string();
  if (!folder.empty()) {
    std::error_code error;
    fs::create_directories(folder, error);
    if (error) throw OutputError(folder, error.message());
  }
  const std::string terms =
      options.any_weights ? "not stated" : "MIT (npm package @vladmandic/face-api)";
  const json provenance = {
      {"program", fmt::format("tarsier {}", version())},
      {"data", options.any_weights ? manifest.filename().string() : imported.data},
      {"terms", terms},
      {"sha256", sums}};
  if (imported.model == &kImportable[1]) {
    face::write_anchor_detector(output, tensors, provenance);
  } else {
    face::recognition::write_deep_weights(output, tensors, provenance);
  }
  if (context.json) {
    json line = imported.numbers;
    line["output"] = output;
    line["terms"] = terms;
    line["sha256"] = sums;
    print_json(line);
  } else {
    print_text(fmt::format("{}: {}; terms: {} -> {}\n", imported.model->name, imported.summary,
                           terms, printable(output)));
  }
  return ExitStatus::kDone;
}

}  // namespace

void add_models_import(Command& models, Context& context) {
  add_verb<ImportOptions>(
      models, "import",
      "import the deep face embedding or a face detector (files of scripts/get-model.sh)", context,
      [](Command& verb, ImportOptions& flags) {
        verb.add_option("MANIFEST", flags.manifest,
                        "face_recognition_model- or tiny_face_detector_model-weights_manifest.json "
                        "of npm @vladmandic/face-api, beside its shard")
            .required();
        verb.add_option("-o,--output", flags.output,
                        "output model file [face-embedding.json or face-anchors.json in "
                        "~/.local/share/tarsier/models]");
        verb.add_flag("--any-weights", flags.any_weights, "accept weights with an unknown SHA-256");
      },
      [](const ImportOptions& flags, Context& run_context) {
        return import_model(run_context, flags);
      });
}

}  // namespace tarsier::cli
