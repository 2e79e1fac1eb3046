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

constexpr const char* kIndex = "SHA256SUMS";

struct ModelsOptions {
  std::string folder;  // --models-dir
  std::string name;    // info, verify
};

// One model file, or a line of the index without its file.
struct ModelFile {
  std::string name;  // of the file, without its ending
  std::string path;
  std::int64_t bytes = 0;
  std::string expected;  // its sum in the index; empty: not there
  std::string card;      // path of NAME.md; empty: none
  bool exists = false;
  bool installed = false;  // by the user, in user_models_folder(): in no index
};

std::string sum_line_error(int number) {
  return fmt::format("line {} is not '<64 hexadecimal digits>  <file name>' (made by sha256sum)",
                     number);
}

// The lines of `sha256sum`: digits, a space, a space or '*', the name.
std::map<std::string, std::string> read_index(const fs::path& path) {
  std::map<std::string, std::string> sums;
  std::error_code error;
  if (!fs::exists(path, error)) return sums;
  std::istringstream text(read_file(path.string(), 1'000'000));
  int number = 0;
  for (std::string line; std::getline(text, line);) {
    ++number;
    if (line.empty() || line.front() == '#') continue;
    const bool is_sum = line.size() > 66 && line.find_first_not_of("0123456789abcdef") == 64 &&
                        line[64] == ' ' && (line[65] == ' ' || line[65] == '*');
    const std::string name = is_sum ? line.substr(66) : "";
    // A name is a file of this very folder: an index must not send us elsewhere.
    if (name.empty() || name.front() == '.' || name.find('/') != std::string::npos) {
      throw ModelError(path.string(), sum_line_error(number));
    }
    sums[name] = line.substr(0, 64);
  }
  return sums;
}

std::vector<ModelFile> find_models(const std::string& folder) {
  std::map<std::string, ModelFile> files;
  if (folder.empty()) return {};
  for (const auto& [file, sum] : read_index(fs::path(folder) / kIndex)) {
    if (fs::path(file).extension() == ".md") continue;
    ModelFile& model = files[file];
    model.expected = sum;
  }
  std::error_code error;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder, error)) {
    const std::string file = entry.path().filename().string();
    if (file.front() == '.' || file == kIndex || entry.path().extension() == ".md") continue;
    if (!entry.is_regular_file(error)) continue;
    ModelFile& model = files[file];
    model.exists = true;
    model.bytes = static_cast<std::int64_t>(entry.file_size(error));
  }
  if (error) throw ModelError(folder, error.message());
  std::vector<ModelFile> models;
  for (auto& [file, model] : files) {
    model.name = fs::path(file).stem().string();
    model.path = (fs::path(folder) / file).string();
    const fs::path card = fs::path(folder) / (model.name + ".md");
    if (fs::exists(card, error)) model.card = card.string();
    models.push_back(std::move(model));
  }
  return models;
}

// Those of the folder, and where that is the program's own those that the user installed beside it.
std::vector<ModelFile> all_models(const ModelsOptions& options, const std::string& folder) {
  std::vector<ModelFile> models = find_models(folder);
  const char* other = std::getenv("TARSIER_MODELS");
  std::error_code error;
  const std::string own = user_models_folder();
  if (!options.folder.empty() || (other != nullptr && *other != '\0') || folder.empty() ||
      own.empty() || !fs::is_directory(own, error))
    return models;
  for (ModelFile& model : find_models(own)) {
    model.installed = true;
    models.push_back(std::move(model));
  }
  return models;
}

// What is wrong with a model, or an empty string. `archive` takes what was read.
std::string problem_of(const ModelFile& model, std::optional<Archive>& archive) {
  if (!model.exists) return "is in the index but missing";
  try {
    archive = read_any_archive(model.path);
  } catch (const Error& error) {
    const std::string what = error.what();
    const std::string prefix = model.path + ": ";
    return what.starts_with(prefix) ? what.substr(prefix.size()) : what;
  }
  return {};
}

std::string provenance_text(const Archive& archive, const char* key) {
  const auto found = archive.provenance.find(key);
  if (found == archive.provenance.end()) return {};
  return found->is_string() ? found->get<std::string>() : found->dump();
}

// The text of the row "| KEY | TEXT |" of a model's card, without backquotes; empty: there is none.
std::string card_text(const ModelFile& model, const std::string& key) {
  if (model.card.empty()) return {};
  std::istringstream card(read_file(model.card, 1'000'000));
  const std::string start = "| " + key + " | ";
  for (std::string line; std::getline(card, line);) {
    if (!line.starts_with(start) || !line.ends_with(" |")) continue;
    std::string text = line.substr(start.size(), line.size() - start.size() - 2);
    std::erase(text, '`');
    return text;
  }
  return {};
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
  const std::string folder = find_models_folder(options.folder);
  const std::vector<ModelFile> models = all_models(options, folder);
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
                      {"card", model.card.empty() ? json() : json(model.card)},
                      {"problem", problem.empty() ? json() : json(problem)}});
    } else if (archive) {
      print_text(fmt::format("{:<24} {:<20} {:>7} {:>10}  {}\n", printable(model.name),
                             printable(archive->type), archive->version, size_text(model.bytes),
                             printable(terms.empty() ? "not stated" : terms)));
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
  const std::string folder = find_models_folder(options.folder);
  const std::vector<ModelFile> models = all_models(options, folder);
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
                    {"provenance", archive->provenance}});
    return ExitStatus::kDone;
  }
  std::string text = fmt::format("{}: {}, version {}, {}\n  file    {}\n  sha256  {}{}\n",
                                 printable(model.name), printable(archive->type), archive->version,
                                 size_text(model.bytes), printable(model.path), sum,
                                 model.installed          ? "  (installed by the user)"
                                 : model.expected.empty() ? "  (not in the index)"
                                 : model.expected == sum  ? "  (as in the index)"
                                                          : "  (NOT as in the index)");
  for (const auto& [key, value] : archive->provenance.items()) {
    text += fmt::format("  {:<7} {}\n", printable(key),
                        printable(value.is_string() ? value.get<std::string>() : value.dump()));
  }
  print_text(text);
  if (model.card.empty()) return ExitStatus::kDone;
  std::istringstream card(read_file(model.card, 1'000'000));
  for (std::string line; std::getline(card, line);)
    print_text(fmt::format("\n{}", printable(line)));
  print_text("\n");
  return ExitStatus::kDone;
}

ExitStatus verify_models(Context& context, const ModelsOptions& options) {
  const std::string folder = find_models_folder(options.folder);
  std::vector<ModelFile> models = all_models(options, folder);
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
    if (model.exists && model.expected.empty() && !model.installed) {
      problem = fmt::format("is not in {}", kIndex);
    } else if (model.exists && !model.installed && model.expected != sum) {
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
                      {"ok", problem.empty()},
                      {"problem", problem.empty() ? json() : json(problem)}});
    } else {
      print_text(problem.empty()
                     ? fmt::format("ok       {}\n", printable(model.name))
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
  Command& models = app.add_subcommand("models", "the trained models that came with the program");
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
}

}  // namespace tarsier::cli
