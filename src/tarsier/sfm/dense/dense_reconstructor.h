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
  kDraft,   // a quarter of the image's size, no second look
  kNormal,  // half the size, depths of images compared with each other
  kHigh,    // the whole size, eight sources, two such looks
};
[[nodiscard]] std::optional<DenseQuality> dense_quality_named(std::string_view name);

struct DenseOptions {
  double reduce = 2;     // how many times smaller images are looked at
  int min_side = 640;    // px; the larger side is not made smaller than this
  double min_depth = 0;  // world units, z; 0: from the points that the image shows
  double max_depth = 0;
  double memory_gb = 2;  // images are made smaller where they would need more
  std::uint64_t seed = 1;
  ViewSelectionOptions views;
  PatchMatchOptions matching;
  DepthFilterOptions filter;
  FusionOptions fusion;

  [[nodiscard]] OptionFields fields() {
    return {{"reduce", reduce, range(1, 64)},
            {"min_side", min_side, range(64, 32766)},
            {"min_depth", min_depth, at_least(0), "--min-depth", "world units; 0: from the points"},
            {"max_depth", max_depth, at_least(0), "--max-depth", "world units; 0: from the points"},
            {"memory_gb", memory_gb, range(0.25, 1024)}};
  }
  void check() const;  // throws std::invalid_argument that names the value
};
[[nodiscard]] DenseOptions dense_options(DenseQuality quality);

// What became of an image.
struct DenseImage {
  std::string name;
  std::vector<std::string> sources;  // images that it was compared with
  cv::Size size;                     // px, of its maps
  double known = 0;                  // share of pixels that have a depth in the end
  double median_cost = 0;            // of these
  // Of the model's points in this image: the share that has a depth, and of these the share whose
  // depth is that of the point to 0.3 %.
  double sparse_known = 0;
  double sparse_within = 0;
  std::int64_t points = 0;      // of the cloud, which it began
  double cpu_seconds = 0;       // of all threads, of the run that made its maps
  bool is_from_before = false;  // its maps are those of an earlier run
  std::string reason;           // why it has no depths, or ""
};

struct DenseResult {
  std::vector<DenseImage> images;  // registered ones, in the model's order
  std::int64_t points = 0;         // of the cloud
  std::string cloud;               // path of fused.ply
  double cpu_seconds = 0;          // of this run, of all threads
};
// dense.json: "images" (name, sources, width, height, known, median_cost, sparse_known,
// sparse_within, points, cpu_seconds, reason),
// "points", "cpu_seconds".
[[nodiscard]] nlohmann::ordered_json to_json(const DenseResult& result);
// The same for people, some lines; images without depths each with its reason.
[[nodiscard]] std::string summary_text(const DenseResult& result);

// A reconstruction whose cameras and points are known, and the images that it was made of.
struct DenseJob {
  Model model;
  std::function<std::string(const std::string& name)> path_of;  // the file of an image
  std::string folder;                                           // of the workspace (workspace.h)
};

// Makes depth maps and a cloud of a reconstruction:
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
// stereo/patch-match.cfg and fusion.cfg. Work on an image that an earlier run finished with the same
// images, cameras and options is not done again, so a run that was stopped goes on where it ended.
//
// Const: any number of threads may use it, each with a folder of its own. Same job, options and
// seed, same result, for any number of threads.
class DenseReconstructor {
 public:
  explicit DenseReconstructor(const DenseOptions& options);  // throws std::invalid_argument
  [[nodiscard]] const DenseOptions& options() const { return options_; }

  // `debug`, which may be null, takes of each image its depths ("NAME depth"), normals, costs and what
  // was kept of the depths. Throws InputError for an image that is missing or of another size than its
  // camera, and where no image can be compared with another; OutputError; Interrupted;
  // std::invalid_argument for a model with numbers that are not finite.
  [[nodiscard]] DenseResult run(const DenseJob& job, Progress& progress,
                                const std::stop_token& stop, DebugSink* debug = nullptr) const;

 private:
  DenseOptions options_;
};

}  // namespace tarsier::sfm
