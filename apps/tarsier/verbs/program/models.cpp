// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/recognition/deep.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/model_store.h"
#include "tarsier/media/sha256.h"
#include "tarsier/media/user_models.h"

#include <fmt/format.h>

#include "framework/cli.h"
#include "framework/parse.h"
#include "verbs/program/model_folder.h"
#include "verbs/program/models_install.h"
#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <system_error>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ModelsOptions {
  std::string folder;  // --models-dir
  std::string name;    // info, verify
};

std::string provenance_text(const Archive& archive, const char* key) {
  const auto found = archive.provenance.find(key);
  if (found == archive.provenance.end()) return {};
  return found->is_string() ? found->get<std::string>() : found->dump();
}

std::string size_text(std::int64_t bytes) {
  const auto value = static_cast<double>(bytes);
  if (value < 1e3) return fmt::format("{} B", bytes);
  return value < 1e6 ? fmt::format("{:.1f} kB", value / 1e3)
                     : fmt::format("{:.1f} MB", value / 1e6);
}

void say_none(const std::string& folder, const Context& context) {
  if (context.json) return;
  print_text(
      folder.empty()
          ? "No models: this program has no models folder beside it (--models-dir names one).\n"
          : fmt::format("No models in {} yet. Nothing that is here needs one.\n",
                        printable(folder)));
}

ExitStatus list_models(const Context& context, const ModelsOptions& options) {
  const ModelStore store = ModelStore::find(options.folder);
  const std::string& folder = store.folder();
  const std::vector<ModelFile> models = find_models(store);
  if (models.empty()) {
    say_none(folder, context);
    return ExitStatus::kDone;
  }
  bool sound = true;
  if (!context.json) {
    print_text(fmt::format("{}\n{:<24} {:<20} {:>7} {:>10}  {}\n", printable(folder), "NAME",
                           "TYPE", "VERSION", "SIZE", "TERMS"));
  }
  for (const ModelFile& model : models) {
    throw_if_stopped(context.stop);
    std::optional<Archive> archive;
    const std::string problem = problem_of(model, archive);
    sound = sound && problem.empty();
    const std::string terms = archive ? provenance_text(*archive, "terms") : "";
    if (context.json) {
      print_json(json{{"name", model.name},
                      {"file", model.path},
                      {"type", archive ? json(archive->type) : json()},
                      {"version", archive ? json(archive->version) : json()},
                      {"bytes", model.bytes},
                      {"terms", terms},
                      {"used_by", card_text(model, "Used by")},
                      {"without_it", card_text(model, "Without it")},
                      {"card", model.card.empty() || model.is_own ? json() : json(model.card)},
                      {"own", model.is_own},
                      {"sha256", model.is_own ? json(sha256_of_file(model.path)) : json()},
                      {"problem", problem.empty() ? json() : json(problem)}});
    } else if (archive) {
      print_text(fmt::format("{:<24} {:<20} {:>7} {:>10}  {}{}\n", printable(model.name),
                             printable(archive->type), archive->version, size_text(model.bytes),
                             printable(terms.empty() ? "not stated" : terms),
                             model.is_own ? "  (your own)" : ""));
      const std::string used = card_text(model, "Used by");
      const std::string without = card_text(model, "Without it");
      if (!used.empty()) print_text(fmt::format("    used by: {}\n", printable(used)));
      if (!without.empty()) print_text(fmt::format("    without it: {}\n", printable(without)));
    } else {
      print_text(fmt::format("{:<24} unusable: {}\n", printable(model.name), printable(problem)));
    }
  }
  if (!context.json && options.folder.empty() && !ModelStore::find().has("face-embedding.json")) {
    print_text(
        "face-embedding           not installed: the network of deep face templates (people "
        "--template deep)\n    to get it: scripts/get-model.sh face-embedding (6 MB, MIT)\n");
  }
  return sound ? ExitStatus::kDone : ExitStatus::kBadModel;
}

const ModelFile& model_named(const std::vector<ModelFile>& models, const std::string& name,
                             const std::string& folder) {
  std::vector<std::string> names;
  for (const ModelFile& model : models) {
    if (model.name == name || fs::path(model.path).filename() == name) return model;
    names.push_back(model.name);
  }
  const std::string meant = nearest_word(name, names);
  throw ModelError(name,
                   fmt::format("no such model{}{}",
                               folder.empty() ? " (there is no models folder)" : " in " + folder,
                               meant.empty() ? "" : ", did you mean '" + meant + "'?"));
}

ExitStatus show_model(const Context& context, const ModelsOptions& options) {
  const ModelStore store = ModelStore::find(options.folder);
  const std::string& folder = store.folder();
  const std::vector<ModelFile> models = find_models(store);
  const ModelFile& model = model_named(models, options.name, folder);
  std::optional<Archive> archive;
  if (const std::string problem = problem_of(model, archive); !problem.empty()) {
    throw ModelError(model.path, problem);
  }
  const std::string sum = sha256_of_file(model.path);
  if (context.json) {
    print_json(json{{"name", model.name},
                    {"file", model.path},
                    {"type", archive->type},
                    {"version", archive->version},
                    {"bytes", model.bytes},
                    {"sha256", sum},
                    {"own", model.is_own},
                    {"provenance", archive->provenance}});
    return ExitStatus::kDone;
  }
  std::string text = fmt::format("{}: {}, version {}, {}\n  file    {}\n  sha256  {}{}\n",
                                 printable(model.name), printable(archive->type), archive->version,
                                 size_text(model.bytes), printable(model.path), sum,
                                 model.is_added           ? "  (installed by the user)"
                                 : model.expected.empty() ? "  (not in the index)"
                                 : model.expected == sum  ? "  (as in the index)"
                                                          : "  (NOT as in the index)");
  for (const auto& [key, value] : archive->provenance.items()) {
    text += fmt::format("  {:<7} {}\n", printable(key),
                        printable(value.is_string() ? value.get<std::string>() : value.dump()));
  }
  print_text(text);
  if (model.card.empty() || model.is_own) return ExitStatus::kDone;
  std::istringstream card(read_file(model.card, 1'000'000));
  for (std::string line; std::getline(card, line);)
    print_text(fmt::format("\n{}", printable(line)));
  print_text("\n");
  return ExitStatus::kDone;
}

ExitStatus verify_models(Context& context, const ModelsOptions& options) {
  const ModelStore store = ModelStore::find(options.folder);
  const std::string& folder = store.folder();
  std::vector<ModelFile> models = find_models(store);
  if (!options.name.empty()) models = {model_named(models, options.name, folder)};
  if (models.empty()) {
    say_none(folder, context);
    return ExitStatus::kDone;
  }
  bool sound = true;
  for (const ModelFile& model : models) {
    throw_if_stopped(context.stop);
    std::optional<Archive> archive;
    std::string problem;
    std::string sum;
    if (model.exists) sum = sha256_of_file(model.path);
    if (model.exists && model.expected.empty() && !model.is_added) {
      problem = fmt::format("is not in {}", kModelIndex);
    } else if (model.exists && !model.is_added && model.expected != sum) {
      problem =
          fmt::format("has changed: its SHA-256 is {}, the index says {}", sum, model.expected);
    } else {
      problem = problem_of(model, archive);
    }
    sound = sound && problem.empty();
    if (context.json) {
      print_json(json{{"name", model.name},
                      {"file", model.path},
                      {"sha256", sum.empty() ? json() : json(sum)},
                      {"own", model.is_own},
                      {"ok", problem.empty()},
                      {"problem", problem.empty() ? json() : json(problem)}});
    } else {
      print_text(problem.empty()
                     ? fmt::format("ok       {}{}\n", printable(model.name),
                                   model.is_own ? " (your own)" : "")
                     : fmt::format("PROBLEM  {} {}\n", printable(model.name), printable(problem)));
    }
  }
  return sound ? ExitStatus::kDone : ExitStatus::kBadModel;
}

// --- import ---

struct ImportOptions {
  std::string manifest;
  std::string output;
  bool any_weights = false;
};

// The files of the npm package @vladmandic/face-api that hold the face recognition network. Its
// versions since 2020 carry the same bytes.
constexpr std::array<std::pair<std::string_view, std::string_view>, 2> kKnownWeights{{
    {"face_recognition_model-weights_manifest.json",
     "cbaffa501b0b9275a12b63357a6843e7e30c054e1c9151e1a5f879b26e32986b"},
    {"face_recognition_model.bin",
     "b413e420d6840b2775fba32008db6f3cddb07d485967fb42cfcf379c16a8c589"},
}};

// Throws ModelError for a file that is not one of those.
std::string checked_sum(const fs::path& path, bool any) {
  const std::string sum = sha256_of_file(path.string());
  const std::string name = path.filename().string();
  const auto known = std::find_if(kKnownWeights.begin(), kKnownWeights.end(),
                                  [&](const auto& entry) { return entry.first == name; });
  if (any || (known != kKnownWeights.end() && known->second == sum)) return sum;
  throw ModelError(
      path.string(),
      known == kKnownWeights.end()
          ? "is no file of the face network that is known here (--any-weights takes others)"
          : fmt::format("its SHA-256 is {}, not {}: damaged, or other weights "
                        "(--any-weights takes them)",
                        sum, known->second));
}

ExitStatus import_model(const Context& context, const ImportOptions& options) {
  using namespace face::recognition;
  const fs::path manifest = options.manifest;
  std::string output = options.output;
  if (output.empty()) {
    const std::string folder = user_models_folder();
    if (folder.empty()) throw UsageError("-o: where to write the model (there is no $HOME)");
    output = (fs::path(folder) / "face-embedding.json").string();
  }
  json sums = {{manifest.filename().string(), checked_sum(manifest, options.any_weights)}};
  for (const std::string& shard : shards_of_manifest(options.manifest))
    sums[shard] = checked_sum(manifest.parent_path() / shard, options.any_weights);
  const DeepWeights weights = read_weights_manifest(options.manifest);
  const DeepNetwork network = build_deep_network(weights, options.manifest);
  if (options.output.empty()) {
    std::error_code error;
    fs::create_directories(fs::path(output).parent_path(), error);
    if (error) throw OutputError(fs::path(output).parent_path().string(), error.message());
  }
  const std::string terms =
      options.any_weights ? "not stated" : "MIT (npm package @vladmandic/face-api)";
  write_deep_weights(output, weights,
                     {{"program", fmt::format("tarsier {}", version())},
                      {"data", options.any_weights
                                   ? manifest.filename().string()
                                   : "face_recognition_model of the npm package "
                                     "@vladmandic/face-api: the face network of dlib (Davis King)"},
                      {"terms", terms},
                      {"sha256", sums}});
  const double millions = network.network.cost({3, kChipSize, kChipSize}) / 1e6;
  if (context.json) {
    print_json(json{{"output", output},
                    {"type", "face-embedding"},
                    {"numbers", network.outputs()},
                    {"multiplications", millions * 1e6},
                    {"terms", terms},
                    {"sha256", sums}});
  } else {
    print_text(
        fmt::format("face-embedding: {} numbers a face, {:.0f} million multiplications; "
                    "terms: {} -> {}\n",
                    network.outputs(), millions, terms, printable(output)));
  }
  return ExitStatus::kDone;
}

}  // namespace

void add_models(Command& app, Context& context) {
  Command& models = app.add_subcommand(
      "models", "the trained models: those that came with the program, and your own");
  models.require_subcommand(1);
  const auto options = std::make_shared<ModelsOptions>();
  const auto add = [&](const char* name, const char* help, auto run) -> Command& {
    Command& verb = models.add_subcommand(name, help);
    verb.add_option(
        "--models-dir", options->folder,
        "folder of models (default: $TARSIER_MODELS, else the one that came with the program)");
    add_common_flags(verb, context);
    set_run(verb, context, [&context, options, run] { return run(context, *options); });
    return verb;
  };
  add("list", "name, type, version, size, terms and use of each model, and how to do without it",
      list_models);
  add("info", "what a model is, what it was made from, and its card", show_model)
      .add_option("NAME", options->name, "as `models list` shows it")
      .required();
  add("verify", "checks the files against models/SHA256SUMS", verify_models)
      .add_option("NAME", options->name, "only this one");
  add_verb<ImportOptions>(
      models, "import",
      "makes the network of deep face templates from another program's file "
      "(scripts/get-model.sh fetches it)",
      context,
      [](Command& verb, ImportOptions& flags) {
        verb.add_option("MANIFEST", flags.manifest,
                        "face_recognition_model-weights_manifest.json of the npm package "
                        "@vladmandic/face-api; its shard lies beside it")
            .required();
        verb.add_option("-o,--output", flags.output,
                        "model file (default: face-embedding.json in the user's models folder, "
                        "~/.local/share/tarsier/models)");
        verb.add_flag("--any-weights", flags.any_weights,
                      "other weights of this form than those whose SHA-256 is known");
      },
      [](const ImportOptions& flags, Context& run_context) {
        return import_model(run_context, flags);
      });
  add_models_install(models, context);
}

}  // namespace tarsier::cli
