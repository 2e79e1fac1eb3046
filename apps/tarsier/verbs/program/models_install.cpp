// SPDX-License-Identifier: MIT
#include "verbs/program/models_install.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/face/appearance/model.h"
#include "tarsier/face/detect/face_networks.h"
#include "tarsier/face/head/head_model.h"
#include "tarsier/face/head_view/view_model.h"
#include "tarsier/face/landmarks/model.h"
#include "tarsier/face/recognition/background.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/media/sha256.h"
#include "tarsier/plate/classic/character_reader.h"
#include "tarsier/plate/classic/plate_svm.h"
#include "tarsier/plate/networks/recognizer.h"

#include <fmt/format.h>

#include "framework/parse.h"
#include "verbs/program/model_folder.h"
#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <system_error>
#include <unistd.h>
#include <vector>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::int64_t kMaxBytes = ArchiveLimits{}.max_bytes;

struct InstallOptions {
  std::string file;
  std::string replaces;
  std::string folder;  // --own-dir
};

// The function by which the verbs read a type of model; it checks all dimensions. It returns the
// number of points, which must equal that of the shipped model, because other models depend on it.
struct ModelType {
  std::string_view type;
  int (*points)(const std::string& path);
};
const std::array kTypes = {
    ModelType{"appearance-model",
              [](const std::string& path) {
                return face::appearance::read_appearance_model(path).shape.points();
              }},
    ModelType{"face-networks",
              [](const std::string& path) {
                static_cast<void>(face::read_face_networks(path));
                return 0;
              }},
    ModelType{"head-model",
              [](const std::string& path) {
                // has its own names of points
                static_cast<void>(face::head::read_head_model(path));
                return 0;
              }},
    ModelType{"head-view",
              [](const std::string& path) {
                static_cast<void>(face::head_view::read_view_model(path));
                return 0;
              }},
    ModelType{"landmark-tracker",
              [](const std::string& path) {
                return face::landmarks::read_landmark_model(path).points();
              }},
    ModelType{"face-background",
              [](const std::string& path) {
                static_cast<void>(face::recognition::read_background(path));
                return 0;
              }},
    ModelType{"plate-detector",
              [](const std::string& path) {
                static_cast<void>(plate::read_detector_model(path));
                return 0;
              }},
    ModelType{"plate-reader",
              [](const std::string& path) {
                static_cast<void>(plate::read_reader_model(path));
                return 0;
              }},
    ModelType{"plate-characters",
              [](const std::string& path) {
                static_cast<void>(plate::read_character_reader(path));
                return 0;
              }},
    ModelType{"plate-svm",
              [](const std::string& path) {
                static_cast<void>(plate::read_plate_svm(path));
                return 0;
              }},
};

std::string own_folder(const InstallOptions& options) {
  if (!options.folder.empty()) return options.folder;
  const std::string folder = ModelStore::find().own_folder();
  if (folder.empty()) {
    throw UsageError(
        "no folder for your models: set TARSIER_OWN_MODELS, which all verbs read, or give "
        "--own-dir");
  }
  return folder;
}

void write_index(const std::string& folder, const std::map<std::string, std::string>& sums) {
  std::string text;
  for (const auto& [file, sum] : sums) text += sum + "  " + file + '\n';
  write_file_atomically((fs::path(folder) / kModelIndex).string(), text);
}

// The shipped models of this type.
std::vector<ModelFile> shipped_of(const ModelStore& store, const std::string& type) {
  std::vector<ModelFile> found;
  for (const ModelFile& model : find_models(store.shipped())) {
    std::optional<Archive> archive;
    if (problem_of(model, archive).empty() && archive->type == type) found.push_back(model);
  }
  return found;
}

std::string names_of(const std::vector<ModelFile>& models) {
  std::string names;
  for (const ModelFile& model : models) names += (names.empty() ? "" : ", ") + model.name;
  return names;
}

// The shipped model that the file replaces.
ModelFile shipped_model_for(const InstallOptions& options, const ModelStore& store,
                            const Archive& archive) {
  const std::vector<ModelFile> shipped = shipped_of(store, archive.type);
  if (shipped.empty()) {
    throw ModelError(options.file,
                     fmt::format("is a '{}', but no model of this type is shipped, so there is "
                                 "none to replace; pass it with its flag (--model ..)",
                                 printable(archive.type)));
  }
  if (options.replaces.empty() && shipped.size() > 1) {
    throw UsageError(
        fmt::format("which model does it replace? Give --as with one of: {}", names_of(shipped)));
  }
  for (const ModelFile& model : shipped) {
    if (options.replaces.empty() || model.name == options.replaces ||
        model.file == options.replaces)
      return model;
  }
  throw UsageError(fmt::format("--as {}: a '{}' can replace only {}", printable(options.replaces),
                               printable(archive.type), names_of(shipped)));
}

void check_usable(const std::string& path, const ModelFile& shipped_model, const Archive& archive) {
  std::optional<Archive> shipped;
  static_cast<void>(problem_of(shipped_model, shipped));
  if (archive.version > shipped->version) {
    throw ModelError(path, fmt::format("has version {}, this program reads up to {}: it was made "
                                       "by a newer program",
                                       archive.version, shipped->version));
  }
  const auto type = std::find_if(kTypes.begin(), kTypes.end(), [&](const ModelType& known) {
    return known.type == archive.type;
  });
  if (type == kTypes.end()) return;
  const int points = type->points(path);
  const int expected_points = type->points(shipped_model.path);
  if (points != expected_points) {
    throw ModelError(path, fmt::format("has {} points, but {} has {}, on which other models "
                                       "depend: pass it with its flag (--model ..)",
                                       points, shipped_model.name, expected_points));
  }
}

ExitStatus install(const Context& context, const InstallOptions& options) {
  const std::string folder = own_folder(options);
  const ModelStore store = ModelStore::find();
  const std::string bytes = read_file(options.file, kMaxBytes);
  Sha256 hash;
  hash.add(bytes);
  const std::string sum = hash.hex();
  const Archive archive = read_any_archive(options.file);
  const ModelFile shipped_model = shipped_model_for(options, store, archive);
  check_usable(options.file, shipped_model, archive);
  // The installed file must be the one that was checked.
  if (sha256_of_file(options.file) != sum)
    throw ModelError(options.file, "changed while it was read; try again");

  make_folder(folder);
  std::map<std::string, std::string> sums = read_model_index(folder);
  const std::string path = (fs::path(folder) / shipped_model.file).string();
  write_file_atomically(path, bytes);
  sums[shipped_model.file] = sum;
  write_index(folder, sums);
  const std::string used_by = card_text(shipped_model, "Used by");
  if (context.json) {
    print_json(json{{"name", shipped_model.name},
                    {"file", path},
                    {"type", archive.type},
                    {"version", archive.version},
                    {"bytes", bytes.size()},
                    {"sha256", sum},
                    {"shipped_sha256", sha256_of_file(shipped_model.path)},
                    {"used_by", used_by},
                    {"provenance", archive.provenance}});
  } else if (!context.quiet) {
    print_text(fmt::format("{} is installed in {}\n  sha256   {}\n  used by  {}\n",
                           printable(shipped_model.name), printable(folder), sum,
                           printable(used_by)));
    if (store.own_folder() != folder)
      print_text(fmt::format("Verbs use it if TARSIER_OWN_MODELS is {}\n", printable(folder)));
  }
  return ExitStatus::kDone;
}

ExitStatus remove(const Context& context, const InstallOptions& options) {
  const std::string folder = own_folder(options);
  std::error_code error;
  std::map<std::string, std::string> sums;
  if (fs::is_directory(folder, error)) sums = read_model_index(folder);
  const std::string file = options.file.ends_with(".json") ? options.file : options.file + ".json";
  if (file.front() == '.' || file.find('/') != std::string::npos)
    throw UsageError(fmt::format("{}: is not a model name", printable(options.file)));
  const std::string path = (fs::path(folder) / file).string();
  const bool found = fs::is_regular_file(path, error);
  if (found && ::unlink(path.c_str()) != 0) throw OutputError(path, errno_text(errno));
  if (sums.erase(file) > 0) write_index(folder, sums);
  const std::string name = fs::path(file).stem().string();
  if (context.json) {
    print_json(json{{"name", name}, {"removed", found}});
  } else if (!context.quiet) {
    print_text(
        found ? fmt::format("{}: the shipped model is used again\n", printable(name))
              : fmt::format("{}: you have not installed a model of this name\n", printable(name)));
  }
  return found ? ExitStatus::kDone : ExitStatus::kNothingFound;
}

}  // namespace

void add_models_install(Command& models, Context& context) {
  const auto options = std::make_shared<InstallOptions>();
  const auto add = [&](const char* name, const char* help, auto run) -> Command& {
    Command& verb = models.add_subcommand(name, help);
    verb.add_option("--own-dir", options->folder,
                    "folder of your own models [$TARSIER_OWN_MODELS]");
    add_common_flags(verb, context);
    set_run(verb, context, [&context, options, run] { return run(context, *options); });
    return verb;
  };
  Command& install_verb =
      add("install", "use your own model instead of a shipped one in all verbs", install);
  install_verb.add_option("FILE", options->file, "model file written by a train verb").required();
  install_verb.add_option(
      "--as", options->replaces,
      "name of the shipped model to replace, as `models list` shows it [the only one of its type]");
  add("remove", "remove your own model and use the shipped one again", remove)
      .add_option("NAME", options->file, "name as `models list` shows it")
      .required();
}

}  // namespace tarsier::cli
