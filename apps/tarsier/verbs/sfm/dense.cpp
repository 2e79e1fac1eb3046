// SPDX-License-Identifier: MIT
#include "verbs/sfm/dense.h"

#include "tarsier/core/errors.h"
#include "tarsier/core/log.h"
#include "tarsier/media/atomic_file.h"
#include "tarsier/media/image_file.h"
#include "tarsier/sfm/dense/dense_reconstructor.h"
#include "tarsier/sfm/pipelines/results.h"
#include "tarsier/sfm/scene/colmap.h"
#include "tarsier/sfm/scene/colmap_binary.h"
#include "tarsier/sfm/surface/surface_page.h"
#include "tarsier/sfm/view/render.h"

#include <fmt/format.h>

#include "framework/bind.h"
#include "verbs/sfm/memory_flag.h"
#include "verbs/sfm/sfm.h"
#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

namespace tarsier::cli {
namespace {

namespace fs = std::filesystem;

// --debug-dir: writes a PNG file for each stage of each image.
class StageFolder final : public DebugSink {
 public:
  explicit StageFolder(std::string folder) : folder_(std::move(folder)) {
    if (!folder_.empty()) make_folder(folder_);
  }
  void image(std::string_view name, const cv::Mat& image) override {
    std::string file(name);
    std::replace(file.begin(), file.end(), ' ', '-');
    std::replace(file.begin(), file.end(), '/', '_');  // an image in a subfolder
    write_image((fs::path(folder_) / (file + ".png")).string(), image);
  }
  [[nodiscard]] bool is_watched() const override { return !folder_.empty(); }

 private:
  std::string folder_;
};

struct DenseVerbFlags {
  std::string model;
  std::string output;
  std::string images;
  DenseFlags dense;
};

// Writes view.png, the cloud seen from the cameras (a large cloud is thinned), and view.html, the
// page.
void write_views(const sfm::DenseJob& job, const sfm::DenseResult& result) {
  constexpr std::size_t kMaxPoints = 1'500'000;
  const std::vector<sfm::CloudPoint> cloud = sfm::read_cloud(result.cloud);
  const std::size_t step = cloud.size() / kMaxPoints + 1;
  sfm::Model model;
  model.cameras = job.model.cameras;
  for (const sfm::Image& image : job.model.images) {
    if (!image.registered) continue;
    model.images.emplace_back();
    model.images.back().camera = image.camera;
    model.images.back().registered = true;
    model.images.back().pose = image.pose;
  }
  for (std::size_t i = 0; i < cloud.size(); i += step) {
    sfm::Point point;
    point.position = {cloud[i].position[0], cloud[i].position[1], cloud[i].position[2]};
    point.color = cloud[i].color;
    model.points.push_back(point);
  }
  write_image((fs::path(job.folder) / "view.png").string(), sfm::render_model(model, {}));
  write_file_atomically(
      (fs::path(job.folder) / "view.html").string(),
      sfm::viewer_html(job.model, "Dense reconstruction", {sfm::viewer_cloud(result.cloud), {}}));
}

bool has_model(const std::string& folder) {
  std::error_code ignored;
  return fs::exists(fs::path(folder) / "cameras.txt", ignored) || sfm::is_colmap_binary(folder);
}

ExitStatus make_dense(const DenseVerbFlags& flags, Context& context) {
  const sfm::DenseReconstructor reconstructor(options_of(flags.dense, context));
  std::string folder = flags.model;
  std::error_code ignored;
  // Also accepts what --export undistorted and COLMAP's image_undistorter write.
  const std::string sparse = (fs::path(folder) / "sparse").string();
  if (!has_model(folder) && has_model(sparse)) folder = sparse;
  if (fs::is_directory(folder, ignored) && !has_model(folder)) {
    throw InputError(
        flags.model,
        "is not a model: give a folder made by `tarsier sfm reconstruct`, or COLMAP's");
  }
  sfm::DenseJob job;
  job.model = sfm::read_colmap(folder);
  std::vector<std::string> names;
  for (const sfm::Image& image : job.model.images) names.push_back(image.name);
  const auto files = sfm::image_files(flags.model, flags.images, names, !is_in_studio());
  job.path_of = [files](const std::string& name) { return files.at(name); };
  job.folder = flags.output;
  if (fs::weakly_canonical(flags.output, ignored) == fs::weakly_canonical(flags.model, ignored))
    throw UsageError("-o: expected a folder that is not the model folder");
  return run_dense(reconstructor, job, context);
}

void add_flags(Command& verb, DenseVerbFlags& flags) {
  verb.add_option("MODEL", flags.model,
                  "model folder of `sfm reconstruct`, or COLMAP's text or binary files")
      .required()
      .type_name("");
  verb.add_option("-o,--output", flags.output, "output folder for depth maps and cloud").required();
  verb.add_option("--images", flags.images, "folder of the model's images [as report.json says]");
  verb.add_option("--quality", flags.dense.quality,
                  "draft: a quarter of the image size; normal: half; high: full")
      .check(one_of({"draft", "normal", "high"}))
      .show_default();
  verb.add_option("--memory", flags.dense.memory, "memory limit; images are reduced to stay below")
      .show_default();
  verb.add_option("--views", flags.dense.views,
                  "number of source images for each depth map [as --quality says]")
      .check(range(1, 16));
  bind_field(verb, flags.dense.options, flags.dense.options.min_depth);
  bind_field(verb, flags.dense.options, flags.dense.options.max_depth);
  bind_all(verb, flags.dense.options.filter, "Filters for depths and points");
  bind_all(verb, flags.dense.options.fusion, "Filters for depths and points");
}

}  // namespace

sfm::DenseOptions options_of(const DenseFlags& flags, const Context& context) {
  sfm::DenseOptions options = sfm::dense_options(sfm::dense_quality_named(flags.quality).value());
  options.min_depth = flags.options.min_depth;
  options.max_depth = flags.options.max_depth;
  options.filter = flags.options.filter;
  options.fusion = flags.options.fusion;
  options.memory_gb = parse_memory(flags.memory);
  if (flags.views) options.views.views = *flags.views;
  if (options.min_depth > 0 && options.max_depth > 0 && options.min_depth >= options.max_depth)
    throw UsageError("--min-depth: expected less than --max-depth");
  options.seed = context.seed;
  return options;
}

ExitStatus run_dense(const sfm::DenseReconstructor& reconstructor, const sfm::DenseJob& job,
                     Context& context) {
  StageFolder debug(context.debug_dir);
  const sfm::DenseResult result = reconstructor.run(job, *context.progress, context.stop, &debug);
  if (context.json)
    print_json(sfm::to_json(result));
  else
    print_text(sfm::summary_text(result));
  if (result.points > 0) write_views(job, result);
  if (result.points == 0) {
    log_warning(
        "{}: no depths are consistent between images, and the cloud is empty: change --min-views, "
        "--min-depth or --max-depth",
        result.cloud);
    return ExitStatus::kNothingFound;
  }
  log_info("{}: dense cloud written; open view.html to see it", result.cloud);
  return ExitStatus::kDone;
}

void add_sfm_dense(Command& sfm, Context& context) {
  add_debug_flag(
      add_verb<DenseVerbFlags>(sfm, "dense", "compute depth maps and a dense cloud of a model",
                               context, add_flags, make_dense),
      context);
}

}  // namespace tarsier::cli
