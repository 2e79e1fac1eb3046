// SPDX-License-Identifier: MIT
#include "tarsier/core/log.h"
#include "tarsier/core/stop.h"
#include "tarsier/face/onnx/network_file.h"
#include "tarsier/media/archive.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/model_store.h"
#include "tarsier/media/sha256.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include "framework/cli.h"
#include "framework/parse.h"
#include "verbs/program/model_folder.h"
#include "verbs/program/models_import.h"
#include "verbs/program/models_install.h"
#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <sstream>
#include <string>
#include <system_error>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

struct ModelsOptions {
  std::string folder;  // --models-dir
  std::string name;    // for info, verify
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

void report_no_models(const std::string& folder, const Context& context) {
  if (context.json) return;
  print_text(
      folder.empty()
          ? "No models: this program has no models folder beside it (--models-dir names one).\n"
          : fmt::format("No models in {}. None is required.\n", printable(folder)));
}

ExitStatus list_models(const Context& context, const ModelsOptions& options) {
  const ModelStore store = ModelStore::find(options.folder);
  const std::string& folder = store.folder();
  const std::vector<ModelFile> models = find_models(store);
  if (models.empty()) {
    report_no_models(folder, context);
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
  if (!context.json && options.folder.empty()) {
    for (const Importable& model : kImportable) {
      if (ModelStore::find().has(model.file)) continue;
      print_text(
          fmt::format("{:<24} not installed: {}\n    to get it: scripts/get-model.sh {} ({})\n",
                      fs::path(model.file).stem().string(), model.what, model.name, model.terms));
    }
  }
  return sound ? ExitStatus::kDone : ExitStatus::kBadModel;
}

// A model file anywhere.
ModelFile model_of_file(const std::string& path) {
  ModelFile model;
  model.name = fs::path(path).stem().string();
  model.file = fs::path(path).filename().string();
  model.path = path;
  model.bytes = static_cast<std::int64_t>(fs::file_size(path));
  model.exists = true;
  return model;
}

ModelFile model_named(const std::vector<ModelFile>& models, const std::string& name,
                      const std::string& folder) {
  std::vector<std::string> names;
  for (const ModelFile& model : models) {
    if (model.name == name || fs::path(model.path).filename() == name) return model;
    names.push_back(model.name);
  }
  std::error_code ignored;
  if (fs::is_regular_file(name, ignored)) return model_of_file(name);
  const std::string meant = nearest_word(name, names);
  throw ModelError(name,
                   fmt::format("no such model{}{}",
                               folder.empty() ? " (there is no models folder)" : " in " + folder,
                               meant.empty() ? "" : ", did you mean '" + meant + "'?"));
}

std::string shape_text(const std::vector<face::onnx::TensorInfo>& forms) {
  std::string text;
  for (const face::onnx::TensorInfo& form : forms) {
    std::vector<std::string> sizes;
    for (const std::int64_t size : form.shape)
      sizes.push_back(size < 0 ? "?" : std::to_string(size));
    text += fmt::format("{}{} {}", text.empty() ? "" : ", ", form.name, fmt::join(sizes, "x"));
  }
  return text;
}

// Shows a user's network for `people --embedding` and `--detector-model`. It is parsed, not run.
ExitStatus show_own_network(const Context& context, const std::string& path) {
  const face::onnx::NetworkFile file = face::onnx::read_network_file(path);
  const face::onnx::InputFormat format = face::onnx::read_input_format(path);
  const std::string licence =
      format.licence.empty() ? std::string(face::onnx::kUnknownLicence) : format.licence;
  if (context.json) {
    print_json(nlohmann::ordered_json{{"name", fs::path(path).filename().string()},
                                      {"file", path},
                                      {"type", "onnx"},
                                      {"bytes", file.bytes.size()},
                                      {"sha256", file.sha256},
                                      {"licence", licence},
                                      {"producer", file.producer},
                                      {"inputs", shape_text(file.inputs)},
                                      {"outputs", shape_text(file.outputs)},
                                      {"layers", file.nodes},
                                      {"parameters", file.parameters}});
    return ExitStatus::kDone;
  }
  print_text(fmt::format(
      "{}: onnx, {}\n  sha256  {}\n  licence {}\n  made by {}\n  takes   {}\n  gives   {}\n"
      "  holds   {} layers, {} numbers\n",
      printable(path), size_text(static_cast<std::int64_t>(file.bytes.size())), file.sha256,
      printable(licence), printable(file.producer.empty() ? "not stated" : file.producer),
      printable(shape_text(file.inputs)), printable(shape_text(file.outputs)), file.nodes,
      file.parameters));
  return ExitStatus::kDone;
}

ExitStatus show_model(const Context& context, const ModelsOptions& options) {
  if (options.name.ends_with(".onnx")) return show_own_network(context, options.name);
  const ModelStore store = ModelStore::find(options.folder);
  const std::string& folder = store.folder();
  const std::vector<ModelFile> models = find_models(store);
  const ModelFile model = model_named(models, options.name, folder);
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
    report_no_models(folder, context);
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

}  // namespace

void add_models(Command& app, Context& context) {
  Command& models = app.add_subcommand("models", "the trained models: shipped ones and your own");
  models.require_subcommand(1);
  const auto options = std::make_shared<ModelsOptions>();
  const auto add = [&](const char* name, const char* help, auto run) -> Command& {
    Command& verb = models.add_subcommand(name, help);
    verb.add_option("--models-dir", options->folder,
                    "folder of models [$TARSIER_MODELS, else the one shipped with the program]");
    add_common_flags(verb, context);
    set_run(verb, context, [&context, options, run] { return run(context, *options); });
    return verb;
  };
  add("list", "list the models: name, type, version, size, terms, use, and alternative",
      list_models);
  add("info", "show what a model is, its training data and its model card", show_model)
      .add_option("NAME", options->name, "name as `models list` shows it, or an ONNX file")
      .required();
  add("verify", "check the model files against models/SHA256SUMS", verify_models)
      .add_option("NAME", options->name, "check only this model");
  add_models_import(models, context);
  add_models_install(models, context);
}

}  // namespace tarsier::cli
