// SPDX-License-Identifier: MIT
#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/frame_source.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/pipelines/inputs.h"
#include "tarsier/sfm/pipelines/reconstructor.h"
#include "tarsier/sfm/pipelines/report.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/ply.h"
#include "tarsier/sfm/view/render.h"

#include "verbs/sfm/dense.h"
#include "verbs/sfm/mesh.h"
#include "verbs/sfm/online.h"
#include "verbs/sfm/reconstruct_flags.h"
#include "verbs/sfm/sfm.h"
#include <algorithm>
#include <exception>
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

// The key frames of a camera, a video or images, whose growing model was shown meanwhile.
OnlineRun run_online(const ReconstructFlags& flags, const sfm::Reconstructor& reconstructor,
                     Context& context) {
  const auto is_image = [](const std::string& text) {
    const SourceKind kind = kind_of_online_source(text);
    return kind == SourceKind::kImage || kind == SourceKind::kFolder || kind == SourceKind::kGlob ||
           kind == SourceKind::kList;
  };
  std::vector<sfm::Input> images;
  if (std::all_of(flags.inputs.begin(), flags.inputs.end(), is_image)) {
    images = sfm::find_inputs(flags.inputs, {}, "", *context.progress, context.stop);
  } else if (flags.inputs.size() > 1) {
    throw UsageError("--online: give images, or one video or camera");
  }
  OnlineRun online = run_online(flags.inputs, images, reconstructor, flags.online, context);
  if (context.stop.stop_requested()) {
    log_info("computing the model of {} key frames; interrupt again to stop immediately",
             online.inputs.size());
    context.stop = {};
  }
  return online;
}

// Writes the growing model in COLMAP's text form for observers. The folder is removed at the end.
class GrowingFolder {
 public:
  explicit GrowingFolder(std::string folder) : folder_(std::move(folder)) {}
  ~GrowingFolder() {
    if (!written_) return;
    for (const char* name : {"cameras.txt", "images.txt", "points3D.txt"})
      fs::remove(fs::path(folder_) / name, ignored_);
    fs::remove(folder_, ignored_);
  }
  GrowingFolder(const GrowingFolder&) = delete;
  GrowingFolder& operator=(const GrowingFolder&) = delete;
  // A full disk must not stop the mapping.
  void write(const sfm::Model& model) {
    try {
      make_folder(folder_);
      written_ = true;
      sfm::write_colmap(folder_, model);
    } catch (const OutputError& error) {
      if (!warned_) log_warning("cannot write the unfinished model: {}", error.what());
      warned_ = true;
    }
  }

 private:
  const std::string folder_;
  std::error_code ignored_;
  bool written_ = false;
  bool warned_ = false;
};

// Makes depth maps and a cloud of the largest model, in its subfolder dense/.
ExitStatus reconstruct_dense(const ReconstructFlags& flags, const sfm::Reconstructor& reconstructor,
                             const sfm::ReconstructorResult& result, Context& context) {
  const sfm::DenseReconstructor dense(options_of(flags.dense_flags, context));
  std::map<std::string, std::string> files;
  for (const sfm::ImageReport& image : result.pipeline.images) files[image.name] = image.path;
  sfm::DenseJob job;
  job.model = result.models().front();
  job.path_of = [files](const std::string& name) { return files.at(name); };
  job.folder = (fs::path(reconstructor.options().folder) / "dense").string();
  return run_dense(dense, job, context);
}

// Works on a folder that reconstruct_dense() filled.
ExitStatus reconstruct_mesh(const ReconstructFlags& flags, const sfm::Reconstructor& reconstructor,
                            Context& context) {
  const fs::path folder = reconstructor.options().folder;
  MeshFlags mesh;
  mesh.output = (folder / "mesh.glb").string();
  mesh.view = (folder / "mesh.png").string();
  mesh.page = (folder / "mesh.html").string();
  if (flags.options.turntable) mesh.turntable = (folder / "mesh.gif").string();
  mesh.memory = flags.dense_flags.memory;
  const sfm::Workspace workspace = sfm::Workspace::open((folder / "dense").string());
  return run_mesh(mesh, options_of(mesh), {workspace, workspace.sparse()}, context);
}

ExitStatus reconstruct(ReconstructFlags& flags, Context& context) {
  const sfm::Reconstructor reconstructor(options_of(flags, context));
  reconstructor.check_outputs();
  sfm::ReconstructorHooks hooks;
  if (!context.debug_dir.empty()) {
    make_folder(context.debug_dir);
    hooks.watch = [&](const std::string& label, const sfm::Model& model) {
      const std::string path = (fs::path(context.debug_dir) / label).string();
      sfm::write_points_ply(path + ".ply", model);
      write_image(path + ".png", sfm::render_model(model, {}));
    };
  }
  GrowingFolder growing((fs::path(reconstructor.options().folder) / "growing").string());
  if (flags.growing) {
    hooks.show = [&](const sfm::Model& model) { growing.write(model); };
  }
  hooks.on_models = [&](const sfm::ReconstructorResult& result) {
    print_models(result, reconstructor.options().folder, context);
  };

  OnlineRun online;
  sfm::ReconstructorResult result;
  if (flags.online.online) {
    online = run_online(flags, reconstructor, context);
    sfm::require_two_images(online.inputs, flags.inputs.front());
    result = reconstructor.run_images(online.inputs, *context.progress, context.stop, hooks);
  } else if (flags.inputs.empty()) {
    const std::vector<sfm::Input> inputs =
        sfm::inputs_of_database(reconstructor.pipeline().database);
    result = reconstructor.run_images(inputs, *context.progress, context.stop, hooks);
  } else {
    expect_files(flags.inputs);
    result = reconstructor.run(flags.inputs, *context.progress, context.stop, hooks);
  }
  const ExitStatus status = status_of(result);
  if (status == ExitStatus::kInterrupted) return status;
  if (online.error) std::rethrow_exception(online.error);
  if (online.status != ExitStatus::kDone) return online.status;
  if (status != ExitStatus::kDone) return status;
  if (!flags.dense && !flags.mesh) return ExitStatus::kDone;
  const ExitStatus dense = reconstruct_dense(flags, reconstructor, result, context);
  if (!flags.mesh || dense != ExitStatus::kDone) return dense;
  return reconstruct_mesh(flags, reconstructor, context);
}

}  // namespace

void expect_files(const std::vector<std::string>& inputs) {
  for (const std::string& text : inputs) {
    const SourceKind kind = classify_source(text);
    if (kind != SourceKind::kFolder && kind != SourceKind::kGlob && kind != SourceKind::kList &&
        kind != SourceKind::kImage && kind != SourceKind::kVideo) {
      throw InputError(text,
                       "expected images, a folder, @list.txt or a video; a camera with --online");
    }
  }
}

void print_models(const sfm::ReconstructorResult& result, const std::string& folder,
                  const Context& context) {
  if (context.json)
    print_json(sfm::to_json(result));
  else
    print_text(sfm::summary_text(result.pipeline));
  if (!result.models().empty() && result.placement_error.empty())
    log_info("{}: model written; open view.html to see it", folder);
}

ExitStatus status_of(const sfm::ReconstructorResult& result) {
  if (!result.placement_error.empty()) throw Error(ErrorKind::kInput, result.placement_error);
  if (result.interrupted()) return ExitStatus::kInterrupted;
  return result.models().empty() ? ExitStatus::kNothingFound : ExitStatus::kDone;
}

void add_sfm_reconstruct(Command& sfm, Context& context) {
  add_debug_flag(
      add_verb<ReconstructFlags>(sfm, "reconstruct", "reconstruct cameras and points from images",
                                 context, add_reconstruct_flags, reconstruct),
      context);
}

}  // namespace tarsier::cli
