// SPDX-License-Identifier: MIT
#pragma once

#include "tarsier/core/debug_sink.h"
#include "tarsier/core/option_fields.h"
#include "tarsier/core/progress.h"
#include "tarsier/sfm/dense/depth_filter.h"
#include "tarsier/sfm/dense/fusion.h"
#include "tarsier/sfm/dense/patch_match.h"
#include "tarsier/sfm/dense/view_selection.h"
#include "tarsier/sfm/scene/model.h"

#include <cstdint>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <stop_token>
#include <string>
#include <string_view>
#include <vector>

namespace tarsier::sfm {

enum class DenseQuality {
  kDraft,   // a quarter of the image's size, without geometric rounds
  kNormal,  // half the size, depths of images compared with each other
  kHigh,    // full size, eight sources, two geometric rounds
};
[[nodiscard]] std::optional<DenseQuality> dense_quality_named(std::string_view name);

struct DenseOptions {
  double reduce = 2;     // factor by which images are reduced
  int min_side = 640;    // px; the longer side is not reduced below this
  double min_depth = 0;  // world units, z; 0: from the points that the image shows
  double max_depth = 0;
  double memory_gb = 2;  // images are reduced further where they would need more
  std::uint64_t seed = 1;
  ViewSelectionOptions views;
  PatchMatchOptions matching;
  DepthFilterOptions filter;
  FusionOptions fusion;

  [[nodiscard]] OptionFields fields() {
    return {{"reduce", reduce, range(1, 64)},
            {"min_side", min_side, range(64, 32766)},
            {"min_depth", min_depth, at_least(0), "--min-depth",
             "minimum depth, world units; 0: from the points"},
            {"max_depth", max_depth, at_least(0), "--max-depth",
             "maximum depth, world units; 0: from the points"},
            {"memory_gb", memory_gb, range(0.25, 1024)}};
  }
  void check() const;  // throws std::invalid_argument, which names the value
};
[[nodiscard]] DenseOptions dense_options(DenseQuality quality);

// The result for an image.
struct DenseImage {
  std::string name;
  std::vector<std::string> sources;  // images that it was compared with
  cv::Size size;                     // px, of its maps
  double known = 0;                  // share of pixels with a final depth
  double median_cost = 0;            // median matching cost of these
  // Of the model's points in this image: the share that has a depth, and of these the share whose
  // depth is within 0.3 % of the point's.
  double sparse_known = 0;
  double sparse_within = 0;
  std::int64_t points = 0;  // points of the cloud that started in this image
  double cpu_seconds = 0;   // of all threads, in the run that made its maps
  bool is_reused = false;   // its maps are from an earlier run
  std::string reason;       // why it has no depths, or ""
};

struct DenseResult {
  std::vector<DenseImage> images;  // registered images, in the model's order
  std::int64_t points = 0;         // points of the cloud
  std::string cloud;               // path of fused.ply
  double cpu_seconds = 0;          // of this run, over all threads
};
// The content of dense.json: "images" (name, sources, width, height, known, median_cost,
// sparse_known, sparse_within, points, cpu_seconds, reason), "points", "cpu_seconds".
[[nodiscard]] nlohmann::ordered_json to_json(const DenseResult& result);
// A readable summary: a few lines, and each image without depths with the reason.
[[nodiscard]] std::string summary_text(const DenseResult& result);

// A reconstruction with cameras and points, and its images.
struct DenseJob {
  Model model;
  std::function<std::string(const std::string& name)> path_of;  // returns the file of an image
  std::string folder;                                           // of the workspace (workspace.h)
};

// Makes depth maps and a point cloud from a reconstruction:
//
//   sfm::DenseJob job;
//   job.model = sfm::read_colmap("model");
//   job.path_of = [](const std::string& name) { return "photos/" + name; };
//   job.folder = "dense";
//   NoProgress progress;
//   const auto result = sfm::DenseReconstructor({}).run(job, progress, {});
//   fmt::print("{} points in {}\n", result.points, result.cloud);
//
// The folder becomes a workspace (workspace.h) with fused.ply, dense.json and, for COLMAP,
// stereo/patch-match.cfg and fusion.cfg. Images that an earlier run finished with the same images,
// cameras and options are not processed again, so an interrupted run can be resumed.
//
// The class is const: several threads may share an object, each with a folder of its own. The
// result depends on job, options and seed, not on the number of threads.
class DenseReconstructor {
 public:
  explicit DenseReconstructor(const DenseOptions& options);  // throws std::invalid_argument
  [[nodiscard]] const DenseOptions& options() const { return options_; }

  // `debug` may be null. For each image it receives the depths ("NAME depth"), normals, costs and
  // the filtered depths. Throws InputError for an image that is missing or differs in size from its
  // camera, and where no image can be compared with another or the coordinates are too large
  // (check_coordinates()); OutputError; Interrupted;
  // std::invalid_argument for a model with numbers that are not finite.
  [[nodiscard]] DenseResult run(const DenseJob& job, Progress& progress,
                                const std::stop_token& stop, DebugSink* debug = nullptr) const;

 private:
  DenseOptions options_;
};

}  // namespace tarsier::sfm
